"""Plan once for every robot through space-time, watch the plans, and publish what holds (Ch. 2)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from snnav_core.area.tracker_settings import TrackedScene
from snnav_core.errors import InvalidInput, PlanningError
from snnav_core.navigator.global_settings import GlobalSettings
from snnav_core.navigator.journey import Journey, Situation, bent, deviates, go_on, set_out
from snnav_core.navigator.prediction import predicted_pose, state_fault, up_to
from snnav_core.navigator.refusals import not_tracked, stop_for
from snnav_core.planning.spacetime import plan_in_spacetime, readjust
from snnav_core.planning.spacetime_problem import OtherRobot, SpacetimePlan, SpacetimeProblem
from snnav_core.planning.travel_bound import travel_bound
from snnav_core.types import (
    PathSource,
    PlannedPath,
    Pose2D,
    RobotSpec,
    RobotState,
    StepResult,
    Stop,
    StopReason,
    TimedPath,
)

__all__ = ["GlobalNavigator"]


@dataclass(frozen=True)
class _Memory:
    """What is known of one robot from earlier decisions.

    Parameters
    ----------
    goal : tuple of float
        [m, map]
    journey : Journey or None
        What it follows.
    arrived : bool
    tried : float
        When a way was sought last [s].
    refusal : Stop or None
        What came of it, when there was no way.
    doubted : int
        Decisions in a row at which the rest of the path did not hold.
    """

    goal: tuple[float, float]
    journey: Journey | None = None
    arrived: bool = False
    tried: float = -math.inf
    refusal: Stop | None = None
    doubted: int = 0


class GlobalNavigator:
    """Plans for all ground robots of a workspace, each once, in turn.

    Parameters
    ----------
    robots : sequence of RobotSpec
        In order of priority: a robot is planned around the paths of those before it.
    settings : GlobalSettings
    rng : numpy.random.Generator, optional
        For ties in the search for a path; by default one of seed 0.

    Raises
    ------
    InvalidInput
        If names repeat, or a robot is larger than the safety margin.

    Notes
    -----
    What is promised: while bodies keep their velocities within the deviations that they were measured with, a robot
    that drives keeps the safety margin from them. A body that changes its velocity is noticed at the next decision;
    until then, and no longer, the margin can be missed by what the body has moved otherwise meanwhile. Then the robot
    has another certified path, or stands; it goes on with less than the margin only where standing would leave even
    less within the window, and never so that it would touch something. A robot that stands without a path is not moved
    out of the way of what comes to it.
    """

    def __init__(
        self,
        robots: Sequence[RobotSpec],
        settings: GlobalSettings,
        rng: np.random.Generator | None = None,
    ) -> None:
        ids = [robot.id for robot in robots]
        if len(set(ids)) != len(ids):
            raise InvalidInput(f"robot ids {ids} are not all different")
        self.settings = settings
        self.robots: dict[str, RobotSpec] = {}
        self._rng = np.random.default_rng(0) if rng is None else rng
        self.reset()
        for robot in robots:
            self.add_robot(robot)

    @property
    def plans(self) -> dict[str, SpacetimePlan]:
        """The plan that each robot follows, with all its candidates, for display; robots without one are left out."""
        return {
            name: memory.journey.plan for name, memory in self._memory.items() if memory.journey is not None
        }

    @property
    def last(self) -> StepResult | None:
        """What was decided last."""
        return self._last

    def add_robot(self, robot: RobotSpec) -> None:
        """Take a robot into the workspace, last in order.

        Raises
        ------
        InvalidInput
            If there is one of this name, or its disk is larger than the safety margin.
        """
        margin = self.settings.spacetime.safety_margin
        if robot.id in self.robots:
            raise InvalidInput(f"robot {robot.id} is there already; robot ids must be different")
        if robot.radius > margin:
            raise InvalidInput(
                f"safety_margin {margin} m is below the radius {robot.radius} m of robot {robot.id}"
            )
        self.robots[robot.id] = robot

    def remove_robot(self, robot_id: str) -> None:
        """Forget a robot that was taken out of the workspace; a name that is not known is no fault."""
        for known in (self.robots, self._memory, self._states, self._given):
            known.pop(robot_id, None)

    def reset(self) -> None:
        """Forget all plans, as after a jump of time."""
        self._memory: dict[str, _Memory] = {}
        self._states: dict[str, RobotState] = {}
        self._given: dict[str, PlannedPath] = {}  # what robots may still follow
        self._last: StepResult | None = None
        self._time = -math.inf

    def step(
        self,
        time: float,
        scene: TrackedScene,
        states: Mapping[str, RobotState],
        goals: Mapping[str, tuple[float, float]],
    ) -> StepResult:
        """Decide for every robot at one sampling instant.

        Parameters
        ----------
        time : float
            t [s].
        scene : TrackedScene
            Bodies and workspace as measured up to t.
        states : mapping
            Robot id -> measured state, stamped t (up to one sampling interval old).
        goals : mapping
            Robot id -> target [m, map].

        Returns
        -------
        StepResult
            For every robot what is left of its path, whose certificate is accepted for the present measurement, a turn
            in place before its path starts, or a stop with reason and message.

        Raises
        ------
        InvalidInput
            If the time is not finite.

        Notes
        -----
        Deviations: the thesis plans once and tracks. Here every path is checked again at every instant, and is given
        out for a short time only. Who was planned before others and finds no way around those that are still to start
        is planned without them, and they around it.
        """
        if not math.isfinite(time):
            raise InvalidInput(f"time of the decision is {time}, must be finite; stop the robots")
        if time < self._time:
            self.reset()
        self._time = time
        for name, state in states.items():
            if name in self.robots and not state_fault(state, time, self.settings.interval):
                self._states[name] = state
        self._poses = {name: self._pose(name, time) for name in self._states}
        decided: dict[str, PlannedPath | Stop] = {}
        for name, robot in self.robots.items():
            unusable = state_fault(states.get(name), time, self.settings.interval)
            if unusable:
                message = f"pose of robot {name} {unusable}; check its odometry"
                decided[name] = Stop(name, StopReason.NO_STATE, message)
            else:
                decided[name] = self._decide(robot, time, scene, goals, decided)
        self._settle(time, scene, decided)
        silent = {name: plan for name, plan in self._given.items() if _is_silent(decided.get(name))}
        self._given = silent | {name: one for name, one in decided.items() if isinstance(one, PlannedPath)}
        self._last = StepResult(time, decided)
        return self._last

    # --- one robot

    def _decide(
        self,
        robot: RobotSpec,
        time: float,
        scene: TrackedScene,
        goals: Mapping[str, tuple[float, float]],
        decided: Mapping[str, PlannedPath | Stop],
    ) -> PlannedPath | Stop:
        name, goal = robot.id, goals.get(robot.id)
        if goal is None or not all(math.isfinite(value) for value in goal):
            self._memory.pop(name, None)
            what = "has no goal" if goal is None else f"has the goal {goal}, which is not finite; set another"
            return Stop(name, StopReason.NO_GOAL, f"robot {name} {what}")
        memory = self._memory.get(name)
        if memory is None or memory.goal != goal:
            memory = _Memory(goal)
        pose = self._poses[name]
        left = math.dist(goal, (pose.x, pose.y))
        if memory.arrived or (left <= self.settings.arrival_distance and _is_over(memory.journey, time)):
            self._memory[name] = _Memory(goal, arrived=True)
            return Stop(name, StopReason.ARRIVED, f"robot {name} is {left:.2f} m from its target")
        if not scene.workspace:
            return Stop(name, StopReason.NO_AREA, "nothing is known to be free; check the sensors")
        now = self._situation(robot, time, scene, decided)
        decision, self._memory[name] = self._follow(now, memory)
        return decision

    def _follow(self, now: Situation, memory: _Memory) -> tuple[PlannedPath | Stop, _Memory]:
        """What is left of the plan, if it holds; else another one."""
        journey, decision, reason, holds = memory.journey, None, "", False
        if journey is not None:
            step = go_on(now, journey)
            changed = deviates(now, step.journey)
            memory = replace(memory, doubted=0 if step.holds else memory.doubted + 1)
            calm = not changed and step.decision is not None and memory.doubted <= self.settings.doubted_steps
            if not step.holds and not calm:
                step = bent(now, step.journey, self._readjust) or step
            decision, journey, reason, holds = step.decision, step.journey, step.reason, step.holds
            if decision is not None and (calm or (holds and not changed)):
                return decision, replace(memory, journey=journey)
            reason = reason or changed
        memory = replace(memory, journey=None if decision is None else journey)
        waits = not_tracked(now)
        if waits is not None:
            return decision or waits, memory
        pause = self.settings.retry * self.settings.interval - 1e-6
        fresh = memory.refusal is None and (journey is None or decision is None)
        if not fresh and now.time < memory.tried + pause:
            return decision or self._refused(now, memory, reason), memory
        memory = replace(memory, tried=now.time)
        try:
            drives = decision is not None and decision.source is PathSource.SPACETIME
            found = self._set_out(now.at_once() if drives else now, memory.goal)
        except PlanningError as error:
            memory = replace(memory, refusal=stop_for(error, now, memory.goal, self._plan))
            if decision is None:
                return self._refused(now, memory, reason), memory
            return decision, memory
        if holds and decision and journey and not self._is_better(now, found, journey):
            bodies = {body.id: body for body in now.bodies}
            return decision, replace(memory, journey=replace(journey, bodies=bodies), refusal=None)
        first = go_on(now, found)
        if first.decision is None:
            refusal = Stop(now.robot.id, StopReason.NO_PATH, first.reason)
            memory = replace(memory, refusal=refusal)
            return decision or refusal, memory
        return first.decision, replace(memory, journey=first.journey, refusal=None, tried=-math.inf)

    def _refused(self, now: Situation, memory: _Memory, reason: str) -> Stop:
        if memory.refusal is not None:
            return memory.refusal
        return Stop(now.robot.id, StopReason.NO_PATH, reason)

    def _set_out(self, now: Situation, goal: tuple[float, float]) -> Journey:
        """A plan around all others; when they leave no way, without those that will be planned around this robot.

        Where there is no room for what is kept in reserve, without that.
        """
        later = self._later(now.robot.id)
        firm = tuple(other for other in now.others if other.id not in later)
        failure: PlanningError | None = None
        for reserved in (True, False):
            for others in (now.others, firm) if len(firm) < len(now.others) else (firm,):
                try:
                    return set_out(replace(now, others=others), goal, self._plan, reserved)
                except PlanningError as error:
                    failure = failure or error
        assert failure is not None
        raise failure

    def _plan(self, problem: SpacetimeProblem) -> SpacetimePlan:
        plan = plan_in_spacetime(problem, self.settings.spacetime, self._rng)
        if not self.settings.bound or plan.bound is not None:
            return plan
        margin = self.settings.spacetime.safety_margin + self.settings.spacetime.tracking_tolerance
        return replace(plan, bound=travel_bound(problem, margin))

    def _readjust(self, path: TimedPath, problem: SpacetimeProblem) -> TimedPath | None:
        found = readjust(path, problem, self.settings.spacetime)
        return None if found is None else found[0]

    def _is_better(self, now: Situation, found: Journey, journey: Journey) -> bool:
        left = journey.path.end_time - now.time
        return found.path.end_time < journey.path.end_time - self.settings.switch_gain * left

    # --- all robots

    def _pose(self, name: str, time: float) -> Pose2D:
        """Where a robot is now: a state that is older than the decision is carried on along the last path."""
        last = None if self._last is None else self._last.decisions.get(name)
        plan = last if isinstance(last, PlannedPath) else None
        return predicted_pose(self.robots[name], self._states[name], plan, time)

    def _later(self, name: str) -> set[str]:
        """Robots that are decided after one and are not at their target."""
        names = list(self.robots)
        after = names[names.index(name) + 1 :]
        return {other for other in after if other in self._memory and not self._memory[other].arrived} | {
            other for other in after if other not in self._memory
        }

    def _situation(
        self,
        robot: RobotSpec,
        time: float,
        scene: TrackedScene,
        decided: Mapping[str, PlannedPath | Stop],
    ) -> Situation:
        others = []
        for name, other in self.robots.items():
            distance = self.settings.distance_between(robot, other)
            if name != robot.id:
                others += [OtherRobot(name, path, distance) for path in self._ways(name, time, decided)]
        pose = self._poses[robot.id]
        return Situation(robot, pose, time, scene.obstacles, scene.workspace, tuple(others), self.settings)

    def _ways(self, name: str, time: float, decided: Mapping[str, PlannedPath | Stop]) -> list[TimedPath]:
        """Where another robot may be: on its way, or standing; nothing when it was never heard of.

        One that is not heard of any more was told to stop, and may do so or not: it stands anywhere, or goes on.
        """
        decision, memory = decided.get(name), self._memory.get(name)
        if memory is not None and memory.journey is not None and not isinstance(decision, Stop):
            return [memory.journey.path]
        if name not in self._poses:
            return []
        places, ways = self._poses[name].position[None], []
        given, interval = self._given.get(name), self.settings.interval
        if given is not None and _is_silent(decision):
            until, path = given.certificate.valid_until, given.path
            ways = [up_to(path, until)] if time < until else []
            passed = np.arange(self._states[name].stamp, min(time, until) + path.step, path.step)
            places = np.vstack((places, path.positions_at(np.minimum(passed, until))[:, :2]))
        return [*ways, *(TimedPath(time, interval, place[None]) for place in np.unique(places, axis=0))]

    def _settle(self, time: float, scene: TrackedScene, decided: dict[str, PlannedPath | Stop]) -> None:
        """Stop robots whose windows no longer agree with what others decided after them, until all agree."""
        changed = len(self.robots) > 1
        while changed:
            changed = False
            for name in reversed(list(self.robots)):
                decision = decided[name]
                if not isinstance(decision, PlannedPath):
                    continue
                now = replace(
                    self._situation(self.robots[name], time, scene, decided), bodies=(), workspace=None
                )
                verdict = now.window(decision.path)
                if verdict.accepted:
                    continue
                text = f"robot {name} waits: {verdict.reason}"
                decided[name] = Stop(name, StopReason.BLOCKED_BY_ROBOT, text)
                changed = True


def _is_silent(decision: PlannedPath | Stop | None) -> bool:
    """Whether a robot got no path because nothing is heard of it: it may still follow its last one."""
    return isinstance(decision, Stop) and decision.reason is StopReason.NO_STATE


def _is_over(journey: Journey | None, time: float) -> bool:
    """Whether a robot has no more way before it."""
    return journey is None or time >= journey.path.end_time - 1e-6
