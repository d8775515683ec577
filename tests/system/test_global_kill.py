"""Real processes over DDS: body tracker and global planner are killed in mid-run: the robot stands, and goes on."""

from __future__ import annotations

import signal
from contextlib import closing
from pathlib import Path as FilePath
from typing import Any

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry

from snnav_core.types import StopReason
from snnav_ros.convert import nanoseconds_from_stamp, seconds, verdict_from_message
from snnav_ros.processes import ChildProcesses
from support.process_site import ProcessSite, goal_at, processes

SCENE = """
name: two_ends
description: A robot goes to and fro past a pillar
sampling_interval: 0.3
boundary_speed: 0.3
safety_margin: 0.6
seed: 1
planner: global
workspace: {polygon: [[0, 0], [12, 0], [12, 6], [0, 6]]}
obstacles:
  - {circle: [6, 4.4, 0.4]}
sensors:
  - {id: west, device: lms200, position: [0.05, 3], heading_deg: 0, field_of_view_deg: 180, resolution_deg: 0.5,
     range_max: 20.0, noise: lms200}
  - {id: east, device: lms200, position: [11.95, 3], heading_deg: 180, field_of_view_deg: 180, resolution_deg: 0.5,
     range_max: 20.0, noise: lms200}
robots:
  - {id: cart, start: [2, 2], heading_deg: 0, target: [10, 2], speed: 0.5, max_turn_rate: 2.0, radius: 0.3}
"""
ENDS = [(10.0, 2.0), (2.0, 2.0)]
WINDOW, INTERVAL = 1.2, 0.3  # [s]
AWAY = 1.0  # [m] to the target, farther than it drives in a window
STILL = 1e-3  # [m/s]
LATE = (
    0.15  # [s] that a certificate may come after its stamp when it is compared with odometry heard before it
)
LONGEST = 60.0  # [s]


class Site(ProcessSite):
    """All nodes as processes, and a node that notes what the robot does and sends it to and fro."""

    def __init__(self, children: ChildProcesses, context: rclpy.Context, folder: FilePath) -> None:
        super().__init__(children, context, LONGEST)
        self.rows: list[tuple[float, float, float]] = []  # time, x, speed
        self.windows: list[tuple[float, float]] = []
        self.stops: list[Any] = []
        self.goal = ENDS[0]
        self._goals = self.node.create_publisher(PoseStamped, "cart/goal_pose", 1)
        self.node.create_subscription(Odometry, "cart/odom", self._on_odometry, 100)
        self.node.create_subscription(DiagnosticStatus, "cart/certificate", self._on_certificate, 100)
        self.start(SCENE, folder)

    @property
    def time(self) -> float:
        return self.rows[-1][0] if self.rows else -1.0

    def _on_odometry(self, message: Odometry) -> None:
        twist = message.twist.twist
        stamp = seconds(nanoseconds_from_stamp(message.header.stamp))
        speed = abs(twist.linear.x) + abs(twist.angular.z)
        self.rows.append((stamp, message.pose.pose.position.x, speed))

    def _on_certificate(self, message: DiagnosticStatus) -> None:
        verdict = verdict_from_message(message)
        if verdict.certificate is not None:
            self.windows.append((verdict.stamp, verdict.certificate.valid_until))
            return
        self.stops.append(verdict.stop)
        if verdict.stop is not None and verdict.stop.reason is StopReason.ARRIVED and self.rows:
            here = self.rows[-1][1]
            self.goal = max(ENDS, key=lambda end: abs(end[0] - here))
            self._goals.publish(goal_at(*self.goal))

    def until_it_drives(self) -> None:
        """Wait until it has driven half a metre towards a target that lies beyond its time window."""
        self.until(lambda: bool(self.rows), "odometry")
        self.until_under_way(lambda: self.rows[-1][1:2], lambda: self.goal[:1], AWAY)

    def pass_time(self, duration: float) -> None:
        end = self.time + duration
        self.until(lambda: self.time >= end, "time")

    def moved_since(self, when: float) -> float:
        return max((speed for stamp, _, speed in self.rows if stamp >= when), default=0.0)


@pytest.mark.slow
def test_kill_of_tracker_and_global_planner_stops_the_robot_and_a_restart_lets_it_go_on(
    tmp_path: FilePath, ros_domain: int
) -> None:
    with (
        processes(tmp_path, ros_domain) as (children, context),
        closing(Site(children, context, tmp_path)) as hall,
    ):
        hall.until(lambda: bool(hall.windows), "a certificate")
        deaf = [
            (0.0, hall.windows[0][0])
        ]  # a planner that starts may find the robot before it finds this test
        for killed in ("global_planner_node", "tracker_node"):
            hall.until_it_drives()
            hall.children.kill(killed, signal.SIGKILL)
            begin, said = hall.time, len(hall.stops)
            hall.pass_time(WINDOW + INTERVAL)
            stood = hall.time
            hall.pass_time(1.0)
            assert hall.moved_since(begin) > 0.3, "it drove"
            assert hall.moved_since(stood) < STILL, f"it stands without {killed}"
            reasons = {stop.reason for stop in hall.stops[said:] if stop.reason is not StopReason.ARRIVED}
            if killed == "tracker_node":
                assert reasons == {StopReason.NO_AREA}
                hall.until_said("check the tracker node")
            else:
                assert not reasons
                hall.until_said("the certificate ended at")
            hall.children.restart(killed)
            restarted, heard = hall.time, len(hall.windows)
            hall.until(lambda heard=heard: len(hall.windows) > heard, "a certificate")
            deaf.append((restarted, hall.windows[heard][0]))
        hall.until_it_drives()
        outside = [
            stamp
            for stamp, _, speed in hall.rows
            if speed > STILL
            and not any(begin - LATE <= stamp <= end + 1e-6 for begin, end in hall.windows)
            and not any(begin <= stamp <= end for begin, end in deaf)
        ]
        assert not outside, (outside, deaf, hall.windows)
