"""All robots as each other have to reckon with them, in a way on which navigators that share them agree."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from snnav_core.navigator.prediction import predicted_pose
from snnav_core.navigator.robot_planner import RobotMemory
from snnav_core.navigator.settings import RobotDistances
from snnav_core.navigator.ways import Party
from snnav_core.types import HeardPath, PlannedPath, RobotSpec, RobotState, Stop

__all__ = ["last_decisions", "party_of"]


def party_of(
    robot: RobotSpec,
    distances: RobotDistances,
    state: RobotState,
    memory: RobotMemory | None,
    goal: tuple[float, float] | None,
    time: float,
    promise: HeardPath | None,
    shared: bool,
) -> Party:
    """Return a robot as others have to reckon with it.

    Parameters
    ----------
    robot : RobotSpec
    distances : RobotDistances
    state : RobotState
        Usable at `time`.
    memory : RobotMemory or None
        What is kept of it if it is served here.
    goal : tuple of float or None
        [m, map]
    time : float
        Of the step [s].
    promise : HeardPath or None
        What was heard of it if another navigator serves it.
    shared : bool
        Whether several navigators share the robots. Then nothing counts that only one of them knows, such as how a path
        goes on beyond its window: all come to the same view of who waits for whom.
    """
    if goal is not None and not all(math.isfinite(value) for value in goal):
        goal = None
    pose = predicted_pose(robot, state, None if memory is None else memory.plan, time)
    target = None if goal is None else np.array(goal)
    if shared:
        arrived = target is not None and float(np.linalg.norm(target - pose.position)) <= distances.arrival
        answers = promise is None or promise.answers
        return Party(robot, distances, pose, target, arrived=arrived, served=answers)
    current = memory is not None and memory.goal == goal
    return Party(
        robot,
        distances,
        pose,
        target,
        None if memory is None else memory.plan,
        memory is not None and current and not memory.evading,
        memory is not None and current and memory.arrived,
    )


def last_decisions(
    own: Mapping[str, PlannedPath | Stop], heard: Mapping[str, HeardPath]
) -> dict[str, PlannedPath | Stop]:
    """Return the decisions of the last instant for all robots, as far as they say who was blocked."""
    foreign = {name: Stop(name, one.stop, "") for name, one in heard.items() if one.stop is not None}
    return {**own, **foreign}
