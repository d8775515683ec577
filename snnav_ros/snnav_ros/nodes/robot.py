"""The node of one robot: tracker, and a simulated base, on the ground or in the air, unless a real one is there."""

from __future__ import annotations

import math
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry, Path
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from snnav_core.errors import InvalidInput
from snnav_core.types import TIME_TOLERANCE
from snnav_ros.convert import nanoseconds, path_to_message, seconds, stop_to_path, word_from_message
from snnav_ros.convert.frames import header
from snnav_ros.gate import Order, PathGate
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import ManagedNode, NodeOptions, diagnostics, serve, status
from snnav_ros.nodes.fellows import PLANNERS_TOPIC
from snnav_ros.nodes.frames import FrameBroadcaster
from snnav_ros.nodes.node_time import ClockWatch, has_time, is_simulated, now_of, watch_time
from snnav_ros.nodes.presence import Presence
from snnav_ros.nodes.robot_parameters import RobotParameters, read_robot
from snnav_ros.qos import COMMAND, DIAGNOSTICS, INBOX, ODOMETRY, ODOMETRY_INPUT, for_mode
from snnav_ros.scenes import read_scene

__all__ = ["RobotNode", "RobotParameters"]


class RobotNode(ManagedNode):
    """Hears `<robot>/path` and `<robot>/certificate`, publishes `<robot>/cmd_vel` and, simulated, `<robot>/odom`."""

    def __init__(self, options: NodeOptions | None = None) -> None:
        super().__init__("robot_node", options or NodeOptions())
        scene = read_scene(self.reader)
        self.settings, self._body, self._curve = read_robot(self.reader, scene)
        settings, self.spec = self.settings, self._body.spec
        if self.lockstep and settings.base == "external":
            self.reader.fail("base", "value 'external' does not go with lockstep; a real base does not wait")
        self._gate = PathGate(settings.robot_id, settings.rules, in_space=self._body.in_space)
        self._is_driving = False
        self._is_simulated = settings.base != "external"
        self._by_wall = not self.lockstep and not is_simulated(self)
        self._presence = Presence(
            self, self.spec, settings.joins_at, settings.leaves_at, by_wall=self._by_wall
        )
        self._begin()
        if not self.lockstep and not self._by_wall:
            self._jump = watch_time(self, self._on_time_back)
        serve(self, self.options, self.reset, {"enable": self._enable, "present": self._presence.want})
        self.autostart()

    def configure(self) -> None:
        """Make the publishers."""
        name = self.spec.id
        self._gate.reset()
        self._enabled = True
        self._presence.configure()
        self._commands = self.publisher(
            TwistStamped if self.settings.stamped else Twist,
            f"{name}/cmd_vel",
            for_mode(self.lockstep, COMMAND),
        )
        self._diagnostics = self.publisher(
            DiagnosticArray, "/diagnostics", for_mode(self.lockstep, DIAGNOSTICS)
        )
        if self._is_simulated:
            self._odometry = self.publisher(Odometry, f"{name}/odom", for_mode(self.lockstep, ODOMETRY))
            self._frames = FrameBroadcaster(self, name)
        if self._curve is not None:
            self._paths = self.publisher(Path, f"{name}/path", for_mode(self.lockstep, COMMAND))

    def start(self) -> None:
        """Listen; then work by ticks or by a timer."""
        self._begin()
        name, command = self.spec.id, for_mode(self.lockstep, COMMAND)
        if self._curve is None:
            self.listen(Path, f"{name}/path", self._on_path, command)
            self.listen(DiagnosticStatus, f"{name}/certificate", self._on_verdict, command)
        if self.settings.base == "external":
            self.listen(Odometry, f"{name}/odom", self._on_odometry, ODOMETRY_INPUT)
        if self.lockstep and self.settings.planners:
            self.listen(DiagnosticStatus, PLANNERS_TOPIC, self._on_word, INBOX)
        self._participant: Participant | None = None
        if self.lockstep:
            period = nanoseconds(self.settings.control_period)
            self._participant = self.participate(period, self._on_tick, self.reset)
        else:
            self.every(self.settings.control_period, self._on_timer)
            self._is_there()
        self._waiting = self.report_waiting(self._inputs)
        self._is_driving = True

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition active -> inactive; the base stops."""
        self._is_driving = False
        self._stop_base()
        return super().on_deactivate(state)

    def reset(self) -> None:
        """Forget the path; a simulated base stands at its start again."""
        self._gate.reset()
        self._begin()

    def _begin(self) -> None:
        self._presence.begin()
        self._words: dict[str, int] = {}
        self._body.begin()
        self._forget()
        self._on_curve = False
        self._refusal = ""

    def _forget(self) -> None:
        """Be without a path, and without what was measured by a clock that is wrong; the base stays where it is."""
        self._body.forget()
        self._watch = ClockWatch(lambda: now_of(self))
        self._moved_at: int | None = None
        self._hold = 0.0
        self._valid_until, self._deadline = math.inf, math.inf
        self._logged: set[str] = set()
        self._is_reported = True

    def _on_time_back(self) -> None:
        self.reset()
        self._refuse("jump", "the clock jumped back; a new path is waited for", logged=True)

    def _check_clock(self) -> None:
        """Forget the path when the clock of the machine was set: its stamps and its validity mean nothing any more."""
        jump = self._watch.jump() if self._by_wall else 0.0
        if jump:
            self._gate.reset()
            self._forget()
            self._refuse("jump", f"the clock jumped by {jump:+.3f} s; a new path is waited for, check NTP")

    def _inputs(self) -> list[str]:
        name = self.spec.id
        if self._curve is not None:
            return []
        topics = [f"{name}/path"] + ([f"{name}/certificate"] if self.settings.require_certificate else [])
        return topics + ([f"{name}/odom"] if self.settings.base == "external" else [])

    def _enable(self, enabled: bool) -> None:
        self._enabled = enabled
        self.get_logger().info(f"robot {self.spec.id} {'drives again' if enabled else 'is paused'}")

    # what comes in

    def _now(self) -> int:
        """Return the time [ns]: of the clock of ROS, or in lockstep of the last tick."""
        return now_of(self) if self._participant is None else self._participant.now

    def _on_path(self, message: Path) -> None:
        self._waiting.heard(f"{self.spec.id}/path")
        self._check_clock()
        if self._is_there():
            self._obey(self._gate.offer_path(message, self._now()))

    def _on_verdict(self, message: DiagnosticStatus) -> None:
        self._waiting.heard(f"{self.spec.id}/certificate")
        self._check_clock()
        if self._is_there():
            self._obey(self._gate.offer_certificate(message, self._now()))

    def _on_word(self, message: DiagnosticStatus) -> None:
        """In lockstep: note that a planner is through with an instant; obey at once if it stops this robot."""
        try:
            word = word_from_message(message, PLANNERS_TOPIC)
        except InvalidInput as error:
            self.get_logger().warning(f"message not used: {error}", throttle_duration_sec=5.0)
            return
        self._words[word.planner] = word.stamp
        if self._presence.is_there and self.spec.id in dict(word.stops):
            self._obey(self._gate.offer_path(stop_to_path(word.stamp), self._now()))
        self._drive_when_complete()

    def _on_odometry(self, message: Odometry) -> None:
        topic = f"{self.spec.id}/odom"
        self._waiting.heard(topic)
        try:
            self._body.hear(message, topic)
        except InvalidInput as error:
            self.get_logger().warning(f"message not used: {error}", throttle_duration_sec=5.0)

    def _obey(self, order: Order | None) -> None:
        if order is not None:
            order = self._from_here(order)
            if order.refusal:
                self._refuse(order.cause, order.refusal)
            else:
                self._refusal = ""
            start = 0
            if order.path is not None:
                self._logged.clear()
                start = nanoseconds(order.path.start_time)
            valid_until = order.valid_until if math.isfinite(order.valid_until) else None
            self._body.follow(order.path, start, valid_until)
            self._valid_until = order.valid_until
            self._deadline = _steady() + order.valid_until - seconds(self._now())
        self._drive_when_complete()

    def _from_here(self, order: Order) -> Order:
        """The order, or a refusal when its path passes the robot farther away than it drives in an interval.

        The certificate holds for a robot on its path; one that was set elsewhere, or whose odometry was, is not.
        """
        away = 0.0 if order.path is None else self._body.away(order.path)
        most = max(self.spec.speed * self.settings.sampling_interval, self.spec.radius)
        if away <= most:
            return order
        text = f"the path passes {away:.2f} m from the robot, allowed {most:.2f} m; check its odometry"
        return Order(None, refusal=text, cause="elsewhere")

    def _refuse(self, cause: str, text: str, *, logged: bool = False) -> None:
        """Note why the robot stops, and say it once until it drives again."""
        if cause not in self._logged and not logged:
            self.get_logger().warning(f"robot {self.spec.id} stops: {text}")
        self._logged.add(cause)
        self._refusal, self._is_reported = text, False

    # what goes out

    def _is_there(self) -> bool:
        """Whether the robot is in the workspace; in lockstep the ticks say so."""
        if not self.lockstep and has_time(self):
            self._come_and_go(now_of(self))
        return self._presence.is_there

    def _come_and_go(self, now: int) -> None:
        """Join or leave when it is time for that [ns]."""
        if not self._presence.update(now):
            return
        there = self._presence.is_there
        self.get_logger().info(f"robot {self.spec.id} {'joins' if there else 'leaves'} the workspace")
        if not there:
            self._stop_base()
            self._gate.reset()
            self._body.begin()
            self._forget()

    def _on_tick(self, tick: int) -> None:
        self._come_and_go(tick)
        if self._presence.is_there:
            self._move(tick)
        self._drive_when_complete()

    def _drive_when_complete(self) -> None:
        """In lockstep: at a sampling instant wait for the path of this instant, then give the next command."""
        if self._participant is None or self._participant.due is None:
            return
        tick = self._participant.due
        sampled = tick % nanoseconds(self.settings.sampling_interval) == 0
        if self._presence.is_there and self._curve is None and sampled:
            heard = all(self._words.get(name, -1) >= tick for name in self.settings.planners)
            if not (heard and self._gate.complete(tick)):
                return
        if self._presence.is_there:
            self._drive(tick)
        self._participant.done()

    def _on_timer(self) -> None:
        self._check_clock()
        if not self._is_there():
            return
        now = now_of(self)
        order = self._gate.watch(now)
        if order is not None:
            self._obey(order)
        if self._is_simulated:
            self._move(now)
        self._drive(now)

    def _move(self, now: int) -> None:
        """Let the simulated base drive up to now, and publish where it is."""
        moment = time.monotonic_ns() if self._by_wall else now
        if self._moved_at is not None:
            self._body.move(max(0.0, seconds(moment - self._moved_at)), self._hold)
        self._moved_at = moment
        message = self._body.measure(now)
        self._odometry.publish(message)
        self._frames.broadcast(message.pose.pose, now)

    def _take_curve(self, now: int) -> None:
        """Follow the curve that the scene gives this robot from now on; nobody plans for it."""
        if self._curve is None or self._on_curve:
            return
        path = self._curve(seconds(now))
        self._on_curve = True
        self._body.follow(path, now, None)
        self._paths.publish(path_to_message(path))

    def _drive(self, now: int) -> None:
        self._take_curve(now)
        problem = self._trouble(now)
        self._body.halt()
        if not problem:
            left = self._window_left(now)
            period, holds = self.settings.control_period, self.settings.command_holds
            self._hold = max(period, min(holds, left))  # so the simulated base ends with the window ...
            needed = period if self._is_simulated else holds  # ... which a real one does not know
            if left + TIME_TOLERANCE >= needed:
                self._body.steer(seconds(now))
            elif not self._body.finished and not self._refusal:
                end = f"the certificate ended at {self._valid_until:.3f} s and no newer path came"
                self._refuse("window", f"{end}; check the planner")
        self._publish_command(now)
        sampled = now % nanoseconds(self.settings.sampling_interval) < nanoseconds(
            self.settings.control_period
        )
        if sampled or not self._is_reported:
            self._is_reported = True
            self._report(now, problem)

    def _publish_command(self, now: int) -> None:
        twist = self._body.twist()
        if self.settings.stamped:
            twist = TwistStamped(header=header(now, f"{self.spec.id}/base_link"), twist=twist)
        self._commands.publish(twist)

    def _stop_base(self) -> None:
        """Tell the base to stop, for this node tells it nothing more."""
        self._body.halt()
        if not self.lockstep:
            self._publish_command(now_of(self))

    def destroy_node(self) -> None:
        """End the node; its base stops."""
        if self._is_driving and self.context.ok():
            self._stop_base()
        super().destroy_node()

    def _window_left(self, now: int) -> float:
        """Return how long the path may still be followed [s], by the clock of ROS and by a steady one."""
        left = self._valid_until - seconds(now)
        return min(left, self._deadline - _steady()) if self._by_wall else left

    def _trouble(self, now: int) -> str:
        """Return why the robot must not drive, or an empty text."""
        if not self._enabled:
            return "paused"
        if self._body.measured_at is None:
            return "no odometry"
        age = seconds(now - self._body.measured_at)
        if age > self.settings.max_odometry_age:
            return f"odometry is {age:.2f} s old"
        if age < -self.settings.clock_tolerance:
            return f"odometry is stamped {-age:.2f} s ahead of this robot's clock; synchronise the clocks"
        return ""

    def _report(self, now: int, problem: str) -> None:
        values: dict[str, Any] = {
            "cross_track_error": f"{self._body.error:.4f}",
            "speed": f"{self._body.speed:.4f}",
            "window_left": "none" if self._body.finished else f"{max(0.0, self._window_left(now)):.3f}",
            "path_age": "none"
            if self._gate.path_stamp < 0
            else f"{seconds(now - self._gate.path_stamp):.3f}",
        }
        entry = status(f"tracker {self.spec.id}", self.spec.id, problem or self._refusal, values)
        self._diagnostics.publish(diagnostics(now, [entry]))


def _steady() -> float:
    """Return the time of a clock that nobody can set [s]."""
    return time.monotonic()
