"""Scene files: load, check, write, and find the ones that come with the package (docs/scene-format.md)."""

from __future__ import annotations

import difflib
import math
from pathlib import Path
from typing import Any

from snnav_sim.scene_check import check_scene
from snnav_sim.scene_faults import fault_entry
from snnav_sim.scene_read import read_scene
from snnav_sim.scene_text import degrees_of, document, head_entries, outline_entry
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
from snnav_sim.scene_yaml import Field, SceneError, read_document
from snnav_sim.space_check import check_space_scene
from snnav_sim.space_read import is_in_space, read_space_scene
from snnav_sim.space_types import SpaceScene
from snnav_sim.space_write import dump_space_scene

__all__ = [
    "AnyScene",
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
    "SpaceScene",
    "dump_scene",
    "find_scene",
    "list_scenes",
    "load_any_scene",
    "load_scene",
    "parse_any_scene",
    "parse_scene",
]

AnyScene = Scene | SpaceScene

_SHIPPED = Path(__file__).parent / "scenes"


def load_scene(path: Path | str) -> Scene:
    """Read and check the file of a scene in the plane.

    Raises
    ------
    SceneError
        One line with file, line, key, value and remedy.
    """
    return _planar(_read(path))


def load_any_scene(path: Path | str) -> AnyScene:
    """Read and check a scene file, in the plane or in space.

    Raises
    ------
    SceneError
        One line with file, line, key, value and remedy.
    """
    return _any(_read(path))


def _read(path: Path | str) -> Field:
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
    return read_document(text, str(path))


def _planar(root: Field) -> Scene:
    if is_in_space(root):
        remedy = "only `snnav run --core` takes one; here give {polygon: [[x, y], ...]}"
        root.children()["workspace"].fail("a scene in space", remedy)
    scene = read_scene(root)
    check_scene(root, scene)
    return scene


def _any(root: Field) -> AnyScene:
    if not is_in_space(root):
        return _planar(root)
    scene = read_space_scene(root)
    check_space_scene(root, scene)
    return scene


def parse_any_scene(text: str, source: str) -> AnyScene:
    """Read and check a scene in the plane or in space from YAML text; see `parse_scene`."""
    return _any(read_document(text, source))


def parse_scene(text: str, source: str) -> Scene:
    """Read and check a scene in the plane from YAML text.

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
    return _planar(read_document(text, source))


def list_scenes() -> dict[str, str]:
    """Return the names of the scenes that come with the package and their descriptions, sorted."""
    return {path.stem: load_any_scene(path).description for path in sorted(_SHIPPED.glob("*.yaml"))}


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


def dump_scene(scene: AnyScene) -> str:
    """Return the complete YAML of a scene; `parse_any_scene` gives back an equal one."""
    if isinstance(scene, SpaceScene):
        return dump_space_scene(scene)
    head = {
        **head_entries(scene),
        "planner": scene.planner,
        "workspace": outline_entry(scene.border),
    }
    sections: dict[str, list[dict[str, Any]]] = {
        "obstacles": [outline_entry(shape) for shape in scene.obstacles],
        "movers": [_mover(mover) for mover in scene.movers],
        "sensors": [_sensor(sensor) for sensor in scene.sensors],
        "robots": [_robot(robot) for robot in scene.robots],
    }
    return document(head, sections)


def _mover(mover: Mover) -> dict[str, Any]:
    entry: dict[str, Any] = {"id": mover.id, **outline_entry(mover.shape)}
    if mover.start is not None:
        return {**entry, "start": list(mover.start), "velocity": list(mover.velocity)}
    waypoints = [list(point) for point in mover.waypoints]
    return {**entry, "waypoints": waypoints, "speed": mover.speed, "loop": mover.loop}


def _sensor(sensor: SensorScene) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "id": sensor.id,
        "device": sensor.device,
        "position": list(sensor.position),
        "heading_deg": degrees_of(sensor.heading),
        "resolution_deg": degrees_of(sensor.resolution),
        "range_min": sensor.range_min,
        "range_max": sensor.range_max,
        "no_return": sensor.no_return,
    }
    if sensor.device == "recorded":
        entry["angle_min_deg"] = degrees_of(sensor.angle_min)
        if sensor.range_cut is not None:
            entry["range_cut"] = sensor.range_cut
        return {**entry, "ranges": list(sensor.ranges)}
    entry["field_of_view_deg"] = degrees_of(sensor.field_of_view)
    entry |= {"noise": sensor.noise, "drop_out": sensor.drop_out, "error_codes": sensor.error_codes}
    if sensor.scan_period is not None:
        entry["scan_period"] = sensor.scan_period
    entry |= {"scan_offset": sensor.scan_offset, "sees_robots": sensor.sees_robots}
    return {**entry, "faults": [fault_entry(fault) for fault in sensor.faults]}


def _robot(robot: RobotScene) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "id": robot.id,
        "start": list(robot.start),
        "heading_deg": degrees_of(robot.heading),
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
