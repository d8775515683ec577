"""What nodes that decide for robots share: who is there, where, with which goal, and their topics and services."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, Protocol

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry

from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlyerState
from snnav_core.types import PlannedPath, RobotSpec, RobotState, Stop, StopReason
from snnav_ros.convert import (
    goal_from_message,
    nanoseconds,
    nanoseconds_from_stamp,
    seconds,
    state_from_message,
)
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import ManagedNode, diagnostics, serve, status
from snnav_ros.nodes.node_time import has_time, now_of, watch_time
from snnav_ros.nodes.operator import GoalScript
from snnav_ros.nodes.robot_port import RobotPort
from snnav_ros.nodes.robots import PlannedRobot
from snnav_ros.nodes.roster import Roster
from snnav_ros.qos import DIAGNOSTICS, LOCKSTEP, for_mode
from snnav_sim.scene import AnyScene

__all__ = ["DecidingNode"]

_HOLD = "hold"


class Rules(Protocol):
    """Parameters that all nodes that decide have."""

    @property
    def clock_tolerance(self) -> float: ...

    @property
    def odometry_frames(self) -> tuple[str, ...]: ...

    @property
    def accept_robots(self) -> bool: ...


class Navigator(Protocol):
    """What decides."""

    def add_robot(self, robot: RobotSpec) -> None: ...

    def remove_robot(self, robot_id: str) -> None: ...

    def reset(self) -> None: ...


class DecidingNode(ManagedNode):
    """Hears odometry and goals of the robots that are there, and publishes what is decided for them.

    A subclass reads its parameters and calls `know` at the end of its constructor. It says in `is_complete` when, in
    lockstep, its own inputs of a tick are there, and decides in `decide`.
    """

    def know(
        self,
        scene: AnyScene | None,
        robots: Sequence[PlannedRobot],
        rules: Rules,
        navigator: Navigator,
        interval: float,
        window: float,
    ) -> None:
        """Take the robots that are there from the start, offer the services of the node, and go active.

        Parameters
        ----------
        scene : Scene or SpaceScene or None
        robots : sequence of PlannedRobot
        rules : Rules
        navigator : Navigator
        interval : float
            Sampling interval [s].
        window : float
            Time window of the paths [s].
        """
        self._rules, self._robots_of, self._interval = rules, navigator, interval
        self._window = nanoseconds(window)
        self._targets = {robot.spec.id: robot.target for robot in robots if robot.target is not None}
        specs = [robot.spec for robot in robots]
        self._roster = Roster(self, scene, specs, rules.accept_robots, self._join, self._leave)
        self._script = GoalScript(scene if self.lockstep else None)
        if not self.lockstep:
            self._jump = watch_time(self, self.reset)
        serve(self, self.options, self.reset, {})
        self.autostart()

    # what a subclass says

    @abstractmethod
    def inputs(self) -> list[str]:
        """Topics that it waits for besides those of the robots."""

    @abstractmethod
    def is_complete(self, tick: int) -> bool:
        """In lockstep: whether its own inputs of a tick [ns] are there, those of the robots aside."""

    @abstractmethod
    def decide(self, tick: int) -> None:
        """In lockstep: decide for a tick [ns] of which everything is there."""

    @abstractmethod
    def forget(self) -> None:
        """Forget its own inputs, as after a jump of time in real time."""

    def serves(self, name: str) -> bool:
        """Whether it decides for a robot."""
        return True

    def robot_heard(self, name: str) -> None:
        """A robot joined, and is heard now."""

    def robot_left(self, name: str) -> None:
        """A robot left."""

    def state_heard(self, state: RobotState | FlyerState) -> None:
        """A state of a robot came."""

    def read_state(self, message: Odometry, name: str, topic: str, frames: list[str]) -> Any:
        """Return the state that odometry tells; InvalidInput says why it cannot be used."""
        return state_from_message(message, name, topic, frames)

    def read_goal(self, message: PoseStamped, topic: str) -> tuple[float, ...]:
        """Return the goal [m, map] of a message; InvalidInput says why it cannot be used."""
        return goal_from_message(message, topic)

    # life

    @property
    def robots(self) -> dict[str, RobotSpec]:
        """Robots in the workspace by id."""
        return self._roster.present

    def configure(self) -> None:
        """Make the publishers."""
        self._goals = dict(self._targets)
        self._goal_messages: dict[str, PoseStamped] = {}
        self._goal_stamps: dict[str, int] = {}
        self._states: dict[str, tuple[int, Any]] = {}
        self._odometry: dict[str, Odometry] = {}  # what the states were read from
        self._unheard_since: dict[str, int] = {}
        self._problems: dict[str, str] = {}
        self._misses = 0
        self._ports: dict[str, RobotPort] = {}
        self._roster.configure()
        for name in self._roster.present:
            self._port(name)
        self._diagnostics = self.publisher(
            DiagnosticArray, "/diagnostics", for_mode(self.lockstep, DIAGNOSTICS)
        )

    def start(self) -> None:
        """Listen to the robots; in lockstep take part."""
        for name in self._script.robots:  # also of those who are still to join; nothing of it may be lost
            self.listen(PoseStamped, f"{name}/goal_pose", partial(self._on_goal, name), LOCKSTEP)
        self._participant: Participant | None = None
        if self.lockstep:
            self._participant = self.participate(
                nanoseconds(self._interval), lambda _: self.go_on(), self.reset
            )
        self._waiting = self.report_waiting(self._expected)
        for name in self._roster.present:
            self._listen_to(name)
        self._roster.start(self.go_on)

    def reset(self) -> None:
        """Forget paths, inputs and states; goals stay."""
        self._robots_of.reset()
        self._roster.reset()
        if not self.lockstep:  # in lockstep data of the new time may be here before their tick
            self._states, self._odometry, self._unheard_since = {}, {}, {}
            self.forget()

    def _expected(self) -> list[str]:
        robots = self._roster.present
        missing_goals = [f"{name}/goal_pose" for name in robots if name not in self._goals]
        return [*self.inputs(), *(f"{name}/odom" for name in robots), *missing_goals]

    # who is there

    def _port(self, name: str) -> RobotPort:
        if name not in self._ports:
            self._ports[name] = RobotPort(self, name)
        return self._ports[name]

    def _join(self, spec: RobotSpec) -> None:
        self._robots_of.add_robot(spec)
        self._port(spec.id)
        self._listen_to(spec.id)
        served = "" if self.serves(spec.id) else "; another planner serves it"
        self.get_logger().info(f"robot {spec.id} joined{served}")

    def _leave(self, name: str) -> None:
        self._robots_of.remove_robot(name)
        if not self.lockstep and self.serves(name):
            # Somebody else may have taken it out while it was given a path, on which nobody reckons with it any more.
            stop = Stop(name, StopReason.NO_GOAL, f"robot {name} left the workspace")
            self._ports[name].publish(stop, now_of(self))
        self._ports[name].close()
        heard = (self._states, self._odometry, self._goals, self._goal_messages, self._goal_stamps)
        for known in (*heard, self._unheard_since):
            known.pop(name, None)
        self._problems.pop(f"{name}/odom", None)
        self.robot_left(name)

    def _listen_to(self, name: str) -> None:
        """Hear a robot, and offer services for it, until it leaves or the node is deactivated."""
        self._ports[name].open(
            partial(self._on_odometry, name),
            partial(self._on_goal, name),
            partial(self._enable, name),
            partial(self._remove, name),
        )
        self.robot_heard(name)

    def _remove(self, name: str) -> str:
        """Take a robot out of the workspace by hand: it is stopped, and not planned around any more."""
        now = now_of(self) if self._participant is None else max(self._participant.now, 0)
        if not self._roster.take_out(name, now):
            return f"robot {name} is not there"
        stop = Stop(name, StopReason.NO_GOAL, "taken out of the workspace by a service")
        self._port(name).publish(stop, now)
        self.get_logger().info(f"robot {name} was taken out")
        self.go_on()
        return ""

    def _enable(self, name: str, enabled: bool) -> None:
        self._ports[name].enabled = enabled
        self.get_logger().info(f"robot {name} is {'planned for again' if enabled else 'stopped'}")

    # what comes in

    def _on_goal(self, name: str, message: PoseStamped) -> None:
        topic = f"{name}/goal_pose"
        self._waiting.heard(topic)
        try:
            self._goals[name] = self.read_goal(message, topic)
        except InvalidInput as error:
            self.get_logger().warning(f"goal not taken: {error}")
        else:
            self._goal_messages[name] = message
            self._goal_stamps[name] = nanoseconds_from_stamp(message.header.stamp)
            place = ", ".join(f"{value:.2f}" for value in self._goals[name])
            self.get_logger().info(f"robot {name} goes to ({place})")
            self.go_on()

    def _on_odometry(self, name: str, message: Odometry) -> None:
        topic = f"{name}/odom"
        self._waiting.heard(topic)
        if not (self.lockstep or has_time(self)):
            return
        try:
            state = self.read_state(message, name, topic, self._frames(name))
            self.check_ahead(topic, nanoseconds_from_stamp(message.header.stamp))
        except InvalidInput as error:
            self.complain(topic, error)
            return
        self._problems.pop(topic, None)
        self._states[name] = (nanoseconds_from_stamp(message.header.stamp), state)
        self._odometry[name] = message
        self.state_heard(state)
        self.go_on()

    def _frames(self, name: str) -> list[str]:
        """Return the frames of odometry of a robot that coincide with the map."""
        return [frame.replace("{robot}", name) for frame in self._rules.odometry_frames]

    def read_again(self) -> None:
        """Read the last odometry and goals of all robots once more, for they mean something else now."""
        for name, message in self._odometry.items():
            self._states.pop(name, None)
            stamp = nanoseconds_from_stamp(message.header.stamp)
            with suppress(InvalidInput):
                self._states[name] = (
                    stamp,
                    self.read_state(message, name, f"{name}/odom", self._frames(name)),
                )
        for name, message in self._goal_messages.items():
            self._goals.pop(name, None)
            with suppress(InvalidInput):
                self._goals[name] = self.read_goal(message, f"{name}/goal_pose")

    def check_ahead(self, topic: str, stamp: int) -> None:
        """Refuse what is stamped in the future: later it would pass for fresh. In lockstep time waits for its data."""
        ahead = 0.0 if self.lockstep else seconds(stamp - now_of(self))
        if ahead > self._rules.clock_tolerance:
            raise InvalidInput(
                f"{topic}: stamped {ahead:.3f} s ahead of the planner's clock, more than clock_tolerance "
                f"{self._rules.clock_tolerance:g} s; synchronise the clocks"
            )

    def complain(self, topic: str, error: InvalidInput) -> None:
        """Say once, and in `/diagnostics` as long as it lasts, why a message is not used."""
        if topic not in self._problems:
            self.get_logger().warning(f"message not used: {error}")
        self._problems[topic] = str(error)

    def goals(self) -> dict[str, tuple[float, ...]]:
        """Goals [m, map], with or without a height, of the robots that are there and planned for."""
        return {
            name: goal
            for name, goal in self._goals.items()
            if name in self._roster.present and self._ports[name].enabled
        }

    def refrain(self, now: int) -> bool:
        """Tell, and say why, whether no path may be issued at a time [ns] as somebody may drive who was not heard yet.

        A node that begins hears one robot before another, which may still be on a way that was certified before: for
        one time window, as long as such a way lasts, it waits for odometry of all.
        """
        unheard = [name for name in self.robots if name not in self._states]
        awaited = [name for name in unheard if now < self._unheard_since.setdefault(name, now) + self._window]
        if not awaited or len(unheard) == len(self.robots):
            return False
        self.hold(
            f"no odometry of robot {', '.join(awaited)} yet, which may be on a way that was certified before"
        )
        return True

    def hold(self, why: str) -> None:
        """Say why no new paths are issued: once, and in `/diagnostics` until `go_ahead`."""
        if _HOLD not in self._problems:
            self.get_logger().warning(f"no new paths: {why}")
        self._problems[_HOLD] = why

    def go_ahead(self) -> None:
        """New paths are issued again."""
        self._problems.pop(_HOLD, None)

    def go_on(self) -> None:
        """In lockstep: decide once all of the present tick is there: own inputs, who joins, odometry, goals."""
        if self._participant is None or self._participant.due is None:
            return
        tick = self._participant.due
        if not self.is_complete(tick) or not self._roster.is_complete(tick):
            return
        self._roster.settle(tick)
        present = self._roster.present
        if any(self._states.get(name, (-1,))[0] != tick for name in present):
            return
        if self._script.is_complete(tick, present, self._goal_stamps):
            self.decide(tick)

    # what goes out

    def publish_decisions(self, now: int, decisions: Mapping[str, PlannedPath | Stop]) -> list[Any]:
        """Tell the robots what was decided for a time [ns]; return their statuses."""
        statuses = []
        for name, decision in decisions.items():
            self._ports[name].publish(decision, now)
            statuses.append(self._ports[name].status(decision, now, self._states.get(name, (None,))[0]))
        return statuses

    def publish_status(
        self, name: str, now: int, statuses: Sequence[Any], duration: float, more: Mapping[str, object] = {}
    ) -> None:
        """Publish statuses and that of the node itself, of a decision at a time [ns] that took a duration [s]."""
        problem = "; ".join(self._problems.values())
        values = {"step_ms": f"{1e3 * duration:.4f}", "deadline_misses": self._misses, **more}
        own = status(name, self.get_name(), problem, values)
        self._diagnostics.publish(diagnostics(now, [*statuses, own]))
