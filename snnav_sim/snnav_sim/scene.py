"""Scene files: load, check, write, and find the ones that come with the package (docs/scene-format.md)."""

from __future__ import annotations

import difflib
import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from snnav_sim.scene_check import check_scene
from snnav_sim.scene_faults import fault_entry
from snnav_sim.scene_read import read_scene
from snnav_sim.scene_types import (
    Circle,
    Fault,
    Mover,
    Polygon,
    Retarget,
    RobotScene,
    Scene,
    SensorScene,
    Shape,
)
from snnav_sim.scene_yaml import SceneError, read_document

__all__ = [
    "Circle",
    "Fault",
    "Mover",
    "Polygon",
    "Retarget",
    "RobotScene",
    "Scene",
    "SceneError",
    "SensorScene",
    "Shape",
    "dump_scene",
    "find_scene",
    "list_scenes",
    "load_scene",
    "parse_scene",
]

_SHIPPED = Path(__file__).parent / "scenes"


def load_scene(path: Path | str) -> Scene:
    """Read and check a scene file.

    Raises
    ------
    SceneError
        One line with file, line, key, value and remedy.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        line = path.read_bytes()[: error.start].count(b"\n") + 1
        raise SceneError(
            f"{path}:{line}: byte {error.object[error.start]:#04x} is no UTF-8: save as UTF-8"
        ) from None
    except OSError as error:
        raise SceneError(f"{path}: cannot be read ({error.strerror}): give an existing scene file") from None
    return parse_scene(text, str(path))


def parse_scene(text: str, source: str) -> Scene:
    """Read and check a scene from YAML text.

    Parameters
    ----------
    text : str
    source : str
        Name of the file, for messages.

    Raises
    ------
    SceneError
        One line with file, line, key, value and remedy.
    """
    root = read_document(text, source)
    scene = read_scene(root)
    check_scene(root, scene)
    return scene


def list_scenes() -> dict[str, str]:
    """Return the names of the scenes that come with the package and their descriptions, sorted."""
    return {path.stem: load_scene(path).description for path in sorted(_SHIPPED.glob("*.yaml"))}


def find_scene(name_or_path: str) -> Path:
    """Return the file of a scene given by the name of a shipped one or by a path.

    A name of a shipped one is that everywhere, also where a run directory or a file is called the same: that is
    ``./NAME``.

    Raises
    ------
    SceneError
        If there is no such scene.
    """
    path, shipped = Path(name_or_path), _SHIPPED / f"{name_or_path}.yaml"
    if "/" not in name_or_path and shipped.is_file():
        return shipped
    if path.is_file():
        return path
    if path.is_dir():
        raise SceneError(f"{name_or_path or '.'}: is a directory: give a scene file in it, or a name")
    if path.suffix in (".yaml", ".yml") or "/" in name_or_path:
        raise SceneError(f"{name_or_path}: there is no such file: give the path of a scene file, or a name")
    names = sorted(path.stem for path in _SHIPPED.glob("*.yaml"))
    near = difflib.get_close_matches(name_or_path, names, n=1, cutoff=0.4)
    hint = f"did you mean {near[0]}?" if near else "give one of these or the path of a scene file"
    raise SceneError(f"{name_or_path}: no scene of this name (there are {', '.join(names)}): {hint}")


def dump_scene(scene: Scene) -> str:
    """Return the complete YAML of a scene; `parse_scene` gives back an equal one."""
    head = {
        "name": scene.name,
        "description": scene.description,
        "seed": scene.seed,
        "sampling_interval": scene.sampling_interval,
        "control_period": scene.control_period,
        "time_window": scene.time_window,
        "boundary_speed": scene.boundary_speed,
        "safety_margin": scene.safety_margin,
        "time_limit": scene.time_limit,
        "planner": scene.planner,
        "workspace": _shape(scene.border),
    }
    lines = [f"{key}: {_flow(value)}" for key, value in head.items()]
    sections: dict[str, list[dict[str, Any]]] = {
        "obstacles": [_shape(shape) for shape in scene.obstacles],
        "movers": [_mover(mover) for mover in scene.movers],
        "sensors": [_sensor(sensor) for sensor in scene.sensors],
        "robots": [_robot(robot) for robot in scene.robots],
    }
    for key, items in sections.items():
        lines.append(f"{key}:" if items else f"{key}: []")
        lines.extend(f"  - {_flow(item)}" for item in items)
    return "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    text: str = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, width=2**30, allow_unicode=True, explicit_end=False
    )
    return text.removesuffix("\n").removesuffix("\n...")


def _shape(shape: Shape) -> dict[str, Any]:
    if isinstance(shape, Circle):
        return {"circle": [shape.x, shape.y, shape.radius]}
    return {"polygon": [list(vertex) for vertex in shape.vertices]}


def _mover(mover: Mover) -> dict[str, Any]:
    entry: dict[str, Any] = {"id": mover.id, **_shape(mover.shape)}
    if mover.start is not None:
        return {**entry, "start": list(mover.start), "velocity": list(mover.velocity)}
    waypoints = [list(point) for point in mover.waypoints]
    return {**entry, "waypoints": waypoints, "speed": mover.speed, "loop": mover.loop}


def _sensor(sensor: SensorScene) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "id": sensor.id,
        "device": sensor.device,
        "position": list(sensor.position),
        "heading_deg": _degrees(sensor.heading),
        "resolution_deg": _degrees(sensor.resolution),
        "range_min": sensor.range_min,
        "range_max": sensor.range_max,
        "no_return": sensor.no_return,
    }
    if sensor.device == "recorded":
        entry["angle_min_deg"] = _degrees(sensor.angle_min)
        if sensor.range_cut is not None:
            entry["range_cut"] = sensor.range_cut
        return {**entry, "ranges": list(sensor.ranges)}
    entry["field_of_view_deg"] = _degrees(sensor.field_of_view)
    entry |= {"noise": sensor.noise, "drop_out": sensor.drop_out, "error_codes": sensor.error_codes}
    if sensor.scan_period is not None:
        entry["scan_period"] = sensor.scan_period
    entry |= {"scan_offset": sensor.scan_offset, "sees_robots": sensor.sees_robots}
    return {**entry, "faults": [fault_entry(fault) for fault in sensor.faults]}


def _robot(robot: RobotScene) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "id": robot.id,
        "start": list(robot.start),
        "heading_deg": _degrees(robot.heading),
        "target": list(robot.target),
        "speed": robot.speed,
        "max_turn_rate": robot.max_turn_rate,
        "radius": robot.radius,
    }
    if robot.joins_at > 0.0:
        entry["joins_at"] = robot.joins_at
    if math.isfinite(robot.leaves_at):
        entry["leaves_at"] = robot.leaves_at
    if robot.retargets:
        entry["retargets"] = [{"time": one.time, "target": list(one.target)} for one in robot.retargets]
    return entry


def _degrees(angle: float) -> float:
    """Return degrees that convert to exactly this angle, short ones first."""
    degrees = math.degrees(angle)
    for digits in range(16):
        if math.radians(round(degrees, digits)) == angle:
            return round(degrees, digits)
    neighbours = (degrees, np.nextafter(degrees, math.inf), np.nextafter(degrees, -math.inf))
    return float(next((value for value in neighbours if math.radians(value) == angle), degrees))
