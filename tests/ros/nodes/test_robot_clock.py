"""The robot node trusts no clock: it is set, corrected, held back, or ahead of odometry."""

from __future__ import annotations

import math
import time
from typing import Any

import pytest
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock

from snnav_core.types import Pose2D
from snnav_ros.convert import (
    nanoseconds,
    nanoseconds_from_stamp,
    odometry_to_message,
    stamp_message,
)
from snnav_ros.nodes.node_time import now_of
from snnav_ros.nodes.robot import RobotNode
from support.robot_cart import CART, TICK, Cart, CartOfTicks, certified


def test_robot_that_is_started_in_mid_run_waits_for_its_clock(
    graph: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    cart = CartOfTicks(graph)
    cart.send(*certified(30.0))
    topics = {"cart/path", "cart/certificate"}
    graph.until(lambda: topics <= cart.node._waiting._heard)
    assert "stops" not in capfd.readouterr().err
    cart.tick = 619
    cart.run()
    assert cart.speed == 0.0
    cart.drive()


def test_clock_that_jumps_before_the_node_is_active_is_no_matter(graph: Any) -> None:
    commands = graph.hear(Twist, "cart/cmd_vel")
    node = graph.add(RobotNode, **CART, use_sim_time=True, autostart=False)
    clock = graph.speak(Clock, "/clock", 1)
    for tick in (9, 3):
        clock.publish(Clock(clock=stamp_message(tick * TICK)))
        graph.until(lambda tick=tick: now_of(node) == tick * TICK)
    node.trigger_configure()
    node.trigger_activate()
    clock.publish(Clock(clock=stamp_message(4 * TICK)))
    graph.until(lambda: bool(commands), "a command")
    assert "the clock jumped" not in node._refusal


def test_external_odometry_from_the_future_stops(graph: Any) -> None:
    commands = graph.hear(Twist, "cart/cmd_vel")
    node = graph.add(RobotNode, **CART, use_sim_time=True, base="external")
    odometry, clock = graph.speak(Odometry, "cart/odom"), graph.speak(Clock, "/clock", 1)
    odometry.publish(odometry_to_message("cart", Pose2D(1.0, 2.0, 0.0), 0.0, 0.0, 9 * TICK))
    graph.until(lambda: node._body.measured_at is not None)
    clock.publish(Clock(clock=stamp_message(TICK)))
    graph.until(lambda: bool(commands))
    assert "odometry is stamped 0.40 s ahead" in node._trouble(now_of(node))


class CartOfTheWall(Cart):
    """Its clock is the one of the machine, which the test sets back or forth."""

    def __init__(self, graph: Any, monkeypatch: pytest.MonkeyPatch, **changes: Any) -> None:
        self.shift = 0
        monkeypatch.setattr("snnav_ros.nodes.robot.now_of", lambda node: now_of(node) + self.shift)
        super().__init__(graph, **changes)

    @property
    def now(self) -> float:
        return (time.time_ns() + self.shift) / 1e9

    def drive(self, window: float = 5.0) -> None:
        self.send(*certified(self.now, window, self.x if self.odometry else 1.0))
        self.graph.until(lambda: bool(self.commands) and self.speed == 0.5, "a moving robot")

    def stands(self) -> bool:
        return self.speed == 0.0


@pytest.mark.parametrize("jump", [-3600.0, -0.5, 0.5, 3600.0])
def test_clock_that_is_set_stops_until_a_path_of_its_new_time_comes(
    graph: Any, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], jump: float
) -> None:
    cart = CartOfTheWall(graph, monkeypatch)
    cart.drive()
    where = cart.x
    cart.shift += nanoseconds(jump)
    graph.until(cart.stands, "a stop", longest=3.0)
    assert f"stops: the clock jumped by {jump:+.1f}" in capfd.readouterr().err
    graph.until(lambda: any("the clock jumped" in text for text in cart.said()), "diagnostics")
    assert cart.x >= where  # the base is not put back to its start
    cart.drive()


def test_slow_correction_of_the_clock_does_not_stop(graph: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    cart = CartOfTheWall(graph, monkeypatch)
    cart.drive()
    for _ in range(5):
        cart.shift -= nanoseconds(0.02)
        count = len(cart.commands)
        graph.until(lambda count=count: len(cart.commands) > count)
        assert cart.speed == 0.5


def test_window_ends_by_the_steady_clock_though_the_clock_is_held_back(
    graph: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clock that is corrected step by step, each too small to be seen as a jump, prolongs no window."""
    cart = CartOfTheWall(graph, monkeypatch)
    cart.drive(window=1.0)
    begin = time.monotonic()
    while not cart.stands():
        assert time.monotonic() - begin < 3.0  # by the clock of ROS it would take 5 s
        cart.shift -= nanoseconds(0.04)
        count = len(cart.commands)
        graph.until(lambda count=count: len(cart.commands) > count)
    assert "the certificate ended" in cart.node._refusal
    assert cart.node._valid_until > cart.now + 0.2  # by the clock of ROS it still held


def test_window_of_the_wall_is_kept(graph: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    cart = CartOfTheWall(graph, monkeypatch)
    cart.drive(window=0.6)
    graph.until(cart.stands, "a stop", longest=2.0)
    stamps = [
        nanoseconds_from_stamp(message.header.stamp) / 1e9
        for message in cart.odometry
        if message.twist.twist.linear.x > 0.0
    ]
    assert max(stamps) <= cart.node._valid_until + 0.06  # odometry of a motion is stamped at its end
    assert cart.x - 1.0 <= 0.5 * 0.6 + 1e-6
    assert math.isfinite(cart.node._valid_until)
