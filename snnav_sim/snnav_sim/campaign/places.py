"""Random places for starts and targets."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from snnav_sim.campaign.halls import Draws
from snnav_sim.campaign.reference import connected, planned_distance
from snnav_sim.report.optimum import reduced
from snnav_sim.scene_types import Point, RobotScene, Scene

__all__ = ["draw_place", "without_locked_in"]

_TRIES = 400


def draw_place(
    draws: Draws, room: BaseGeometry, others: Sequence[Point] = (), apart: Sequence[float] = ()
) -> Point | None:
    """Return a random point of a region, or None where there is no room.

    Parameters
    ----------
    draws : numpy.random.Generator
    room : shapely polygon or multipolygon
        [m, map]
    others, apart : sequence
        The point lies farther from each of these points than the distance beside it [m].
    """
    if room.is_empty:
        return None
    shapely.prepare(room)
    low, high = np.array(room.bounds[:2]), np.array(room.bounds[2:])
    points = draws.uniform(low, high, (_TRIES, 2)).round(2)
    for x, y in points[shapely.contains_xy(room, points[:, 0], points[:, 1])].tolist():
        if all(math.dist((x, y), other) > far for other, far in zip(others, apart, strict=True)):
            return x, y
    return None


def without_locked_in(scene: Scene, area: BaseGeometry) -> Scene:
    """Leave out robots until none is locked in by others that stand at their targets, or at their starts.

    A robot that has no way even alone stays.
    """
    robots = list(scene.robots)
    while True:
        locked = next((robot for robot in robots if _is_locked_in(robot, robots, scene, area)), None)
        if locked is None:
            return replace(scene, robots=tuple(robots))
        robots.remove(locked)


def _is_locked_in(robot: RobotScene, robots: Sequence[RobotScene], scene: Scene, area: BaseGeometry) -> bool:
    region = reduced(area, planned_distance(scene, robot))
    if not connected(region, robot.start, robot.target):
        return False
    for end in ("target", "start"):
        disks = []
        for other in robots:
            distance = max(robot.radius, other.radius) + scene.safety_margin + 0.05
            place = getattr(other, end)
            near = min(math.dist(place, robot.start), math.dist(place, robot.target))
            if other is not robot and near > distance:
                disks.append(shapely.Point(place).buffer(distance))
        if not connected(region.difference(shapely.union_all(disks)), robot.start, robot.target):
            return True
    return False
