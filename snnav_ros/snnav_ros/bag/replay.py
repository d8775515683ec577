"""Replay a recorded run through fusion and planner, without ROS, and compare the paths."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np

from snnav_core.area.fusion import AreaFusion
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.sensing.scan import PlanarScan
from snnav_core.types import PlannedPath, RobotState
from snnav_ros.bag.errors import BagError
from snnav_ros.bag.reader import BagReader
from snnav_ros.convert import (
    area_from_message,
    goal_from_message,
    nanoseconds_from_stamp,
    path_from_message,
    scan_from_message,
    seconds,
    state_from_message,
)
from snnav_sim.configure import fusion_settings, navigator_settings, planar_sensor
from snnav_sim.scene import Scene, load_scene

__all__ = ["STOP", "Replay", "ReplayedStep", "replay"]

STOP = "stop"
"""Stands for the digest of an empty path."""

_AREA = "unoccupied_area"

Value = TypeVar("Value")


@dataclass(frozen=True)
class ReplayedStep:
    """One sampling instant: what was recorded and what came out now.

    Parameters
    ----------
    time : float
        [s]
    same_area : bool
        Whether the unoccupied area has exactly the recorded vertices.
    recorded, replayed : dict
        Robot id -> digest of its path, or `STOP`.
    """

    time: float
    same_area: bool
    recorded: dict[str, str]
    replayed: dict[str, str]


@dataclass(frozen=True)
class Replay:
    """All sampling instants of a recorded run."""

    steps: tuple[ReplayedStep, ...]

    @property
    def path_count(self) -> int:
        """Number of recorded paths that are not stops."""
        return sum(digest != STOP for step in self.steps for digest in step.recorded.values())

    @property
    def differences(self) -> list[str]:
        """One line for every area or path that differs from the recorded one; empty when all are the same."""
        lines = []
        for step in self.steps:
            if not step.same_area:
                lines.append(f"{step.time:.3f} s: the unoccupied area differs")
            for robot in sorted(step.recorded.keys() | step.replayed.keys()):
                before, now = step.recorded.get(robot, "nothing"), step.replayed.get(robot, "nothing")
                if before != now:
                    lines.append(f"{step.time:.3f} s: path of {robot} was {before}, now {now}")
        return lines


@dataclass
class _Recording:
    """What a bag holds, by header stamp [ns]; goals by the time of recording."""

    scans: dict[int, dict[str, PlanarScan]] = field(default_factory=dict)
    states: dict[int, dict[str, RobotState]] = field(default_factory=dict)
    areas: dict[int, UnoccupiedArea] = field(default_factory=dict)
    paths: dict[int, dict[str, str]] = field(default_factory=dict)
    goals: dict[int, dict[str, tuple[float, float]]] = field(default_factory=dict)


def replay(bag: str | Path, scene: Scene | None = None) -> Replay:
    """Feed the scans, odometry and goals of a run to fusion and planner at its sampling instants.

    Parameters
    ----------
    bag : path-like
        Recording of `snnav run` with the topics sensors/<id>/scan, <robot>/odom, <robot>/goal_pose (if any came),
        unoccupied_area and <robot>/path.
    scene : Scene, optional
        The scene of the run; by default ``scene.yaml`` beside the bag.

    Returns
    -------
    Replay
        Deterministic; `Replay.differences` is empty when every area and path is the recorded one.

    Raises
    ------
    BagError
        If the bag cannot be read or a topic is missing.
    SceneError
        If the scene cannot be read.
    """
    bag = Path(bag)
    scene = scene or load_scene(bag.parent / "scene.yaml")
    recording = _read(bag, scene)
    fusion = AreaFusion([planar_sensor(sensor) for sensor in scene.sensors], fusion_settings(scene))
    navigator = GroundNavigator([robot.spec for robot in scene.robots], navigator_settings(scene))
    goals = {robot.id: robot.target for robot in scene.robots}
    states: dict[str, RobotState] = {}
    steps = []
    last = -1
    for stamp in sorted(recording.areas):
        for sensor_id, scan in sorted(_between(recording.scans, last, stamp).items()):
            fusion.add_scan(sensor_id, scan)
        states |= _between(recording.states, last, stamp)
        goals |= _between(recording.goals, last, stamp)
        time, recorded_area = seconds(stamp), recording.areas[stamp]
        area = UnoccupiedArea.from_rings(time, fusion.area(time).rings)  # as the planner gets it by message
        result = navigator.step(time, area, states, goals)
        replayed = {
            name: decision.path.digest() if isinstance(decision, PlannedPath) else STOP
            for name, decision in result.decisions.items()
        }
        same = _same_rings(area, recorded_area)
        steps.append(ReplayedStep(time, same, recording.paths.get(stamp, {}), replayed))
        last = stamp
    return Replay(tuple(steps))


def _read(path: Path, scene: Scene) -> _Recording:
    """Read what the replay needs."""
    recording = _Recording()
    scans = {f"sensors/{sensor.id}/scan": sensor.id for sensor in scene.sensors}
    odometry = {f"{robot.id}/odom": robot.id for robot in scene.robots}
    paths = {f"{robot.id}/path": robot.id for robot in scene.robots}
    goals = {f"{robot.id}/goal_pose": robot.id for robot in scene.robots}
    with BagReader(path) as bag:
        there = {topic.strip("/") for topic in bag.topics}
        needed = [*scans, *odometry, *paths, _AREA]
        for entry in bag.messages([*needed, *(topic for topic in goals if topic in there)]):
            topic, message = entry.topic.strip("/"), entry.message
            stamp = nanoseconds_from_stamp(message.header.stamp)
            if topic in scans:
                recording.scans.setdefault(stamp, {})[scans[topic]] = scan_from_message(message)
            elif topic in odometry:
                robot = odometry[topic]
                recording.states.setdefault(stamp, {})[robot] = state_from_message(message, robot, topic)
            elif topic in paths:
                timed = path_from_message(message, topic)
                digest = STOP if timed is None else timed.digest()
                recording.paths.setdefault(stamp, {})[paths[topic]] = digest
            elif topic in goals:
                recording.goals.setdefault(entry.stamp_ns, {})[goals[topic]] = goal_from_message(
                    message, topic
                )
            else:
                recording.areas[stamp] = area_from_message(message, topic)
    if not recording.areas:
        raise BagError(f"{path}: no message on {_AREA!r}; record the run to its first sampling instant")
    return recording


def _between(entries: dict[int, dict[str, Value]], last: int, stamp: int) -> dict[str, Value]:
    """Return the latest entry of every name stamped after `last` and not after `stamp` [ns]."""
    found: dict[str, Value] = {}
    for time in sorted(entries):
        if last < time <= stamp:
            found |= entries[time]
    return found


def _same_rings(first: UnoccupiedArea, second: UnoccupiedArea) -> bool:
    return len(first.rings) == len(second.rings) and all(
        np.array_equal(one, other) for one, other in zip(first.rings, second.rings, strict=True)
    )
