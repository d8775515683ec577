"""A scene in space as YAML text."""

from __future__ import annotations

from typing import Any

from snnav_sim.scene_faults import fault_entry
from snnav_sim.scene_text import degrees_of, document, head_entries, outline_entry
from snnav_sim.space_types import Body, Box, DepthSensor, FlyerScene, Prism, Solid, SpaceMover, SpaceScene

__all__ = ["dump_space_scene"]


def dump_space_scene(scene: SpaceScene) -> str:
    """Return the complete YAML of a scene in space; reading gives back an equal one."""
    head = {
        **head_entries(scene),
        "grid_spacing": scene.grid_spacing,
        "workspace": {"box": [list(scene.low), list(scene.high)], "known_static": scene.known_border},
    }
    sections = {
        "obstacles": [_obstacle(body) for body in scene.obstacles],
        "movers": [_mover(mover) for mover in scene.movers],
        "sensors": [_sensor(sensor) for sensor in scene.sensors],
        "robots": [_robot(robot) for robot in scene.robots],
    }
    return document(head, sections)


def _shape(solid: Solid) -> dict[str, Any]:
    if isinstance(solid, Box):
        entry: dict[str, Any] = {"box": [list(solid.low), list(solid.high)]}
        if solid.holes:
            entry["holes"] = [[list(low), list(high)] for low, high in solid.holes]
        return entry
    if isinstance(solid, Prism):
        return {**outline_entry(solid.outline), "height": [solid.bottom, solid.top]}
    return {"mesh": solid.file}


def _obstacle(body: Body) -> dict[str, Any]:
    return {**_shape(body.solid), "known_static": body.known_static}


def _mover(mover: SpaceMover) -> dict[str, Any]:
    waypoints = [list(point) for point in mover.waypoints]
    way = {"waypoints": waypoints, "speed": mover.speed, "loop": mover.loop}
    return {"id": mover.id, **_shape(mover.solid), **way}


def _sensor(sensor: DepthSensor) -> dict[str, Any]:
    entry: dict[str, Any] = {"id": sensor.id, "device": sensor.device, "position": list(sensor.position)}
    if sensor.look_at is None:
        entry["heading_deg"] = degrees_of(sensor.heading)
    else:
        entry["look_at"] = list(sensor.look_at)
    entry |= {
        "columns": sensor.columns,
        "rows": sensor.rows,
        "field_of_view_deg": [degrees_of(sensor.width), degrees_of(sensor.height)],
        "range_min": sensor.range_min,
        "range_max": sensor.range_max,
        "noise": sensor.noise,
        "no_return": sensor.no_return,
        "drop_out": sensor.drop_out,
        "scan_offset": sensor.scan_offset,
    }
    for key in ("wrap", "scan_period"):
        if getattr(sensor, key) is not None:
            entry[key] = getattr(sensor, key)
    return {**entry, "faults": [fault_entry(fault) for fault in sensor.faults]}


def _robot(robot: FlyerScene) -> dict[str, Any]:
    goal = {"curve": [list(p) for p in robot.curve]} if robot.curve else {"target": list(robot.target)}
    return {
        "id": robot.id,
        "start": list(robot.start),
        "heading_deg": degrees_of(robot.heading),
        "pitch_deg": degrees_of(robot.pitch),
        **goal,
        "speed": robot.speed,
        "max_turn_rate": robot.max_turn_rate,
        "radius": robot.radius,
    }
