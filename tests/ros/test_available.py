"""What a machine offers: asked in one place."""

from __future__ import annotations

import sys
import types
from importlib.machinery import ModuleSpec
from typing import Any

import pytest
from nav_msgs.msg import Path as PathMessage

from snnav_core.types import Pose2D
from snnav_ros import available
from snnav_ros.convert import odometry_to_message, yaw_from_message
from snnav_ros.nodes.frames import FrameBroadcaster


def test_messages_are_made_by_name() -> None:
    message = available.new_message("nav_msgs/Path")
    assert isinstance(message, PathMessage)
    assert available.new_message("geometry_msgs/Point", x=1.5).x == 1.5


def pose() -> Any:
    return odometry_to_message("cart", Pose2D(1.0, 2.0, 0.5), 0.0, 0.0, 0).pose.pose


def test_missing_ros_is_one_line_with_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    available.require_ros("this")
    monkeypatch.setattr(available, "find_spec", lambda name: None)
    with pytest.raises(
        available.MissingRos, match=r"this needs ROS 2 \(rclpy\), which is not found: source a ROS 2"
    ):
        available.require_ros("this")


def test_without_tf2_nothing_is_broadcast(graph: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(available, "find_spec", lambda name: None)
    FrameBroadcaster(graph.probe, "cart").broadcast(pose(), 0)


def test_with_tf2_the_frames_of_a_robot_are_broadcast(graph: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[Any] = []

    class Broadcaster:
        def __init__(self, node: Any) -> None:
            assert node is graph.probe

        def sendTransform(self, transform: Any) -> None:  # noqa: N802  (the name in tf2_ros)
            sent.append(transform)

    module = types.ModuleType("tf2_ros")
    module.__spec__ = ModuleSpec("tf2_ros", None)
    module.TransformBroadcaster = module.StaticTransformBroadcaster = Broadcaster  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "tf2_ros", module)
    FrameBroadcaster(graph.probe, "cart").broadcast(pose(), 3 * 10**9)
    fixed, moving = sent
    assert (fixed.header.frame_id, fixed.child_frame_id) == ("map", "cart/odom")
    assert (moving.header.frame_id, moving.child_frame_id) == ("cart/odom", "cart/base_link")
    assert fixed.transform.translation.x == 0.0
    assert (moving.transform.translation.x, moving.transform.translation.y) == (1.0, 2.0)
    assert yaw_from_message(moving.transform.rotation) == 0.5
    assert moving.header.stamp.sec == 3
