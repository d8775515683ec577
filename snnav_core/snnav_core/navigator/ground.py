"""One decision step for all ground robots: unoccupied area, robots, goals -> certified paths or typed stops (Ch. 3)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.errors import GoalBlocked, GoalUnreachable, InvalidInput, PlanningError, StartBlocked
from snnav_core.navigator.attempt import Attempt, margin_profiles
from snnav_core.navigator.context import AreaContext, Disks
from snnav_core.navigator.search import Route, find_route, route_candidates, turn_heading
from snnav_core.navigator.settings import NavigatorSettings, RobotDistances
from snnav_core.planning.adjustment import resample
from snnav_core.planning.certificate import OtherRobot, separation_fault
from snnav_core.types import (
    FloatArray,
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

__all__ = ["GroundNavigator"]

_ALIGNED = 0.02  # a turn by less than this [rad] brings nothing

_REASONS: dict[type[PlanningError], StopReason] = {
    StartBlocked: StopReason.START_BLOCKED,
    GoalBlocked: StopReason.GOAL_BLOCKED,
    GoalUnreachable: StopReason.GOAL_UNREACHABLE,
}


@dataclass(frozen=True)
class _Memory:
    """What the navigator keeps of one robot from step to step."""

    goal: tuple[float, float]
    target: FloatArray
    plan: PlannedPath | None = None
    profile: int = 0
    steps_since_search: int = 0
    arrived: bool = False


@dataclass(frozen=True)
class _Failure:
    """A fruitless search, so that it is not repeated while nothing has changed."""

    situation: tuple[object, ...]
    stop: Stop


@dataclass(frozen=True)
class _Outcome:
    """Result of a search: a path, or why there is none; the route tells where a turn in place should point."""

    best: PlannedPath | None
    stop: Stop
    route: Route | None


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
        self._memory: dict[str, _Memory] = {}
        self._failures: dict[str, _Failure] = {}
        self._states: dict[str, RobotState] = {}
        self._context: AreaContext | None = None
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
            A(t).
        states : mapping
            Robot id -> measured state, stamped t (up to one sampling interval old).
        goals : mapping
            Robot id -> target [m, map].

        Returns
        -------
        StepResult
            For every robot a path whose certificate is accepted, or a stop with reason and message.

        Notes
        -----
        Deviations: the last path is adjusted again first and replaced only by one shorter by `switch_gain` (C3-26);
        when nothing verifies, the last path is followed while it verifies for at least one interval (C3-14); a robot
        that cannot leave along its heading turns on the spot. Others are moving disks along their own paths, each
        planned around those before it (C3-2, C4-10).
        """
        if time < self._time:
            self.reset()
        self._time = time
        self._update_context(area)
        self._states.update({name: state for name, state in states.items() if name in self.robots})
        decisions: dict[str, PlannedPath | Stop] = {}
        for name, robot in self.robots.items():
            others = self._others(name, time, decisions)
            decisions[name] = self._decide(robot, time, states.get(name), goals.get(name), others)
        self._settle(time, decisions)
        for name, decision in decisions.items():
            self._remember(name, decision)
        return StepResult(time, decisions)

    def _update_context(self, area: UnoccupiedArea) -> None:
        fresh = AreaContext(area, self.settings.simplification)
        if self._context is not None and self._context.digest == fresh.digest:
            self._context.area = self._context.area.restamped(area.stamp, area.contradictions)
            self._changed = False
        else:
            self._context, self._changed = fresh, True

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
            plan = memory.plan if decision is None and memory is not None else None
            if isinstance(decision, PlannedPath):
                path = decision.path
            elif plan is not None and time < plan.certificate.valid_until:
                path = plan.path
            else:
                path = TimedPath(time, self._distances[other].step, state.pose.position[None])
            radius = max(robot.radius, self.robots[name].radius)
            others.append(OtherRobot(other, radius, path))
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
        if state is None or time - state.stamp > self.settings.sampling_interval + 1e-6:
            age = "never measured" if state is None else f"measured {time - state.stamp:.2f} s ago"
            return Stop(
                robot.id, StopReason.NO_STATE, f"pose of robot {robot.id} was {age}; check its odometry"
            )
        if goal is None:
            return Stop(robot.id, StopReason.NO_GOAL, f"robot {robot.id} has no goal")
        if context.area.is_empty:
            return Stop(robot.id, StopReason.NO_AREA, "nothing is known to be free; check the sensors")
        memory = self._memory.get(robot.id)
        if memory is None or memory.goal != goal:
            memory = _Memory(goal, np.array(goal, dtype=np.float64))
            self._memory[robot.id] = memory
        distance = float(np.linalg.norm(state.pose.position - memory.target))
        if (
            memory.arrived
            or min(distance, math.dist(goal, state.pose.position)) <= self._distances[robot.id].arrival
        ):
            self._memory[robot.id] = replace(memory, arrived=True)
            return Stop(robot.id, StopReason.ARRIVED, f"robot {robot.id} is {distance:.2f} m from its target")
        return self._plan(robot, time, state.pose, others, context, memory)

    def _plan(
        self,
        robot: RobotSpec,
        time: float,
        pose: Pose2D,
        others: Sequence[OtherRobot],
        context: AreaContext,
        memory: _Memory,
    ) -> PlannedPath | Stop:
        distances = self._distances[robot.id]
        planned_for = memory.plan.planning_distance if memory.plan is not None else distances.least
        attempt = Attempt(
            context, robot, pose, memory.target, time, others, distances, self.settings, planned_for
        )
        best = self._warm(attempt, memory)
        due = self._changed and memory.steps_since_search + 1 >= self.settings.search_interval
        if best is not None and attempt.is_full(best) and not due:
            return best
        situation = (context.digest, pose, tuple(other.path.points.tobytes() for other in others))
        failure = self._failures.get(robot.id)
        if best is None and failure is not None and failure.situation == situation:
            return failure.stop
        self._memory[robot.id] = replace(self._memory[robot.id], steps_since_search=-1)
        outcome = self._search(attempt, best, memory)
        decision = outcome.best or self._kept(attempt, memory) or self._turn(attempt, outcome.route)
        if decision is None:
            self._failures[robot.id] = _Failure(situation, outcome.stop)
        return decision or outcome.stop

    def _profiles(self, attempt: Attempt, route_distance: float) -> list[FloatArray]:
        present = attempt.context.clearance(attempt.pose.position)
        return margin_profiles(attempt.distances, self.settings, attempt.robot, route_distance, present)

    def _warm(self, attempt: Attempt, memory: _Memory) -> PlannedPath | None:
        """The last path, shifted to the robot and adjusted again."""
        if memory.plan is None or memory.plan.path.turn_to is not None:
            return None
        chain = _remainder(memory.plan.path, attempt.pose, attempt.distances.link)
        if chain is None:
            return None
        points = resample(chain, attempt.distances.link)
        rotation = _side(chain, attempt.pose)
        best: PlannedPath | None = None
        profiles = self._profiles(attempt, memory.plan.planning_distance)
        first = 0 if memory.steps_since_search == 0 else min(memory.profile, len(profiles) - 1)
        order = [first, *(index for index in range(len(profiles)) if index != first)]
        for index in order:
            plan = attempt.adjusted(
                points, rotation, profiles[index], self.settings.adjustment.warm_passes, PathSource.WARM_START
            )
            best = _better(best, plan)
            if attempt.is_full(plan):
                self._memory[attempt.robot.id] = replace(self._memory[attempt.robot.id], profile=index)
                break
        return best

    def _search(self, attempt: Attempt, best: PlannedPath | None, memory: _Memory) -> _Outcome:
        """Best of the warm start and of new candidates, and the typed reason should there be none."""
        robot = attempt.robot
        disks = self._standing(attempt)
        try:
            route = find_route(
                attempt.context,
                robot,
                attempt.pose,
                np.array(memory.goal),
                attempt.distances,
                self.settings,
                disks,
            )
        except PlanningError as error:
            return _Outcome(best, self._stop_for(error, attempt, memory, disks), None)
        self._memory[robot.id] = replace(self._memory[robot.id], target=route.target)
        attempt = replace(attempt, target=route.target, planning_distance=route.distance)
        rejected = "no candidate leaves along the heading of the robot"
        candidates = route_candidates(attempt.context, route, attempt.pose, attempt.distances, self.settings)
        for candidate in candidates[: self.settings.max_adjusted]:
            enough = math.inf
            if best is not None and attempt.is_full(best):
                enough = (1.0 - self.settings.switch_gain) * best.path.length
            if candidate.length > enough:
                break
            plan = self._best_profile(attempt, candidate.polyline, candidate.rotation, candidate.source)
            if not plan.certificate.accepted:
                rejected = plan.certificate.reason
            elif best is None or self._replaces(attempt, plan, best):
                best = plan
                if attempt.is_full(plan):
                    break
        message = f"robot {robot.id}: {len(candidates)} candidates, none certified; the last: {rejected}"
        reason = StopReason.BLOCKED_BY_ROBOT if "of robot" in rejected else StopReason.NO_PATH
        return _Outcome(best, Stop(robot.id, reason, message), route)

    def _best_profile(
        self, attempt: Attempt, polyline: FloatArray, rotation: int, source: PathSource
    ) -> PlannedPath:
        points = resample(polyline, attempt.distances.link)
        best: PlannedPath | None = None
        for margins in self._profiles(attempt, attempt.planning_distance):
            plan = attempt.adjusted(points, rotation, margins, self.settings.adjustment.cold_passes, source)
            best = _better(best, plan) or plan
            if attempt.is_full(plan):
                return plan
        assert best is not None
        return best

    def _replaces(self, attempt: Attempt, plan: PlannedPath, best: PlannedPath) -> bool:
        if attempt.is_full(plan) != attempt.is_full(best):
            return attempt.is_full(plan)
        return plan.path.length < (1.0 - self.settings.switch_gain) * best.path.length

    def _stop_for(self, error: PlanningError, attempt: Attempt, memory: _Memory, disks: Disks) -> Stop:
        robot = attempt.robot
        if disks and not isinstance(error, StartBlocked):
            try:
                find_route(
                    attempt.context,
                    robot,
                    attempt.pose,
                    np.array(memory.goal),
                    attempt.distances,
                    self.settings,
                    (),
                )
            except PlanningError as without:
                error = without
            else:
                names = ", ".join(other.id for other in attempt.others if _stands(other, attempt.time))
                return Stop(
                    robot.id,
                    StopReason.BLOCKED_BY_ROBOT,
                    f"robot {robot.id} waits: the way to its target is blocked by standing robots ({names})",
                )
        return Stop(robot.id, _REASONS.get(type(error), StopReason.NO_PATH), str(error))

    def _standing(self, attempt: Attempt) -> Disks:
        """Disks that candidates go around: standing robots, with the margin and the reserve."""
        clearance = attempt.distances.least + self.settings.planning_reserve
        disks = []
        for other in attempt.others:
            if _stands(other, attempt.time):
                x, y = other.path.points[-1, :2]
                disks.append((float(x), float(y), other.radius + clearance))
        return tuple(disks)

    def _kept(self, attempt: Attempt, memory: _Memory) -> PlannedPath | None:
        """The last path as it is, while it verifies for at least one sampling interval (C3-14)."""
        if memory.plan is None or memory.plan.path.turn_to is not None:
            return None
        chain = _remainder(memory.plan.path, attempt.pose, attempt.distances.link)
        if chain is None:
            return None
        plan = attempt.kept(chain)
        return plan if plan.certificate.accepted else None

    def _turn(self, attempt: Attempt, route: Route | None) -> PlannedPath | None:
        """A turn on the spot towards the shortest way."""
        if route is None or not attempt.robot.can_turn_in_place:
            return None
        heading = turn_heading(attempt.context, route, attempt.pose)
        if heading is None or abs(math.remainder(heading - attempt.pose.heading, 2.0 * math.pi)) < _ALIGNED:
            return None
        points = np.repeat(attempt.pose.position[None], attempt.distances.window_points + 1, axis=0)
        path = TimedPath(attempt.time, attempt.distances.step, points, turn_to=heading)
        plan = attempt.planned(path, PathSource.TURN_IN_PLACE)
        return plan if plan.certificate.accepted else None

    def _settle(self, time: float, decisions: dict[str, PlannedPath | Stop]) -> None:
        """Stop robots whose paths no longer agree with what others decided after them, until all agree."""
        end = time + self.settings.time_window * self.settings.sampling_interval
        changed = True
        while changed:
            changed = False
            for name, decision in decisions.items():
                if not isinstance(decision, PlannedPath):
                    continue
                others = self._others(name, time, decisions)
                until = min(end, decision.certificate.valid_until)
                least, fault = separation_fault(decision.path, others, until, self.settings.safety_margin)
                if fault:
                    decisions[name] = Stop(name, StopReason.BLOCKED_BY_ROBOT, f"robot {name} waits: {fault}")
                    changed = True
                else:
                    certificate = replace(decision.certificate, least_separation=least)
                    decisions[name] = replace(decision, certificate=certificate)

    def _remember(self, name: str, decision: PlannedPath | Stop) -> None:
        memory = self._memory.get(name)
        if memory is None:
            return
        plan = decision if isinstance(decision, PlannedPath) else None
        self._memory[name] = replace(memory, plan=plan, steps_since_search=memory.steps_since_search + 1)


def _stands(other: OtherRobot, time: float) -> bool:
    return bool(np.all(other.path.positions_at(np.array([time])) == other.path.points[-1]))


def _better(best: PlannedPath | None, plan: PlannedPath) -> PlannedPath | None:
    """The accepted plan with the longer window; None while none is accepted."""
    if not plan.certificate.accepted:
        return best
    if best is None or plan.certificate.valid_until > best.certificate.valid_until + 1e-6:
        return plan
    return best


def _remainder(path: TimedPath, pose: Pose2D, link: float) -> FloatArray | None:
    """The part of a path that lies ahead of the robot, from the robot on; None at its end."""
    points = np.asarray(path.points)
    if len(points) < 2:
        return None
    position = pose.position
    begin, change = points[:-1], np.diff(points, axis=0)
    share = np.einsum("ij,ij->i", position - begin, change) / np.maximum(
        np.einsum("ij,ij->i", change, change), 1e-18
    )
    foot = begin + np.clip(share, 0.0, 1.0)[:, None] * change
    # The robot is near the front of its path: a later part that comes back past it is not meant.
    window = min(len(foot), 4 * max(1, math.ceil(len(foot) / 8)) + 8)
    nearest = int(np.argmin(np.linalg.norm(foot[:window] - position, axis=1)))
    ahead = points[nearest + 1 :]
    if float(np.linalg.norm(ahead[0] - position)) < 0.3 * link:
        ahead = ahead[1:]
    if len(ahead) == 0:
        return None
    return np.vstack((position, ahead))


def _side(points: FloatArray, pose: Pose2D) -> int:
    """Side of the heading on which a path starts: +1 left, -1 right."""
    direction = points[1] - points[0]
    across = math.cos(pose.heading) * direction[1] - math.sin(pose.heading) * direction[0]
    return 1 if across >= 0.0 else -1
