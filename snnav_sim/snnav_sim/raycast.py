"""One scan of a planar range finder against segments and circles, exact along every beam."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numba
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from snnav_core.types import FloatArray

__all__ = ["cast"]

_TURN = 2.0 * math.pi
_INDEX_SLACK = 1e-9  # beams; neighbouring segments share a corner, no beam may pass between them
_ON_SEGMENT = 1e-9  # [m]; a device mounted on a wall


def cast(
    origin: tuple[float, float],
    heading: float,
    angle_min: float,
    increment: float,
    beams: int,
    segments: FloatArray,
    circles: FloatArray,
    range_max: float,
) -> FloatArray:
    """Return the distance to the first hit along every beam.

    Parameters
    ----------
    origin : pair of float
        Position of the device [m, map].
    heading : float
        [rad, map]
    angle_min, increment : float
        Bearing of the first beam and positive step to the next [rad, sensor].
    beams : int
    segments : ndarray, shape (S, 4)
        x1, y1, x2, y2 [m, map], directed so that free space is on the left. Segments are seen from there only;
        closed outlines lose nothing by that, and a device can be mounted on a wall: beams into it return 0.
    circles : ndarray, shape (C, 3)
        x, y, radius [m, map] of solid disks.
    range_max : float
        Hits beyond it do not return [m].

    Returns
    -------
    ndarray, shape (B,)
        Distances [m]; infinity where nothing was hit; 0 everywhere for a device inside a disk.

    Notes
    -----
    For every segment only the beams inside the angle it subtends are computed: the cost is the number of
    (segment, covered beam) pairs plus one bearing per end.
    """
    ranges = np.full(beams, np.inf)
    angles = heading + angle_min + increment * np.arange(beams)
    _cast(
        origin[0],
        origin[1],
        heading + angle_min,
        increment,
        np.cos(angles),
        np.sin(angles),
        np.ascontiguousarray(segments, dtype=np.float64),
        np.ascontiguousarray(circles, dtype=np.float64),
        ranges,
    )
    ranges[ranges > range_max] = np.inf
    return ranges


@numba.njit(cache=True, error_model="numpy")
def _mark(
    start: float, span: float, first: float, increment: float, beams: int, out: NDArray[np.int64]
) -> None:
    """Write into `out` the (at most two) index intervals [out[0], out[1]), [out[2], out[3]) of an angle."""
    offset = (start - first) % _TURN
    low = offset / increment - _INDEX_SLACK
    high = (offset + span) / increment + _INDEX_SLACK
    turn = _TURN / increment
    out[0] = math.ceil(max(0.0, low))
    out[1] = min(beams, math.floor(high) + 1)
    out[2] = 0
    out[3] = min(beams, math.floor(high - turn) + 1)


@numba.njit(cache=True, error_model="numpy")
def _cast(
    x: float,
    y: float,
    first: float,
    increment: float,
    cosines: NDArray[np.float64],
    sines: NDArray[np.float64],
    segments: NDArray[np.float64],
    circles: NDArray[np.float64],
    ranges: NDArray[np.float64],
) -> None:
    """Lower `ranges` to the hits of every segment and circle."""
    beams = ranges.shape[0]
    interval = np.zeros(4, dtype=np.int64)
    for index in range(segments.shape[0]):
        ax, ay = segments[index, 0] - x, segments[index, 1] - y
        bx, by = segments[index, 2] - x, segments[index, 3] - y
        ex, ey = bx - ax, by - ay
        area = ax * by - ay * bx
        length = math.sqrt(ex * ex + ey * ey)
        if abs(area) <= _ON_SEGMENT * length:
            if ax * bx + ay * by <= _ON_SEGMENT * length:
                for beam in range(beams):
                    if ex * sines[beam] - ey * cosines[beam] < -1e-9 * length:
                        ranges[beam] = 0.0
            continue
        if area < 0.0:
            continue
        span = math.atan2(area, ax * bx + ay * by)
        _mark(math.atan2(ay, ax), span, first, increment, beams, interval)
        farthest = math.sqrt(max(ax * ax + ay * ay, bx * bx + by * by))
        for part in range(0, 4, 2):
            for beam in range(interval[part], interval[part + 1]):
                along = cosines[beam] * ey - sines[beam] * ex
                distance = area / along if along * farthest > area else farthest
                ranges[beam] = min(ranges[beam], distance)
    for index in range(circles.shape[0]):
        cx, cy, radius = circles[index, 0] - x, circles[index, 1] - y, circles[index, 2]
        square = cx * cx + cy * cy
        if square <= radius * radius:
            ranges[:] = 0.0
            continue
        half = math.asin(radius / math.sqrt(square))
        _mark(math.atan2(cy, cx) - half, 2.0 * half, first, increment, beams, interval)
        for part in range(0, 4, 2):
            for beam in range(interval[part], interval[part + 1]):
                ahead = cosines[beam] * cx + sines[beam] * cy
                aside = cosines[beam] * cy - sines[beam] * cx
                distance = ahead - math.sqrt(max(0.0, radius * radius - aside * aside))
                ranges[beam] = min(ranges[beam], distance)
