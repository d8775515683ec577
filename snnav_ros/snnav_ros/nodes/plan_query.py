"""A question to the global planner by hand, as nav_msgs/GetPlan: a plan among the bodies of now, or why none."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from snnav_core.area.tracks import TrackedScene
from snnav_core.errors import (
    GoalBlocked,
    GoalUnreachable,
    InvalidInput,
    NoPathFound,
    PlanningError,
    SnnavError,
    StartBlocked,
)
from snnav_core.navigator.global_ground import GlobalNavigator
from snnav_core.navigator.journey import Situation
from snnav_core.planning.spacetime import plan_in_spacetime
from snnav_core.planning.spacetime_problem import OtherRobot, SpacetimePlan
from snnav_core.types import PlannedPath, Pose2D, RobotState, StopReason, TimedPath
from snnav_ros.convert import MAP_FRAME, check_frame, goal_from_message, seconds_from_stamp, yaw_from_message

__all__ = ["PlanQuery", "query_plan", "reason_of"]

_RINGS, _DIRECTIONS = 4, 16  # where a target is sought within the tolerance

_REASONS: dict[type[SnnavError], str] = {
    StartBlocked: StopReason.START_BLOCKED.value,
    GoalBlocked: StopReason.GOAL_BLOCKED.value,
    GoalUnreachable: StopReason.GOAL_UNREACHABLE.value,
    NoPathFound: StopReason.NO_PATH.value,
    InvalidInput: "invalid_request",
}


def reason_of(error: SnnavError) -> str:
    """Return the typed reason of a failure in one word."""
    return _REASONS.get(type(error), StopReason.NO_PATH.value)


@dataclass(frozen=True)
class PlanQuery:
    """From where, from when on, and where to.

    Parameters
    ----------
    start : Pose2D
        [m, rad, map]
    time : float
        [s]
    goal : tuple of float
        [m, map]
    tolerance : float
        A target that is blocked may be replaced by one no farther away than this [m].
    """

    start: Pose2D
    time: float
    goal: tuple[float, float]
    tolerance: float

    @classmethod
    def of(cls, request: Any, state: RobotState | None, now: float) -> PlanQuery:
        """Return what a GetPlan request asks for.

        Parameters
        ----------
        request : nav_msgs/GetPlan_Request
            A start without frame means where the robot is; one stamped before now means now.
        state : RobotState or None
            Of the robot.
        now : float
            Stamp of the bodies [s].

        Raises
        ------
        InvalidInput
            If a frame is unknown, a number is not finite, or the robot's place is asked for and not known.
        """
        if not (math.isfinite(request.tolerance) and request.tolerance >= 0.0):
            raise InvalidInput(f"plan: tolerance is {request.tolerance}, give metres, at least 0")
        goal = goal_from_message(request.goal, "plan: goal")
        if not request.start.header.frame_id:
            if state is None:
                raise InvalidInput(
                    f"plan: start has no frame_id and the robot has no odometry; give a start in {MAP_FRAME!r}"
                )
            return cls(state.pose, now, goal, float(request.tolerance))
        check_frame(request.start, "plan: start")
        x, y = goal_from_message(request.start, "plan: start")
        start = Pose2D(x, y, yaw_from_message(request.start.pose.orientation))
        time = max(now, seconds_from_stamp(request.start.header.stamp))
        return cls(start, time, goal, float(request.tolerance))

    def targets(self) -> Iterator[tuple[float, float]]:
        """The goal, and places within the tolerance around it, the nearest first."""
        yield self.goal
        for ring in range(1, _RINGS + 1 if self.tolerance > 0.0 else 1):
            for step in range(_DIRECTIONS):
                angle, reach = 2.0 * math.pi * step / _DIRECTIONS, self.tolerance * ring / _RINGS
                yield self.goal[0] + reach * math.cos(angle), self.goal[1] + reach * math.sin(angle)


def query_plan(
    query: PlanQuery,
    robot_id: str,
    navigator: GlobalNavigator,
    scene: TrackedScene,
    states: Mapping[str, RobotState],
) -> SpacetimePlan:
    """Plan for a robot as the navigator would; what it does and what comes of its own decisions does not change.

    Parameters
    ----------
    query : PlanQuery
    robot_id : str
    navigator : GlobalNavigator
    scene : TrackedScene
    states : mapping
        Robot id -> last known state; other robots follow what was decided for them last, or stand.

    Raises
    ------
    PlanningError
        When there is no path, for the typed reason.
    """
    settings = navigator.settings
    others = []
    decided = {} if navigator.last is None else navigator.last.decisions
    for name, other in navigator.robots.items():
        if name == robot_id:
            continue
        decision, distance = decided.get(name), settings.distance_between(navigator.robots[robot_id], other)
        if isinstance(decision, PlannedPath):
            others.append(OtherRobot(name, decision.path, distance))
        elif name in states:
            place = states[name].pose.position[None]
            others.append(OtherRobot(name, TimedPath(query.time, settings.interval, place), distance))
    now = Situation(
        navigator.robots[robot_id],
        query.start,
        query.time,
        scene.obstacles,
        scene.workspace,
        tuple(others),
        settings,
    )
    refusal: PlanningError | None = None
    for target in query.targets():
        problem = now.problem(query.start, query.time, np.array(target), reserved=True)
        try:
            return plan_in_spacetime(problem, settings.spacetime, np.random.default_rng(0))
        except GoalBlocked as error:
            refusal = refusal or error
    assert refusal is not None
    raise refusal
