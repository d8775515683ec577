"""A corridor whose nodes are processes; one node of the test is the robot's base and the person who gives goals.

The base does what `cart/cmd_vel` says, for at most 0.1 s after the stamp of the last command. All is recorded.
"""

from __future__ import annotations

import math
import signal
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from nav_msgs.msg import Path as PathMessage
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan, PointCloud2
from std_msgs.msg import String

from snnav_core.types import Pose2D, StopReason, VelocityCommand
from snnav_ros.bag.drives import EVENTS_TOPIC
from snnav_ros.bag.writer import BagWriter
from snnav_ros.convert import (
    Verdict,
    nanoseconds,
    nanoseconds_from_stamp,
    odometry_to_message,
    seconds,
    verdict_from_message,
)
from snnav_ros.processes import ChildProcesses
from snnav_ros.qos import LATCHED, RECORDED, SENSOR
from snnav_sim.devices.base import PioneerBase
from snnav_sim.scene import parse_scene
from support.process_site import ProcessSite, goal_at, processes

SCENE = """
name: corridor
description: A robot goes to and fro in a narrow corridor, most of which only one range finder sees
sampling_interval: 0.4
control_period: 0.05
time_window: 4
boundary_speed: 0.3
safety_margin: 0.4
seed: 1
workspace: {polygon: [[0, 0], [8, 0], [8, 2.2], [0, 2.2]]}
sensors:
  - {id: west, device: lms200, position: [0.05, 1.1], heading_deg: 0, field_of_view_deg: 180, resolution_deg: 0.5,
     range_max: 10.0, noise: lms200}
  - {id: east, device: lms200, position: [7.95, 1.1], heading_deg: 180, field_of_view_deg: 180, resolution_deg: 0.5,
     range_max: 1.5, noise: lms200}
robots:
  - {id: cart, start: [1.5, 1.1], heading_deg: 0, target: [5.5, 1.1], speed: 0.8, max_turn_rate: 2.5, radius: 0.3}
"""
INTERVAL = 0.4  # [s] from decision to decision, as in the scene
GOALS = [(5.5, 1.1), (1.5, 1.1)]
WATCHDOG = 0.1  # [s] after the last command the base stops by itself
STILL = 0.5  # [s] without any motion: it stands
STILL_STANDING = VelocityCommand(0.0, 0.0)
RESTART, RESET = "restart", "clock set back"  # events, besides names of signals
LONGEST = 40.0  # [s] that anything may take before a test fails


class Listener:
    """A node that records what it hears, as `ros2 bag record` would, and what it is told that was done."""

    TOPICS = (
        (Clock, "/clock", RECORDED),
        (Odometry, "cart/odom", RECORDED),
        (TwistStamped, "cart/cmd_vel", RECORDED),
        (PathMessage, "cart/path", RECORDED),
        (DiagnosticStatus, "cart/certificate", RECORDED),
        (PoseStamped, "cart/goal_pose", RECORDED),
        (DiagnosticArray, "/diagnostics", RECORDED),
        (PointCloud2, "unoccupied_area", LATCHED),
        (OccupancyGrid, "unoccupied_area/grid", LATCHED),
        (LaserScan, "sensors/west/scan", SENSOR),
        (LaserScan, "sensors/east/scan", SENSOR),
    )

    def __init__(self, context: rclpy.Context, bag: BagWriter) -> None:
        self._bag = bag
        self._offset, self._last = time.time_ns() - time.monotonic_ns(), 0
        self.node = Node("listener", context=context, enable_rosout=False, start_parameter_services=False)
        for kind, topic, qos in self.TOPICS:
            self.node.create_subscription(kind, topic, partial(self._write, topic), qos)

    def note(self, text: str) -> None:
        """Record that something is done now."""
        self._write(EVENTS_TOPIC, String(data=text))

    def _write(self, topic: str, message: Any) -> None:
        self._last = max(self._last + 1, self._offset + time.monotonic_ns())  # no two at the same time
        self._bag.write(topic, message, self._last)


class Site(ProcessSite):
    """The nodes of the scene as processes, and a node that is the robot's base and the person who gives goals."""

    def __init__(
        self, children: ChildProcesses, context: rclpy.Context, folder: FilePath, bag: BagWriter
    ) -> None:
        super().__init__(children, context, LONGEST)
        self.scene = parse_scene(SCENE, "corridor")
        assert self.scene.sampling_interval == INTERVAL
        (robot,) = self.scene.robots
        self.base = PioneerBase(robot.pose, robot.spec)
        self.time, self.jumps, self.moved_at = -1.0, 0, {"wall": 0.0, "simulated": 0.0}
        self.steps: deque[float] = deque(maxlen=5)  # lengths of the last motions [m]
        self._command, self._commanded, self._goal = STILL_STANDING, -math.inf, 0
        self.listener = Listener(context, bag)
        self.executor.add_node(self.listener.node)
        self._odometry = self.node.create_publisher(Odometry, "cart/odom", 10)
        self._goals = self.node.create_publisher(PoseStamped, "cart/goal_pose", 1)
        for kind, topic, take in (
            (Clock, "/clock", self._on_clock),
            (TwistStamped, "cart/cmd_vel", self._on_command),
            (DiagnosticStatus, "cart/certificate", self._on_certificate),
        ):
            self.node.create_subscription(kind, topic, take, 100)
        external = {"base": "external", "command_timeout": WATCHDOG, "stamped": True}
        self.start(SCENE, folder, {"cart": external})

    def close(self) -> None:
        super().close()
        self.listener.node.destroy_node()

    def _on_clock(self, message: Clock) -> None:
        now = seconds(nanoseconds_from_stamp(message.clock))
        if now < self.time:
            self.jumps += 1
            self._commanded = -math.inf
        elif now > self.time >= 0.0:
            self._move(now)
        self.time = now
        self._tell_pose(now)

    def _move(self, now: float) -> None:
        """Do what was commanded as long as that holds, then stand; the odometry tells both exactly."""
        before = self.base.pose
        rest = min(now, max(self.time, self._commanded + WATCHDOG))
        self.base.apply(self._command, rest - self.time)
        if self.base.pose != before:
            self.moved_at = {"wall": time.monotonic(), "simulated": now}
            self.steps.append(math.dist(_place(before), _place(self.base.pose)))
        if rest < now:
            if rest > self.time:
                self._tell_pose(rest)
            self.base.apply(STILL_STANDING, now - rest)

    def _tell_pose(self, stamp: float) -> None:
        driven = self.base.command
        pose = odometry_to_message("cart", self.base.pose, driven.speed, driven.turn_rate, nanoseconds(stamp))
        self._odometry.publish(pose)

    def _on_command(self, message: TwistStamped) -> None:
        stamp, twist = seconds(nanoseconds_from_stamp(message.header.stamp)), message.twist
        if stamp <= self.time + WATCHDOG:  # else it was given before time began anew
            self._command, self._commanded = VelocityCommand(twist.linear.x, twist.angular.z), stamp

    def _on_certificate(self, message: DiagnosticStatus) -> None:
        verdict: Verdict = verdict_from_message(message)
        if verdict.stop is not None and verdict.stop.reason is StopReason.ARRIVED:
            self._goal = min(range(len(GOALS)), key=lambda k: -math.dist(GOALS[k], _place(self.base.pose)))
            self._goals.publish(goal_at(*GOALS[self._goal]))

    def until_it_drives(self) -> None:
        """Wait until the robot drives, and has some way to go."""
        self.steps.clear()

        def drives() -> bool:
            goal = GOALS[self._goal]
            return sum(self.steps) > 0.1 and 1.2 < math.dist(goal, _place(self.base.pose)) < 3.6

        self.until(drives, "a robot that drives")

    def clock_of(self, kind: str) -> tuple[str, Callable[[], float]]:
        """Return by which time an outage of a kind is measured: simulated time stands still without its clock.

        It was also seen to stand still for one or two seconds after the death or sleep of another node: then nothing
        moves, but the robot has not stopped.
        """
        return ("wall", time.monotonic) if kind == "clock" else ("simulated", lambda: self.time)

    def until_it_stands(self, kind: str) -> None:
        name, now = self.clock_of(kind)
        self.until(lambda: now() - self.moved_at[name] > STILL, "a robot that stands")

    def wait(self, kind: str, duration: float) -> None:
        _, now = self.clock_of(kind)
        end = now() + duration
        self.until(lambda: now() >= end, "the end of a while")

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a node, and record it."""
        self.listener.note(f"{number.name} {name}")
        self.children.kill(name, number)

    def restart(self, name: str) -> None:
        """Start a node again, and record it."""
        self.listener.note(f"{RESTART} {name}")
        self.children.restart(name)


@contextmanager
def site(folder: FilePath, domain: int) -> Iterator[Site]:
    """Bring all up; what is recorded is in `folder / "bag"` afterwards, also when something failed."""
    with ExitStack() as stack:
        children, context = stack.enter_context(processes(folder, domain))
        bag = BagWriter(folder / "bag")
        bag.open()
        stack.callback(bag.close)
        made = stack.enter_context(closing(Site(children, context, folder, bag)))
        yield made
        made.until_it_drives()  # the recording shows that it goes on


def _place(pose: Pose2D) -> tuple[float, float]:
    return pose.x, pose.y
