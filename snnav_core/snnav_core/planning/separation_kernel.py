"""The distance between one moving robot and many others, compiled: exact for uniform motion between path points."""

from __future__ import annotations

import math

import numba
import numpy as np

__all__ = ["are_near", "outlook", "sample", "separate"]

_SAME_TIME = 1e-9  # of a step
_TOLERANCE = 1e-9  # [m]


@numba.njit(cache=True, nogil=True)
def separate(own, own_start, own_step, points, offsets, starts, steps, may_stop, radii, end, soon, margin):  # type: ignore[no-untyped-def]
    """Compare one path with those of others, see `separation.separation`.

    Parameters
    ----------
    own : ndarray, shape (N, 2)
        Points of the path [m], `own_step` [s] apart from `own_start` [s] on.
    points : ndarray, shape (M, 2)
        Those of other o are ``points[offsets[o] : offsets[o + 1]]``, `steps[o]` apart from `starts[o]` on.
    may_stop : ndarray of bool
        Whether other o may also stop before `soon` [s] at any point of its path.
    radii : ndarray
        [m]
    end, soon : float
        Times up to which to look [s].
    margin : float
        [m]

    Returns
    -------
    until, least, other, gap, limit
        Time up to which the margin holds [s] (inf: throughout), least distance to a disk [m], and of the first failure
        the other (-1 for none), its distance and what was demanded [m].
    """
    begin, count = own_start, len(radii)
    present, reach = outlook(points, offsets, starts, steps, begin, end)
    _, reach_soon = outlook(points, offsets, starts, steps, begin, soon)
    own_reach = _reach(own, own_start, own_step, begin, end)
    own_soon = _reach(own, own_start, own_step, begin, soon)
    gaps, bounds = np.empty(count), np.empty(count)
    for o in range(count):
        dx, dy = present[o, 0] - own[0, 0], present[o, 1] - own[0, 1]
        gaps[o] = math.sqrt(dx * dx + dy * dy)
        bounds[o] = gaps[o] - own_reach - reach[o] - radii[o]
    until, least, other, gap, fault_limit = math.inf, math.inf, -1, math.inf, 0.0
    for o in np.argsort(bounds, kind="mergesort"):
        # Robots that stand too near already may only part.
        limit = min(margin, gaps[o] - radii[o])
        if bounds[o] >= least and bounds[o] >= limit:
            continue
        way = points[offsets[o] : offsets[o + 1]]
        demanded = radii[o] + limit - _TOLERANCE
        nearest, fails, value = _approach(
            own, own_start, own_step, way, starts[o], steps[o], len(way) - 1.0, begin, end, demanded
        )
        least = min(least, nearest - radii[o])
        if may_stop[o] and gaps[o] - own_soon - reach_soon[o] - radii[o] < limit:
            first = max(int(math.floor((begin - starts[o]) / steps[o] + _SAME_TIME)) + 1, 1)
            last = min(int(math.ceil((soon - starts[o]) / steps[o] - _SAME_TIME)), len(way) - 1)
            for k in range(first - 1, last):
                # at once, or at its point k
                stop = max((begin - starts[o]) / steps[o], 0.0) if k < first else float(k)
                _, breaks, at = _approach(
                    own, own_start, own_step, way, starts[o], steps[o], stop, begin, soon, demanded
                )
                if breaks < fails:
                    fails, value = breaks, at
        if fails < until or (fails == until and fails < math.inf and o < other):
            until, other, gap, fault_limit = fails, o, value - radii[o], limit
    return until, least, other, gap, fault_limit


@numba.njit(cache=True, nogil=True)
def outlook(points, offsets, starts, steps, begin, end):  # type: ignore[no-untyped-def]
    """Where robots are at `begin` (O, 2) [m], and how far from there they come up to `end` (O,) [m]."""
    count = len(starts)
    present, reach = np.empty((count, 2)), np.empty(count)
    for o in range(count):
        way = points[offsets[o] : offsets[o + 1]]
        present[o, 0], present[o, 1] = _position(way, starts[o], steps[o], math.inf, begin)
        reach[o] = _reach(way, starts[o], steps[o], begin, end)
    return present, reach


@numba.njit(cache=True, nogil=True)
def sample(points, offsets, starts, steps, times):  # type: ignore[no-untyped-def]
    """Where robots are at times (K,) [s], shape (O, K, 2) [m]."""
    positions = np.empty((len(starts), len(times), 2))
    for o in range(len(starts)):
        way = points[offsets[o] : offsets[o + 1]]
        for k in range(len(times)):
            positions[o, k, 0], positions[o, k, 1] = _position(way, starts[o], steps[o], math.inf, times[k])
    return positions


@numba.njit(cache=True, nogil=True)
def are_near(places, limits, chain, link):  # type: ignore[no-untyped-def]
    """Whether each place (O, 2) has a point of a chain (N, 2) nearer than its limit (O,); links are at most `link`."""
    near = np.zeros(len(places), dtype=np.bool_)
    for o in range(len(places)):
        k = 0
        while k < len(chain):
            dx, dy = chain[k, 0] - places[o, 0], chain[k, 1] - places[o, 1]
            excess = math.sqrt(dx * dx + dy * dy) - limits[o]
            if excess <= 0.0:
                near[o] = True
                break
            k += max(1, int(excess / link))
    return near


@numba.njit(cache=True, nogil=True)
def _reach(way, start, step, begin, end):  # type: ignore[no-untyped-def]
    """Farthest distance from where a robot is at `begin` up to `end` [m]."""
    x, y = _position(way, start, step, math.inf, begin)
    ex, ey = _position(way, start, step, math.inf, end)
    farthest = (ex - x) * (ex - x) + (ey - y) * (ey - y)
    first = max(int(math.floor((begin - start) / step)) + 1, 0)
    last = min((end - start) / step, len(way) - 1.0)
    for k in range(first, int(math.floor(last)) + 1):
        dx, dy = way[k, 0] - x, way[k, 1] - y
        farthest = max(farthest, dx * dx + dy * dy)
    return math.sqrt(farthest)


@numba.njit(cache=True, nogil=True)
def _position(way, start, step, stop, time):  # type: ignore[no-untyped-def]
    """Where a robot is that follows a way up to its point number `stop` (a fraction counts) and stays there."""
    index = min(max((time - start) / step, 0.0), stop, len(way) - 1.0)
    k = int(index)
    if k + 1 >= len(way):
        return way[len(way) - 1, 0], way[len(way) - 1, 1]
    share = index - k
    x = way[k, 0] + share * (way[k + 1, 0] - way[k, 0])
    y = way[k, 1] + share * (way[k + 1, 1] - way[k, 1])
    return x, y


@numba.njit(cache=True, nogil=True)
def _next_knot(start, step, last, time):  # type: ignore[no-untyped-def]
    """Time after `time` at which a motion changes; it ends at its (perhaps fractional) point number `last`."""
    if last <= 0.0:
        return math.inf
    index = max(math.floor((time - start) / step + _SAME_TIME) + 1.0, 0.0)
    if start + index * step <= time + _SAME_TIME * step:
        index += 1.0  # this is a knot itself: times since 1970 are no finer than a quarter of a microsecond
    knot = start + min(index, last) * step
    return knot if knot > time + _SAME_TIME * step else math.inf


@numba.njit(cache=True, nogil=True)
def _approach(own, own_start, own_step, way, start, step, stop, begin, end, demanded):  # type: ignore[no-untyped-def]
    """Least distance of two robots [m], of which the second stays at its point number `stop`.

    And the start [s] of the first uniform motion in which it is below `demanded`, with the least distance in that.
    """
    least, fails, value = math.inf, math.inf, math.inf
    ax, ay = _position(own, own_start, own_step, math.inf, begin)
    bx, by = _position(way, start, step, stop, begin)
    rx, ry = ax - bx, ay - by
    time = begin
    while time < end:
        until = min(
            end,
            _next_knot(own_start, own_step, len(own) - 1.0, time),
            _next_knot(start, step, stop, time),
        )
        ax, ay = _position(own, own_start, own_step, math.inf, until)
        bx, by = _position(way, start, step, stop, until)
        cx, cy = ax - bx - rx, ay - by - ry
        square = cx * cx + cy * cy
        share = 0.0
        if square > 0.0:
            share = min(max(-(rx * cx + ry * cy) / square, 0.0), 1.0)
        dx, dy = rx + share * cx, ry + share * cy
        distance = math.sqrt(dx * dx + dy * dy)
        least = min(least, distance)
        if distance < demanded and fails == math.inf:
            fails, value = time, distance
        rx, ry, time = ax - bx, ay - by, until
    return least, fails, value
