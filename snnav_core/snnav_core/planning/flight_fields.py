"""What keeps the points of a path in space in the free region, and out of the initial torus (Ch. 4, F_R and F_C)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from snnav_core.area.spatial import SpatialArea
from snnav_core.types import FloatArray

__all__ = ["FLAT", "RegionBarrier", "TorusBarrier"]

FLAT = 1e-6
"""Where the clearance rises by less than this per metre, inside bodies, it shows no way out: the rest is rounding."""

_TINY = 1e-12


@dataclass(frozen=True)
class RegionBarrier:
    """F_R: the points keep a distance from the boundary, which may come nearer over the window.

    Parameters
    ----------
    area : SpatialArea
    distance : float
        Demanded of every point [m].
    growth : ndarray, shape (K,)
        How far what may move can have come nearer at p_1, p_2, ... [m]; the last one holds for all beyond.
    """

    area: SpatialArea
    distance: float
    growth: FloatArray

    def reset(self) -> None:
        """Nothing is cached."""

    def violation(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `snnav_core.planning.fields.Barrier.violation`."""
        index = np.minimum(np.arange(len(points)), len(self.growth) - 1)
        clearance, gradient = self.area.smooth_at(points, self.growth[index])
        size = np.linalg.norm(gradient, axis=1)
        return self.distance - clearance, gradient / np.maximum(size, FLAT)[:, None]


@dataclass(frozen=True)
class TorusBarrier:
    """F_C: the first points stay out of the initial torus (Ch. 4, definition of F_C).

    Parameters
    ----------
    centre : ndarray, shape (3,)
        The robot [m, map].
    axis : ndarray, shape (3,)
        Its direction of flight, a unit vector.
    radius : float
        Of the circle B, and of the tube around it [m]: the torus has no hole (C4-12).
    count : int
        So many points are kept out (C3-16).
    """

    centre: FloatArray
    axis: FloatArray
    radius: float
    count: int

    def reset(self) -> None:
        """Nothing is cached."""

    def violation(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `snnav_core.planning.fields.Barrier.violation`."""
        depth = np.full(len(points), -np.inf)
        gradient = np.zeros_like(points)
        offset = points[: self.count] - self.centre
        along = offset @ self.axis
        aside = offset - along[:, None] * self.axis
        width = np.linalg.norm(aside, axis=1)
        outward = aside / np.maximum(width, _TINY)[:, None]
        # From the nearest point of the circle to the point.
        leave = (width - self.radius)[:, None] * outward + along[:, None] * self.axis
        distance = np.linalg.norm(leave, axis=1)
        depth[: self.count] = np.where(width > _TINY, self.radius - distance, -np.inf)
        gradient[: self.count] = leave / np.maximum(distance, _TINY)[:, None]
        return depth, gradient
