"""How near a path in space comes to other robots, exact in time: a part of the independent check."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from snnav_core.planning.certificate import CertificateSettings
from snnav_core.types import FloatArray, TimedPath

__all__ = ["OtherFlyer", "least_gap", "separation"]

_STOPS = 8  # so many places in an interval are looked at where another robot may stop


@dataclass(frozen=True)
class OtherFlyer:
    """Where another robot will be: it follows `path` and hovers at its end.

    One that `leaves` hovers now and has a target elsewhere: planning counts with it for the window only, else robots
    that want to each other's places would wait for each other. The certificate makes no difference.
    """

    id: str
    radius: float
    path: TimedPath
    leaves: bool = False


def least_gap(one: TimedPath, other: TimedPath, begin: float, end: float) -> tuple[float, float]:
    """Least distance of two robots that follow their paths between two times, exact.

    Parameters
    ----------
    one, other : TimedPath
        Held at both ends.
    begin, end : float
        [s]

    Returns
    -------
    gap, time : float
        [m] and when [s].
    """
    gap, time = _least_gap(*_line(one), *_line(other), begin, end)
    return float(gap), float(time)


def separation(
    path: TimedPath, others: Sequence[OtherFlyer], settings: CertificateSettings
) -> tuple[float, float, str]:
    """Until when the margin to other robots holds [s], the least distance to their spheres [m], what fails then."""
    start = path.start_time
    interval = settings.sampling_interval
    margin = settings.safety_margin + 2.0 * settings.tracking_tolerance
    until, least, fault = math.inf, math.inf, ""
    for other in others:
        gaps, times, present, at_stops, coarse = _gaps(
            *_line(path), *_line(other.path), start, interval, settings.time_window
        )
        limit = min(margin, present - other.radius)
        for count in range(settings.time_window):
            gap = float(gaps[count]) - other.radius
            least = min(least, gap)
            if count == 0 and at_stops - other.radius < min(margin, present - coarse - other.radius) - 1e-6:
                gap = min(gap, at_stops - other.radius)
            if gap < limit - 1e-6:
                if start + count * interval < until:
                    until = start + count * interval
                    fault = (
                        f"comes within {gap:.3f} m of robot {other.id} after {times[count] - start:.2f} s, "
                        f"margin {limit:.3f} m"
                    )
                break
    return until, least, fault


def _line(path: TimedPath) -> tuple[FloatArray, float, float]:
    return path.points, path.start_time, path.step


@njit(cache=True, nogil=True)
def _gaps(
    one: FloatArray,
    one_start: float,
    one_step: float,
    other: FloatArray,
    other_start: float,
    other_step: float,
    begin: float,
    interval: float,
    count: int,
) -> tuple[FloatArray, FloatArray, float, float, float]:  # pragma: no cover - compiled
    """Least distance in every interval and when, the present distance, and the least one should the other stop [m].

    That one is for a stop anywhere in the first interval, this robot goes on; it is too little by the last number at
    most.
    """
    gaps, times = np.empty(count), np.empty(count)
    for k in range(count):
        from_time, to_time = begin + k * interval, begin + (k + 1) * interval
        gaps[k], times[k] = _least_gap(
            one, one_start, one_step, other, other_start, other_step, from_time, to_time
        )
    mine, stops = np.empty((_STOPS + 1, 3)), np.empty((_STOPS + 1, 3))
    moved, half = 0.0, 0.0
    at_stops = np.inf
    for later in range(_STOPS + 1):
        time = begin + interval * later / _STOPS
        _place(one, one_start, one_step, time, mine[later])
        _place(other, other_start, other_step, time, stops[later])
        if later:
            moved = max(moved, 0.5 * np.sqrt(np.sum((mine[later] - mine[later - 1]) ** 2)))
            half = max(half, 0.5 * np.sqrt(np.sum((stops[later] - stops[later - 1]) ** 2)))
        for sooner in range(later + 1):
            at_stops = min(at_stops, np.sqrt(np.sum((mine[later] - stops[sooner]) ** 2)))
    present = np.sqrt(np.sum((mine[0] - stops[0]) ** 2))
    return gaps, times, present, at_stops - half - moved, half + moved


@njit(cache=True, nogil=True)
def _least_gap(
    one: FloatArray,
    one_start: float,
    one_step: float,
    other: FloatArray,
    other_start: float,
    other_step: float,
    begin: float,
    end: float,
) -> tuple[float, float]:  # pragma: no cover - compiled
    """Walk from knot to knot of either path: between them both go straight at constant speed."""
    here, there, apart, following = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    _place(one, one_start, one_step, begin, here)
    _place(other, other_start, other_step, begin, there)
    apart[:] = here - there
    least, when, time = np.sqrt(np.sum(apart**2)), begin, begin
    while time < end:
        after = min(
            end,
            _knot_after(len(one), one_start, one_step, time),
            _knot_after(len(other), other_start, other_step, time),
        )
        _place(one, one_start, one_step, after, here)
        _place(other, other_start, other_step, after, there)
        following[:] = here - there
        squared, along = 0.0, 0.0
        for axis in range(3):
            step = following[axis] - apart[axis]
            squared += step * step
            along -= apart[axis] * step
        share = min(max(along / max(squared, 1e-18), 0.0), 1.0)
        gap = 0.0
        for axis in range(3):
            gap += (apart[axis] + share * (following[axis] - apart[axis])) ** 2
        gap = np.sqrt(gap)
        if gap < least:
            least, when = gap, time + share * (after - time)
        apart[:] = following
        time = after
    return least, when


@njit(cache=True, nogil=True)
def _knot_after(count: int, start: float, step: float, time: float) -> float:  # pragma: no cover - compiled
    """Time of the next knot of a path after a time, inf when there is none."""
    index = max(int(np.floor((time - start) / step + 1e-9)) + 1, 0)
    if start + index * step <= time:
        index += 1  # this is a knot itself: times since 1970 are no finer than a quarter of a microsecond
    knot = start + index * step
    return knot if index < count and knot > time else np.inf


@njit(cache=True, nogil=True)
def _place(
    points: FloatArray, start: float, step: float, time: float, place: FloatArray
) -> None:  # pragma: no cover - compiled
    """Where a path is at a time, held at both ends."""
    index = min(max((time - start) / step, 0.0), len(points) - 1.0)
    low = min(int(index), max(len(points) - 2, 0))
    share = index - low
    high = min(low + 1, len(points) - 1)
    for axis in range(3):
        place[axis] = (1.0 - share) * points[low, axis] + share * points[high, axis]
