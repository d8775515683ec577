"""All nodes of a scene by the clock of the machine: it is set, the robot stops, and all go on in the new time."""

from __future__ import annotations

from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry

from snnav_ros.convert import nanoseconds, state_from_message
from snnav_ros.nodes import node_time
from snnav_ros.nodes.fusion import FusionNode
from snnav_ros.nodes.lms200 import Lms200Node
from snnav_ros.nodes.planner import PlannerNode
from snnav_ros.nodes.robot import RobotNode
from snnav_sim.warm_up import warm_up

_USERS = ("deciding", "fusion", "range_finder", "planner", "robot", "node_time")


@pytest.mark.parametrize("jump", [-1000.0, 1000.0])
def test_clock_that_is_set_while_a_robot_drives(
    graph: Any, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], jump: float
) -> None:
    warm_up()
    shift = 0
    true_time = node_time.now_of
    for user in _USERS:
        monkeypatch.setattr(f"snnav_ros.nodes.{user}.now_of", lambda node: true_time(node) + shift)
    odometry, diagnostics = graph.hear(Odometry, "robot_1/odom"), graph.hear(DiagnosticArray, "/diagnostics")
    for kind, name, more in (
        (Lms200Node, "west", {"sensor_id": "lms_west"}),
        (Lms200Node, "east", {"sensor_id": "lms_east"}),
        (FusionNode, "fusion_node", {}),
        (PlannerNode, "planner_node", {}),
        (RobotNode, "robot_1", {}),
    ):
        graph.add(kind, name, scene="hello", **more)

    def x() -> float:
        return float(state_from_message(odometry[-1], "robot_1").pose.x)

    def speed() -> float:
        return float(odometry[-1].twist.twist.linear.x)

    graph.until(lambda: bool(odometry) and x() > 1.8, "a robot that drives")
    assert speed() == 0.8
    shift = nanoseconds(jump)
    graph.until(lambda: speed() == 0.0, "a stop", longest=2.0)
    where = x()
    assert f"stops: the clock jumped by {jump:+.0f}" in capfd.readouterr().err
    graph.until(lambda: x() > where + 1.0, "a robot that drives again")
    assert x() < where + 1.2  # it went on from where it stood
    said = {
        status.message
        for array in diagnostics
        for status in array.status
        if status.name.startswith("tracker")
    }
    assert any("the clock jumped" in text for text in said)
