"""The node of one robot: tracker, and a simulated Pioneer base unless a real one is there."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any, Literal

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry, Path

from snnav_core.errors import InvalidInput
from snnav_core.tracking.planar import PlanarTracker, TrackerSettings
from snnav_core.types import Pose2D, RobotSpec, VelocityCommand
from snnav_ros.convert import (
    nanoseconds,
    nanoseconds_from_stamp,
    odometry_to_message,
    path_from_message,
    seconds,
    state_from_message,
    verdict_from_message,
)
from snnav_ros.convert.frames import header
from snnav_ros.gate import Order, PathGate
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import ManagedNode, NodeOptions, diagnostics, now_of, serve, status, watch_time
from snnav_ros.nodes.frames import FrameBroadcaster
from snnav_ros.parameters import ParameterReader
from snnav_ros.qos import COMMAND, DIAGNOSTICS, ODOMETRY, ODOMETRY_INPUT, for_mode
from snnav_ros.scenes import read_scene
from snnav_sim.devices.base import PioneerBase
from snnav_sim.scene_types import RobotScene, Scene

__all__ = ["RobotNode", "RobotParameters"]

_HEADINGS_KEPT = 200
_STOP = VelocityCommand(0.0, 0.0)


@dataclass(frozen=True)
class RobotParameters:
    """Parameters of the node besides those of the tracker.

    Parameters
    ----------
    robot_id : str
        Name of the robot; may stay empty when the scene has only one.
    start : tuple of float
        Where the simulated base stands at first [m, map].
    heading_deg : float
        Its heading there [degree, map].
    speed : float
        Constant travelling speed [m/s].
    max_turn_rate : float
        Largest turn rate u_M [rad/s].
    radius : float
        Radius of the disk that covers the robot [m].
    control_period : float
        From command to command [s].
    sampling_interval : float
        From path to path [s]; used in lockstep.
    base : {"simulated", "external"}
        Drive a simulated Pioneer base and publish its odometry, or hear `<robot>/odom` of a real one.
    require_certificate : bool
        Follow a path only with an accepted certificate that bears its digest.
    max_odometry_age : float
        With an external base: the robot is stopped when its odometry is older [s].
    stamped : bool
        Publish `<robot>/cmd_vel` as TwistStamped instead of Twist.
    """

    robot_id: str = ""
    start: tuple[float, ...] = (0.0, 0.0)
    heading_deg: float = 0.0
    speed: float = 0.5
    max_turn_rate: float = 1.0
    radius: float = 0.3
    control_period: float = 0.05
    sampling_interval: float = 1.0
    base: Literal["simulated", "external"] = "simulated"
    require_certificate: bool = True
    max_odometry_age: float = 0.5
    stamped: bool = False


class RobotNode(ManagedNode):
    """Hears `<robot>/path` and `<robot>/certificate`, publishes `<robot>/cmd_vel` and, simulated, `<robot>/odom`."""

    def __init__(self, options: NodeOptions | None = None) -> None:
        super().__init__("robot_node", options or NodeOptions())
        scene = read_scene(self.reader)
        self.settings, entry = _read(self.reader, scene)
        tracker = self.reader.settings(TrackerSettings, "tracker")
        self.reader.finish()
        settings = self.settings
        self.spec = RobotSpec(settings.robot_id, settings.radius, settings.speed, settings.max_turn_rate)
        heading = entry.heading if entry is not None else math.radians(settings.heading_deg)
        self._start = Pose2D(settings.start[0], settings.start[1], heading)
        try:
            self._tracker = PlanarTracker(self.spec, tracker, settings.control_period)
        except InvalidInput as error:
            self.reader.fail("tracker", str(error))
        if self.lockstep and settings.base == "external":
            self.reader.fail("base", "value 'external' does not go with lockstep; a real base does not wait")
        if not self.lockstep:
            self._jump = watch_time(self, self.reset)
        serve(self, self.options, self.reset, {"enable": self._enable})
        self.autostart()

    def configure(self) -> None:
        """Make the publishers."""
        name = self.spec.id
        self._gate = PathGate(self.settings.require_certificate)
        self._enabled = True
        self._commands = self.publisher(
            TwistStamped if self.settings.stamped else Twist,
            f"{name}/cmd_vel",
            for_mode(self.lockstep, COMMAND),
        )
        self._diagnostics = self.publisher(
            DiagnosticArray, "/diagnostics", for_mode(self.lockstep, DIAGNOSTICS)
        )
        if self.settings.base == "simulated":
            self._odometry = self.publisher(Odometry, f"{name}/odom", for_mode(self.lockstep, ODOMETRY))
            self._frames = FrameBroadcaster(self, name)

    def start(self) -> None:
        """Listen; then work by ticks or by a timer."""
        self._begin()
        name, command = self.spec.id, for_mode(self.lockstep, COMMAND)
        self.listen(Path, f"{name}/path", self._on_path, command)
        self.listen(DiagnosticStatus, f"{name}/certificate", self._on_verdict, command)
        if self.settings.base == "external":
            self.listen(Odometry, f"{name}/odom", self._on_odometry, ODOMETRY_INPUT)
        self._participant: Participant | None = None
        if self.lockstep:
            period = nanoseconds(self.settings.control_period)
            self._participant = self.participate(period, self._on_tick, self.reset)
        else:
            self.every(self.settings.control_period, self._on_timer)
        self._waiting = self.report_waiting(self._inputs)

    def reset(self) -> None:
        """Forget the path; a simulated base stands at its start again."""
        self._gate.reset()
        self._begin()

    def _begin(self) -> None:
        self._tracker.reset()
        self._base = PioneerBase(self._start, self.spec)
        self._pose: tuple[int, Pose2D] | None = None
        self._headings: deque[tuple[int, float]] = deque(maxlen=_HEADINGS_KEPT)
        self._command = _STOP
        self._refusal = ""
        self._last_path = -1

    def _inputs(self) -> list[str]:
        name = self.spec.id
        topics = [f"{name}/path"] + ([f"{name}/certificate"] if self.settings.require_certificate else [])
        return topics + ([f"{name}/odom"] if self.settings.base == "external" else [])

    def _enable(self, enabled: bool) -> None:
        self._enabled = enabled
        self.get_logger().info(f"robot {self.spec.id} {'drives again' if enabled else 'is paused'}")

    # what comes in

    def _on_path(self, message: Path) -> None:
        topic, stamp = f"{self.spec.id}/path", nanoseconds_from_stamp(message.header.stamp)
        self._waiting.heard(topic)
        try:
            order = self._gate.offer_path(stamp, path_from_message(message, topic))
        except InvalidInput as error:
            order = Order(None, refusal=str(error))
        self._obey(order, stamp)

    def _on_verdict(self, message: DiagnosticStatus) -> None:
        topic = f"{self.spec.id}/certificate"
        self._waiting.heard(topic)
        try:
            verdict = verdict_from_message(message, topic)
        except InvalidInput as error:
            self._obey(Order(None, refusal=str(error)), self._gate.path_stamp)
            return
        stamp = nanoseconds(verdict.stamp)
        self._obey(self._gate.offer_verdict(stamp, verdict), stamp)

    def _on_odometry(self, message: Odometry) -> None:
        topic = f"{self.spec.id}/odom"
        self._waiting.heard(topic)
        try:
            state = state_from_message(message, self.spec.id, topic)
        except InvalidInput as error:
            self.get_logger().warning(f"message not used: {error}", throttle_duration_sec=5.0)
            return
        self._moved(nanoseconds_from_stamp(message.header.stamp), state.pose)

    def _obey(self, order: Order | None, stamp: int) -> None:
        if order is not None:
            if order.refusal and order.refusal != self._refusal:
                self.get_logger().warning(f"robot {self.spec.id} stops: {order.refusal}")
            self._refusal = order.refusal
            heading = next((value for when, value in reversed(self._headings) if when <= stamp), None)
            valid_until = order.valid_until if math.isfinite(order.valid_until) else None
            self._tracker.set_path(order.path, heading, valid_until)
        self._drive_when_complete()

    # what goes out

    def _on_tick(self, tick: int) -> None:
        self._move(tick)
        self._drive_when_complete()

    def _drive_when_complete(self) -> None:
        """In lockstep: at a sampling instant wait for the path of this instant, then give the next command."""
        if self._participant is None or self._participant.due is None:
            return
        tick = self._participant.due
        if tick % nanoseconds(self.settings.sampling_interval) or self._gate.complete(tick):
            self._drive(tick)
            self._participant.done()

    def _on_timer(self) -> None:
        now = now_of(self)
        if self.settings.base == "simulated":
            self._move(now)
        self._drive(now)

    def _move(self, now: int) -> None:
        """Let the simulated base drive up to now, and publish where it is."""
        if self._pose is not None:
            self._base.apply(self._command, seconds(now - self._pose[0]))
        self._moved(now, self._base.pose)
        driven = self._base.command
        message = odometry_to_message(self.spec.id, self._base.pose, driven.speed, driven.turn_rate, now)
        self._odometry.publish(message)
        self._frames.broadcast(self._base.pose, now)

    def _moved(self, stamp: int, pose: Pose2D) -> None:
        self._pose = (stamp, pose)
        self._headings.append((stamp, pose.heading))

    def _drive(self, now: int) -> None:
        problem = self._trouble(now)
        self._command = _STOP
        if not problem and self._pose is not None:
            self._command = self._tracker.command(self._pose[1], seconds(now))
        twist = Twist()
        twist.linear.x, twist.angular.z = self._command.speed, self._command.turn_rate
        if self.settings.stamped:
            twist = TwistStamped(header=header(now, f"{self.spec.id}/base_link"), twist=twist)
        self._commands.publish(twist)
        if now % nanoseconds(self.settings.sampling_interval) < nanoseconds(self.settings.control_period):
            self._report(now, problem)

    def _trouble(self, now: int) -> str:
        """Return why the robot must not drive, or an empty text."""
        if not self._enabled:
            return "paused"
        if self._pose is None:
            return "no odometry"
        age = seconds(now - self._pose[0])
        if age > self.settings.max_odometry_age:
            return f"odometry is {age:.2f} s old"
        return ""

    def _report(self, now: int, problem: str) -> None:
        values: dict[str, Any] = {
            "cross_track_error": f"{self._tracker.cross_track_error:.4f}",
            "speed": f"{self._command.speed:.4f}",
            "path_age": "none"
            if self._gate.path_stamp < 0
            else f"{seconds(now - self._gate.path_stamp):.3f}",
        }
        entry = status(f"tracker {self.spec.id}", self.spec.id, problem or self._refusal, values)
        self._diagnostics.publish(diagnostics(now, [entry]))


def _read(reader: ParameterReader, scene: Scene | None) -> tuple[RobotParameters, RobotScene | None]:
    """Return the parameters, and the robot of the scene whose heading they take over."""
    if scene is None:
        settings = reader.settings(RobotParameters)
        if not settings.robot_id:
            reader.fail("robot_id", "is not given; name the robot")
        return _checked(reader, settings), None
    ids = [robot.id for robot in scene.robots]
    chosen = reader.peek("robot_id", ids[0] if len(ids) == 1 else "")
    if chosen not in ids:
        reader.fail(
            "robot_id", f"value {chosen!r} names no robot of {scene.name}; it has {', '.join(ids) or 'none'}"
        )
    robot = scene.robots[ids.index(chosen)]
    settings = reader.settings(
        RobotParameters,
        robot_id=robot.id,
        start=robot.start,
        heading_deg=math.degrees(robot.heading),
        speed=robot.speed,
        max_turn_rate=robot.max_turn_rate,
        radius=robot.radius,
        control_period=scene.control_period,
        sampling_interval=scene.sampling_interval,
    )
    return _checked(reader, settings), robot if settings.heading_deg == math.degrees(robot.heading) else None


def _checked(reader: ParameterReader, settings: RobotParameters) -> RobotParameters:
    if len(settings.start) != 2 or not all(map(math.isfinite, (*settings.start, settings.heading_deg))):
        reader.fail(
            "start", f"value {list(settings.start)} with heading_deg {settings.heading_deg} is no pose"
        )
    ratio = settings.sampling_interval / settings.control_period
    if abs(ratio - round(ratio)) > 1e-6 or ratio < 0.5:
        reader.fail(
            "control_period",
            f"value {settings.control_period} does not divide sampling_interval {settings.sampling_interval}",
        )
    return settings
