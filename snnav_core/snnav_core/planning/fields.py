"""The vector fields that move the points of a path, for the plane and for space alike.

F_I keeps the points at equal distance, F_P pulls the last one to the target (Ch. 3). F_R (margin to the boundary),
F_C (initial circles) and the other robots are one-sided: each is a `Barrier` that says how deep a point violates it
and in which direction it leaves. The adjustment loop uses a barrier either exactly (projection, deviation C0-5) or as
the spring that is printed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from snnav_core.types import FloatArray

__all__ = [
    "Barrier",
    "BoundaryBarrier",
    "CircleBarrier",
    "DiskBarrier",
    "DistanceField",
    "interval_field",
    "pull_field",
]

_TINY = 1e-12


def interval_field(points: FloatArray, rest_length: float, gain: float) -> FloatArray:
    """F_I at the points 1..n: springs between neighbours (Ch. 3, definition of F_I).

    Parameters
    ----------
    points : ndarray, shape (n + 1, D)
        p_0 .. p_n [m].
    rest_length : float
        Length of a link without tension [m]. Deviation C0-3: L - G_P / G_I instead of L, so that the links are L long
        under the constant pull.
    gain : float
        G_I.

    Returns
    -------
    ndarray, shape (n, D)
    """
    links = points[:-1] - points[1:]
    length = np.sqrt(np.einsum("ij,ij->i", links, links))
    tension: FloatArray = links * (gain * (1.0 - rest_length / np.maximum(length, _TINY)))[:, None]
    tension[:-1] -= tension[1:]
    return tension


def pull_field(last: FloatArray, target: FloatArray, gain: float) -> FloatArray:
    """F_P at the last point: constant pull of `gain` [m] towards the target (Ch. 3, definition of F_P)."""
    direction = target - last
    length = float(np.sqrt(direction @ direction))
    return direction * (gain / max(length, _TINY))


class Barrier(Protocol):
    """A one-sided condition on the points p_1..p_n."""

    def violation(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """By how much points violate the condition, and the way out.

        Parameters
        ----------
        points : ndarray, shape (n, D)
            p_1 .. p_n [m].

        Returns
        -------
        depth : ndarray, shape (n,)
            Depth of the violation [m], <= 0 where the condition holds.
        outward : ndarray, shape (n, D)
            Unit vector along which the depth falls.
        """
        ...

    def reset(self) -> None:
        """Forget what was cached about earlier points: their number or order has changed."""
        ...


class DistanceField(Protocol):
    """Signed distance to the boundary of an area."""

    def query(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the signed distance (m,) [m] of points (m, D) [m] and its gradient (m, D)."""
        ...


class BoundaryBarrier:
    """F_R: point k keeps `margins[k - 1]` from the boundary of the unoccupied area.

    Parameters
    ----------
    field : DistanceField
    margins : ndarray, shape (K,)
        Demanded distance of p_1, p_2, ... [m]; the last one holds for all points beyond.

    Notes
    -----
    Distance changes at most by as much as a point moves; a point is looked up again only when it has moved by what it
    had in reserve.
    """

    def __init__(self, field: DistanceField, margins: FloatArray) -> None:
        self.field = field
        self.margins = margins
        self._asked: FloatArray | None = None
        self._distance: FloatArray = np.empty(0)
        self._gradient: FloatArray = np.empty((0, 2))

    def reset(self) -> None:
        """Forget the distances of earlier points."""
        self._asked = None

    def demanded(self, count: int) -> FloatArray:
        """Demanded distances of p_1..p_count [m], shape (count,)."""
        if count <= len(self.margins):
            return self.margins[:count]
        return np.concatenate((self.margins, np.full(count - len(self.margins), self.margins[-1])))

    def violation(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Barrier.violation`."""
        demanded = self.demanded(len(points))
        if self._asked is None or len(self._asked) != len(points):
            self._distance, self._gradient = self.field.query(points)
            self._asked = points.copy()
        else:
            moved = points - self._asked
            reserve = np.maximum(self._distance - demanded, 0.0)
            stale = np.einsum("ij,ij->i", moved, moved) >= reserve * reserve
            if stale.any():
                where = np.flatnonzero(stale)
                self._distance[where], self._gradient[where] = self.field.query(points[where])
                self._asked[where] = points[where]
        depth = demanded - self._distance
        return depth, self._gradient


@dataclass(frozen=True)
class CircleBarrier:
    """F_C: the first points stay out of an initial circle (Ch. 3, definition of F_C).

    Deviation C3-16: only the first `count` points, and the radius is a little above R_min.
    """

    centre: FloatArray
    radius: float
    count: int

    def disks(self) -> tuple[FloatArray, FloatArray]:
        """Centres (K, 2) and distances (K,) of p_1, p_2, ... [m], the last for all beyond."""
        return np.tile(self.centre, (self.count + 1, 1)), np.append(np.full(self.count, self.radius), -np.inf)

    def reset(self) -> None:
        """Nothing is cached."""

    def violation(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Barrier.violation`."""
        depth = np.full(len(points), -np.inf)
        gradient = np.zeros_like(points)
        offset = points[: self.count] - self.centre
        distance = np.sqrt(np.einsum("ij,ij->i", offset, offset))
        depth[: self.count] = self.radius - distance
        gradient[: self.count] = offset / np.maximum(distance, _TINY)[:, None]
        return depth, gradient


@dataclass(frozen=True)
class DiskBarrier:
    """Another robot as a moving disk: point k keeps away from where that robot is at the same time (C4-9, C4-10).

    Parameters
    ----------
    centres : ndarray, shape (K, D)
        Position of the other robot at the times of p_1, p_2, ... [m]; it stays at the last one.
    distances : ndarray, shape (K,)
        Distance that the centres keep at these times [m].
    """

    centres: FloatArray
    distances: FloatArray

    def disks(self) -> tuple[FloatArray, FloatArray]:
        """Centres (K, 2) and distances (K,) of p_1, p_2, ... [m], the last for all beyond."""
        return self.centres, self.distances

    def reset(self) -> None:
        """Nothing is cached."""

    def violation(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Barrier.violation`."""
        index = np.minimum(np.arange(len(points)), len(self.centres) - 1)
        offset = points - self.centres[index]
        distance = np.sqrt(np.einsum("ij,ij->i", offset, offset))
        gradient = offset / np.maximum(distance, _TINY)[:, None]
        return self.distances[index] - distance, gradient
