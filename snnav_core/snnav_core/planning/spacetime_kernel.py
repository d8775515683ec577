"""Fields and adjustment loop in space-time, compiled (Ch. 2, F_I, F_R, F_P and A1-A3)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np

from snnav_core.planning.contact import TOUCHING, push_out
from snnav_core.planning.spacetime_bodies import (
    STEEPEST,
    border_distance,
    circle_distance,
    demanded,
    distance,
    outline_distance,
)
from snnav_core.types import FloatArray

__all__ = ["Gains", "World", "longest_and_shortest", "relax"]

_TINY = 1e-12
_WEDGE, _INSIDE = 5, 1e-7  # moves out of two bodies that are touched at once; how exact [m]
_ACUTE = 0.1  # sine of the angle between two bodies below which there is no way out of their wedge
_QUIET = 5  # passes in which everything is small before rest counts
_ATTRACTION = 2.0  # largest attraction to the followed body as a multiple of G_P
_SHORTEST = 0.3  # rest length of a link as a share of L: the tension of a chain is bounded
_EVEN = 0.0003  # of L: links that can be L long differ less from it at rest


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
def _keep_out(world, first, n, p, velocity, force, memory):  # type: ignore[no-untyped-def]
    """Put points out of every body that they are too near to; take the inward parts out of velocity and force.

    Bodies are looked at again only when a point has moved by what it had in reserve to them, and when that is not so
    for the nearest one only, that one alone.
    """
    vertices, offsets, shifts, circles = world.vertices, world.offsets, world.shifts, world.circles
    kept, ends, count = world.kept, world.ends, len(world.shifts)
    for i in range(first, n + 1):
        x, y = p[i, 0], p[i, 1]
        moved = math.sqrt((x - memory[i, 0]) ** 2 + (y - memory[i, 1]) ** 2) * STEEPEST
        if moved < memory[i, 2]:
            continue
        if moved < memory[i, 3]:
            body = int(memory[i, 4])
            if body == count:
                rho, nx, ny = border_distance(world, x, y)
            else:
                rho, nx, ny = outline_distance(vertices, offsets, shifts, circles, body, i, x, y)
            push_out(p, velocity, force, i, demanded(kept, ends, body, x, y) - rho, nx, ny)
        else:
            _look_around(world, i, p, velocity, force, memory)


@numba.njit(cache=True, nogil=True)
def _look_around(world, i, p, velocity, force, memory):  # type: ignore[no-untyped-def]
    """Put point i out of all bodies, and remember how near they are."""
    vertices, offsets, shifts, circles = world.vertices, world.offsets, world.shifts, world.circles
    kept, ends, count = world.kept, world.ends, len(world.shifts)
    x, y = p[i, 0], p[i, 1]
    nearest, least, second = 0, math.inf, math.inf
    contacts, one, other, ox, oy = 0, 0, 0, 0.0, 0.0
    for body in range(count + 1):
        spare = math.inf
        if body < count:
            spare = circle_distance(shifts, circles, body, i, p[i, 0], p[i, 1]) - kept[body, 0]
            if spare >= second:
                continue
            if spare < kept[body, 0]:
                rho, nx, ny = outline_distance(vertices, offsets, shifts, circles, body, i, p[i, 0], p[i, 1])
                spare = rho - demanded(kept, ends, body, p[i, 0], p[i, 1])
        elif len(world.border[0]) > 0:
            rho, nx, ny = border_distance(world, p[i, 0], p[i, 1])
            spare = rho - demanded(kept, ends, body, p[i, 0], p[i, 1])
        if spare < -TOUCHING:
            push_out(p, velocity, force, i, -spare, nx, ny)
            _corner(i, contacts, ox, oy, velocity, force)
            contacts, one, other, ox, oy = contacts + 1, other, body, nx, ny
        if spare < least:
            nearest, least, second = body, spare, least
        else:
            second = min(second, spare)
    if contacts > 1:
        _out_of_wedge(world, i, one, other, p)
    memory[i, 0], memory[i, 1], memory[i, 4] = p[i, 0], p[i, 1], nearest
    pushed = math.sqrt((p[i, 0] - x) ** 2 + (p[i, 1] - y) ** 2) * STEEPEST
    memory[i, 2], memory[i, 3] = least - pushed, second - pushed


@numba.njit(cache=True, nogil=True)
def _out_of_wedge(world, i, one, other, p):  # type: ignore[no-untyped-def]
    """Put point i out of two bodies that it touches."""
    for _ in range(_WEDGE):
        x, y = p[i, 0], p[i, 1]
        rho, ax, ay = distance(world, one, i, x, y)
        one_spare = rho - demanded(world.kept, world.ends, one, x, y)
        rho, bx, by = distance(world, other, i, x, y)
        other_spare = rho - demanded(world.kept, world.ends, other, x, y)
        if not _leave_wedge(i, one_spare, ax, ay, other_spare, bx, by, p):
            return


@numba.njit(cache=True, nogil=True)
def _leave_wedge(i, one, ax, ay, other, bx, by, p):  # type: ignore[no-untyped-def]
    """Move point i out of two bodies by the shortest way, as if both were straight; whether it was in one.

    `one` and `other` are by how much it is farther than demanded, (ax, ay) and (bx, by) the ways out.
    """
    if one > -_INSIDE and other > -_INSIDE:
        return False
    cosine, sine = ax * bx + ay * by, ax * by - ay * bx
    if one < 0.0 and other - one * cosine >= 0.0:
        dx, dy = -one * ax, -one * ay
    elif other < 0.0 and one - other * cosine >= 0.0:
        dx, dy = -other * bx, -other * by
    elif abs(sine) > _ACUTE:
        dx, dy = (-one * by + other * ay) / sine, (one * bx - other * ax) / sine
    else:
        dx, dy = -0.5 * (one * ax + other * bx), -0.5 * (one * ay + other * by)
    p[i, 0] += dx
    p[i, 1] += dy
    return True


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
