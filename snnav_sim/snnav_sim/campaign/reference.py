"""Exact references that robots are judged by: which targets can be reached at all (not imported by the planner)."""

from __future__ import annotations

import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.navigator.settings import RobotDistances
from snnav_sim.configure import navigator_settings
from snnav_sim.scene_types import Point, RobotScene, Scene

__all__ = ["connected", "planned_distance", "window_distance"]


def planned_distance(scene: Scene, robot: RobotScene) -> float:
    """Return the least distance to the boundary at which a path can be certified for one sampling interval [m].

    The safety margin, what the boundary may move in an interval, tracking tolerance, reserve and the dip of chords.
    """
    distances = RobotDistances(robot.spec, navigator_settings(scene))
    return float(distances.demanded()[distances.parts - 1])


def window_distance(scene: Scene, robot: RobotScene) -> float:
    """Return the distance to the boundary at which a robot may stand for a whole window [m]."""
    return float(RobotDistances(robot.spec, navigator_settings(scene)).demanded()[-1])


def connected(region: BaseGeometry, start: Point, target: Point) -> bool:
    """Whether two points lie in one component of a region [m, map]."""
    ends = shapely.MultiPoint([start, target])
    return any(bool(shapely.covers(part, ends)) for part in shapely.get_parts(region))
