"""Coarse search over places and times: a way at full speed through everything that moves, other robots included."""

from __future__ import annotations

import heapq
import math

import numba
import numpy as np

from snnav_core.planning.spacetime_bodies import demanded, distance
from snnav_core.planning.spacetime_kernel import World
from snnav_core.types import FloatArray

__all__ = ["lattice_way"]

_HEADINGS = 16
_SHARPEST = 3  # largest change of the heading from move to move, in steps between headings
_TIMES = 20  # at which ways may come to a cell
_LINKS = 3  # of a path make a move


def lattice_way(
    world: World, link: float, cell: float, most_points: int, most_nodes: int
) -> FloatArray | None:
    """Points one link apart, from the start to less than a move from the target; None when none is found.

    Parameters
    ----------
    world : World
        What to keep away from, at the times of the points.
    link : float
        [m]
    cell : float
        Side of the cells in which one way at a time is enough, as a share of a move.
    most_points, most_nodes : int
        Of the way, and of the search.

    Returns
    -------
    ndarray, shape (n + 1, 2), or None
        [m, map]

    Notes
    -----
    A* over moves of constant length in 16 directions. Of the ways that come to a cell at the same time the first one
    is kept, and of these times the first ones. So the answer is near the quickest way but not the quickest: it is to be
    adjusted.
    """
    points = _search(world, link, cell, most_points, most_nodes)
    return points if len(points) > 1 else None


@numba.njit(cache=True, nogil=True)
def _search(world, link, share, most_points, most_nodes):  # type: ignore[no-untyped-def]
    move, cell = _LINKS * link, share * _LINKS * link
    target_x, target_y = world.ends[1, 0], world.ends[1, 1]
    places = np.empty((most_nodes, 2))
    parents = np.full(most_nodes, -1, dtype=np.int64)
    headings = np.full(most_nodes, -1, dtype=np.int64)
    steps = np.zeros(most_nodes, dtype=np.int64)
    places[0] = world.ends[0]
    seen = {(0, 0, 0)}
    visits = {(0, 0): 1}
    gap = math.hypot(places[0, 0] - target_x, places[0, 1] - target_y)
    queue = [(gap, 0)]
    count = 1
    while len(queue) > 0:
        _, node = heapq.heappop(queue)
        x, y, k = places[node, 0], places[node, 1], steps[node] * _LINKS
        if math.hypot(x - target_x, y - target_y) < move:
            return _trace(node, places, parents, steps)
        if k + _LINKS >= most_points:
            continue
        for heading in range(_HEADINGS):
            turn = 0
            if headings[node] >= 0:
                turn = abs(heading - headings[node])
                turn = min(turn, _HEADINGS - turn)
            if turn > _SHARPEST:
                continue
            angle = 2.0 * math.pi * heading / _HEADINGS
            nx, ny = x + move * math.cos(angle), y + move * math.sin(angle)
            key = (int(math.floor(nx / cell)), int(math.floor(ny / cell)), steps[node] + 1)
            place = (key[0], key[1])
            if key in seen or visits.get(place, 0) >= _TIMES or not _is_free(world, k, x, y, nx, ny):
                continue
            seen.add(key)
            visits[place] = visits.get(place, 0) + 1
            if count == most_nodes:
                return places[:0].copy()
            places[count, 0], places[count, 1] = nx, ny
            parents[count], headings[count], steps[count] = node, heading, steps[node] + 1
            rest = math.hypot(nx - target_x, ny - target_y)
            heapq.heappush(queue, (steps[count] * move + rest, count))
            count += 1
    return places[:0].copy()


@numba.njit(cache=True, nogil=True)
def _is_free(world, k, x, y, nx, ny):  # type: ignore[no-untyped-def]
    """Whether a move that begins at the time of point k keeps away from everything at the times of its points."""
    count = len(world.shifts)
    for part in range(1, _LINKS + 1):
        px, py = x + (nx - x) * part / _LINKS, y + (ny - y) * part / _LINKS
        now = min(k + part, world.shifts.shape[1] - 1)
        for body in range(count):
            dx = px - world.shifts[body, now, 0] - world.circles[body, 0]
            dy = py - world.shifts[body, now, 1] - world.circles[body, 1]
            limit = world.circles[body, 2] + world.kept[body, 0]
            if dx * dx + dy * dy > limit * limit:
                continue
            rho, _, _ = distance(world, body, now, px, py)
            if rho < demanded(world.kept, world.ends, body, px, py):
                return False
    if len(world.border[0]) > 0:
        for part in range(1, _LINKS + 1):
            px, py = x + (nx - x) * part / _LINKS, y + (ny - y) * part / _LINKS
            rho, _, _ = distance(world, count, 0, px, py)
            if rho < demanded(world.kept, world.ends, count, px, py):
                return False
    return True


@numba.njit(cache=True, nogil=True)
def _trace(node, places, parents, steps):  # type: ignore[no-untyped-def]
    """The points of the way to a node, those between its moves included."""
    points = np.empty((steps[node] * _LINKS + 1, 2))
    while node >= 0:
        k = steps[node] * _LINKS
        points[k] = places[node]
        before = parents[node]
        if before >= 0:
            for part in range(1, _LINKS):
                share = part / _LINKS
                points[k - part] = places[node] + share * (places[before] - places[node])
        node = before
    return points
