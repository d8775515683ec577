"""Which straight edges in space keep a distance, all swept in one compiled pass (Ch. 4, A2, A4)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from snnav_core.area.spatial import SpatialArea, bound
from snnav_core.types import FloatArray

__all__ = ["NOBODY", "Spheres", "clear_edges", "outside"]

_SWEEP = 0.5  # edges are looked at every so many cells at least, where there is nothing to spare

Spheres = FloatArray
"""Places to stay out of: centres [m, map] and radii [m], shape (K, 4)."""

NOBODY: Spheres = np.empty((0, 4))


def outside(points: FloatArray, spheres: Spheres) -> NDArray[np.bool_]:
    """Whether points (N, 3) are in none of the spheres, shape (N,)."""
    away = np.linalg.norm(points[:, None] - spheres[None, :, :3], axis=2)
    return np.asarray((away > spheres[:, 3]).all(axis=1))


def clear_edges(
    area: SpatialArea,
    begins: FloatArray,
    ends: FloatArray,
    distance: float,
    growth: float,
    spheres: Spheres = NOBODY,
    growth_per_metre: FloatArray | None = None,
) -> NDArray[np.bool_]:
    """Return which edges keep a distance to the boundary and stay out of spheres.

    Parameters
    ----------
    area : SpatialArea
    begins, ends : ndarray, shape (E, 3)
        [m, map]
    distance : float
        [m]
    growth : float
        How far what may move may have come nearer [m].
    spheres : ndarray, shape (K, 4)
    growth_per_metre : ndarray, shape (E,), optional
        Where finite, the edge starts at a robot: what moves has come nearer by so much per metre of the edge only, the
        robot may stand nearer than the distance or in a sphere, and leave (C4-5).

    Returns
    -------
    ndarray of bool, shape (E,)

    Notes
    -----
    A robot that stands too near leaves at least as fast as it flies: half of what it goes is gained.
    """
    count = len(begins)
    per_metre = np.full(count, math.inf) if growth_per_metre is None else growth_per_metre
    return np.asarray(
        _clear(
            np.array(begins, dtype=np.float64, order="C"),
            np.array(ends, dtype=np.float64, order="C"),
            distance,
            growth,
            np.array(per_metre, dtype=np.float64, order="C"),
            np.array(spheres, dtype=np.float64, order="C"),
            (area.moving, area.static, area.grid.origin, area.grid.spacing),
        )
    )


@njit(cache=True, nogil=True)
def _clear(begins, ends, distance, growth, per_metre, spheres, field):  # type: ignore[no-untyped-def]
    moving, static, origin, spacing = field
    clear = np.ones(len(begins), dtype=np.bool_)
    place = np.empty(3)
    for edge in range(len(begins)):
        begin, end = begins[edge], ends[edge]
        length = np.sqrt(np.sum((end - begin) ** 2))
        leaving = per_metre[edge] < np.inf
        present = bound(begin, 0.0, moving, static, origin, spacing) if leaving else 0.0
        along = 0.0
        while True:
            share = along / length if length > 0.0 else 0.0
            for axis in range(3):
                place[axis] = begin[axis] + share * (end[axis] - begin[axis])
            demanded, grown = distance, growth
            if leaving:
                demanded = min(distance, present + 0.5 * along - 1e-3)
                grown = min(growth, per_metre[edge] * along)
            spare = bound(place, grown, moving, static, origin, spacing) - demanded
            for k in range(len(spheres)):
                gap = np.sqrt(np.sum((place - spheres[k, :3]) ** 2)) - spheres[k, 3]
                if gap > 0.0 or along > 0.0 or not leaving:
                    spare = min(spare, gap if gap > 0.0 else -1.0)
            if spare < 0.0:
                clear[edge] = False
                break
            if along >= length:
                break
            along = min(length, along + max(_SWEEP * spacing, 0.5 * spare))
    return clear
