"""The robot node trusts nobody: altered messages, lost partners, processes that sleep or end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Clock

from snnav_core.types import Pose2D
from snnav_ros.convert import (
    Word,
    nanoseconds,
    odometry_to_message,
    stamp_message,
    word_to_message,
)
from snnav_ros.nodes.base import NodeOptions
from snnav_ros.nodes.node_time import now_of
from snnav_ros.nodes.robot import RobotNode
from snnav_ros.qos import LATCHED, for_mode
from support.robot_cart import CART, TICK, CartOfTicks, certified

Change = Callable[[Path, DiagnosticStatus], None]


def value_of(certificate: DiagnosticStatus, key: str) -> Any:
    return next(pair for pair in certificate.values if pair.key == key)


def flip(number: float, bit: int) -> float:
    return float((np.float64(number).view(np.uint64) ^ np.uint64(1 << bit)).view(np.float64))


def on_path(change: Callable[[Path], None]) -> Change:
    return lambda path, _: change(path)


def on_position(path: Path) -> None:
    path.poses[40].pose.position.x = flip(path.poses[40].pose.position.x, 0)


def on_orientation(path: Path) -> None:
    path.poses[40].pose.orientation.w = flip(path.poses[40].pose.orientation.w, 0)


def on_pose_stamp(path: Path) -> None:
    path.poses[-1].header.stamp.nanosec ^= 1


def on_pose_frame(path: Path) -> None:
    path.poses[-1].header.frame_id = "lap"


def on_path_stamp(path: Path) -> None:
    path.header.stamp.nanosec ^= 1


def on_path_second(path: Path) -> None:
    path.header.stamp.sec ^= 1 << 30


def on_frame(path: Path) -> None:
    path.header.frame_id = "lap"


def on_digit(key: str) -> Change:
    """Alter the lowest bit of the last letter of a value."""

    def change(_: Path, certificate: DiagnosticStatus) -> None:
        pair = value_of(certificate, key)
        pair.value = pair.value[:-1] + chr(ord(pair.value[-1]) ^ 1)

    return change


def on_accepted(_: Path, certificate: DiagnosticStatus) -> None:
    value_of(certificate, "accepted").value = "tsue"


def on_level(_: Path, certificate: DiagnosticStatus) -> None:
    certificate.level = b"\x10"


CHANGES: dict[str, Change] = {
    "position": on_path(on_position),
    "orientation": on_path(on_orientation),
    "stamp of a pose": on_path(on_pose_stamp),
    "frame of a pose": on_path(on_pose_frame),
    "nanosecond of the path": on_path(on_path_stamp),
    "second of the path": on_path(on_path_second),
    "frame": on_path(on_frame),
    "valid_until": on_digit("valid_until"),
    "least_clearance": on_digit("least_clearance"),
    "stamp": on_digit("stamp"),
    "path_digest": on_digit("path_digest"),
    "robot_id": on_digit("robot_id"),
    "seal": on_digit("seal"),
    "accepted": on_accepted,
    "level": on_level,
}


@pytest.mark.parametrize("name", CHANGES)
def test_one_bit_over_the_wire_stops_until_a_good_pair_comes(
    graph: Any, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    cart = CartOfTicks(graph)
    cart.run()
    cart.drive()
    path, certificate = certified(cart.now)
    CHANGES[name](path, certificate)
    cart.send(path, certificate)
    graph.until(lambda: bool(cart.node._refusal), "a refusal")
    cart.run()
    assert cart.speed == 0.0
    refusal = cart.node._refusal
    assert f"robot cart stops: {refusal}" in capfd.readouterr().err
    graph.until(lambda: refusal in cart.said(), "diagnostics")
    cart.run(9)  # whatever else comes of it: it stands
    assert cart.speed == 0.0
    cart.drive()
    cart.run(10)
    graph.until(lambda: cart.said()[-1] == "ok", "diagnostics without a refusal")


def test_every_kind_of_refusal_is_logged_once(graph: Any, capfd: pytest.CaptureFixture[str]) -> None:
    cart = CartOfTicks(graph)
    cart.run()
    cart.drive()
    for _ in range(3):
        path, certificate = certified(cart.now)
        on_digit("seal")(path, certificate)
        cart.send(path, certificate)
        stamp = nanoseconds(cart.now)
        graph.until(lambda stamp=stamp: cart.node._gate.complete(stamp), "path and certificate")
        cart.run(5)
    assert cart.speed == 0.0
    assert capfd.readouterr().err.count("stops: path and certificate stamped") == 1


@pytest.mark.parametrize("path_comes", [True, False])
def test_partner_that_does_not_come_stops(graph: Any, path_comes: bool) -> None:
    cart = CartOfTicks(graph)  # half a sampling interval is 5 ticks
    cart.run()
    cart.drive()
    path, certificate = certified(cart.now)
    cart.send(path if path_comes else None, None if path_comes else certificate)
    stamp = nanoseconds(cart.now)
    gate = cart.node._gate
    graph.until(lambda: stamp in (gate.path_stamp, gate.verdict_stamp), "the message")
    cart.run(5)
    assert cart.speed == 0.5
    cart.run()
    assert cart.speed == 0.0
    assert "has waited 0.30 s for its" in cart.node._refusal
    cart.drive()


def test_window_that_ends_is_said(graph: Any, capfd: pytest.CaptureFixture[str]) -> None:
    cart = CartOfTicks(graph)
    cart.run()
    cart.drive()
    begin = cart.x
    cart.run(60)
    assert cart.speed == 0.0
    assert cart.x - begin <= 0.5 * 2.0
    assert capfd.readouterr().err.count("the certificate ended at 2.050 s and no newer path came") == 1
    assert any("the certificate ended" in text for text in cart.said())
    cart.drive()


@pytest.mark.parametrize("sleep", [3, 30])
def test_base_stops_by_itself_while_its_tracker_sleeps(graph: Any, sleep: int) -> None:
    cart = CartOfTicks(graph)
    cart.run()
    cart.drive()
    begin = cart.x
    cart.run(1, stride=sleep)
    assert cart.x - begin == pytest.approx(0.5 * 0.1)
    assert cart.odometry[-1].twist.twist.linear.x == 0.0


def test_base_ends_with_the_window_though_its_tracker_sleeps(graph: Any) -> None:
    cart = CartOfTicks(graph)
    cart.run()
    cart.send(*certified(cart.now, window=0.5))
    graph.until(lambda: cart.node._gate.complete(TICK))
    cart.run(9)
    assert cart.speed == 0.5  # the last command, given at 0.5 s: the window ends at 0.55 s
    begin = cart.x
    cart.run(1, stride=30)
    assert cart.x - begin == pytest.approx(0.5 * 0.05)


def test_external_base_gets_no_command_that_may_hold_beyond_the_window(graph: Any) -> None:
    commands = graph.hear(Twist, "cart/cmd_vel")
    graph.add(RobotNode, **CART, use_sim_time=True, base="external", command_timeout=0.2)
    odometry, clock = graph.speak(Odometry, "cart/odom"), graph.speak(Clock, "/clock", 1)
    paths = graph.speak(Path, "cart/path", 1)
    verdicts = graph.speak(DiagnosticStatus, "cart/certificate", 1)
    node, speeds = graph.nodes[-1], {}
    for tick in range(1, 22):
        odometry.publish(odometry_to_message("cart", Pose2D(1.0, 2.0, 0.0), 0.0, 0.0, tick * TICK))
        graph.until(lambda tick=tick: node._body.measured_at == tick * TICK)
        if tick == 1:
            clock.publish(Clock(clock=stamp_message(TICK)))
            graph.until(lambda: now_of(node) == TICK)
            path, certificate = certified(0.05, window=0.9)
            paths.publish(path)
            verdicts.publish(certificate)
            graph.until(lambda: node._gate.complete(TICK))
            continue
        count = len(commands)
        clock.publish(Clock(clock=stamp_message(tick * TICK)))
        graph.until(lambda count=count: len(commands) > count)
        speeds[tick] = commands[-1].linear.x
    assert [tick for tick, speed in speeds.items() if speed] == list(range(2, 16))  # 0.75 s + 0.2 s = 0.95 s


@pytest.mark.parametrize("way", ["deactivated", "destroyed"])
def test_robot_node_that_ends_stops_its_base(graph: Any, way: str) -> None:
    cart = CartOfTicks(graph)
    cart.run()
    cart.drive()
    count = len(cart.commands)
    if way == "deactivated":
        cart.node.trigger_deactivate()
    else:
        graph.executor.remove_node(cart.node)
        graph.nodes.remove(cart.node)
        cart.node.destroy_node()
    graph.until(lambda: len(cart.commands) > count, "a last command")
    assert cart.speed == 0.0


def test_robot_node_ends_though_ros_is_shut_down_already(ros_domain: int) -> None:
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=ros_domain)
    node = RobotNode(NodeOptions(parameters=CART, context=context, lean=True))
    rclpy.shutdown(context=context)
    node.destroy_node()


def test_a_path_from_elsewhere_is_refused_and_the_next_one_from_here_is_followed(graph: Any) -> None:
    cart = CartOfTicks(graph)
    cart.run(2)
    cart.drive()
    stamp = nanoseconds(cart.now)
    cart.send(*certified(cart.now, x=8.0))
    graph.until(lambda: cart.node._gate.complete(stamp), "path and certificate")
    cart.run(2)
    assert cart.speed == 0.0
    assert any("from the robot, allowed 0.30 m; check its odometry" in text for text in cart.said())
    cart.drive()


def test_a_word_of_a_planner_that_lies_is_not_used(graph: Any, capfd: pytest.CaptureFixture[str]) -> None:
    node = graph.add(RobotNode, **CART, lockstep=True, planners=["planner_1"])
    words = graph.speak(DiagnosticStatus, "planners", for_mode(True, LATCHED))
    words.publish(DiagnosticStatus(name="planner_1"))
    words.publish(word_to_message(Word("planner_1", TICK, "a", 1)))
    graph.until(lambda: node._words == {"planner_1": TICK}, "the good word")
    assert "message not used: planners: key 'stamp' is missing" in capfd.readouterr().err
