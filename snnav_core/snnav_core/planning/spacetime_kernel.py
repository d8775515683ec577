"""Fields and adjustment loop in space-time, compiled: point i of a path meets the bodies where they are at its time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np

from snnav_core.area.clearance import nearest_boundary
from snnav_core.types import FloatArray

__all__ = [
    "Gains",
    "World",
    "cuts",
    "demanded",
    "distance",
    "distances_over_time",
    "longest_and_shortest",
    "relax",
    "touched",
]

_TINY = 1e-12
_TOUCHING = -1e-9  # [m]
_SLOPE = 0.3  # of what is demanded, over the distance from start or target where that has to be less there
_STEEPEST = 1.0 + _SLOPE
_WEDGE = 10  # pushes out of two bodies that are touched at once, in turn
_QUIET = 5  # passes in which everything is small before rest counts
_ATTRACTION = 2.0  # largest attraction to the followed body as a multiple of G_P
_FAR = 1e9  # [m]
_SHORTEST = 0.3  # rest length of a link as a share of L: the tension of a chain is bounded
_EVEN = 0.001  # of L: links that can be L long differ less from it at rest


class World(NamedTuple):
    """All that a path has to keep away from, at the times of its points.

    Bodies are numbered from 0; the last number (``len(shifts)``) is the border of the workspace.

    Attributes
    ----------
    vertices : ndarray, shape (V, 2)
        Outlines of all bodies [m].
    offsets : ndarray of int, shape (B + 1,)
        Where those of each body begin.
    shifts : ndarray, shape (B, K, 2)
        Where a body is at the time of point k, relative to its vertices [m].
    circles : ndarray, shape (B, 4)
        Circle around each grown body: centre, radius; by how much the outline is grown [m].
    kept : ndarray, shape (B + 1, 3)
        Planning distance to each, what start and target keep from it [m]; less than the planning distance is demanded
        near them where they keep less.
    ends : ndarray, shape (2, 2)
        Start and target [m, map].
    border : tuple
        `ClearanceField.arrays` of the workspace; without segments in an open plane.
    """

    vertices: FloatArray
    offsets: np.ndarray
    shifts: FloatArray
    circles: FloatArray
    kept: FloatArray
    ends: FloatArray
    border: tuple[Any, ...]


class Gains(NamedTuple):
    """Constants of the loop.

    Attributes
    ----------
    link, pull : float
        L and G_P [m].
    interval, attraction, attenuation : float
        G_I, G_R (towards the followed body), G_N.
    force_threshold, speed_threshold : float
        What counts as rest [m].
    correction : float
        Change of the rest length of a link per pass, as a share of what the link is too long.
    stiffness, bend : float
        Share of what the change from link to link is above `bend` [m] that is taken back per pass.
    """

    link: float
    pull: float
    interval: float
    attraction: float
    attenuation: float
    force_threshold: float
    speed_threshold: float
    correction: float = 0.0
    stiffness: float = 0.0
    bend: float = 0.0


@numba.njit(cache=True, nogil=True)
def distance(world, body, k, x, y):  # type: ignore[no-untyped-def]
    """Signed distance [m] of (x, y) to a body at the time of point k, and its gradient; negative inside."""
    if body == len(world.shifts):
        return _border(world, x, y)
    return _outline(world.vertices, world.offsets, world.shifts, world.circles, body, k, x, y)


@numba.njit(cache=True, nogil=True)
def _outline(vertices, offsets, shifts, circles, body, k, x, y):  # type: ignore[no-untyped-def]
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
def _border(world, x, y):  # type: ignore[no-untyped-def]
    starts, ends, normals_start, normals_end, offsets, members, origin, size, columns, rows = world.border
    if len(starts) == 0:
        return _FAR, 1.0, 0.0
    return nearest_boundary(
        x,
        y,
        math.inf,
        starts,
        ends,
        normals_start,
        normals_end,
        offsets,
        members,
        origin,
        size,
        columns,
        rows,
    )


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
def _farther(shifts, circles, body, k, x, y):  # type: ignore[no-untyped-def]
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
        along += max(spare / _STEEPEST, least)
    return False


@numba.njit(cache=True, nogil=True)
def touched(world, k, x, y, tolerance, without):  # type: ignore[no-untyped-def]
    """The body of least spare distance among those touched at (x, y) at the time of point k; -1 for none."""
    found, nearest = -1, tolerance
    for body in range(len(world.shifts) + 1):
        if body == without:
            continue
        if body < len(world.shifts):
            bound = _farther(world.shifts, world.circles, body, k, x, y)
            if bound > world.kept[body, 0] + tolerance:
                continue
        rho, _, _ = distance(world, body, k, x, y)
        spare = rho - demanded(world.kept, world.ends, body, x, y)
        if spare < nearest:
            found, nearest = body, spare
    return found


@numba.njit(cache=True, nogil=True)
def _keep_out(world, first, n, p, velocity, force, memory):  # type: ignore[no-untyped-def]
    """Put points out of every body that they are too near to; take the inward parts out of velocity and force.

    Bodies are looked at again only when a point has moved by what it had in reserve to them, and when that is not so
    for the nearest one only, that one alone.
    """
    vertices, offsets, shifts, circles = world.vertices, world.offsets, world.shifts, world.circles
    kept, ends, count = world.kept, world.ends, len(world.shifts)
    bounded = len(world.border[0]) > 0
    for i in range(first, n + 1):
        x, y = p[i, 0], p[i, 1]
        moved = math.sqrt((x - memory[i, 0]) ** 2 + (y - memory[i, 1]) ** 2) * _STEEPEST
        if moved < memory[i, 2]:
            continue
        if moved < memory[i, 3]:
            body = int(memory[i, 4])
            if body == count:
                rho, nx, ny = _border(world, x, y)
            else:
                rho, nx, ny = _outline(vertices, offsets, shifts, circles, body, i, x, y)
            _push(i, rho - demanded(kept, ends, body, x, y), nx, ny, p, velocity, force)
            continue
        nearest, least, second = 0, math.inf, math.inf
        contacts, one, other, ox, oy = 0, 0, 0, 0.0, 0.0
        for body in range(count + 1):
            if body < count:
                spare = _farther(shifts, circles, body, i, p[i, 0], p[i, 1]) - kept[body, 0]
                if spare >= second:
                    continue
                if spare < kept[body, 0]:
                    rho, nx, ny = _outline(vertices, offsets, shifts, circles, body, i, p[i, 0], p[i, 1])
                    spare = rho - demanded(kept, ends, body, p[i, 0], p[i, 1])
            elif bounded:
                rho, nx, ny = _border(world, p[i, 0], p[i, 1])
                spare = rho - demanded(kept, ends, body, p[i, 0], p[i, 1])
            else:
                continue
            if spare < -_TOUCHING:
                _push(i, spare, nx, ny, p, velocity, force)
                _corner(i, contacts, ox, oy, velocity, force)
                contacts, one, other, ox, oy = contacts + 1, other, body, nx, ny
            if spare < least:
                nearest, least, second = body, spare, least
            else:
                second = min(second, spare)
        for push in range(_WEDGE if contacts > 1 else 0):
            # out of the wedge between two bodies, in turn
            body = one if push % 2 == 0 else other
            if body == count:
                rho, nx, ny = _border(world, p[i, 0], p[i, 1])
            else:
                rho, nx, ny = _outline(vertices, offsets, shifts, circles, body, i, p[i, 0], p[i, 1])
            _push(i, rho - demanded(kept, ends, body, p[i, 0], p[i, 1]), nx, ny, p, velocity, force)
        memory[i, 0], memory[i, 1], memory[i, 4] = p[i, 0], p[i, 1], nearest
        pushed = math.sqrt((p[i, 0] - x) ** 2 + (p[i, 1] - y) ** 2) * _STEEPEST
        memory[i, 2], memory[i, 3] = least - pushed, second - pushed


@numba.njit(cache=True, nogil=True)
def _push(i, spare, nx, ny, p, velocity, force):  # type: ignore[no-untyped-def]
    """Put point i out of a body that it is nearer to than demanded, by what `spare` is below 0."""
    if spare >= -_TOUCHING:
        return
    out = max(-spare, 0.0)
    p[i, 0] += out * nx
    p[i, 1] += out * ny
    inward = min(velocity[i, 0] * nx + velocity[i, 1] * ny, 0.0)
    velocity[i, 0] -= inward * nx
    velocity[i, 1] -= inward * ny
    inward = min(force[i, 0] * nx + force[i, 1] * ny, 0.0)
    force[i, 0] -= inward * nx
    force[i, 1] -= inward * ny


@numba.njit(cache=True, nogil=True)
def _corner(i, contacts, ox, oy, velocity, force):  # type: ignore[no-untyped-def]
    """Where two bodies are touched: what leads out of one into the other, with normal (ox, oy), leads nowhere."""
    if contacts == 0:
        return
    if velocity[i, 0] * ox + velocity[i, 1] * oy < 0.0:
        velocity[i, 0], velocity[i, 1] = 0.0, 0.0
    if force[i, 0] * ox + force[i, 1] * oy < 0.0:
        force[i, 0], force[i, 1] = 0.0, 0.0


@numba.njit(cache=True, nogil=True)
def _guide(world, n, p, force, followed, side, gains):  # type: ignore[no-untyped-def]
    """F_P at the last point: R1 towards the target (nothing is followed), R2 around the followed body."""
    x, y = p[n, 0], p[n, 1]
    if followed < 0:
        gx, gy = world.ends[1, 0] - x, world.ends[1, 1] - y
        share = gains.pull / max(math.sqrt(gx * gx + gy * gy), gains.pull)
        force[n, 0] += share * gx
        force[n, 1] += share * gy
        return
    rho, nx, ny = distance(world, followed, n, x, y)
    away = max(rho - demanded(world.kept, world.ends, followed, x, y), 0.0)
    towards = min(gains.attraction * away, _ATTRACTION * gains.pull)
    force[n, 0] += -towards * nx + side * gains.pull * ny
    force[n, 1] += -towards * ny - side * gains.pull * nx


@numba.njit(cache=True, nogil=True)
def _unbend(first, n, p, force, stiffness, bend):  # type: ignore[no-untyped-def]
    """Straighten where the change from link to link is larger than `bend`."""
    for i in range(first, n):
        sx = p[i - 1, 0] - 2.0 * p[i, 0] + p[i + 1, 0]
        sy = p[i - 1, 1] - 2.0 * p[i, 1] + p[i + 1, 1]
        size = math.sqrt(sx * sx + sy * sy)
        if size <= bend:
            continue
        share = stiffness * (1.0 - bend / size)
        force[i, 0] += 2.0 * share * sx
        force[i, 1] += 2.0 * share * sy
        force[i + 1, 0] -= share * sx
        force[i + 1, 1] -= share * sy
        if i > first:
            force[i - 1, 0] -= share * sx
            force[i - 1, 1] -= share * sy


@numba.njit(cache=True, nogil=True)
def relax(world, first, n, p, velocity, force, rest, memory, followed, side, gains, most):  # type: ignore[no-untyped-def]
    """A1-A3 for the points `first` .. n: move them until they rest; returns the passes and whether they do.

    Parameters
    ----------
    p, velocity, force : ndarray, shape (room, 2)
        Points and what belongs to them, changed in place.
    rest : ndarray, shape (room,)
        Rest length of the link that ends at each point [m].
    memory : ndarray, shape (room, 5)
        Where bodies were looked up, reserve to the nearest and to all others [m] there, which is the nearest; a new
        point has a negative reserve to all.
    followed, side : int
        Body of mode R2 (-1 in R1), and gamma.
    gains : Gains
    most : int
        Passes.

    Notes
    -----
    Deviations: v first, then p (C0-2); exact barrier (C0-5); rest means that all are small for several passes (C0-1);
    in R2 what pulls towards the body acts only beyond its margin (C2-6). With `correction` rest lengths change until
    all links are L long: bodies in motion push along the path as well, so that the tension and with it the spacing of
    springs differs from link to link (deviation C0-3). With `stiffness` a chain that has to lose time, which constant
    speed allows by a detour only, does not fold (deviation C0-8).
    """
    quiet = 0
    for passes in range(1, most + 1):
        ahead_x, ahead_y, uneven = 0.0, 0.0, 0.0
        for i in range(n, first - 1, -1):
            lx, ly = p[i - 1, 0] - p[i, 0], p[i - 1, 1] - p[i, 1]
            length = math.sqrt(lx * lx + ly * ly)
            tension = gains.interval * (1.0 - rest[i] / max(length, _TINY))
            tx, ty = lx * tension, ly * tension
            force[i, 0], force[i, 1] = tx - ahead_x, ty - ahead_y
            ahead_x, ahead_y = tx, ty
            if gains.correction > 0.0:
                changed = rest[i] - gains.correction * (length - gains.link)
                rest[i] = min(max(changed, _SHORTEST * gains.link), gains.link)
                if rest[i] == changed:
                    uneven = max(uneven, abs(length - gains.link))
        _guide(world, n, p, force, followed, side, gains)
        if gains.stiffness > 0.0:
            _unbend(first, n, p, force, gains.stiffness, gains.bend)
        fastest, strongest = 0.0, 0.0
        for i in range(first, n + 1):
            for axis in range(2):
                velocity[i, axis] = gains.attenuation * velocity[i, axis] + force[i, axis]
                p[i, axis] += velocity[i, axis]
        _keep_out(world, first, n, p, velocity, force, memory)
        for i in range(first, n + 1):
            strongest = max(strongest, force[i, 0] * force[i, 0] + force[i, 1] * force[i, 1])
            fastest = max(fastest, velocity[i, 0] * velocity[i, 0] + velocity[i, 1] * velocity[i, 1])
        calm = strongest < gains.force_threshold**2 and fastest < gains.speed_threshold**2
        quiet = quiet + 1 if calm and uneven < _EVEN * gains.link else 0
        if quiet > _QUIET:
            return passes, True
    return most, False


@numba.njit(cache=True, nogil=True)
def longest_and_shortest(p, n):  # type: ignore[no-untyped-def]
    """Longest and shortest of the n links [m]."""
    longest, shortest = 0.0, math.inf
    for i in range(1, n + 1):
        dx, dy = p[i, 0] - p[i - 1, 0], p[i, 1] - p[i - 1, 1]
        length = math.sqrt(dx * dx + dy * dy)
        longest, shortest = max(longest, length), min(shortest, length)
    return longest, shortest
