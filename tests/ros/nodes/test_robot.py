"""The robot node: it follows certified paths, and stops whenever something is not as it must be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool

from snnav_core.types import Certificate, PathSource, PlannedPath, Pose2D, Stop, StopReason, TimedPath
from snnav_ros.convert import (
    nanoseconds_from_stamp,
    odometry_to_message,
    path_to_message,
    stamp_message,
    state_from_message,
    stop_to_path,
    verdict_to_message,
)
from snnav_ros.nodes.robot import RobotNode
from snnav_ros.parameters import ParameterError

TICK = 50_000_000
CART = {"robot_id": "cart", "speed": 0.5, "max_turn_rate": 1.0, "start": [1.0, 2.0], "use_sim_time": True}


def straight(tick: int, length: float = 5.0, y: float = 2.0) -> TimedPath:
    points = np.column_stack((np.arange(1.0, 1.0 + length, 0.1), np.full(round(length / 0.1), y)))
    return TimedPath(tick * TICK / 1e9, 0.2, points)


class Site:
    """A robot node whose time and orders are in the hands of the test."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.odometry = graph.hear(Odometry, "cart/odom")
        self.commands = graph.hear(Twist, "cart/cmd_vel") if not changes.get("stamped") else []
        self.node = graph.add(RobotNode, lean=False, **{**CART, **changes})
        self.paths = graph.speak(Path, "cart/path", 1)
        self.verdicts = graph.speak(DiagnosticStatus, "cart/certificate", 1)
        self.clock = graph.speak(Clock, "/clock", 1)
        self.tick = 0

    def run(self, ticks: int) -> None:
        """Let time go on, tick by tick."""
        for _ in range(ticks):
            self.tick += 1
            stamp = self.tick * TICK
            self.clock.publish(Clock(clock=stamp_message(stamp)))
            self.graph.until(
                lambda stamp=stamp: (
                    self.odometry
                    and nanoseconds_from_stamp(self.odometry[-1].header.stamp) == stamp
                    and len(self.commands) == len(self.odometry)
                ),
                "a control period",
            )

    def order(
        self, path: TimedPath, *, certificate: bool = True, until: float = 1e6, digest: str = ""
    ) -> None:
        message = path_to_message(path)
        self.paths.publish(message)
        stamp = round(path.start_time * 1e9)
        if certificate:
            held = Certificate("cart", True, until, 1.0, 1.0, 1.0, 0.0, digest or path.digest())
            plan = PlannedPath("cart", path, held, PathSource.WARM_START, 1.0)
            self.verdicts.publish(verdict_to_message(plan, stamp, message))
            self.graph.until(lambda: self.node._gate.verdict_stamp == stamp, "the certificate")
        self.graph.until(lambda: self.node._gate.path_stamp == stamp, "the path")

    @property
    def speed(self) -> float:
        return float(self.commands[-1].linear.x)

    @property
    def pose(self) -> Pose2D:
        return state_from_message(self.odometry[-1], "cart").pose


def test_stands_at_its_start_until_a_path_comes(graph: Any) -> None:
    site = Site(graph, heading_deg=90.0)
    site.run(5)
    assert site.pose == Pose2D(1.0, 2.0, math.pi / 2)
    assert site.speed == 0.0


def test_follows_a_certified_path_to_its_end(graph: Any) -> None:
    site = Site(graph)
    site.run(2)
    site.order(straight(2, length=2.0))
    site.run(20)
    assert site.speed == 0.5
    assert site.pose.x == pytest.approx(1.0 + 20 * 0.05 * 0.5, abs=0.03)
    assert site.odometry[-1].twist.twist.linear.x == 0.5
    site.run(80)
    assert site.speed == 0.0
    assert site.pose.x == pytest.approx(2.9, abs=0.05)
    assert abs(site.pose.y - 2.0) < 0.01


def test_turns_in_place(graph: Any) -> None:
    site = Site(graph)
    site.run(1)
    site.order(TimedPath(TICK / 1e9, 0.5, np.tile([1.0, 2.0], (5, 1)), turn_to=1.2))
    site.run(40)
    assert site.pose.heading == pytest.approx(1.2, abs=0.01)
    assert (site.pose.x, site.pose.y) == (1.0, 2.0)
    assert max(abs(command.angular.z) for command in site.commands) <= 1.0


def test_stops_when_the_path_is_no_longer_certified(graph: Any) -> None:
    site = Site(graph)
    site.run(1)
    site.order(straight(1), until=1.0)
    site.run(18)
    assert site.speed == 0.5
    site.run(1)  # a command given now would hold beyond
    assert site.speed == 0.0


def test_does_not_follow_without_certificate_or_with_another_one(graph: Any) -> None:
    site = Site(graph)
    site.run(1)
    site.order(straight(1), certificate=False)
    site.run(5)
    assert site.speed == 0.0
    site.order(straight(6), digest="0123456789abcdef")
    site.run(5)
    assert site.speed == 0.0
    site.order(straight(11))
    site.run(2)
    assert site.speed == 0.5


def test_wrong_certificate_stops_a_robot_that_drives(graph: Any, capfd: pytest.CaptureFixture[str]) -> None:
    site = Site(graph)
    site.run(1)
    site.order(straight(1))
    site.run(3)
    assert site.speed == 0.5
    site.order(straight(4), digest="0123456789abcdef")
    site.run(1)
    assert site.speed == 0.0
    assert "stops: the certificate is of path 0123456789abcdef" in capfd.readouterr().err


def test_follows_without_certificate_when_told_so(graph: Any) -> None:
    site = Site(graph, require_certificate=False)
    site.run(1)
    site.order(straight(1), certificate=False)
    site.run(2)
    assert site.speed == 0.5


def test_empty_path_stops(graph: Any) -> None:
    site = Site(graph)
    site.run(1)
    site.order(straight(1))
    site.run(4)
    message = stop_to_path(5 * TICK)
    site.paths.publish(message)
    site.verdicts.publish(verdict_to_message(Stop("cart", StopReason.NO_PATH, "no way"), 5 * TICK, message))
    graph.until(lambda: site.node._gate.path_stamp == 5 * TICK)
    site.run(1)
    assert site.speed == 0.0


def test_older_path_stops_until_a_newer_one_comes(graph: Any, capfd: pytest.CaptureFixture[str]) -> None:
    site = Site(graph)
    site.run(5)
    site.order(straight(5))
    site.run(3)
    assert site.speed == 0.5
    older = straight(3, y=4.0)
    site.paths.publish(path_to_message(older))
    graph.until(lambda: bool(site.node._refusal))
    site.run(20)
    assert site.speed == 0.0
    assert capfd.readouterr().err.count("stops: cart/path: stamped 0.150 s, older than the last one") == 1
    site.order(straight(28))
    site.run(2)
    assert site.speed == 0.5


def test_path_that_lies_stops(graph: Any, capfd: pytest.CaptureFixture[str]) -> None:
    site = Site(graph)
    site.run(1)
    site.order(straight(1))
    site.run(3)
    message = path_to_message(straight(4))
    message.header.frame_id = "odom"
    site.paths.publish(message)
    graph.until(lambda: bool(site.node._refusal))
    site.run(1)
    assert site.speed == 0.0
    assert "stops: cart/path: frame_id is 'odom', expected 'map'" in capfd.readouterr().err


def test_pause_holds_and_time_jump_resets(graph: Any) -> None:
    site = Site(graph)
    site.run(1)
    site.order(straight(1))
    site.run(4)
    graph.call(SetBool, "robot_node/enable", SetBool.Request(data=False))
    site.run(2)
    assert site.speed == 0.0
    graph.call(SetBool, "robot_node/enable", SetBool.Request(data=True))
    site.run(2)
    assert site.speed == 0.5
    site.run(20)
    site.clock.publish(Clock())
    graph.until(lambda: site.node.get_clock().now().nanoseconds == 0)
    site.tick = 0
    site.run(1)
    assert site.pose == Pose2D(1.0, 2.0, 0.0)
    assert site.speed == 0.0


def test_commands_can_be_stamped(graph: Any) -> None:
    heard = graph.hear(TwistStamped, "cart/cmd_vel")
    node = graph.add(RobotNode, **CART, stamped=True)
    clock = graph.speak(Clock, "/clock", 1)
    clock.publish(Clock(clock=stamp_message(TICK)))
    graph.until(lambda: bool(heard))
    assert heard[0].header.stamp == stamp_message(TICK)
    assert node.spec.id == "cart"


def test_external_base_is_driven_by_its_odometry(graph: Any) -> None:
    commands = graph.hear(Twist, "cart/cmd_vel")
    node = graph.add(RobotNode, **CART, base="external", max_odometry_age=0.2)
    odometry, clock = graph.speak(Odometry, "cart/odom"), graph.speak(Clock, "/clock", 1)
    paths = graph.speak(Path, "cart/path", 1)
    verdicts = graph.speak(DiagnosticStatus, "cart/certificate", 1)

    def command(tick: int) -> Twist:
        count = len(commands)
        clock.publish(Clock(clock=stamp_message(tick * TICK)))
        graph.until(lambda: len(commands) > count)
        return commands[-1]

    assert command(1).linear.x == 0.0  # no odometry yet
    odometry.publish(odometry_to_message("cart", Pose2D(1.0, 2.0, 0.0), 0.0, 0.0, TICK))
    path = straight(1)
    certificate = Certificate("cart", True, 9.0, 1.0, 1.0, 1.0, 0.0, path.digest())
    message = path_to_message(path)
    paths.publish(message)
    plan = PlannedPath("cart", path, certificate, PathSource.WARM_START, 1.0)
    verdicts.publish(verdict_to_message(plan, TICK, message))
    graph.until(lambda: node._gate.complete(TICK) and node._body.measured_at is not None)
    assert command(2).linear.x == 0.5
    assert command(8).linear.x == 0.0  # odometry is 0.35 s old


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"robot_id": ""}, "robot_id: is not given"),
        (
            {"scene": "hello", "robot_id": "cart"},
            "robot_id: value 'cart' names no robot of hello; it has robot_1",
        ),
        ({"control_period": 0.3}, "control_period: value 0.3 does not divide sampling_interval 1.0"),
        ({"base": "real"}, "base: value 'real' must be one of 'simulated', 'flyer', 'external'"),
        ({"base": "external", "lockstep": True}, "base: value 'external' does not go with lockstep"),
        ({"max_odometry_age": 0.0}, "max_odometry_age: value 0.0 lies outside"),
        ({"tracker.law": "pid"}, "tracker.law: value 'pid' must be one of"),
        ({"tracker.saturation": 900.0}, "saturation .* too large for speed"),
        ({"start": [1.0, math.nan]}, "start: value"),
        ({"command_timeout": 0.04}, "command_timeout: value 0.04 is below control_period 0.05"),
        ({"pairing_patience": 1.5}, "pairing_patience: value 1.5 is above sampling_interval 1.0"),
        ({"clock_tolerance": -0.1}, "clock_tolerance: value -0.1 lies outside"),
    ],
)
def test_mistakes_end_it_at_its_start(graph: Any, changes: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        graph.add(RobotNode, **{**CART, **changes})
