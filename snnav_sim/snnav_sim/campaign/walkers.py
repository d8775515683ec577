"""People who walk to and fro along lanes of their own for the whole run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import shapely
from shapely.geometry.base import BaseGeometry

from snnav_sim.campaign.halls import Draws, between
from snnav_sim.scene_types import Circle, Mover, Point

__all__ = ["draw_walkers", "swept"]

_TRIES = 60
_OFF_WALL = 0.3  # [m] that somebody walks from walls and obstacles
_SHORTEST_LANE = 3.0  # [m]
_SHORTEST_LEG = 0.5  # [m]


def draw_walkers(draws: Draws, free: BaseGeometry, top_speed: float, most: int) -> tuple[Mover, ...]:
    """Return one to `most` walkers, none where there is no room for a lane.

    Parameters
    ----------
    draws : numpy.random.Generator
    free : shapely polygon or multipolygon
        Where nothing stands [m, map].
    top_speed : float
        V_max [m/s]; every other walker is as fast, the others are slower.
    most : int
    """
    walkers = []
    for number in range(1, int(draws.integers(1, most + 1)) + 1):
        radius = between(draws, 0.2, 0.35)
        lane = _lane(draws, free.buffer(-(radius + _OFF_WALL)))
        if lane:
            share = 1.0 if draws.random() < 0.5 else draws.uniform(0.4, 1.0)
            speed = max(0.01, math.floor(1e3 * share * top_speed) / 1e3)
            walkers.append(Mover(f"walker_{number}", Circle(0.0, 0.0, radius), lane, speed, loop=True))
    return tuple(walkers)


def swept(walkers: Sequence[Mover]) -> BaseGeometry:
    """Return where any of the walkers may ever stand [m, map]."""
    lanes = []
    for walker in walkers:
        assert isinstance(walker.shape, Circle)
        lanes.append(shapely.LineString(walker.waypoints).buffer(walker.shape.radius))
    return shapely.union_all(lanes)


def _lane(draws: Draws, room: BaseGeometry) -> tuple[Point, ...]:
    """Two to four points with straight ways between them; none where that fails."""
    if room.is_empty:
        return ()
    shapely.prepare(room)
    low_x, low_y, high_x, high_y = room.bounds
    wanted = int(draws.integers(2, 5))
    points: list[Point] = []
    for _ in range(_TRIES):
        point = (between(draws, low_x, high_x), between(draws, low_y, high_y))
        way = shapely.LineString([points[-1], point]) if points else shapely.Point(point)
        if room.contains(way) and (not points or math.dist(points[-1], point) >= _SHORTEST_LEG):
            points.append(point)
        if len(points) >= wanted and sum(math.dist(*leg) for leg in pairwise(points)) >= _SHORTEST_LANE:
            return tuple(points)
    return ()
