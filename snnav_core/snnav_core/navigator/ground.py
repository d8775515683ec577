"""One decision step for all ground robots: unoccupied area, robots, goals -> certified paths or typed stops (Ch. 3)."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.errors import InvalidInput
from snnav_core.navigator.attempt import Attempt
from snnav_core.navigator.context import AreaContext, aged
from snnav_core.navigator.crowd import Cast, Turns, believed, possible_paths
from snnav_core.navigator.explain import Explainer
from snnav_core.navigator.forecast import Trend
from snnav_core.navigator.parties import last_decisions, party_of
from snnav_core.navigator.plans import shortened
from snnav_core.navigator.prediction import (
    halted,
    onwards,
    predicted_pose,
    state_fault,
    up_to,
)
from snnav_core.navigator.right_of_way import RightOfWay
from snnav_core.navigator.robot_planner import RobotMemory, plan_robot
from snnav_core.navigator.settings import NavigatorSettings, RobotDistances
from snnav_core.planning.separation import OtherRobot, separation
from snnav_core.types import (
    TIME_TOLERANCE,
    HeardPath,
    PlannedPath,
    RobotSpec,
    RobotState,
    StepResult,
    Stop,
    StopReason,
)

__all__ = ["GroundNavigator"]

_GRAIN = 0.01  # [m]; in a crowd distances of planning are rounded up to multiples: kinds of robots share what follows
_PLACE_SEARCH = 6  # to look for a place to wait costs about as much as so many searches for a way


class GroundNavigator:
    """Plans for all ground robots of a workspace.

    Parameters
    ----------
    robots : sequence of RobotSpec
        In order of priority: a robot is planned around the paths of those before it.
    settings : NavigatorSettings
    serves : collection of str or None
        Ids of the robots to decide for, also of some that are added later; None for all. Other navigators decide for
        the rest.

    Raises
    ------
    InvalidInput
        If names repeat, or a robot does not fit the settings (see `RobotDistances`).
    """

    def __init__(
        self,
        robots: Sequence[RobotSpec],
        settings: NavigatorSettings,
        serves: Collection[str] | None = None,
    ) -> None:
        ids = [robot.id for robot in robots]
        if len(set(ids)) != len(ids):
            raise InvalidInput(f"robot ids {ids} are not all different")
        self.settings = settings
        self.robots: dict[str, RobotSpec] = {}
        self._serves = None if serves is None else frozenset(serves)
        self._distances: dict[str, RobotDistances] = {}
        self.reset()
        for robot in robots:
            self.add_robot(robot)

    @property
    def served(self) -> list[str]:
        """Ids of the robots in the workspace that are decided for here, in the order they were given."""
        return [name for name in self.robots if self._serves is None or name in self._serves]

    def add_robot(self, robot: RobotSpec) -> None:
        """Take a robot into the workspace, last in order.

        Raises
        ------
        InvalidInput
            If there is one of this name, or it does not fit the settings (see `RobotDistances`).
        """
        if robot.id in self.robots:
            raise InvalidInput(f"robot {robot.id} is there already; robot ids must be different")
        self._distances[robot.id] = RobotDistances(robot, self.settings)
        self.robots[robot.id] = robot

    def remove_robot(self, robot_id: str) -> None:
        """Forget a robot that was taken out of the workspace; a name that is not known is no fault."""
        for known in (self.robots, self._distances, self._memory, self._states, self._promised):
            known.pop(robot_id, None)
        self._explainer.forget(robot_id)
        self._right_of_way.remove(robot_id)

    def reset(self) -> None:
        """Forget all paths, as after a jump of time."""
        self._memory: dict[str, RobotMemory] = {}
        self._before: dict[str, RobotMemory] = {}
        self._states: dict[str, RobotState] = {}
        self._explainer = Explainer(self.settings.search_interval)
        self._right_of_way = RightOfWay(self.settings)
        self._context: AreaContext | None = None
        self._trend = Trend(self.settings)
        self._changed = True
        self._heard: dict[str, HeardPath] = {}
        self._promised: dict[str, HeardPath] = {}  # the same without those who were stopped here
        self._decisions: dict[str, PlannedPath | Stop] = {}
        self._goals: Mapping[str, tuple[float, float]] = {}
        self._cast = Cast()
        self._time = -math.inf

    def withdraw(self) -> None:
        """Take back the last step: nothing of it was published, the robots follow what they had before."""
        self._memory = dict(self._before)

    def step(
        self,
        time: float,
        area: UnoccupiedArea,
        states: Mapping[str, RobotState],
        goals: Mapping[str, tuple[float, float]],
        heard: Mapping[str, HeardPath] = MappingProxyType({}),
    ) -> StepResult:
        """Decide for every robot that is served at one sampling instant.

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
        heard : mapping
            Robot id -> last promise of the navigator that serves it; None for a path says that it stands. Those who
            were decided before at this instant have a path that starts at `time`. An entry without a path for a robot
            that is served here: another navigator stopped it. Names that are not known are not used.

        Returns
        -------
        StepResult
            For every robot that is served a path whose certificate is accepted, or a stop with reason and message;
            and the others that have to be stopped.

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
        self._update_context(aged(area, time, self.settings))
        for name, state in states.items():
            if name in self.robots and not state_fault(state, time, self.settings.sampling_interval):
                self._states[name] = state
        self._hear(heard, goals)
        self._before = dict(self._memory)
        self._cast, sequence = Cast(), self._rank(time, states, goals)
        self._turns = self._share_turns()
        decided: dict[str, PlannedPath | Stop] = {}
        for name in sequence:
            others = self._others(name, time, decided)
            decided[name] = self._decide(self.robots[name], time, states.get(name), goals.get(name), others)
            self._cast.forget(name)
            self._turns.skip(name)
        stop_foreign = self._settle(time, decided)
        self._decisions = decisions = {name: decided[name] for name in self.served}
        for name, decision in decisions.items():
            self._remember(name, decision)
        if self._serves is None:
            self._right_of_way.note(decisions)
        return StepResult(time, decisions, stop_foreign)

    @property
    def _area_context(self) -> AreaContext:
        assert self._context is not None
        return self._context

    def _share_turns(self) -> Turns:
        """Who may seek new ways in this step: in a crowd fewer where places to wait were sought."""
        if len(self.robots) <= self.settings.crowd:
            return Turns(self.settings.searches_per_step)
        waiting = {name: memory.waited for name, memory in self._memory.items() if memory.waited > 0}
        sought = _PLACE_SEARCH * self._right_of_way.sought
        return Turns(max(1, self.settings.searches_per_step - sought), waiting)

    def _rank(
        self, time: float, states: Mapping[str, RobotState], goals: Mapping[str, tuple[float, float]]
    ) -> list[str]:
        """Settle who makes room; return the robots that are served here in the order in which they are decided."""
        interval, shared, served = self.settings.sampling_interval, self._serves is not None, self.served
        if shared:
            self._right_of_way.note(last_decisions(self._decisions, self._heard))
        parties = {}
        for name, robot in self.robots.items():
            state, memory, promise = states.get(name), self._memory.get(name), self._heard.get(name)
            if state is not None and not state_fault(state, time, interval):
                facts = (robot, self._distances[name], state, memory, goals.get(name), time, promise)
                parties[name] = party_of(*facts, shared)
        self._right_of_way.update(self._area_context, parties, goals)
        for name in parties.keys() - set(served):
            self._right_of_way.waits(name, parties[name].pose, self._distances[name].arrival)
        first = [name for name in self._right_of_way.sequence() if name in served]
        return first + [name for name in served if name not in first]

    def _hear(self, heard: Mapping[str, HeardPath], goals: Mapping[str, tuple[float, float]]) -> None:
        """Keep what others promised, and forget the paths of own robots that others stopped."""
        self._goals, served = goals, set(self.served)
        last, states, interval = self._promised, self._states, self.settings.sampling_interval
        self._promised = {
            name: believed(promise, last.get(name), states.get(name), self._time, interval)
            for name, promise in heard.items()
            if name not in served
        }
        self._heard = dict(self._promised)
        for name in served & heard.keys():
            if heard[name].path is None and name in self._memory:
                self._memory[name] = replace(self._memory[name], plan=None)

    def _update_context(self, area: UnoccupiedArea) -> None:
        last, grain = self._context, _GRAIN if len(self.robots) > self.settings.crowd else 0.0
        fresh = AreaContext(area, self.settings.simplification, grain)
        self._context, self._changed = self._trend.follow(last, fresh)
        if last is not None and self._changed and grain > 0.0:
            self._context.prepare(last)

    def _others(
        self, name: str, time: float, decisions: Mapping[str, PlannedPath | Stop]
    ) -> list[OtherRobot]:
        """Where the other robots will be: decided already in this step, or on their last path, or standing."""
        return self._cast.others(
            name, self.robots, lambda other, radius: self._ways(other, radius, time, decisions)
        )

    def _ways(
        self, other: str, radius: float, time: float, decisions: Mapping[str, PlannedPath | Stop]
    ) -> list[OtherRobot]:
        """Where one robot will be, as a disk of a given radius [m]."""
        promise = self._promise(other, decisions)
        paths = possible_paths(self._states.get(other), promise, self._distances[other], time)
        parked = promise.path is None and self._is_parked(other)
        return [OtherRobot(other, radius, path, parked) for path in paths]

    def _promise(self, name: str, decisions: Mapping[str, PlannedPath | Stop]) -> HeardPath:
        """The path that a robot follows for all that is known now."""
        if name in self._heard:
            return self._heard[name]
        decision, memory = decisions.get(name), self._memory.get(name)
        plan = decision if isinstance(decision, PlannedPath) else None
        if memory is not None and (decision is None or _is_silent(decision)):
            plan = memory.plan
        return HeardPath(None) if plan is None else HeardPath(plan.path, plan.certificate.valid_until)

    def _is_parked(self, name: str) -> bool:
        """Whether a robot that stands has no way to go."""
        memory = self._memory.get(name)
        if memory is not None or name not in self._goals:
            return memory is None or memory.arrived
        state = self._states.get(name)
        left = math.inf if state is None else math.dist(self._goals[name], (state.pose.x, state.pose.y))
        return left <= self._distances[name].arrival

    def _decide(
        self,
        robot: RobotSpec,
        time: float,
        state: RobotState | None,
        goal: tuple[float, float] | None,
        others: Sequence[OtherRobot],
    ) -> PlannedPath | Stop:
        context = self._area_context
        unusable = state_fault(state, time, self.settings.sampling_interval)
        if state is None or unusable:
            message = f"pose of robot {robot.id} {unusable}; check its odometry"
            return Stop(robot.id, StopReason.NO_STATE, message)
        if goal is None:
            return Stop(robot.id, StopReason.NO_GOAL, f"robot {robot.id} has no goal")
        if not all(math.isfinite(value) for value in goal):
            return Stop(
                robot.id, StopReason.NO_GOAL, f"goal {goal} of robot {robot.id} is not finite; set another"
            )
        makes_room, goal = self._right_of_way.goal(robot.id, goal)
        memory = self._memory.get(robot.id)
        pose = predicted_pose(robot, state, None if memory is None else memory.plan, time)
        if memory is None or memory.goal != goal:
            memory = RobotMemory(goal, np.array(goal, dtype=np.float64))
        position, distances = pose.position, self._distances[robot.id]
        known = (context, robot, pose, memory.target, time, others, distances, self.settings, distances.least)
        attempt = Attempt(*known, self._trend.previous, self._trend.forecast, self._turns)
        if context.area.is_empty:
            message = f"nothing is known to be free by the area stamped {context.area.stamp:.2f} s; check the sensors"
            return self._explainer.explain(Stop(robot.id, StopReason.NO_AREA, message), attempt, goal)
        waits = self._right_of_way.waits(robot.id, pose, distances.arrival)
        if waits is not None:
            self._memory[robot.id] = replace(memory, plan=None)
            return waits
        distance = float(np.linalg.norm(position - memory.target))
        near = memory.arrived or min(distance, math.dist(goal, position)) <= distances.arrival
        if near and not makes_room:
            self._memory[robot.id] = replace(memory, arrived=True, plan=None)
            return Stop(robot.id, StopReason.ARRIVED, f"robot {robot.id} is {distance:.2f} m from its target")
        decision, self._memory[robot.id] = plan_robot(attempt, memory, self._changed)
        decision = self._right_of_way.labelled(robot.id, decision)
        if isinstance(decision, Stop):
            return self._explainer.explain(decision, attempt, goal)
        self._explainer.forget(robot.id)
        return decision

    def _settle(self, time: float, decisions: dict[str, PlannedPath | Stop]) -> dict[str, Stop]:
        """Shorten windows, or stop robots, whose paths no longer agree with what others decided after them.

        Until all agree. Returns the robots of other navigators that have to be stopped.
        """
        margin, interval = self.settings.safety_margin, self.settings.sampling_interval
        end = time + self.settings.time_window * interval
        stopped: dict[str, Stop] = {}
        changed = True
        while changed:
            changed = False
            for name, decision in decisions.items():
                if not isinstance(decision, PlannedPath):
                    continue
                others = self._others(name, time, decisions)
                until = min(end, decision.certificate.valid_until)
                fails, least, fault = separation(decision.path, others, until, margin, interval)
                if fault:
                    decisions[name] = shortened(decision, fails, interval, fault)
                    self._cast.forget(name)
                    changed = True
                else:
                    certificate = replace(decision.certificate, least_separation=least)
                    decisions[name] = replace(decision, certificate=certificate)
            for stop in self._foreign_conflicts(time, decisions):
                stopped[stop.robot_id] = stop
                self._heard[stop.robot_id] = halted(self._heard[stop.robot_id], time)
                self._cast.forget(stop.robot_id)
                changed = True
        return stopped

    def _foreign_conflicts(self, time: float, decisions: Mapping[str, PlannedPath | Stop]) -> list[Stop]:
        """Robots of other navigators that would come too near to robots that are served here.

        One that is still to be decided is stopped only for what would happen before its navigator can react.
        """
        margin, interval = self.settings.safety_margin, self.settings.sampling_interval
        stops = []
        for name, promise in self._heard.items():
            path = promise.path
            if path is None or len(path) < 2 or promise.valid_until <= time or name not in self.robots:
                continue
            decided = abs(path.start_time - time) <= TIME_TOLERANCE
            until = min(promise.valid_until, time + (self.settings.time_window if decided else 2) * interval)
            others = [other for other in self._others(name, time, decisions) if other.id in decisions]
            way = onwards(up_to(path, promise.valid_until), time)
            _, _, fault = separation(way, others, until, margin, interval)
            if fault:
                stops.append(Stop(name, StopReason.BLOCKED_BY_ROBOT, f"robot {name} waits: {fault}"))
        return stops

    def _remember(self, name: str, decision: PlannedPath | Stop) -> None:
        if name in self._memory and not _is_silent(decision):
            plan = decision if isinstance(decision, PlannedPath) else None
            self._memory[name] = replace(self._memory[name], plan=plan)


def _is_silent(decision: PlannedPath | Stop) -> bool:
    """Whether a robot got no path because nothing is heard of it: it may still follow its last one."""
    return isinstance(decision, Stop) and decision.reason is StopReason.NO_STATE
