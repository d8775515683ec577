"""One scan of a planar range finder against segments and circles, exact along every beam."""

from __future__ import annotations

import math
from functools import lru_cache
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
    ranges = np.empty(beams)
    cosines, sines = _fan(increment, beams)
    segments = np.ascontiguousarray(segments, dtype=np.float64)
    circles = np.ascontiguousarray(circles, dtype=np.float64)
    _cast(
        origin[0],
        origin[1],
        heading + angle_min,
        increment,
        cosines,
        sines,
        segments,
        circles,
        range_max,
        ranges,
    )
    return ranges


@lru_cache(maxsize=64)
def _fan(increment: float, beams: int) -> tuple[FloatArray, FloatArray]:
    """Return cosine and sine of the bearings 0, increment, ..., each shape (B,), read only."""
    bearings = increment * np.arange(beams)
    cosines, sines = np.cos(bearings), np.sin(bearings)
    cosines.setflags(write=False)
    sines.setflags(write=False)
    return cosines, sines


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
    fan_cosines: NDArray[np.float64],
    fan_sines: NDArray[np.float64],
    segments: NDArray[np.float64],
    circles: NDArray[np.float64],
    range_max: float,
    ranges: NDArray[np.float64],
) -> None:
    """Write the distance to the first hit of every beam into `ranges`."""
    beams = ranges.shape[0]
    cosines, sines = np.empty(beams), np.empty(beams)
    turn_cosine, turn_sine = math.cos(first), math.sin(first)
    for beam in range(beams):
        cosines[beam] = turn_cosine * fan_cosines[beam] - turn_sine * fan_sines[beam]
        sines[beam] = turn_sine * fan_cosines[beam] + turn_cosine * fan_sines[beam]
        ranges[beam] = np.inf
    _meet_segments(x, y, first, increment, cosines, sines, segments, ranges)
    _meet_circles(x, y, first, increment, cosines, sines, circles, ranges)
    for beam in range(beams):
        if ranges[beam] > range_max:
            ranges[beam] = np.inf


@numba.njit(cache=True, error_model="numpy")
def _meet_segments(
    x: float,
    y: float,
    first: float,
    increment: float,
    cosines: NDArray[np.float64],
    sines: NDArray[np.float64],
    segments: NDArray[np.float64],
    ranges: NDArray[np.float64],
) -> None:
    """Lower `ranges` to the hits of every segment that shows its free side."""
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


@numba.njit(cache=True, error_model="numpy")
def _meet_circles(
    x: float,
    y: float,
    first: float,
    increment: float,
    cosines: NDArray[np.float64],
    sines: NDArray[np.float64],
    circles: NDArray[np.float64],
    ranges: NDArray[np.float64],
) -> None:
    """Lower `ranges` to the hits of every disk; to 0 inside one."""
    beams = ranges.shape[0]
    interval = np.zeros(4, dtype=np.int64)
    for index in range(circles.shape[0]):
        cx, cy, radius = circles[index, 0] - x, circles[index, 1] - y, circles[index, 2]
        square = cx * cx + cy * cy
        if square <= radius * radius:
            ranges[:] = 0.0
            return
        half = math.asin(radius / math.sqrt(square))
        _mark(math.atan2(cy, cx) - half, 2.0 * half, first, increment, beams, interval)
        for part in range(0, 4, 2):
            for beam in range(interval[part], interval[part + 1]):
                ahead = cosines[beam] * cx + sines[beam] * cy
                aside = cosines[beam] * cy - sines[beam] * cx
                distance = ahead - math.sqrt(max(0.0, radius * radius - aside * aside))
                ranges[beam] = min(ranges[beam], distance)
