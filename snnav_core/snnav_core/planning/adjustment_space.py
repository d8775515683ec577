"""The adjustment loop compiled for space: the steps of `adjustment.adjust`, some 30 times as fast."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numba
import numpy as np

from snnav_core.area.spatial import interpolate
from snnav_core.planning.fields import Barrier, DiskBarrier
from snnav_core.planning.flight_fields import FLAT, RegionBarrier, TorusBarrier
from snnav_core.types import FloatArray

__all__ = ["adjust_in_space"]

_TINY = 1e-12
_TOUCHING = -1e-9  # [m]
_DIAGONAL = 1.7321  # of a cell, by its edge: no neighbour is farther
_QUIET = 5  # passes without a change of the number of points before rest counts


def adjust_in_space(
    points: FloatArray,
    target: FloatArray,
    barriers: Sequence[Barrier],
    gains: tuple[float, float, float, float, float],
    limits: tuple[float, float, float, float],
    most: tuple[int, int],
) -> tuple[FloatArray, bool, int] | None:
    """Adjust a path in space; None when the barriers are not of the kinds that the kernel knows, or not in order.

    Parameters
    ----------
    points : ndarray, shape (n + 1, 3)
    target : ndarray, shape (3,)
    barriers : sequence of Barrier
        A `RegionBarrier`, then any number of `DiskBarrier`, then perhaps a `TorusBarrier`.
    gains, limits, most
        See `snnav_core.planning.adjustment_kernel.adjust_in_plane`.

    Returns
    -------
    points, settled, passes
    """
    if points.shape[1] != 3 or not barriers or not isinstance(barriers[0], RegionBarrier):
        return None
    region, rest = barriers[0], list(barriers[1:])
    torus = rest.pop() if rest and isinstance(rest[-1], TorusBarrier) else None
    spheres = [one for one in rest if isinstance(one, DiskBarrier)]
    if len(spheres) != len(rest):
        return None
    offsets = np.cumsum([0, *(len(one.distances) for one in spheres)])
    centres = np.concatenate([np.zeros((0, 3)), *(one.centres for one in spheres)])
    distances = np.concatenate([np.zeros(0), *(one.distances for one in spheres)])
    around = (np.zeros(3), np.zeros(3), 0.0, 0)
    if isinstance(torus, TorusBarrier):
        around = (np.array(torus.centre), np.array(torus.axis), torus.radius, torus.count)
    area = region.area
    adjusted, settled, passes = _adjust(
        np.array(points, dtype=np.float64, order="C"),
        np.array(target, dtype=np.float64),
        gains,
        limits,
        most,
        (area.moving, area.static, area.grid.origin, area.grid.spacing),
        (region.distance, np.array(region.growth, dtype=np.float64)),
        (centres, distances, offsets),
        around,
    )
    return adjusted, bool(settled), int(passes)


@numba.njit(cache=True, nogil=True)
def _adjust(start, target, gains, limits, most, field, kept, spheres, torus):  # type: ignore[no-untyped-def]
    link, pull, rest, gain, attenuation = gains
    threshold, speed_threshold, shortest_end, longest_end = limits
    max_passes, max_points = most
    n = start.shape[0] - 1
    room = max(n, max_points) + 2
    p = np.empty((room, 3))  # p_0 .. p_n
    p[: n + 1] = start
    velocity = np.zeros((room, 3))
    force = np.zeros((room, 3))
    normal = np.empty(3)
    quiet = 0
    for passes in range(1, max_passes + 1):
        _forces(p, n, force, target, pull, rest, gain)
        for i in range(1, n + 1):
            for axis in range(3):
                velocity[i, axis] = attenuation * velocity[i, axis] + force[i, axis]
                p[i, axis] += velocity[i, axis]
            _into_region(p, velocity, force, i, field, kept, normal)
            _off_spheres(p, velocity, force, i, spheres, normal)
            if i <= torus[3]:
                _off_torus(p, velocity, force, i, torus, normal)
        away = math.sqrt(_squared(target, p[n]))
        changed = True
        if away < shortest_end * link and n > 1:
            n -= 1
        elif away > longest_end * link:
            share = min(link, away) / away
            for axis in range(3):
                p[n + 1, axis] = p[n, axis] + (target[axis] - p[n, axis]) * share
                velocity[n + 1, axis] = 0.0
            n += 1
        else:
            changed = False
        if n > max_points:
            return p[: n + 1].copy(), False, passes
        if changed:
            quiet = 0
            continue
        quiet += 1
        at_rest = _largest(force, n) < threshold * threshold
        if quiet > _QUIET and at_rest and _largest(velocity, n) < speed_threshold * speed_threshold:
            return p[: n + 1].copy(), True, passes
    return p[: n + 1].copy(), False, max_passes


@numba.njit(cache=True, nogil=True)
def _squared(one, other):  # type: ignore[no-untyped-def]
    x, y, z = one[0] - other[0], one[1] - other[1], one[2] - other[2]
    return x * x + y * y + z * z


@numba.njit(cache=True, nogil=True)
def _forces(p, n, force, target, pull, rest, gain):  # type: ignore[no-untyped-def]
    """F_I and F_P at p_1 .. p_n."""
    ahead = np.zeros(3)
    for i in range(n, 0, -1):
        tension = gain * (1.0 - rest / max(math.sqrt(_squared(p[i - 1], p[i])), _TINY))
        for axis in range(3):
            one = (p[i - 1, axis] - p[i, axis]) * tension
            force[i, axis] = one - ahead[axis]
            ahead[axis] = one
    if n > 0:
        share = pull / max(math.sqrt(_squared(target, p[n])), _TINY)
        for axis in range(3):
            force[n, axis] += (target[axis] - p[n, axis]) * share


@numba.njit(cache=True, nogil=True)
def _push(p, velocity, force, i, depth, normal):  # type: ignore[no-untyped-def]
    """Put point i out of what it is in by `depth`; take the inward parts out of velocity and force."""
    if not depth > _TOUCHING:
        return
    out = max(depth, 0.0)
    fast, strong = 0.0, 0.0
    for axis in range(3):
        p[i, axis] += out * normal[axis]
        fast += velocity[i, axis] * normal[axis]
        strong += force[i, axis] * normal[axis]
    fast, strong = min(fast, 0.0), min(strong, 0.0)
    for axis in range(3):
        velocity[i, axis] -= fast * normal[axis]
        force[i, axis] -= strong * normal[axis]


@numba.njit(cache=True, nogil=True)
def _into_region(p, velocity, force, i, field, kept, normal):  # type: ignore[no-untyped-def]
    """`RegionBarrier` at point i."""
    moving, static, origin, spacing = field
    distance, growth = kept
    grown = growth[min(i, len(growth)) - 1]
    if _is_far(p[i], distance + grown, moving, static, origin, spacing):
        return
    value = interpolate(p[i], grown, moving, static, origin, spacing, normal)
    size = max(math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2), FLAT)
    for axis in range(3):
        normal[axis] /= size
    _push(p, velocity, force, i, distance - value, normal)


@numba.njit(cache=True, nogil=True)
def _is_far(point, distance, moving, static, origin, spacing):  # type: ignore[no-untyped-def]
    """Whether the cell that holds a point says already that it keeps a distance: its neighbours have little less."""
    nx, ny, nz = moving.shape
    i, j, k = (
        int((point[0] - origin[0]) / spacing),
        int((point[1] - origin[1]) / spacing),
        int((point[2] - origin[2]) / spacing),
    )
    if not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz):
        return False
    return min(moving[i, j, k], static[i, j, k]) > distance + _DIAGONAL * spacing


@numba.njit(cache=True, nogil=True)
def _off_spheres(p, velocity, force, i, spheres, normal):  # type: ignore[no-untyped-def]
    """`DiskBarrier` of all other robots at point i."""
    centres, distances, offsets = spheres
    for d in range(len(offsets) - 1):
        k = min(offsets[d] + i, offsets[d + 1]) - 1
        away = math.sqrt(_squared(p[i], centres[k]))
        for axis in range(3):
            normal[axis] = (p[i, axis] - centres[k, axis]) / max(away, _TINY)
        _push(p, velocity, force, i, distances[k] - away, normal)


@numba.njit(cache=True, nogil=True)
def _off_torus(p, velocity, force, i, torus, normal):  # type: ignore[no-untyped-def]
    """`TorusBarrier` at point i."""
    centre, axis_of, radius, _ = torus
    along = 0.0
    for axis in range(3):
        along += (p[i, axis] - centre[axis]) * axis_of[axis]
    width = 0.0
    for axis in range(3):
        normal[axis] = p[i, axis] - centre[axis] - along * axis_of[axis]
        width += normal[axis] ** 2
    width = math.sqrt(width)
    if width <= _TINY:
        return
    away = 0.0
    for axis in range(3):  # from the nearest point of the circle
        normal[axis] = (width - radius) * normal[axis] / width + along * axis_of[axis]
        away += normal[axis] ** 2
    away = math.sqrt(away)
    for axis in range(3):
        normal[axis] /= max(away, _TINY)
    _push(p, velocity, force, i, radius - away, normal)


@numba.njit(cache=True, nogil=True)
def _largest(vectors, n):  # type: ignore[no-untyped-def]
    """Largest square length among the vectors 1 .. n."""
    largest = 0.0
    for i in range(1, n + 1):
        largest = max(largest, vectors[i, 0] ** 2 + vectors[i, 1] ** 2 + vectors[i, 2] ** 2)
    return largest
