"""Cross-checks between the entries of a scene, each failing at the line of the value to change."""

from __future__ import annotations

import math

import shapely

from snnav_sim.scene_types import Circle, Fault, Point, Scene, SensorScene, Shape
from snnav_sim.scene_yaml import Field

__all__ = ["check_ids", "check_scene", "check_times", "items_of"]


def check_scene(root: Field, scene: Scene) -> None:
    """Check what no single entry shows.

    Parameters
    ----------
    root : Field
        The document that `scene` was read from.
    scene : Scene

    Raises
    ------
    SceneError
        At the first contradiction.
    """
    entries = root.children()
    if not scene.sensors:
        entries["sensors"].fail("an empty list", "add at least one range finder: without any nothing is free")
    check_times(entries, scene.sampling_interval, scene.control_period)
    check_ids(entries)
    _check_events(entries, scene)
    _check_scanners(entries, scene)
    _check_places(entries, scene)
    _check_overlap(entries, scene)
    _check_speeds(entries, scene)
    if scene.recorded and (scene.movers or any(s.device != "recorded" for s in scene.sensors)):
        key = "movers" if scene.movers else "sensors"
        entries[key].fail(
            "beside recorded sensors", "a recorded scan cannot show simulated bodies: use one kind only"
        )


def check_times(entries: dict[str, Field], sampling_interval: float, control_period: float) -> None:
    """Check that a whole number of control periods make a sampling interval."""
    ratio = sampling_interval / control_period
    if round(ratio) < 1 or abs(ratio - round(ratio)) > 1e-6:
        # the control period may be defaulted: then the interval is what the user can see
        field = entries.get("control_period", entries["sampling_interval"])
        fitting = max(1, round(ratio)) * control_period
        field.fail(
            f"sampling_interval {sampling_interval:g} s is no whole multiple of control_period "
            f"{control_period:g} s",
            f"give a control_period that divides it, or sampling_interval: {fitting:g}",
        )


def _check_events(entries: dict[str, Field], scene: Scene) -> None:
    """What happens to a robot happens in order, while it is there, and at different sampling instants."""
    for item, robot in zip(items_of(entries, "robots"), scene.robots, strict=True):
        children, join, leave = item.children(), scene.instant(robot.joins_at), scene.instant(robot.leaves_at)
        if leave <= join:
            children["leaves_at"].fail(
                f"{robot.leaves_at:g} is no later sampling instant than joins_at {robot.joins_at:g}",
                f"give more than {join:g}",
            )
        before = join
        for field, retarget in zip(items_of(children, "retargets"), robot.retargets, strict=True):
            place = field.children()["time"]
            if scene.instant(retarget.time) <= before:
                place.fail(
                    f"{retarget.time:g} is no later sampling instant than what comes before it ({before:g})",
                    "give the times in order, after joins_at",
                )
            before = scene.instant(retarget.time)
            if before >= leave:
                place.fail(
                    f"{retarget.time:g} is not before leaves_at {robot.leaves_at:g}", "give an earlier time"
                )


def _check_scanners(entries: dict[str, Field], scene: Scene) -> None:
    for item, sensor in zip(items_of(entries, "sensors"), scene.sensors, strict=True):
        children, period = item.children(), scene.scan_period(sensor)
        if period < scene.control_period - 1e-9:
            children["scan_period"].fail(
                f"{period:g} is shorter than control_period {scene.control_period:g}",
                "give at least the control period",
            )
        if sensor.scan_offset >= period:
            children["scan_offset"].fail(
                f"{sensor.scan_offset:g} is not below the time {period:g} s from scan to scan",
                "give the time of the first scan",
            )
        for field, fault in zip(items_of(children, "faults"), sensor.faults, strict=True):
            _check_fault(field, fault, sensor)


def _check_fault(field: Field, fault: Fault, sensor: SensorScene) -> None:
    if fault.kind == "frozen" and sensor.noise == "none":
        field.children()["kind"].fail(
            "frozen beside noise: none",
            "add noise: lms200; a repeated scan of a device without noise is the same as a world at rest",
        )
    added = sum(max(0, other.change) for other in sensor.faults)
    beams = sensor.beams + (added if fault.change > 0 else fault.change)
    most = max(sensor.beams, math.floor(2.0 * math.pi / sensor.resolution + 1.0 + 1e-6))
    if fault.change and not 2 <= beams <= most:
        field.children()["change"].fail(
            f"{fault.change} leaves {beams} of {sensor.beams} beams",
            f"leave at least 2 and, within one turn, at most {most}",
        )


def check_ids(entries: dict[str, Field]) -> None:
    """Check that every sensor, robot and mover has its own id."""
    for key in ("sensors", "robots", "movers"):
        seen: dict[str, int] = {}
        for item in items_of(entries, key):
            field = item.children()["id"]
            name = field.text()
            if name in seen:
                field.fail(
                    f"{name} is used twice (first in line {seen[name]})", "give every entry its own id"
                )
            seen[name] = field.line


def items_of(entries: dict[str, Field], key: str) -> list[Field]:
    """Return the fields of a list that may be left out."""
    return entries[key].items("a list") if key in entries else []


def _solid(shape: Shape) -> shapely.Geometry:
    if isinstance(shape, Circle):
        return shapely.Point(shape.x, shape.y).buffer(shape.radius, quad_segs=32)
    return shapely.Polygon(shape.vertices)


def _check_places(entries: dict[str, Field], scene: Scene) -> None:
    workspace = shapely.Polygon(scene.border.vertices)

    def inside(point: Point) -> bool:
        return bool(workspace.distance(shapely.Point(point)) <= 1e-9)

    def check(field: Field, point: Point) -> None:
        if not inside(point):
            field.fail(
                f"[{point[0]:g}, {point[1]:g}] lies outside the workspace", "move it inside the polygon"
            )

    solids = [_solid(shape) for shape in scene.obstacles]
    for item, sensor in zip(items_of(entries, "sensors"), scene.sensors, strict=True):
        field = item.children()["position"]
        check(field, sensor.position)
        for index, solid in enumerate(solids):
            if solid.contains(shapely.Point(sensor.position)) and not scene.recorded:
                field.fail(f"the sensor is inside obstacles[{index}]", "move it out, it would be blind")
    for item, robot in zip(items_of(entries, "robots"), scene.robots, strict=True):
        check(item.children()["start"], robot.start)
        check(item.children()["target"], robot.target)
        for field, retarget in zip(items_of(item.children(), "retargets"), robot.retargets, strict=True):
            check(field.children()["target"], retarget.target)


def _check_speeds(entries: dict[str, Field], scene: Scene) -> None:
    for item, robot in zip(items_of(entries, "robots"), scene.robots, strict=True):
        if scene.safety_margin < robot.radius:
            entries["safety_margin"].fail(
                f"{scene.safety_margin:g} is below the radius {robot.radius:g} of {robot.id}",
                "it is measured from the robot's centre: give at least the radius",
            )
        if scene.boundary_speed >= robot.speed:
            field = entries.get("boundary_speed", item.children()["speed"])
            field.fail(
                f"boundary_speed {scene.boundary_speed:g} is not below the speed {robot.speed:g} of {robot.id}",
                "robots must be faster than any boundary (assumption of ch. 3)",
            )
    for item, mover in zip(items_of(entries, "movers"), scene.movers, strict=True):
        if mover.top_speed > scene.boundary_speed * (1.0 + 1e-9):
            children = item.children()
            children.get("velocity", children.get("speed", item)).fail(
                f"{mover.id} moves at {mover.top_speed:g} m/s, faster than boundary_speed {scene.boundary_speed:g}",
                "raise boundary_speed or slow the mover down",
            )


def _check_overlap(entries: dict[str, Field], scene: Scene) -> None:
    items = items_of(entries, "robots")
    for index, robot in enumerate(scene.robots):
        for other in scene.robots[:index]:
            together = scene.instant(robot.joins_at) == scene.instant(other.joins_at)
            if together and math.dist(robot.start, other.start) < robot.radius + other.radius:
                items[index].children()["start"].fail(
                    f"[{robot.start[0]:g}, {robot.start[1]:g}] overlaps the disk of {other.id}",
                    "move the start away",
                )
