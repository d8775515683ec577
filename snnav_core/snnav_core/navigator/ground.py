"""One decision step for all ground robots: unoccupied area, robots, goals -> certified paths or typed stops (Ch. 3)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from shapely.geometry import MultiPolygon

from snnav_core.area.planar import UnoccupiedArea, shrink
from snnav_core.errors import InvalidInput
from snnav_core.navigator.attempt import Attempt
from snnav_core.navigator.context import AreaContext
from snnav_core.navigator.explain import Explainer
from snnav_core.navigator.prediction import predicted_pose
from snnav_core.navigator.robot_planner import RobotMemory, plan_robot
from snnav_core.navigator.settings import NavigatorSettings, RobotDistances
from snnav_core.planning.separation import OtherRobot, separation
from snnav_core.types import PlannedPath, RobotSpec, RobotState, StepResult, Stop, StopReason, TimedPath

__all__ = ["GroundNavigator"]

_TIME_TOLERANCE = 1e-6


class GroundNavigator:
    """Plans for all ground robots of a workspace.

    Parameters
    ----------
    robots : sequence of RobotSpec
        In order of priority: a robot is planned around the paths of those before it.
    settings : NavigatorSettings

    Raises
    ------
    InvalidInput
        If names repeat, or a robot does not fit the settings (see `RobotDistances`).
    """

    def __init__(self, robots: Sequence[RobotSpec], settings: NavigatorSettings) -> None:
        self.robots = {robot.id: robot for robot in robots}
        if len(self.robots) != len(robots):
            raise InvalidInput(f"robot ids {[robot.id for robot in robots]} are not all different")
        self.settings = settings
        self._distances = {robot.id: RobotDistances(robot, settings) for robot in robots}
        self.reset()

    def reset(self) -> None:
        """Forget all paths, as after a jump of time."""
        self._memory: dict[str, RobotMemory] = {}
        self._states: dict[str, RobotState] = {}
        self._explainer = Explainer(self.settings.search_interval)
        self._context: AreaContext | None = None
        self._previous: AreaContext | None = None
        self._changed = True
        self._time = -math.inf

    def step(
        self,
        time: float,
        area: UnoccupiedArea,
        states: Mapping[str, RobotState],
        goals: Mapping[str, tuple[float, float]],
    ) -> StepResult:
        """Decide for every robot at one sampling instant.

        Parameters
        ----------
        time : float
            t [s].
        area : UnoccupiedArea
            A(t). An older one is reduced by what its boundary may have moved since.
        states : mapping
            Robot id -> measured state, stamped t (up to one sampling interval old).
        goals : mapping
            Robot id -> target [m, map].

        Returns
        -------
        StepResult
            For every robot a path whose certificate is accepted, or a stop with reason and message.

        Raises
        ------
        InvalidInput
            If the time is not finite.

        Notes
        -----
        Deviations: the last path is adjusted again first and replaced only by one shorter by `switch_gain` (C3-26);
        when nothing verifies, the last path is followed while it verifies for at least one interval (C3-14); a robot
        that cannot leave along its heading turns on the spot. Others are moving disks along their own paths, each
        planned around those before it (C3-2, C4-10). A state that is older than the decision is
        carried on along the last path (C3-33).
        """
        if not math.isfinite(time):
            raise InvalidInput(f"time of the decision is {time}, must be finite; stop the robots")
        if time < self._time:
            self.reset()
        self._time = time
        self._update_context(self._aged(area, time))
        for name, state in states.items():
            if name in self.robots and not self._state_fault(time, state):
                self._states[name] = state
        decisions: dict[str, PlannedPath | Stop] = {}
        for name, robot in self.robots.items():
            others = self._others(name, time, decisions)
            decisions[name] = self._decide(robot, time, states.get(name), goals.get(name), others)
        self._settle(time, decisions)
        for name, decision in decisions.items():
            self._remember(name, decision)
        return StepResult(time, decisions)

    def _aged(self, area: UnoccupiedArea, time: float) -> UnoccupiedArea:
        """The part of an older area that is free for sure at `time` [s]; nothing when it is older than the window."""
        age, interval = time - area.stamp, self.settings.sampling_interval
        if not -interval <= age <= self.settings.time_window * interval:
            return UnoccupiedArea(area.stamp, MultiPolygon(), area.contradictions, area.lost)
        if age <= _TIME_TOLERANCE:
            return area
        region = shrink(area.region, age * self.settings.boundary_speed)
        return UnoccupiedArea(area.stamp, region, area.contradictions, area.lost)

    def _update_context(self, area: UnoccupiedArea) -> None:
        fresh = AreaContext(area, self.settings.simplification)
        if self._context is not None and self._context.digest == fresh.digest:
            self._context.area = self._context.area.restamped(area.stamp, area.contradictions, area.lost)
            self._previous, self._changed = None, False
        else:
            self._previous, self._context, self._changed = self._context, fresh, True

    def _others(
        self, name: str, time: float, decisions: Mapping[str, PlannedPath | Stop]
    ) -> list[OtherRobot]:
        """Where the other robots will be: decided already in this step, or on their last path, or standing."""
        others = []
        for other, robot in self.robots.items():
            state = self._states.get(other)
            if other == name or state is None:
                continue
            decision = decisions.get(other)
            memory = self._memory.get(other)
            plan = decision if isinstance(decision, PlannedPath) else None
            if memory is not None and (decision is None or _is_silent(decision)):
                plan = memory.plan
            step = self._distances[other].step
            paths = [TimedPath(time, step, state.pose.position[None])]
            if plan is not None and time < plan.certificate.valid_until:
                paths = [_until(plan.path, plan.certificate.valid_until)]
            elif plan is not None and state.stamp < time - _TIME_TOLERANCE:
                # Not heard of since: it stands somewhere on what was left of its way.
                left = np.arange(state.stamp, plan.certificate.valid_until + 0.5 * step, step)
                paths += [TimedPath(time, step, point[None]) for point in plan.path.positions_at(left)]
            radius = max(robot.radius, self.robots[name].radius)
            parked = plan is None and (memory is None or memory.arrived)
            others += [OtherRobot(other, radius, path, parked) for path in paths]
        return others

    def _decide(
        self,
        robot: RobotSpec,
        time: float,
        state: RobotState | None,
        goal: tuple[float, float] | None,
        others: Sequence[OtherRobot],
    ) -> PlannedPath | Stop:
        context = self._context
        assert context is not None
        unusable = self._state_fault(time, state)
        if state is None or unusable:
            message = f"pose of robot {robot.id} {unusable}; check its odometry"
            return Stop(robot.id, StopReason.NO_STATE, message)
        if goal is None:
            return Stop(robot.id, StopReason.NO_GOAL, f"robot {robot.id} has no goal")
        if not all(math.isfinite(value) for value in goal):
            return Stop(
                robot.id, StopReason.NO_GOAL, f"goal {goal} of robot {robot.id} is not finite; set another"
            )
        memory = self._memory.get(robot.id)
        if memory is None or memory.goal != goal:
            memory = RobotMemory(goal, np.array(goal, dtype=np.float64))
        pose = predicted_pose(robot, state, memory.plan, time)
        position, distances = pose.position, self._distances[robot.id]
        attempt = Attempt(
            context,
            robot,
            pose,
            memory.target,
            time,
            others,
            distances,
            self.settings,
            distances.least,
            self._previous,
        )
        if context.area.is_empty:
            message = f"nothing is known to be free by the area stamped {context.area.stamp:.2f} s; check the sensors"
            return self._explainer.explain(Stop(robot.id, StopReason.NO_AREA, message), attempt, goal)
        distance = float(np.linalg.norm(position - memory.target))
        if memory.arrived or min(distance, math.dist(goal, position)) <= distances.arrival:
            self._memory[robot.id] = replace(memory, arrived=True, plan=None)
            return Stop(robot.id, StopReason.ARRIVED, f"robot {robot.id} is {distance:.2f} m from its target")
        decision, self._memory[robot.id] = plan_robot(attempt, memory, self._changed)
        if isinstance(decision, Stop):
            return self._explainer.explain(decision, attempt, goal)
        self._explainer.forget(robot.id)
        return decision

    def _state_fault(self, time: float, state: RobotState | None) -> str:
        """Why a measured state cannot be used, or an empty string."""
        if state is None:
            return "is missing"
        if not abs(time - state.stamp) <= self.settings.sampling_interval + _TIME_TOLERANCE:
            return f"was measured {time - state.stamp:.2f} s ago"
        pose = state.pose
        if not all(math.isfinite(value) for value in (pose.x, pose.y, pose.heading)):
            return f"is ({pose.x}, {pose.y}, {pose.heading})"
        return ""

    def _settle(self, time: float, decisions: dict[str, PlannedPath | Stop]) -> None:
        """Stop robots whose paths no longer agree with what others decided after them, until all agree."""
        margin, interval = self.settings.safety_margin, self.settings.sampling_interval
        end = time + self.settings.time_window * interval
        changed = True
        while changed:
            changed = False
            for name, decision in decisions.items():
                if not isinstance(decision, PlannedPath):
                    continue
                others = self._others(name, time, decisions)
                until = min(end, decision.certificate.valid_until)
                _, least, fault = separation(decision.path, others, until, margin, interval)
                if fault:
                    decisions[name] = Stop(name, StopReason.BLOCKED_BY_ROBOT, f"robot {name} waits: {fault}")
                    changed = True
                else:
                    certificate = replace(decision.certificate, least_separation=least)
                    decisions[name] = replace(decision, certificate=certificate)

    def _remember(self, name: str, decision: PlannedPath | Stop) -> None:
        if name in self._memory:
            plan = decision if isinstance(decision, PlannedPath) else None
            if not _is_silent(decision):
                self._memory[name] = replace(self._memory[name], plan=plan)


def _is_silent(decision: PlannedPath | Stop) -> bool:
    """Whether a robot got no path because nothing is heard of it: it may still follow its last one."""
    return isinstance(decision, Stop) and decision.reason is StopReason.NO_STATE


def _until(path: TimedPath, end: float) -> TimedPath:
    """The part of a path up to time `end` [s], where the robot stops without a new one."""
    count = math.floor((end - path.start_time) / path.step + 1e-6) + 1
    return path if count >= len(path) else TimedPath(path.start_time, path.step, path.points[: max(count, 1)])
