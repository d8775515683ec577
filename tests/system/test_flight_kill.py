"""Real processes over DDS: cameras, fusion and planner are killed while a robot flies: it hovers, and flies on later.

All that the robot moved is judged: it lies inside of a window that was certified,
and keeps the safety margin from the true bodies.
"""

from __future__ import annotations

import math
import signal
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path as FilePath

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry

from snnav_core.types import Stop, StopReason
from snnav_ros.convert import flyer_state_from_message, verdict_from_message
from snnav_ros.processes import ChildProcesses
from snnav_sim.scene import SpaceScene, parse_any_scene
from snnav_sim.space_world import SpaceWorld
from support.process_site import ProcessSite, goal_at, processes

SCENE = """
name: loft
description: A robot flies to and fro in a room with two cameras, past a pillar
seed: 1
sampling_interval: 0.4
time_window: 3
boundary_speed: 0.25
safety_margin: 0.4
workspace: {box: [[0, 0, 0], [6, 4, 3]], known_static: true}
obstacles:
  - {circle: [3, 0.3, 0.2], height: [0, 3], known_static: true}
sensors:
  - {id: south, device: tof, position: [0.1, 0.1, 2.9], look_at: [3, 2.2, 1.2], columns: 64, rows: 64}
  - {id: north, device: tof, position: [5.9, 3.9, 2.9], look_at: [3, 1.8, 1.2], columns: 64, rows: 64}
robots:
  - {id: bee, start: [1.4, 2, 1.4], heading_deg: 0, target: [4.6, 2, 1.6], speed: 0.6, max_turn_rate: 2.0, radius: 0.2}
"""
ENDS = [(4.6, 2.0, 1.6), (1.4, 2.0, 1.4)]
KILLED = {
    "cameras": ("south", "north"),
    "fusion": ("fusion_node",),
    "planner": ("planner_node",),
}
WINDOW, INTERVAL = 1.2, 0.4  # [s]
AWAY = 1.0  # [m] to the target, farther than it flies in a window
STILL = 1.0  # [s] without any motion: it hovers
LATE = (
    0.2  # [s] that a certificate may come after its stamp when it is compared with odometry heard before it
)
LONGEST = 90.0  # [s]


class Site(ProcessSite):
    """All nodes as processes, and a node that notes what the robot does and sends it to and fro."""

    def __init__(self, children: ChildProcesses, context: rclpy.Context, folder: FilePath) -> None:
        super().__init__(children, context, LONGEST)
        self.rows: list[tuple[float, ...]] = []  # time, x, y, z, speed since the row before
        self.windows: list[tuple[float, float]] = []
        self.stops: list[Stop] = []
        self.goal = ENDS[0]
        self._goals = self.node.create_publisher(PoseStamped, "bee/goal_pose", 1)
        self.node.create_subscription(Odometry, "bee/odom", self._on_odometry, 100)
        self.node.create_subscription(DiagnosticStatus, "bee/certificate", self._on_certificate, 100)
        self.start(SCENE, folder)

    @property
    def time(self) -> float:
        return self.rows[-1][0] if self.rows else -1.0

    @property
    def moved_at(self) -> float:
        """When it was last in motion [s]."""
        return next((row[0] for row in reversed(self.rows) if row[4] > 0.0), -math.inf)

    def _on_odometry(self, message: Odometry) -> None:
        state = flyer_state_from_message(message, "bee")
        self.rows.append((state.stamp, *state.position.tolist(), state.speed))

    def _on_certificate(self, message: DiagnosticStatus) -> None:
        verdict = verdict_from_message(message)
        if verdict.certificate is not None:
            self.windows.append((verdict.stamp, verdict.certificate.valid_until))
        elif verdict.stop is not None:
            self.stops.append(verdict.stop)
            if verdict.stop.reason is StopReason.ARRIVED and self.rows:
                here = self.rows[-1][1]
                self.goal = max(ENDS, key=lambda end: abs(end[0] - here))
                self._goals.publish(goal_at(*self.goal))

    def until_it_flies(self) -> None:
        """Wait until it has flown half a metre towards a target that lies beyond its time window."""
        self.until(lambda: bool(self.rows), "odometry")
        self.until_under_way(lambda: self.rows[-1][1:4], lambda: self.goal, AWAY)

    def until_it_hovers(self) -> None:
        self.until(lambda: self.time - self.moved_at > STILL, "a robot that hovers")


def kill_and_restart(site: Site, kind: str) -> tuple[float, float]:
    """Kill nodes in flight, see the robot hover and why, start them again.

    Returns
    -------
    tuple
        From when to when the test may not have heard what the planner certified: the restart and the first
        certificate after it [s].
    """
    site.until_it_flies()
    for name in KILLED[kind]:
        site.children.kill(name, signal.SIGKILL)
    said = len(site.stops)
    site.until_it_hovers()
    reasons = {stop.reason for stop in site.stops[said:]} - {StopReason.ARRIVED}
    if kind == "planner":
        assert not reasons
        assert site.moved_at <= max(end for _, end in site.windows) + 1e-6
        site.until_said("the certificate ended at")
    else:
        assert reasons, "the robot was told to stop"
        assert (StopReason.NO_AREA in reasons) == (kind == "fusion")
    restarted, heard = site.time, len(site.windows)
    for name in KILLED[kind]:
        site.children.restart(name)
    site.until_it_flies()
    return restarted, site.windows[heard][0]


def fly_without(site: Site, camera: str) -> None:
    """Kill one camera in flight: the area without it is said and flown in."""
    site.until_it_flies()
    site.children.kill(camera, signal.SIGKILL)
    site.until_said(f"sensor {camera}: no image young enough")
    site.until_it_flies()
    site.children.restart(camera)


def judge(site: Site, deaf: Sequence[tuple[float, float]]) -> None:
    """See that no motion was without a window, and none too near to a wall.

    A planner that starts may find the robot before it finds this test, which is deaf to its first certificates.
    """
    rows = np.array(site.rows)
    flying = rows[rows[:, 4] > 0.0]
    assert len(flying) > 100
    windows = [*((begin - LATE, end) for begin, end in site.windows), *deaf]
    outside = [time for time in flying[:, 0] if not any(b <= time <= e + 1e-6 for b, e in windows)]
    assert not outside, (outside, deaf, site.windows)
    scene = parse_any_scene(SCENE, "loft")
    assert isinstance(scene, SpaceScene)
    clearance = SpaceWorld(scene).clearance(rows[:, 1:4], rows[:, 0])
    assert clearance.min() >= scene.safety_margin


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_kill_of_cameras_fusion_and_planner_lets_the_robot_hover_and_a_restart_lets_it_fly_on(
    tmp_path: FilePath, ros_domain: int
) -> None:
    with (
        processes(tmp_path, ros_domain) as (children, context),
        closing(Site(children, context, tmp_path)) as site,
    ):
        site.until(lambda: bool(site.windows), "a certificate")
        deaf = [(0.0, site.windows[0][0])]
        fly_without(site, "south")
        deaf += [kill_and_restart(site, kind) for kind in KILLED]
        judge(site, deaf)
