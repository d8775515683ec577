"""The robots of a planner node, from a scene or from parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass

from snnav_core.types import RobotSpec
from snnav_ros.parameters import ParameterReader
from snnav_sim.scene import AnyScene, RobotScene, SpaceScene
from snnav_sim.space_types import FlyerScene

__all__ = ["PlannedRobot", "read_robot_spec", "read_robots"]

Target = tuple[float, ...]  # two numbers in the plane, three in space

_TEXTS = {
    "radius": "Radius of the disk that covers the robot [m].",
    "speed": "Constant travelling speed [m/s].",
    "max_turn_rate": "Largest turn rate u_M [rad/s].",
}


@dataclass(frozen=True)
class PlannedRobot:
    """A robot and its first goal, if it has one from the start."""

    spec: RobotSpec
    target: Target | None


def read_robots(
    reader: ParameterReader, scene: AnyScene | None, *, may_be_none: bool = False
) -> list[PlannedRobot]:
    """Declare the parameters of all robots.

    Parameters
    ----------
    reader : ParameterReader
    scene : Scene or SpaceScene or None
        Its robots that are there at the start, unless the parameter `robots` names others.
    may_be_none : bool
        Whether there may be no robot at the start because robots join.

    Raises
    ------
    ParameterError
        If there is no robot or a value is missing.
    """
    known = {robot.id: PlannedRobot(robot.spec, robot.target) for robot in _there(scene)}
    text = "Ids of the robots in order of priority, each with its own group of parameters; by default the scene's."
    ids: tuple[str, ...] = reader.value("robots", tuple[str, ...], text, tuple(known))
    if not ids and not may_be_none:
        reader.fail("robots", "is empty; list the ids of the robots, or give `scene`")
    if len(set(ids)) != len(ids):
        reader.fail("robots", f"value {list(ids)} names a robot twice; give different ids")
    numbers = (2, 3) if scene is None else (3,) if isinstance(scene, SpaceScene) else (2,)
    return [_read(reader, robot_id, known.get(robot_id), numbers) for robot_id in ids]


def _there(scene: AnyScene | None) -> list[RobotScene | FlyerScene]:
    """Return the robots that are there from the start and want to be planned for."""
    if scene is None:
        return []
    if isinstance(scene, SpaceScene):
        return list(scene.planned)
    return [robot for robot in scene.robots if scene.is_present(robot, 0.0)]


def read_robot_spec(reader: ParameterReader, robot_id: str, known: RobotSpec | None) -> RobotSpec:
    """Declare what has to be known of a robot's body; a value that is missing must be given."""
    values = {}
    for name, text in _TEXTS.items():
        default = {} if known is None else {"default": getattr(known, name)}
        values[name] = reader.value(f"{robot_id}.{name}", float, text, **default)
    turns = reader.value(
        f"{robot_id}.can_turn_in_place",
        bool,
        "Whether the base may turn at speed zero (a differential drive can).",
        True if known is None else known.can_turn_in_place,
    )
    return RobotSpec(robot_id, can_turn_in_place=turns, **values)


def _read(
    reader: ParameterReader, robot_id: str, known: PlannedRobot | None, numbers: tuple[int, ...]
) -> PlannedRobot:
    spec = read_robot_spec(reader, robot_id, None if known is None else known.spec)
    where = f"{robot_id}.target"
    text = "First goal [m, map], in space with its height; else the robot waits for `<robot>/goal_pose`."
    target = reader.value(where, tuple[float, ...] | None, text, None if known is None else known.target)
    if target is not None and (len(target) not in numbers or not all(map(math.isfinite, target))):
        axes = "three numbers [x, y, z]" if numbers == (3,) else "two numbers [x, y]"
        reader.fail(where, f"value {list(target)} is no point; give {axes}")
    return PlannedRobot(spec, target)
