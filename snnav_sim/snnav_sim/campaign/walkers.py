"""People who walk to and fro along lanes of their own for the whole run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import shapely
from shapely.geometry.base import BaseGeometry

from snnav_sim.campaign.halls import Draws, between
from snnav_sim.report.optimum import reduced
from snnav_sim.scene_types import Circle, Mover, Point

__all__ = ["draw_walkers", "refuge", "swept"]

_TRIES = 60
_OFF_WALL = 0.3  # [m] that somebody walks from walls and obstacles
_SHORTEST_LANE = 3.0  # [m]
_SHORTEST_LEG = 0.5  # [m]
_BESIDE = 1.0  # [m] that a robot has to go at most to where it may stand, beyond what it keeps from a lane


def draw_walkers(
    draws: Draws, area: BaseGeometry, top_speed: float, most: int, distance: float
) -> tuple[Mover, ...]:
    """Return one to `most` walkers, fewer where there is no room for so many lanes.

    Parameters
    ----------
    draws : numpy.random.Generator
    area : shapely polygon or multipolygon
        What the sensors see while nobody is there [m, map].
    top_speed : float
        V_max [m/s]; every other walker is as fast, the others are slower.
    most : int
    distance : float
        At which a robot may stand for a whole window [m].

    Notes
    -----
    Walkers do not see robots, and a robot between two of them, or before one in a passage, could not make room. So
    lanes are so far apart that a robot may stand between any two, and from everywhere on a lane it is not far to where
    one may stand for ever.
    """
    walkers: list[Mover] = []
    for number in range(1, int(draws.integers(1, most + 1)) + 1):
        radius = between(draws, 0.2, 0.35)
        room = area.buffer(-(radius + _OFF_WALL)).difference(swept(walkers).buffer(2.0 * distance + radius))
        lane = _lane(draws, room)
        share = 1.0 if draws.random() < 0.5 else draws.uniform(0.4, 1.0)
        speed = max(0.01, math.floor(1e3 * share * top_speed) / 1e3)
        if not lane:
            continue
        walker = Mover(f"walker_{number}", Circle(0.0, 0.0, radius), lane, speed, loop=True)
        near = refuge(area, [*walkers, walker], distance).buffer(radius + distance + _BESIDE)
        if shapely.covers(near, shapely.LineString(lane)):
            walkers.append(walker)
    return tuple(walkers)


def swept(walkers: Sequence[Mover]) -> BaseGeometry:
    """Return where any of the walkers may ever stand [m, map]."""
    lanes = []
    for walker in walkers:
        assert isinstance(walker.shape, Circle)
        lanes.append(shapely.LineString(walker.waypoints).buffer(walker.shape.radius))
    return shapely.union_all(lanes)


def refuge(area: BaseGeometry, walkers: Sequence[Mover], distance: float) -> BaseGeometry:
    """Return where a robot may stand at a distance [m] from everything whatever the walkers do [m, map]."""
    return reduced(area, distance).difference(swept(walkers).buffer(distance))


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
