"""One decision step for flying robots: (free region, robots, goals) -> paths with certificates (Ch. 4)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from snnav_core.area.spatial import SpatialArea
from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlyerState
from snnav_core.navigator.flight_company import settle, silent
from snnav_core.navigator.flight_planner import FlightPlanner
from snnav_core.navigator.flight_retreat import Retreats
from snnav_core.navigator.flight_settings import FlightSettings
from snnav_core.navigator.prediction import up_to
from snnav_core.planning.flight_separation import OtherFlyer
from snnav_core.types import (
    TIME_TOLERANCE,
    FloatArray,
    PlannedPath,
    RobotSpec,
    StepResult,
    Stop,
    StopReason,
    TimedPath,
)

__all__ = ["FlightNavigator"]


class FlightNavigator:
    """Plans for every flying robot, one after the other, around the paths of all.

    Parameters
    ----------
    robots : sequence of RobotSpec
        In order of precedence.
    settings : FlightSettings

    Raises
    ------
    InvalidInput
        If two robots have the same name, or settings and a robot do not agree.

    Notes
    -----
    Deviations: robots not decided yet in this round are where their last path has them at the same time (C4-10); a
    robot that was blocked for some steps goes first (C4-11), and where several are blocked the last one goes aside;
    robots without a path hover, as spheres that stay. Once all are decided, windows end where they no longer agree with
    what others were told later. A robot that is not heard of may be anywhere on the rest of its way.
    """

    def __init__(self, robots: Sequence[RobotSpec], settings: FlightSettings) -> None:
        self.settings = settings
        self._planners: dict[str, FlightPlanner] = {}
        self._blocked: dict[str, int] = {}
        self._searched: dict[str, int] = {}  # number of the step of the last search
        self._states: dict[str, FlyerState] = {}  # the last that could be used
        self._steps, self._time = 0, -math.inf
        self._retreats = Retreats(settings.retreat_steps, settings.seed)
        for robot in robots:
            self.add_robot(robot)

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the robots, by precedence."""
        return tuple(self._planners)

    def add_robot(self, robot: RobotSpec) -> None:
        """Plan for one more robot, at the end of the order."""
        if robot.id in self._planners:
            raise InvalidInput(f"two robots are called {robot.id!r}")
        self._planners[robot.id] = FlightPlanner(robot, self.settings, len(self._planners))
        self._blocked[robot.id], self._searched[robot.id] = 0, -1

    def remove_robot(self, robot_id: str) -> None:
        """Forget a robot that is no longer in the workspace."""
        self._planners.pop(robot_id, None)
        self._blocked.pop(robot_id, None)
        self._searched.pop(robot_id, None)
        self._states.pop(robot_id, None)
        self._retreats.forget(robot_id)

    def reset(self) -> None:
        """Forget all paths, and where the robots were."""
        self._states, self._time = {}, -math.inf
        for name, planner in self._planners.items():
            planner.reset()
            self._retreats.forget(name)

    def step(
        self,
        time: float,
        area: SpatialArea | None,
        states: Mapping[str, FlyerState],
        goals: Mapping[str, FloatArray],
    ) -> StepResult:
        """Decide for all robots.

        Parameters
        ----------
        time : float
            Sampling instant [s].
        area : SpatialArea or None
            Free region at this time; None when there is none, and all robots are stopped.
        states : mapping
            Where the robots are, measured up to one sampling interval earlier; one that is missing or older gets no
            path.
        goals : mapping
            Targets (3,) [m, map].

        Returns
        -------
        StepResult
        """
        decisions: dict[str, PlannedPath | Stop] = {}
        if time < self._time:
            self.reset()
        self._time = time
        given, states = states, self._usable(states, time)
        self._states.update(states)
        if area is not None:
            valid = {
                name: np.asarray(goal, dtype=np.float64) for name, goal in goals.items() if _is_point(goal)
            }
            distances = {name: planner.distances for name, planner in self._planners.items()}
            aside = self._retreats.places(time, area, self._order(), states, valid, self._blocked, distances)
            goals = {**goals, **aside}
        turns = self._turns()
        left = self.settings.searches - len(turns)
        for name in self._order():
            planner = self._planners[name]
            state, goal = states.get(name), goals.get(name)
            stop = _missing(name, area, given.get(name), state is not None, goal, time)
            if stop is not None or area is None or state is None or goal is None:
                decisions[name] = stop = stop or Stop(name, StopReason.NO_AREA, "no area")
                if stop.reason is not StopReason.NO_STATE:  # it may still follow its last path
                    planner.reset()
                continue
            others = self._others(name, time, states, goals)
            may_search = name in turns or left > 0
            decisions[name], searched = planner.decide(
                time, area, state, np.asarray(goal, dtype=np.float64), others, may_search
            )
            if searched:
                left -= name not in turns
                self._searched[name] = self._steps
        self._steps += 1
        self._settle(time, decisions, states)
        for name, decision in decisions.items():
            waits = isinstance(decision, Stop) and decision.reason in _WAITING
            self._blocked[name] = self._blocked[name] + 1 if waits else 0
        return StepResult(time, {name: decisions[name] for name in self._planners})

    def _turns(self) -> list[str]:
        """Robots that wait to search and may do so now, those first that did so longest ago."""
        waiting = [name for name, planner in self._planners.items() if planner.waits]
        return sorted(waiting, key=lambda name: self._searched[name])[: self.settings.searches]

    def _order(self) -> list[str]:
        """Names by precedence; who was blocked for long comes first (C4-11)."""
        patient = [name for name in self._planners if self._blocked[name] < self.settings.blocked_steps]
        return [name for name in self._planners if name not in patient] + patient

    def _others(
        self, name: str, time: float, states: Mapping[str, FlyerState], goals: Mapping[str, FloatArray]
    ) -> list[OtherFlyer]:
        """Where all other robots are going to be."""
        others = []
        for other, planner in self._planners.items():
            if other == name:
                continue
            if other not in states:
                others += silent(planner.robot, self._states.get(other), planner.last, time)
                continue
            path, place = planner.promised(time), states[other].position
            leaves = False
            if path is None:
                path = TimedPath(time, self.settings.sampling_interval, place[None])
                goal = goals.get(other)
                if goal is not None and _is_point(goal):
                    leaves = float(np.linalg.norm(goal - place)) > planner.distances.arrival
            others.append(OtherFlyer(other, planner.robot.radius, path, leaves))
        return others

    def _usable(self, states: Mapping[str, FlyerState], time: float) -> dict[str, FlyerState]:
        """The states of robots that are known here which are not older than a sampling interval."""
        oldest = self.settings.sampling_interval + TIME_TOLERANCE
        return {
            name: state
            for name, state in states.items()
            if name in self._planners and abs(time - state.stamp) <= oldest
        }

    def _settle(
        self, time: float, decisions: dict[str, PlannedPath | Stop], states: Mapping[str, FlyerState]
    ) -> None:
        """Let windows end where others, decided later, no longer are where they were to be, in place."""
        ways: dict[str, list[OtherFlyer]] = {}
        for name, planner in self._planners.items():
            decision = decisions[name]
            if isinstance(decision, PlannedPath):
                path = up_to(decision.path, decision.certificate.valid_until)
            elif name in states:
                path = TimedPath(time, self.settings.sampling_interval, states[name].position[None])
            else:
                ways[name] = silent(planner.robot, self._states.get(name), planner.last, time)
                continue
            ways[name] = [OtherFlyer(name, planner.robot.radius, path)]
        for name in settle(time, decisions, ways, states, self.settings):
            self._planners[name].revise(decisions[name])


_WAITING = (
    StopReason.NO_PATH,
    StopReason.BLOCKED_BY_ROBOT,
    StopReason.GOAL_UNREACHABLE,
    StopReason.GOAL_BLOCKED,
)


def _missing(
    name: str,
    area: SpatialArea | None,
    state: FlyerState | None,
    is_usable: bool,
    goal: FloatArray | None,
    time: float,
) -> Stop | None:
    """Why a robot cannot be planned for, if something is missing."""
    if area is None:
        return Stop(name, StopReason.NO_AREA, f"no free region is known at {time:.2f} s")
    if state is None:
        return Stop(name, StopReason.NO_STATE, f"position of robot {name} is unknown at {time:.2f} s")
    if not is_usable:
        when = f"was measured {time - state.stamp:.2f} s ago"
        return Stop(name, StopReason.NO_STATE, f"position of robot {name} {when}; check its odometry")
    if goal is None:
        return Stop(name, StopReason.NO_GOAL, f"robot {name} has no target")
    if not _is_point(goal):
        return Stop(
            name, StopReason.NO_GOAL, f"target {np.asarray(goal).tolist()} of robot {name} is no point"
        )
    return None


def _is_point(goal: FloatArray) -> bool:
    return np.shape(goal) == (3,) and all(math.isfinite(value) for value in np.asarray(goal).tolist())
