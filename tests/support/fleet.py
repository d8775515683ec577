"""Unicycles with trackers that do as they are told, for closed loops round a navigator."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping

import numpy as np

from snnav_core.motion.unicycle import step_unicycle
from snnav_core.tracking.planar import PlanarTracker, TrackerSettings
from snnav_core.types import FloatArray, PlannedPath, Pose2D, RobotSpec, RobotState, Stop

CONTROL_PERIOD = 0.05


class Fleet:
    """Where robots are, and the trackers that drive them."""

    def __init__(self, robots: Mapping[str, RobotSpec], poses: Mapping[str, Pose2D]) -> None:
        self.poses = dict(poses)
        self._trackers = {
            name: PlanarTracker(robot, TrackerSettings(), CONTROL_PERIOD) for name, robot in robots.items()
        }

    def states(self, time: float) -> dict[str, RobotState]:
        return {name: RobotState(name, pose, time) for name, pose in self.poses.items()}

    def tell(self, decisions: Mapping[str, PlannedPath | Stop]) -> None:
        """Give robots paths or stops to follow."""
        for name, decision in decisions.items():
            if isinstance(decision, PlannedPath):
                until = decision.certificate.valid_until
                self._trackers[name].set_path(decision.path, self.poses[name].heading, until)
            else:
                self._trackers[name].set_path(None)

    def move(self, time: float, stuck: Collection[str] = ()) -> None:
        """Let a control period pass; robots that are stuck are commanded, but do not move."""
        for name, pose in self.poses.items():
            command = self._trackers[name].command(pose, time)
            if name not in stuck:
                self.poses[name] = step_unicycle(pose, command.speed, command.turn_rate, CONTROL_PERIOD)


def ring(names: str, radius: float = 4.5) -> tuple[dict[str, Pose2D], dict[str, tuple[float, float]]]:
    """Robots on a circle round (10, 6), each heading for the far side, a little off the others' starts."""
    poses, goals = {}, {}
    for index, name in enumerate(names):
        angle = 2.0 * math.pi * index / len(names) + 0.1
        x, y = radius * math.cos(angle), radius * math.sin(angle)
        poses[name] = Pose2D(10.0 + x, 6.0 + y, angle + math.pi)
        goals[name] = (10.0 - 0.9 * x, 6.0 - 0.9 * y)
    return poses, goals


def least_separation(positions: Mapping[str, FloatArray]) -> float:
    """Return the least distance between two robots at any control period [m]."""
    return min(
        float(np.linalg.norm(positions[first] - positions[second], axis=1).min())
        for first, second in itertools.combinations(positions, 2)
    )
