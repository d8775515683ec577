"""The decisions for one flying robot: the last path goes on, or a new one is sought, or it hovers and says why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from snnav_core.area.spatial import SpatialArea
from snnav_core.flight_types import FlyerState
from snnav_core.navigator.flight_refusal import explain, without_search
from snnav_core.navigator.flight_seek import can_be_reached, in_company, seek
from snnav_core.navigator.flight_settings import FlightDistances, FlightSettings
from snnav_core.navigator.flight_task import FlightTask
from snnav_core.navigator.progress import Progress
from snnav_core.planning.flight_separation import OtherFlyer
from snnav_core.types import (
    TIME_TOLERANCE,
    FloatArray,
    PathSource,
    PlannedPath,
    RobotSpec,
    Stop,
    StopReason,
    TimedPath,
)

__all__ = ["FlightPlanner"]

_SAME_GOAL = 1e-6  # [m]
_EXCUSED = 3  # beside others only every third decision counts towards getting nowhere: they may be to blame
_SOON = 3  # steps until a way is sought instead of a path that cannot be adjusted any more


class FlightPlanner:
    """Plans for one robot, step by step.

    Parameters
    ----------
    robot : RobotSpec
    settings : FlightSettings
    index : int
        Number of the robot: its samples are its own.
    """

    def __init__(self, robot: RobotSpec, settings: FlightSettings, index: int) -> None:
        self.robot = robot
        self.settings = settings
        self.distances = FlightDistances(robot, settings)
        self._index = index
        self._count = 0
        self.reset()

    def reset(self) -> None:
        """Forget the last path."""
        self._last: PlannedPath | None = None
        self._goal: FloatArray | None = None
        self._failures = 0
        self._refusal: Stop | None = None
        self._progress = Progress.at_start(3)
        self.waits = False  # for its turn to search, with no path that can be adjusted

    def promised(self, time: float) -> TimedPath | None:
        """The path that the robot follows at a time [s], None when it hovers."""
        if self._last is None or self._last.certificate.valid_until < time - TIME_TOLERANCE:
            return None
        return self._last.path

    @property
    def last(self) -> PlannedPath | None:
        """What the robot was told last; None for a stop."""
        return self._last

    def revise(self, decision: PlannedPath | Stop) -> None:
        """Take what became of the last decision when all robots were decided."""
        self._last = decision if isinstance(decision, PlannedPath) else None

    def decide(
        self,
        time: float,
        area: SpatialArea,
        state: FlyerState,
        goal: FloatArray,
        others: Sequence[OtherFlyer],
        may_search: bool = True,
    ) -> tuple[PlannedPath | Stop, bool]:
        """Return a certified path, or why there is none; and whether a new one was sought."""
        name = self.robot.id
        if float(np.linalg.norm(goal - state.position)) <= self.distances.arrival:
            self.reset()
            return Stop(name, StopReason.ARRIVED, f"robot {name} is at its target"), False
        if self._goal is None or float(np.abs(goal - self._goal).max()) > _SAME_GOAL:
            self.reset()
        self._goal, self._count, self.waits = goal.copy(), self._count + 1, False
        task = FlightTask(self.robot, self.distances, time, area, state, goal, others)
        self._progress = self._progress.here(state.position)
        decision, searched = self._rests(task) or self._weighed(task, may_search)
        interval, speed = self.settings.sampling_interval, self.robot.speed
        excused = in_company(task) and self._count % _EXCUSED != 0
        self._progress = self._progress.after(decision, interval, speed, excused)
        return decision, searched

    def _rests(self, task: FlightTask) -> tuple[Stop, bool] | None:
        """Hover for a while after getting nowhere for long."""
        if self._progress.rest == 0:
            return None
        here = task.state.position
        room = float(task.area.clearance_at(here[None], task.now)[0])
        stop = self._progress.stop(self.robot, here, room, self.settings.safety_margin)
        self._last = None
        return None if stop is None else (stop, False)

    def _weighed(self, task: FlightTask, may_search: bool) -> tuple[PlannedPath | Stop, bool]:
        """The last path, or a better new one, or why there is none; and whether a new one was sought."""
        kept = self._kept(task)
        chosen, searched = kept, False
        interval = self.settings.search_interval
        if kept is not None and kept.source is PathSource.LAST_PATH:
            interval = min(interval, _SOON)
        due = (self._count + 3 * self._index) % interval == 0  # robots do not seek in the same step
        if (kept is None and without_search(task) is None) or (kept is not None and due):
            searched = may_search
            if may_search:
                chosen = self._sought(task, kept)
            else:
                self.waits = kept is None
        self._last = chosen
        if chosen is not None:
            self._refusal = None
            return chosen, searched
        return self._hovers(task, searched), searched

    def _kept(self, task: FlightTask) -> PlannedPath | None:
        """The last path, adjusted to what is seen now, else as it is."""
        if self._last is None:
            return None
        return task.go_on(self._last) or task.rest_of(self._last)

    def _sought(self, task: FlightTask, kept: PlannedPath | None) -> PlannedPath | None:
        """A new path if there is one that is better than the kept one, else that."""
        refused = self._refusal is not None and self._refusal.reason is StopReason.GOAL_UNREACHABLE
        if refused and not can_be_reached(task):
            return kept
        found = seek(task, (self.settings.seed, self._index, self._count), self._failures)
        self._failures = 0 if found is not None or kept is not None else self._failures + 1
        if found is None or kept is None:
            return found or kept
        stiff = kept.source is PathSource.LAST_PATH
        return found if stiff or task.is_better(found, kept) else kept

    def _hovers(self, task: FlightTask, searched: bool) -> Stop:
        """Why it hovers: what was found at the last search holds until the next one."""
        stop = without_search(task)
        if stop is not None:
            return stop
        if searched:
            self._refusal = explain(task)
        if self._refusal is not None:
            return self._refusal
        name = self.robot.id
        return Stop(name, StopReason.NO_PATH, f"robot {name} waits for its turn to search for a way")
