"""The exact region that a range finder can see among polygons, by an angular sweep over all corners."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
import shapely
from numpy.typing import NDArray

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from snnav_core.types import FloatArray

__all__ = ["ring_segments", "visible_region"]

_TURN = 2.0 * math.pi
_ARC_STEP = math.radians(0.25)  # the arc at the range limit is a chain of chords inside it
_ON_SEGMENT = 1e-9  # [m]; a device mounted on a wall


def ring_segments(region: BaseGeometry) -> FloatArray:
    """Return the boundary of a region as segments with the region on their left, shape (S, 4) [m, map]."""
    parts: list[FloatArray] = [np.zeros((0, 4))]
    for polygon in shapely.get_parts(shapely.orient_polygons(region)):
        for ring in shapely.get_rings(polygon):
            points = shapely.get_coordinates(ring)
            parts.append(np.hstack((points[:-1], points[1:])))
    return np.concatenate(parts)


def visible_region(
    origin: tuple[float, float], first: float, field_of_view: float, range_max: float, segments: FloatArray
) -> BaseGeometry:
    """Return what is seen from a point.

    Parameters
    ----------
    origin : pair of float
        Position of the device [m, map], inside the region or on its boundary.
    first : float
        Direction of the first beam [rad, map].
    field_of_view : float
        Counter-clockwise from the first direction, at most 2 pi [rad].
    range_max : float
        Nothing is seen beyond it [m].
    segments : ndarray, shape (S, 4)
        Boundary of the free region, free space on the left, segments meeting at ends only [m, map].

    Returns
    -------
    shapely geometry
        The exact visibility region; arcs at `range_max` are replaced by chords inside them.

    Notes
    -----
    Between two neighbouring bearings of corners one segment is the nearest throughout, so two points on it
    describe the boundary there. Independent of the beams of `snnav_sim.raycast`.
    """
    a = segments[:, :2] - np.asarray(origin)
    b = segments[:, 2:] - np.asarray(origin)
    a, b = _in_question(a, b, range_max)
    ends = np.concatenate((a, b))
    bearings = (np.arctan2(ends[:, 1], ends[:, 0]) - first) % _TURN
    inside = bearings[(bearings > 0.0) & (bearings < field_of_view)]
    cuts = np.unique(np.concatenate(([0.0], inside, [field_of_view])))
    points = _sweep(a, b, first, cuts, range_max)
    if field_of_view < _TURN - 1e-9:
        points = np.vstack((np.zeros((1, 2)), points))
    points = points[np.hypot(*(points - np.roll(points, 1, axis=0)).T) > _ON_SEGMENT]
    if len(points) < 3:
        return shapely.Polygon()
    polygon = shapely.Polygon(points + np.asarray(origin))
    return polygon if polygon.is_valid else polygon.buffer(0.0)


def _in_question(a: FloatArray, b: FloatArray, range_max: float) -> tuple[FloatArray, FloatArray]:
    """Return the segments (S, 2), (S, 2) from the origin that face it or point at it, within range."""
    edge = b - a
    length = np.hypot(edge[:, 0], edge[:, 1])
    facing = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] >= -_ON_SEGMENT * length
    share = np.clip(-np.sum(a * edge, axis=1) / np.maximum(length, 1e-300) ** 2, 0.0, 1.0)
    nearest = np.hypot(*(a + share[:, None] * edge).T)
    kept = facing & (nearest <= range_max * (1.0 + 1e-9))
    return a[kept], b[kept]


@numba.njit(cache=True, error_model="numpy")
def _nearest(a: NDArray[np.float64], b: NDArray[np.float64], dx: float, dy: float) -> tuple[int, float]:
    """Return the segment first met along a direction and the distance; -1 when none, or blocked at once."""
    best, nearest = np.inf, -1
    for index in range(a.shape[0]):
        ax, ay, bx, by = a[index, 0], a[index, 1], b[index, 0], b[index, 1]
        area = ax * by - ay * bx
        ex, ey = bx - ax, by - ay
        along = dx * ey - dy * ex
        length = math.sqrt(ex * ex + ey * ey)
        if abs(area) <= _ON_SEGMENT * length:
            if ax * bx + ay * by <= _ON_SEGMENT * length and along > 1e-9 * length:
                return -1, 0.0
            continue
        if area > 0.0 and ax * dy - ay * dx >= 0.0 and dx * by - dy * bx >= 0.0 and along > 0.0:
            distance = area / along
            if distance < best:
                best, nearest = distance, index
    return nearest, best


@numba.njit(cache=True, error_model="numpy")
def _sweep(
    a: NDArray[np.float64], b: NDArray[np.float64], first: float, cuts: NDArray[np.float64], range_max: float
) -> NDArray[np.float64]:
    """Return the outline relative to the origin, counter-clockwise, shape (N, 2)."""
    points = []
    for index in range(cuts.shape[0] - 1):
        low, high = cuts[index], cuts[index + 1]
        middle = first + (low + high) / 2.0
        nearest, distance = _nearest(a, b, math.cos(middle), math.sin(middle))
        if nearest < 0 and distance == 0.0:
            points.append((0.0, 0.0))
            continue
        left, right = low, high  # between them the boundary is the segment; beside them the arc
        normal, reach = 0.0, math.inf
        if nearest >= 0:
            ax, ay, bx, by = a[nearest, 0], a[nearest, 1], b[nearest, 0], b[nearest, 1]
            ex, ey = bx - ax, by - ay
            reach = (ax * by - ay * bx) / math.sqrt(ex * ex + ey * ey)
            normal = math.atan2(-ex, ey) - middle
            normal += middle - first - _TURN * round(normal / _TURN)
        if reach >= range_max * (1.0 - 1e-12):  # the arc touches the segment at most
            left = right = high
        elif math.isfinite(reach):
            half = math.acos(reach / range_max)
            left, right = max(low, normal - half), min(high, normal + half)
            if left >= right:
                left = right = high
        _arc(points, first, low, left, range_max)
        if left < right:
            for bearing in (left, right):
                length = min(range_max, reach / math.cos(bearing - normal))
                points.append((length * math.cos(first + bearing), length * math.sin(first + bearing)))
            _arc(points, first, right, high, range_max)
    out = np.empty((len(points), 2))
    for index in range(len(points)):
        out[index, 0], out[index, 1] = points[index]
    return out


@numba.njit(cache=True, error_model="numpy")
def _arc(points: Any, first: float, low: float, high: float, radius: float) -> None:
    """Append the points of an arc; nothing when it is empty."""
    if high <= low:
        return
    steps = int(math.ceil((high - low) / _ARC_STEP))
    for step in range(steps + 1):
        bearing = first + low + (high - low) * step / steps
        points.append((radius * math.cos(bearing), radius * math.sin(bearing)))
