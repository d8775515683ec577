"""Cross-checks between the entries of a scene in space, each failing at the line of the value to change."""

from __future__ import annotations

import math

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_sim.scene_check import check_ids, check_times, items_of
from snnav_sim.scene_yaml import Field
from snnav_sim.space_types import Box, Point3, Prism, SpaceScene
from snnav_sim.space_world import SpaceWorld, triangles_of

__all__ = ["check_space_scene"]

_FAULTS = ("drop_out", "delay", "duplicate", "reorder", "nan", "zero", "frozen", "clock_offset")


def check_space_scene(root: Field, scene: SpaceScene) -> None:
    """Check what no single entry shows.

    Parameters
    ----------
    root : Field
        The document that `scene` was read from.
    scene : SpaceScene

    Raises
    ------
    SceneError
        At the first contradiction.
    """
    entries = root.children()
    if not scene.sensors and any(not robot.curve for robot in scene.robots):
        entries["sensors"].fail("an empty list", "add at least one camera: without any nothing is free")
    check_times(entries, scene.sampling_interval, scene.control_period)
    check_ids(entries)
    try:
        _ = scene.grid
    except InvalidInput as error:
        entries.get("grid_spacing", entries["workspace"]).fail(str(error), "choose another grid_spacing")
    _check_meshes(entries, scene)
    _check_sensors(entries, scene)
    _check_robots(entries, scene)
    _check_movers(entries, scene)


def _check_meshes(entries: dict[str, Field], scene: SpaceScene) -> None:
    for item, body in zip(items_of(entries, "obstacles"), scene.obstacles, strict=True):
        if isinstance(body.solid, (Box, Prism)):
            continue
        field = item.children()["mesh"]
        try:
            triangles = triangles_of(body.solid)
        except Exception as error:  # whatever a reader of foreign files may raise
            field.fail(f"cannot be read ({' '.join(str(error).split())})", "give an STL or OBJ file")
        if not (len(triangles) and np.isfinite(triangles).all()):
            field.fail("holds no triangles, or some that are not finite", "give a closed surface in m")


def _inside(scene: SpaceScene, point: Point3) -> bool:
    return all(
        low - 1e-9 <= value <= high + 1e-9
        for low, value, high in zip(scene.low, point, scene.high, strict=True)
    )


def _check_inside(field: Field, scene: SpaceScene, point: Point3) -> None:
    if not _inside(scene, point):
        field.fail(f"{_text(point)} lies outside the workspace", "move it inside the box")


def _text(point: Point3) -> str:
    return "[" + ", ".join(f"{value:g}" for value in point) + "]"


def _check_sensors(entries: dict[str, Field], scene: SpaceScene) -> None:
    world = SpaceWorld(scene)
    for item, sensor in zip(items_of(entries, "sensors"), scene.sensors, strict=True):
        children, period = item.children(), scene.scan_period(sensor)
        _check_inside(children["position"], scene, sensor.position)
        if world.body_clearance(np.array([sensor.position]))[0] < 1e-3:
            children["position"].fail(
                f"{_text(sensor.position)} is inside an obstacle or nearer than 1 mm",
                "move it out, it would be blind",
            )
        if period < scene.control_period - 1e-9:
            children["scan_period"].fail(
                f"{period:g} is shorter than control_period {scene.control_period:g}",
                "give at least the control period",
            )
        if sensor.scan_offset >= period:
            children["scan_offset"].fail(
                f"{sensor.scan_offset:g} is not below the time {period:g} s from image to image",
                "give the time of the first image",
            )
        if sensor.wrap is not None and sensor.wrap <= sensor.range_min:
            children["wrap"].fail(f"{sensor.wrap:g} is not above range_min", "give the ambiguous range")
        for field, fault in zip(items_of(children, "faults"), sensor.faults, strict=True):
            if fault.kind not in _FAULTS:
                field.children()["kind"].fail(
                    f"{fault.kind} is for planar scans", f"write one of {', '.join(_FAULTS)}"
                )
            if fault.kind == "frozen" and sensor.noise == "none":
                field.children()["kind"].fail(
                    "frozen beside noise: none", "add noise: tof; a world at rest gives the same images"
                )


def _check_robots(entries: dict[str, Field], scene: SpaceScene) -> None:
    for item, robot in zip(items_of(entries, "robots"), scene.robots, strict=True):
        children = item.children()
        _check_inside(children["start"], scene, robot.start)
        for field, point in zip(items_of(children, "curve"), robot.curve, strict=True):
            _check_inside(field, scene, point)
        if not robot.curve:
            _check_inside(children["target"], scene, robot.target)
        for name, least in (("radius", robot.radius), ("turning radius", robot.spec.min_turn_radius)):
            if scene.safety_margin < least:
                entries["safety_margin"].fail(
                    f"{scene.safety_margin:g} is below the {name} {least:g} of {robot.id}",
                    "it is measured from the robot's centre: give at least that",
                )
        if scene.boundary_speed >= robot.speed:
            field = entries.get("boundary_speed", children["speed"])
            field.fail(
                f"boundary_speed {scene.boundary_speed:g} is not below the speed {robot.speed:g} of {robot.id}",
                "robots must be faster than any boundary (assumption of ch. 4)",
            )
    for index, robot in enumerate(scene.robots):
        for other in scene.robots[:index]:
            if math.dist(robot.start, other.start) < robot.radius + other.radius:
                items_of(entries, "robots")[index].children()["start"].fail(
                    f"{_text(robot.start)} overlaps the sphere of {other.id}", "move the start away"
                )


def _check_movers(entries: dict[str, Field], scene: SpaceScene) -> None:
    for item, mover in zip(items_of(entries, "movers"), scene.movers, strict=True):
        if mover.speed > scene.boundary_speed * (1.0 + 1e-9):
            item.children()["speed"].fail(
                f"{mover.id} moves at {mover.speed:g} m/s, faster than boundary_speed {scene.boundary_speed:g}",
                "raise boundary_speed or slow the mover down",
            )
