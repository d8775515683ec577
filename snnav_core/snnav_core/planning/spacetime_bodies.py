"""Distances to bodies in motion, compiled: point i of a path meets the bodies where they are at its time."""

from __future__ import annotations

import math

import numba
import numpy as np

from snnav_core.area.clearance import nearest_boundary

__all__ = [
    "STEEPEST",
    "border_distance",
    "circle_distance",
    "cuts",
    "demanded",
    "distance",
    "distances_over_time",
    "outline_distance",
    "touched",
]

_TINY = 1e-12
_SLOPE = 0.3  # of what is demanded, over the distance from start or target where that has to be less there
STEEPEST = 1.0 + _SLOPE
"""By so much the distance beyond what is demanded changes at most, per distance."""

_FAR = 1e9  # [m]


@numba.njit(cache=True, nogil=True)
def distance(world, body, k, x, y):  # type: ignore[no-untyped-def]
    """Signed distance [m] of (x, y) to a body at the time of point k, and its gradient; negative inside."""
    if body == len(world.shifts):
        return border_distance(world, x, y)
    return outline_distance(world.vertices, world.offsets, world.shifts, world.circles, body, k, x, y)


@numba.njit(cache=True, nogil=True)
def outline_distance(vertices, offsets, shifts, circles, body, k, x, y):  # type: ignore[no-untyped-def]
    """Signed distance to a body and its gradient. Few arguments: each array that is handed on costs time."""
    k = min(k, shifts.shape[1] - 1)
    x, y = x - shifts[body, k, 0], y - shifts[body, k, 1]
    first, last = offsets[body], offsets[body + 1]
    best, bx, by, inside = math.inf, 0.0, 0.0, False
    ax, ay = vertices[last - 1, 0], vertices[last - 1, 1]
    ex, ey = 1.0, 0.0
    for v in range(first, last):
        cx, cy = vertices[v, 0], vertices[v, 1]
        dx, dy = cx - ax, cy - ay
        square = dx * dx + dy * dy
        share = 0.0
        if square > 0.0:
            share = min(max(((x - ax) * dx + (y - ay) * dy) / square, 0.0), 1.0)
        qx, qy = x - ax - share * dx, y - ay - share * dy
        gap = qx * qx + qy * qy
        if gap < best:
            best, bx, by = gap, qx, qy
            ex, ey = dy, -dx  # outward for counter-clockwise outlines
        if (ay > y) != (cy > y) and x < ax + (y - ay) * dx / dy:
            inside = not inside
        ax, ay = cx, cy
    rho = math.sqrt(best)
    if rho > _TINY:
        sign = -1.0 if inside else 1.0
        return sign * rho - circles[body, 3], sign * bx / rho, sign * by / rho
    scale = max(math.sqrt(ex * ex + ey * ey), _TINY)
    return -circles[body, 3], ex / scale, ey / scale


@numba.njit(cache=True, nogil=True)
def border_distance(world, x, y):  # type: ignore[no-untyped-def]
    """Signed distance [m] of (x, y) to the border of the workspace, and its gradient; negative outside."""
    if len(world.border[0]) == 0:
        return _FAR, 1.0, 0.0
    return nearest_boundary(x, y, math.inf, *world.border)


@numba.njit(cache=True, nogil=True)
def demanded(kept, ends, body, x, y):  # type: ignore[no-untyped-def]
    """Distance [m] that a path keeps at (x, y): the planning distance, or what start or target allow near them."""
    least = kept[body, 0]
    for end in range(2):
        if kept[body, 1 + end] < least:
            dx, dy = x - ends[end, 0], y - ends[end, 1]
            least = min(least, kept[body, 1 + end] + _SLOPE * math.sqrt(dx * dx + dy * dy))
    return least


@numba.njit(cache=True, nogil=True)
def distances_over_time(world, earliest, latest):  # type: ignore[no-untyped-def]
    """Distance [m] of the start from every body at first, and of the target at the least up to `latest`."""
    count = len(world.shifts) + 1
    at_start, at_target = np.empty(count), np.full(count, math.inf)
    for body in range(count):
        at_start[body], _, _ = distance(world, body, 0, world.ends[0, 0], world.ends[0, 1])
        for k in range(earliest, latest):
            rho, _, _ = distance(world, body, k, world.ends[1, 0], world.ends[1, 1])
            at_target[body] = min(at_target[body], rho)
    return at_start, at_target


@numba.njit(cache=True, nogil=True)
def circle_distance(shifts, circles, body, k, x, y):  # type: ignore[no-untyped-def]
    """Lower bound of the distance to a body [m], by the circle around it."""
    k = min(k, shifts.shape[1] - 1)
    dx, dy = x - shifts[body, k, 0] - circles[body, 0], y - shifts[body, k, 1] - circles[body, 1]
    return math.sqrt(dx * dx + dy * dy) - circles[body, 2]


@numba.njit(cache=True, nogil=True)
def cuts(world, body, k, from_x, from_y, to_x, to_y, share):  # type: ignore[no-untyped-def]
    """Whether the segment comes nearer to a body, as it is at the time of point k, than demanded less a share of it.

    Walks along the segment, each time as far as the distance allows.
    """
    dx, dy = to_x - from_x, to_y - from_y
    length = math.sqrt(dx * dx + dy * dy)
    if length < _TINY:
        return False
    dx, dy = dx / length, dy / length
    allowed = share * world.kept[body, 0]
    least, along = 0.05 * allowed, 0.0
    while along < length:
        x, y = from_x + along * dx, from_y + along * dy
        rho, _, _ = distance(world, body, k, x, y)
        spare = rho - demanded(world.kept, world.ends, body, x, y) + allowed
        if spare < 0.0:
            return True
        along += max(spare / STEEPEST, least)
    return False


@numba.njit(cache=True, nogil=True)
def touched(world, k, x, y, tolerance, without):  # type: ignore[no-untyped-def]
    """The body of least spare distance among those touched at (x, y) at the time of point k; -1 for none."""
    found, nearest = -1, tolerance
    for body in range(len(world.shifts) + 1):
        if body == without:
            continue
        if body < len(world.shifts):
            bound = circle_distance(world.shifts, world.circles, body, k, x, y)
            if bound > world.kept[body, 0] + tolerance:
                continue
        rho, _, _ = distance(world, body, k, x, y)
        spare = rho - demanded(world.kept, world.ends, body, x, y)
        if spare < nearest:
            found, nearest = body, spare
    return found
