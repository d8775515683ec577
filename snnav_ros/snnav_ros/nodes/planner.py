"""The node that decides for all robots: a certified path, or a stop with its reason."""

from __future__ import annotations

import time as clock
from dataclasses import MISSING, fields
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from snnav_core.area.planar import LostPart, UnoccupiedArea
from snnav_core.errors import InvalidInput
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.types import RobotSpec, RobotState, StepResult, Stop, StopReason
from snnav_ros.convert import (
    area_from_message,
    goal_from_message,
    lost_from_message,
    nanoseconds,
    nanoseconds_from_stamp,
    seconds,
    state_from_message,
)
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import ManagedNode, NodeOptions, diagnostics, serve, status
from snnav_ros.nodes.fellows import Fellows
from snnav_ros.nodes.node_time import has_time, now_of, watch_time
from snnav_ros.nodes.operator import GoalScript
from snnav_ros.nodes.planner_parameters import PlannerParameters
from snnav_ros.nodes.robot_port import RobotPort
from snnav_ros.nodes.robots import read_robots
from snnav_ros.nodes.roster import Roster
from snnav_ros.qos import DIAGNOSTICS, LATCHED, LOCKSTEP, for_mode
from snnav_ros.scenes import read_scene
from snnav_sim.configure import navigator_settings

__all__ = ["PlannerNode", "PlannerParameters"]

_AREA, _LOST = "unoccupied_area", "unoccupied_area/lost"


class PlannerNode(ManagedNode):
    """Hears the area, odometry and goals; publishes `<robot>/path` and `<robot>/certificate`.

    One step for every unoccupied area that comes. When none comes for `max_area_age`, all robots are stopped.

    The time of a step is the stamp of the area or, in real time, that of the newest odometry if this is later: what
    the boundary may have moved in between is then taken off the area. Several planners go by the stamp of the area,
    and issue nothing while they do not know what the others promised (see `Fellows`): robots then go on to the ends of
    their windows. Robots join and leave by `robots` (see `Roster`).
    """

    def __init__(self, options: NodeOptions | None = None) -> None:
        super().__init__("planner_node", options or NodeOptions())
        scene = read_scene(self.reader)
        self.settings = self.reader.settings(PlannerParameters)
        robots = read_robots(self.reader, scene, may_be_none=self.settings.accept_robots)
        base: dict[str, Any] = {"boundary_speed": MISSING}  # how fast things move, a person has to say
        if scene is not None:
            held = navigator_settings(scene)
            base = {field.name: getattr(held, field.name) for field in fields(held)}
        self.navigator_settings = self.reader.settings(NavigatorSettings, **base)
        self.reader.finish()
        settings, interval = self.settings, self.navigator_settings.sampling_interval
        self._max_area_age = settings.max_area_age or 2.0 * interval
        self._targets = {robot.spec.id: robot.target for robot in robots if robot.target is not None}
        specs = [robot.spec for robot in robots]
        try:
            self._navigator = GroundNavigator(specs, self.navigator_settings, settings.serves or None)
        except InvalidInput as error:
            self.reader.fail("robots", str(error))
        self._roster = Roster(self, scene, specs, settings.accept_robots, self._join, self._leave)
        self._script = GoalScript(scene if self.lockstep else None)
        self._fellows: Fellows | None = None
        if settings.planners:
            window = self.navigator_settings.time_window * interval
            try:
                self._fellows = Fellows(self, settings.planners, window, self._on_promise)
            except InvalidInput as error:
                self.reader.fail("planners", str(error))
        self._share = nanoseconds(settings.sharing_deadline or interval / (len(settings.planners) + 1))
        if not self.lockstep:
            self._jump = watch_time(self, self.reset)
        serve(self, self.options, self.reset, {})
        self.autostart()

    @property
    def robots(self) -> dict[str, RobotSpec]:
        """Robots in the workspace by id."""
        return self._roster.present

    def configure(self) -> None:
        """Make the publishers."""
        self._goals = dict(self._targets)
        self._goal_stamps: dict[str, int] = {}
        self._area: UnoccupiedArea | None = None
        self._area_stamp = -1
        self._lost: tuple[LostPart, ...] = ()
        self._lost_stamp = self._decided = -1
        self._states: dict[str, tuple[int, RobotState]] = {}
        self._due: tuple[int, UnoccupiedArea] | None = None
        self._problems: dict[str, str] = {}
        self._misses = 0
        self._ports: dict[str, RobotPort] = {}
        self._roster.configure()
        if self._fellows is not None:
            self._fellows.configure()
        for name in self._roster.present:
            self._port(name)
        self._diagnostics = self.publisher(
            DiagnosticArray, "/diagnostics", for_mode(self.lockstep, DIAGNOSTICS)
        )

    def start(self) -> None:
        """Listen; in real time watch the age of the area."""
        latched = for_mode(self.lockstep, LATCHED)
        self.listen(MarkerArray, _LOST, self._on_lost, latched)
        self.listen(PointCloud2, _AREA, self._on_area, latched)
        for name in self._script.robots:  # also of those who are still to join; nothing of it may be lost
            self.listen(PoseStamped, f"{name}/goal_pose", partial(self._on_goal, name), LOCKSTEP)
        self._participant: Participant | None = None
        interval = self.navigator_settings.sampling_interval
        if self.lockstep:
            self._participant = self.participate(
                nanoseconds(interval), lambda _: self._step_when_complete(), self.reset
            )
        else:
            self.every(interval, self._watch_area)
        self._waiting = self.report_waiting(self._inputs)
        for name in self._roster.present:
            self._listen_to(name)
        if self._fellows is not None:
            self._fellows.start()
            if not self.lockstep:
                self.every(seconds(self._share) / 20.0, self._on_promise)
        self._roster.start(self._step_when_complete)

    def reset(self) -> None:
        """Forget paths, area and states; goals stay."""
        self._navigator.reset()
        self._roster.reset()
        if not self.lockstep:  # in lockstep data of the new time may be here before their tick
            if self._fellows is not None:
                self._fellows.reset()
            self._area, self._area_stamp = None, -1
            self._lost, self._lost_stamp = (), -1
            self._decided = -1
            self._states, self._due = {}, None

    # who is there

    def _port(self, name: str) -> RobotPort:
        if name not in self._ports:
            self._ports[name] = RobotPort(self, name)
        return self._ports[name]

    def _serves(self, name: str) -> bool:
        return not self.settings.serves or name in self.settings.serves

    def _join(self, spec: RobotSpec) -> None:
        self._navigator.add_robot(spec)
        self._port(spec.id)
        self._listen_to(spec.id)
        served = "" if self._serves(spec.id) else "; another planner serves it"
        self.get_logger().info(f"robot {spec.id} joined{served}")

    def _leave(self, name: str) -> None:
        self._navigator.remove_robot(name)
        self._ports[name].close()
        for known in (self._states, self._goals, self._goal_stamps):
            known.pop(name, None)
        self._problems.pop(f"{name}/odom", None)
        if self._fellows is not None:
            self._fellows.unwatch(name)

    def _listen_to(self, name: str) -> None:
        """Hear a robot, and offer services for it, until it leaves or the node is deactivated."""
        self._ports[name].open(
            partial(self._on_odometry, name),
            partial(self._on_goal, name),
            partial(self._enable, name),
            partial(self._remove, name),
        )
        if self._fellows is not None and not self._serves(name):
            self._fellows.watch(name)

    def _remove(self, name: str) -> str:
        """Take a robot out of the workspace by hand: it is stopped, and not planned around any more."""
        now = now_of(self) if self._participant is None else max(self._participant.now, 0)
        if not self._roster.take_out(name, now):
            return f"robot {name} is not there"
        stop = Stop(name, StopReason.NO_GOAL, "taken out of the workspace by a service")
        self._port(name).publish(stop, now)
        self.get_logger().info(f"robot {name} was taken out")
        self._step_when_complete()
        return ""

    def _inputs(self) -> list[str]:
        robots = self._roster.present
        missing_goals = [f"{name}/goal_pose" for name in robots if name not in self._goals]
        return [_AREA, *(f"{name}/odom" for name in robots), *missing_goals]

    def _enable(self, name: str, enabled: bool) -> None:
        self._ports[name].enabled = enabled
        self.get_logger().info(f"robot {name} is {'planned for again' if enabled else 'stopped'}")

    def _on_goal(self, name: str, message: PoseStamped) -> None:
        topic = f"{name}/goal_pose"
        self._waiting.heard(topic)
        try:
            self._goals[name] = goal_from_message(message, topic)
        except InvalidInput as error:
            self.get_logger().warning(f"goal not taken: {error}")
        else:
            self._goal_stamps[name] = nanoseconds_from_stamp(message.header.stamp)
            self.get_logger().info(
                f"robot {name} goes to ({self._goals[name][0]:.2f}, {self._goals[name][1]:.2f})"
            )
            self._step_when_complete()

    def _on_odometry(self, name: str, message: Odometry) -> None:
        topic = f"{name}/odom"
        self._waiting.heard(topic)
        if not (self.lockstep or has_time(self)):
            return
        frames = [frame.replace("{robot}", name) for frame in self.settings.odometry_frames]
        try:
            state = state_from_message(message, name, topic, frames)
            self._check_ahead(topic, nanoseconds_from_stamp(message.header.stamp))
        except InvalidInput as error:
            self._complain(topic, error)
            return
        self._problems.pop(topic, None)
        self._states[name] = (nanoseconds_from_stamp(message.header.stamp), state)
        if self._fellows is not None:
            self._fellows.add_state(state)
        self._step_when_complete()

    def _on_area(self, message: PointCloud2) -> None:
        self._waiting.heard(_AREA)
        if not (self.lockstep or has_time(self)):
            return
        stamp = nanoseconds_from_stamp(message.header.stamp)
        try:
            area = area_from_message(message, _AREA)
            self._check_ahead(_AREA, stamp)
        except InvalidInput as error:
            self._complain(_AREA, error)
            return
        self._problems.pop(_AREA, None)
        self._area, self._area_stamp = area, stamp
        if self._participant is not None:
            self._step_when_complete()
        elif self._fellows is not None:
            self._due = stamp, area
            self._on_promise()
        elif not self._watch_area():
            # Whoever was measured after the area held passes the points of its path later by as much.
            newest = max([stamp, *(when for when, _ in self._states.values())])
            if newest > self._decided:
                self._step(newest, area)

    def _on_lost(self, message: MarkerArray) -> None:
        """Take what silent sensors saw last: it explains refusals, and changes no path."""
        try:
            self._lost_stamp, self._lost = lost_from_message(message, _LOST)
        except InvalidInput as error:
            self._complain(_LOST, error)
            return
        self._problems.pop(_LOST, None)
        self._step_when_complete()

    def _check_ahead(self, topic: str, stamp: int) -> None:
        """Refuse what is stamped in the future: later it would pass for fresh. In lockstep time waits for its data."""
        ahead = 0.0 if self.lockstep else seconds(stamp - now_of(self))
        if ahead > self.settings.clock_tolerance:
            raise InvalidInput(
                f"{topic}: stamped {ahead:.3f} s ahead of the planner's clock, more than clock_tolerance "
                f"{self.settings.clock_tolerance:g} s; synchronise the clocks"
            )

    def _complain(self, topic: str, error: InvalidInput) -> None:
        if topic not in self._problems:
            self.get_logger().warning(f"message not used: {error}")
        self._problems[topic] = str(error)

    def _step_when_complete(self, _: int = 0) -> None:
        """In lockstep: go on once all of the present tick is there: who joins, area, odometry, goals, promises."""
        if self._participant is None or self._participant.due is None or self._area is None:
            return
        tick = self._participant.due
        if min(self._area_stamp, self._lost_stamp) != tick or not self._roster.is_complete(tick):
            return
        self._roster.settle(tick)
        present = self._roster.present
        if any(self._states.get(name, (-1,))[0] != tick for name in present):
            return
        if not self._script.is_complete(tick, present, self._goal_stamps):
            return
        if self._fellows is None or not self._fellows.missing(tick):
            self._step(tick, self._area)
            self._participant.done()

    def _on_promise(self) -> None:
        """Go on once it is known what the other planners promised, or issue nothing when that takes too long."""
        if self._participant is not None:
            self._step_when_complete()
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
            self._step(instant, area)

    def _hold(self, instant: int, why: str) -> None:
        """Issue nothing at an instant [ns]: robots go on to the ends of their windows."""
        assert self._fellows is not None
        self._fellows.say(instant, (), {})
        if "planners" not in self._problems:
            self.get_logger().warning(f"no new paths: {why}")
        self._problems["planners"] = why
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
        decisions = {name: Stop(name, StopReason.NO_AREA, message) for name in self._navigator.served}
        self._publish(now, StepResult(seconds(now), dict(decisions)), 0.0)
        return True

    def _states_at(self, instant: int) -> dict[str, RobotState]:
        """The last state of every robot; for several planners the last one up to the instant that they share [ns]."""
        states = {name: state for name, (_, state) in self._states.items()}
        return states if self._fellows is None else self._fellows.states_at(seconds(instant), states)

    def _step(self, now: int, area: UnoccupiedArea) -> None:
        begin = clock.perf_counter()
        goals = {
            name: goal
            for name, goal in self._goals.items()
            if name in self._roster.present and self._ports[name].enabled
        }
        if self._lost:
            area = area.restamped(area.stamp, lost=self._lost)
        heard = {} if self._fellows is None else self._fellows.promises()
        result = self._navigator.step(seconds(now), area, self._states_at(now), goals, heard)
        duration = clock.perf_counter() - begin
        self._misses += duration > self.navigator_settings.sampling_interval
        if self._fellows is not None and not self.lockstep:
            late = now_of(self) - now - (self._fellows.place + 1) * self._share
            if late > 0:
                self._navigator.withdraw()
                self._misses += 1
                self._hold(now, f"the decision came {seconds(late):.3f} s after its share of the interval")
                return
            self._problems.pop("planners", None)
            self._problems.pop("area", None)
        self._publish(now, result, duration)

    def _publish(self, now: int, result: StepResult, duration: float) -> None:
        self._decided = now
        statuses = []
        for name, decision in result.decisions.items():
            self._ports[name].publish(decision, now)
            statuses.append(self._ports[name].status(decision, now, self._states.get(name, (None,))[0]))
        for name in result.stop_foreign:
            self._ports[name].halt(now)
        if self._fellows is not None:
            self._fellows.say(now, list(result.decisions), result.stop_foreign)
        self._publish_status(now, statuses, duration)

    def _publish_status(self, now: int, statuses: list[Any], duration: float) -> None:
        problem = "; ".join(self._problems.values())
        values = {"step_ms": f"{1e3 * duration:.4f}", "deadline_misses": self._misses}
        name = "planner" if self._fellows is None else f"planner {self.get_name()}"
        statuses.append(status(name, self.get_name(), problem, values))
        self._diagnostics.publish(diagnostics(now, statuses))
