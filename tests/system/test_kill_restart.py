"""Real processes over DDS: any node is killed, put to sleep or started afresh in mid-run, and the robot stays safe.

The robot's base is in the hands of this test: it does what `cart/cmd_vel` says, for at most 0.1 s after the stamp of
the last command. So what the robot node promises is judged by code that it does not share.
"""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import rclpy
import shapely
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from snnav_core.types import Pose2D, StopReason, VelocityCommand
from snnav_ros.available import make_executor
from snnav_ros.bringup import plan_nodes
from snnav_ros.convert import (
    MAP_FRAME,
    Verdict,
    nanoseconds_from_stamp,
    odometry_to_message,
    seconds,
    verdict_from_message,
)
from snnav_ros.processes import ChildProcesses
from snnav_sim.devices.base import PioneerBase
from snnav_sim.scene import parse_scene
from snnav_sim.warm_up import warm_up

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
GOALS = [(5.5, 1.1), (1.5, 1.1)]
KINDS = {
    "lms200": "west",
    "fusion": "fusion_node",
    "planner": "planner_node",
    "robot": "cart",
    "clock": "clock_node",
}
WATCHDOG = 0.1  # [s] after the last command the base stops by itself
STILL = 0.5  # [s] without any motion: it stands
LONGEST = 40.0  # [s] that anything may take before a test fails


@dataclass(frozen=True)
class Motion:
    """The base moved between two times of the simulation [s] from one place to another [m, map]."""

    begin: float
    end: float
    before: tuple[float, float]
    after: tuple[float, float]
    covered_until: float  # latest end of all windows that were certified up to then [s]


class Site:
    """The nodes of the scene as processes, and a node that is the robot's base and the person who gives goals."""

    def __init__(self, children: ChildProcesses, context: Any, folder: FilePath) -> None:
        self.scene = parse_scene(SCENE, "corridor")
        self.children = children
        (robot,) = self.scene.robots
        self.base = PioneerBase(robot.pose, robot.spec)
        self.motions: list[Motion] = []
        self.windows: list[
            tuple[float, float]
        ] = []  # stamp and end of every accepted certificate since the last jump
        self.time, self.jumps, self.moved_at = -1.0, 0, -math.inf
        self.texts: list[str] = []
        self._command, self._commanded, self._goal = VelocityCommand(0.0, 0.0), -math.inf, 0
        self.node = Node("site", context=context, enable_rosout=False, start_parameter_services=False)
        self.executor = make_executor(context)
        self.executor.add_node(self.node)
        self._odometry = self.node.create_publisher(Odometry, "cart/odom", 10)
        self._goals = self.node.create_publisher(PoseStamped, "cart/goal_pose", 1)
        for kind, topic, take in (
            (Clock, "/clock", self._on_clock),
            (TwistStamped, "cart/cmd_vel", self._on_command),
            (DiagnosticStatus, "cart/certificate", self._on_certificate),
            (DiagnosticArray, "/diagnostics", self._on_diagnostics),
        ):
            self.node.create_subscription(kind, topic, take, 100)
        file = folder / "scene.yaml"
        file.write_text(SCENE, encoding="utf-8")
        external = {"base": "external", "command_timeout": WATCHDOG, "stamped": True}
        for plan in plan_nodes(self.scene, file, realtime=True, processes=True, seed=1):
            parameters = {**plan.parameters, **(external if plan.name == "cart" else {})}
            children.start(plan.name, f"snnav_ros.nodes.{plan.module}_node", parameters)

    def _on_clock(self, message: Clock) -> None:
        now = seconds(nanoseconds_from_stamp(message.clock))
        if now < self.time:
            self.jumps += 1
            self.windows.clear()
            self._commanded = -math.inf
        elif now > self.time >= 0.0:
            self._move(now)
        self.time = now
        driven = self.base.command
        odometry = odometry_to_message(
            "cart", self.base.pose, driven.speed, driven.turn_rate, nanoseconds_from_stamp(message.clock)
        )
        self._odometry.publish(odometry)

    def _move(self, now: float) -> None:
        before = self.base.pose
        left = max(0.0, self._commanded + WATCHDOG - self.time)
        after = self.base.apply(self._command, now - self.time, left)
        if after != before:
            self.moved_at = time.monotonic()
            ends = [end for stamp, end in self.windows if stamp <= now + 0.1]
            end = min(now, self.time + left)
            self.motions.append(
                Motion(self.time, end, _place(before), _place(after), max(ends, default=-math.inf))
            )

    def _on_command(self, message: TwistStamped) -> None:
        stamp, twist = seconds(nanoseconds_from_stamp(message.header.stamp)), message.twist
        if stamp <= self.time + WATCHDOG:  # else it was given before time began anew
            self._command, self._commanded = VelocityCommand(twist.linear.x, twist.angular.z), stamp

    def _on_certificate(self, message: DiagnosticStatus) -> None:
        verdict: Verdict = verdict_from_message(message)
        if verdict.certificate is not None and verdict.certificate.accepted:
            self.windows.append((verdict.stamp, verdict.certificate.valid_until))
        elif verdict.stop is not None and verdict.stop.reason is StopReason.ARRIVED:
            self._goal = min(range(len(GOALS)), key=lambda k: -math.dist(GOALS[k], _place(self.base.pose)))
            goal = PoseStamped()
            goal.header.frame_id = MAP_FRAME
            goal.pose.position.x, goal.pose.position.y = GOALS[self._goal]
            self._goals.publish(goal)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.texts += [f"{status.name}: {status.message}" for status in message.status]

    # what a test does

    def until(self, condition: Callable[[], bool], what: str, longest: float = LONGEST) -> None:
        end = time.monotonic() + longest
        while not condition():
            assert not (ended := self.children.ended()), ended
            assert time.monotonic() < end, f"waited {longest} s for {what}; last said {self.texts[-4:]}"
            self.executor.spin_once(timeout_sec=0.02)

    def until_it_drives(self) -> None:
        """Wait until the robot drives, and has some way to go."""
        count = len(self.motions)

        def drives() -> bool:
            way = self.motions[max(count, len(self.motions) - 5) :]
            moved = sum(math.dist(motion.before, motion.after) for motion in way)
            goal = GOALS[self._goal]
            return moved > 0.1 and 1.2 < math.dist(goal, _place(self.base.pose)) < 3.6

        self.until(drives, "a robot that drives")

    def until_it_stands(self) -> None:
        self.until(lambda: time.monotonic() - self.moved_at > STILL, "a robot that stands")

    def judge(self) -> None:
        """See that no motion was without a window, and none too near to a wall."""
        assert len(self.motions) > 20
        late = [motion for motion in self.motions if motion.end > motion.covered_until + 1e-6]
        assert not late, f"{len(late)} motions beyond their window, first {late[0]}"
        ways = shapely.linestrings([(motion.before, motion.after) for motion in self.motions])
        walls = shapely.Polygon(self.scene.border.vertices).boundary
        assert shapely.distance(ways, walls).min() >= self.scene.safety_margin


@contextmanager
def site(folder: FilePath, domain: int) -> Iterator[Site]:
    warm_up()
    with ExitStack() as stack:
        context = rclpy.Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        stack.callback(rclpy.try_shutdown, context=context)
        children = stack.enter_context(ChildProcesses(folder, domain))
        made = Site(children, context, folder)
        stack.callback(made.node.destroy_node)
        stack.callback(made.executor.shutdown)
        yield made


def _place(pose: Pose2D) -> tuple[float, float]:
    return pose.x, pose.y


@dataclass(frozen=True)
class Stop:
    """What a kill -9 led to: the robot stood so long after it, and might have moved for so long [s]."""

    kind: str
    to_standstill: float
    promised: float


def kill_and_restart(site: Site, kind: str) -> Stop:
    """Kill the node of a kind while the robot drives, see it stop, start the node again and see it drive."""
    name = KINDS[kind]
    site.until_it_drives()
    at, wall = site.time, time.monotonic()
    said = len(site.texts)
    site.children.kill(name)
    if kind == "lms200":  # until what it saw is gone the robot may go to and fro
        reason = "sensor west is silent since"
        site.until(lambda: any(reason in text for text in site.texts[said:]), "the reason of a stop")
    site.until_it_stands()
    stood = site.motions[-1].end - at if kind != "clock" else site.moved_at - wall
    # Without a scanner the planner goes on certifying; of the others one decision may have been under way.
    ends = [
        end for stamp, end in site.windows if kind == "lms200" or stamp <= at + site.scene.sampling_interval
    ]
    site.children.restart(name)
    site.until_it_drives()
    return Stop(kind, max(0.0, stood), max(ends) - at)


def test_kill_of_any_node_stops_the_robot_inside_its_window_and_a_restart_lets_it_go_on(
    tmp_path: FilePath, ros_domain: int
) -> None:
    with site(tmp_path, ros_domain) as here:
        for kind in KINDS:
            stop = kill_and_restart(here, kind)
            assert stop.to_standstill <= stop.promised, stop
        here.judge()
        assert here.jumps == 1  # the clock began anew
        said = set(here.texts)
    assert any(text.startswith("tracker cart: the certificate ended at") for text in said)
    assert any(text.startswith("robot cart: the unoccupied area is") for text in said)


def test_nodes_that_sleep_and_wake_and_a_clock_that_is_set_back(tmp_path: FilePath, ros_domain: int) -> None:
    with site(tmp_path, ros_domain) as here:
        for name in KINDS.values():
            here.until_it_drives()
            here.children.kill(name, signal.SIGSTOP)
            wake = time.monotonic() + 3.0 * here.scene.sampling_interval
            here.until(lambda wake=wake: time.monotonic() > wake, "the end of the nap")
            here.children.kill(name, signal.SIGCONT)
        here.until_it_drives()
        assert here.jumps == 0
        set_back_the_clock(here)
        here.judge()


def set_back_the_clock(site: Site) -> None:
    """Let the clock begin anew: the robot stops, and goes on from where it stands."""
    client = site.node.create_client(Trigger, "clock_node/reset")
    site.until(client.service_is_ready, "the service")
    count = len(site.motions)
    answer = client.call_async(Trigger.Request())
    site.until(answer.done, "the answer")
    site.until(lambda: site.jumps == 1, "a jump")
    place = _place(site.base.pose)
    site.until_it_drives()
    anew = next(
        motion for motion in site.motions[count:] if motion.begin < site.scene.sampling_interval * 10.0
    )
    assert math.dist(anew.before, place) < 1e-9
    assert any("tracker cart: the clock jumped back" in text for text in site.texts)


@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", KINDS)
def test_series_of_kills(
    tmp_path: FilePath, ros_domain: int, kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with site(tmp_path, ros_domain) as here:
        stops = [kill_and_restart(here, kind) for _ in range(20)]
        here.judge()
    times = np.array([[stop.to_standstill, stop.promised] for stop in stops])
    p50, p99 = np.percentile(times, [50, 99], axis=0)
    with capfd.disabled():
        print(
            f"\n{kind}: {len(stops)} kills, to standstill p50 {p50[0]:.2f} p99 {p99[0]:.2f} s, promised p50 "
            f"{p50[1]:.2f} least {times[:, 1].min():.2f} s, least left {(times[:, 1] - times[:, 0]).min():.2f} s"
        )
    assert (times[:, 0] <= times[:, 1]).all()
