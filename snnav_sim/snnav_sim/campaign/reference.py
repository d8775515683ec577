"""Exact references that robots are judged by: which targets can be reached at all (not imported by the planner)."""

from __future__ import annotations

from dataclasses import replace

import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.area.fusion import AreaFusion
from snnav_core.navigator.settings import RobotDistances
from snnav_sim.configure import fusion_settings, navigator_settings, planar_sensor
from snnav_sim.devices import make_device
from snnav_sim.scene_types import Point, RobotScene, Scene
from snnav_sim.world import World

__all__ = ["connected", "planned_distance", "seen_area", "window_distance"]


def planned_distance(scene: Scene, robot: RobotScene) -> float:
    """Return the least distance to the boundary at which a path can be certified for one sampling interval [m].

    The safety margin, what the boundary may move in an interval, tracking tolerance, reserve and the dip of chords.
    """
    distances = RobotDistances(robot.spec, navigator_settings(scene))
    return float(distances.demanded()[distances.parts - 1])


def window_distance(scene: Scene, robot: RobotScene) -> float:
    """Return the distance to the boundary at which a robot may stand for a whole window [m]."""
    return float(RobotDistances(robot.spec, navigator_settings(scene)).demanded()[-1])


def seen_area(scene: Scene) -> BaseGeometry:
    """Return what one noise-free scan of every sensor shows to be free while nobody walks [m, map].

    Less than what is truly visible: past an edge far away a beam passes, or the next one 0.5 degrees beside it.
    """
    sensors = [
        replace(
            sensor,
            noise="none",
            drop_out=0.0,
            faults=(),
            scan_period=None,
            scan_offset=0.0,
            sees_robots=False,
        )
        for sensor in scene.sensors
    ]
    ideal = replace(scene, sensors=tuple(sensors), movers=())
    world = World(ideal)
    fusion = AreaFusion([planar_sensor(sensor) for sensor in sensors], fusion_settings(ideal))
    for sensor in sensors:
        fusion.add_scan(sensor.id, make_device(sensor, world, scene.seed).scan(0.0))
    return fusion.area(0.0).region


def connected(region: BaseGeometry, start: Point, target: Point) -> bool:
    """Whether two points lie in one component of a region [m, map]."""
    ends = shapely.MultiPoint([start, target])
    return any(bool(shapely.covers(part, ends)) for part in shapely.get_parts(region))
