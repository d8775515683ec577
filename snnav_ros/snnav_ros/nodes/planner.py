"""The node that decides for all robots: a certified path, or a stop with its reason."""

from __future__ import annotations

import time as clock
from typing import Any

from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from snnav_core.area.planar import LostPart
from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlyerState
from snnav_core.types import RobotState, StepResult, Stop, StopReason
from snnav_ros.convert import (
    goal_from_message,
    goal_in_space_from_message,
    lost_from_message,
    nanoseconds,
    nanoseconds_from_stamp,
    seconds,
)
from snnav_ros.nodes.base import NodeOptions
from snnav_ros.nodes.deciding import DecidingNode
from snnav_ros.nodes.fellows import Fellows
from snnav_ros.nodes.node_time import has_time, now_of
from snnav_ros.nodes.planner_parameters import PlannerParameters
from snnav_ros.nodes.planner_worlds import Area, Crew, State, read_planning
from snnav_ros.nodes.robots import read_robots
from snnav_ros.qos import LATCHED, for_mode
from snnav_ros.scenes import read_scene
from snnav_sim.scene import SpaceScene

__all__ = ["PlannerNode", "PlannerParameters"]

_AREA, _LOST = "unoccupied_area", "unoccupied_area/lost"


class PlannerNode(DecidingNode):
    """Hears the area, odometry and goals; publishes `<robot>/path` and `<robot>/certificate`.

    One step for every unoccupied area that comes. When none comes for `max_area_age`, all robots are stopped.

    The time of a step is the stamp of the area or, in real time, that of the newest odometry if this is later: what
    the boundary may have moved in between is then taken off the area. Several planners go by the stamp of the area,
    and issue nothing while they do not know what the others promised (see `Fellows`): robots then go on to the ends of
    their windows. Robots join and leave by `robots` (see `Roster`).

    For an area in the plane the robots are planned for on the ground, for one in space in the air (see `Crew`). Before
    any came it is the world of the scene, or of the first goals.
    """

    def __init__(self, options: NodeOptions | None = None) -> None:
        super().__init__("planner_node", options or NodeOptions())
        scene = read_scene(self.reader)
        self.settings = self.reader.settings(PlannerParameters)
        robots = read_robots(self.reader, scene, may_be_none=self.settings.accept_robots)
        planning = read_planning(self.reader, scene)
        self.navigator_settings = planning.plane
        self.reader.finish()
        settings, interval = self.settings, self.navigator_settings.sampling_interval
        self._max_area_age = settings.max_area_age or 2.0 * interval
        targets = [robot.target for robot in robots if robot.target is not None]
        in_space = isinstance(scene, SpaceScene) or any(len(target) == 3 for target in targets)
        try:
            specs = [robot.spec for robot in robots]
            self._crew = Crew(specs, planning, settings.serves, in_space=in_space)
        except InvalidInput as error:
            self.reader.fail("robots", str(error))
        self._fellows: Fellows | None = None
        window = self.navigator_settings.time_window * interval
        if settings.planners:
            if in_space:
                self.reader.fail("planners", "is given; in space one planner serves all robots, leave it out")
            try:
                self._fellows = Fellows(self, settings.planners, window, self._on_promise)
            except InvalidInput as error:
                self.reader.fail("planners", str(error))
        self._share = nanoseconds(settings.sharing_deadline or interval / (len(settings.planners) + 1))
        self.know(scene, robots, settings, self._crew, interval, window)

    def configure(self) -> None:
        """Make the publishers."""
        super().configure()
        self._area: Area | None = None
        self._area_stamp = -1
        self._lost: tuple[LostPart, ...] = ()
        self._lost_stamp = self._decided = -1
        self._due: tuple[int, Area] | None = None
        if self._fellows is not None:
            self._fellows.configure()

    def start(self) -> None:
        """Listen; in real time watch the age of the area."""
        latched = for_mode(self.lockstep, LATCHED)
        self.listen(MarkerArray, _LOST, self._on_lost, latched)
        self.listen(PointCloud2, _AREA, self._on_area, latched)
        super().start()
        if not self.lockstep:
            self.every(self.navigator_settings.sampling_interval, self._watch_area)
        if self._fellows is not None:
            self._fellows.start()
            if not self.lockstep:
                self.every(seconds(self._share) / 20.0, self._on_promise)

    def forget(self) -> None:
        """Forget the area and what others promised."""
        if self._fellows is not None:
            self._fellows.reset()
        self._area, self._area_stamp = None, -1
        self._lost, self._lost_stamp = (), -1
        self._decided, self._due = -1, None

    # who is there

    def serves(self, name: str) -> bool:
        """Whether it decides for a robot."""
        return not self.settings.serves or name in self.settings.serves

    def robot_heard(self, name: str) -> None:
        """Hear what another planner promises for a robot."""
        if self._fellows is not None and not self.serves(name):
            self._fellows.watch(name)

    def robot_left(self, name: str) -> None:
        """Hear no promises for a robot any more."""
        if self._fellows is not None:
            self._fellows.unwatch(name)

    def read_state(self, message: Any, name: str, topic: str, frames: list[str]) -> State:
        """Return the state that odometry tells, in the plane or in space."""
        return self._crew.state(message, name, topic, frames)

    def read_goal(self, message: PoseStamped, topic: str) -> tuple[float, ...]:
        """Return the goal of a message, in space with its height."""
        return (goal_in_space_from_message if self._crew.in_space else goal_from_message)(message, topic)

    def state_heard(self, state: RobotState | FlyerState) -> None:
        """Keep a state for the instants that several planners share."""
        if self._fellows is not None and isinstance(state, RobotState):
            self._fellows.add_state(state)

    # what comes in

    def inputs(self) -> list[str]:
        """Topics that it waits for besides those of the robots."""
        return [_AREA]

    def _on_area(self, message: PointCloud2) -> None:
        self._waiting.heard(_AREA)
        if not (self.lockstep or has_time(self)):
            return
        stamp = nanoseconds_from_stamp(message.header.stamp)
        try:
            if self._crew.enter(message, _AREA):
                self.read_again()
            area = self._crew.area(message, _AREA)
            self.check_ahead(_AREA, stamp)
            if stamp < self._area_stamp and not self.lockstep:
                raise InvalidInput(
                    f"{_AREA}: stamped {seconds(stamp):.3f} s, after one stamped {seconds(self._area_stamp):.3f} s; is "
                    "there another fusion node?"
                )
        except InvalidInput as error:
            self.complain(_AREA, error)
            return
        self._problems.pop(_AREA, None)
        self._area, self._area_stamp = area, stamp
        if self._participant is not None:
            self.go_on()
        elif self._fellows is not None:
            if stamp > self._decided:  # others count on one word for each instant
                self._due = stamp, area
                self._on_promise()
        elif not self._watch_area():
            # Whoever was measured after the area held passes the points of its path later by as much.
            newest = max([stamp, *(when for when, _ in self._states.values())])
            if newest > self._decided:
                self._step_or_refrain(newest, area)

    def _on_lost(self, message: MarkerArray) -> None:
        """Take what silent sensors saw last: it explains refusals, and changes no path."""
        try:
            self._lost_stamp, self._lost = lost_from_message(message, _LOST)
        except InvalidInput as error:
            self.complain(_LOST, error)
            return
        self._problems.pop(_LOST, None)
        self.go_on()

    def is_complete(self, tick: int) -> bool:
        """In lockstep: whether the area of a tick [ns] is there."""
        stamp = self._area_stamp if self._crew.in_space else min(self._area_stamp, self._lost_stamp)
        return self._area is not None and stamp == tick

    def decide(self, tick: int) -> None:
        """In lockstep: decide for a tick [ns] once the promises of the other planners are there as well."""
        assert self._area is not None
        assert self._participant is not None
        if self._fellows is None or not self._fellows.missing(tick):
            self._step(tick, self._area)
            self._participant.done()

    def _on_promise(self) -> None:
        """Go on once it is known what the other planners promised, or issue nothing when that takes too long."""
        if self._participant is not None:
            self.go_on()
            return
        if self._due is None or self._fellows is None:
            return
        instant, area = self._due
        missing = self._fellows.missing(instant)
        if missing:
            if now_of(self) < instant + (self._fellows.place + 0.5) * self._share:
                return
            missing = self._fellows.give_up(instant, self._states_at(instant))
        self._due = None
        if missing:
            self._hold(instant, f"planner {', '.join(missing)} is silent, and may have promised something")
        else:
            self._step_or_refrain(instant, area)

    def _step_or_refrain(self, instant: int, area: Area) -> None:
        if self.refrain(instant):
            self._issue_nothing(instant)
        else:
            self._step(instant, area)

    def _hold(self, instant: int, why: str) -> None:
        self.hold(why)
        self._issue_nothing(instant)

    def _issue_nothing(self, instant: int) -> None:
        """Issue nothing at an instant [ns]: robots go on to the ends of their windows."""
        self._decided = instant
        if self._fellows is not None:
            self._fellows.say(instant, (), {})
        self._publish_status(instant, [], 0.0)

    def _watch_area(self) -> bool:
        """Stop all robots when the area is too old, alone; return whether it is."""
        now = now_of(self)
        if self._area is None or now - self._area_stamp <= nanoseconds(self._max_area_age):
            return False
        age = seconds(now - self._area_stamp)
        message = f"the unoccupied area is {age:.1f} s old; check the fusion node"
        if self._fellows is not None:
            # Others count on these robots to go on; the windows end by themselves.
            self._problems["area"] = message
            self._publish_status(now, [], 0.0)
            return True
        decisions = {name: Stop(name, StopReason.NO_AREA, message) for name in self._crew.served}
        self._publish(now, StepResult(seconds(now), dict(decisions)), 0.0)
        return True

    def _states_at(self, instant: int) -> dict[str, State]:
        """The last state of every robot; for several planners the last one up to the instant that they share [ns]."""
        states = {name: state for name, (_, state) in self._states.items()}
        return states if self._fellows is None else self._fellows.states_at(seconds(instant), states)

    def _step(self, now: int, area: Area) -> None:
        begin = clock.perf_counter()
        heard = {} if self._fellows is None else self._fellows.promises()
        states = self._states_at(now)
        result = self._crew.step(seconds(now), area, states, self.goals(), self._lost, heard)
        duration = clock.perf_counter() - begin
        self._misses += duration > self.navigator_settings.sampling_interval
        if self._fellows is not None and not self.lockstep:
            late = now_of(self) - now - (self._fellows.place + 1) * self._share
            if late > 0:
                self._crew.withdraw()
                self._misses += 1
                self._hold(now, f"the decision came {seconds(late):.3f} s after its share of the interval")
                return
            self._problems.pop("area", None)
        self.go_ahead()
        self._publish(now, result, duration)

    def _publish(self, now: int, result: StepResult, duration: float) -> None:
        self._decided = now
        statuses = self.publish_decisions(now, result.decisions)
        for name in result.stop_foreign:
            self._ports[name].halt(now)
        if self._fellows is not None:
            self._fellows.say(now, list(result.decisions), result.stop_foreign)
        self._publish_status(now, statuses, duration)

    def _publish_status(self, now: int, statuses: list[Any], duration: float) -> None:
        name = "planner" if self._fellows is None else f"planner {self.get_name()}"
        self.publish_status(name, now, statuses, duration)
