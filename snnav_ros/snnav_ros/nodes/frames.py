"""Transforms of a simulated robot, where tf2 is there."""

from __future__ import annotations

from geometry_msgs.msg import Pose, TransformStamped
from rclpy.node import Node

from snnav_ros.available import make_tf_broadcasters
from snnav_ros.convert.frames import MAP_FRAME, header

__all__ = ["FrameBroadcaster"]


class FrameBroadcaster:
    """Broadcasts map -> <robot>/odom (fixed: odometry is ground truth) -> <robot>/base_link.

    Parameters
    ----------
    node : Node
    robot_id : str
    """

    def __init__(self, node: Node, robot_id: str) -> None:
        self._odom, self._base = f"{robot_id}/odom", f"{robot_id}/base_link"
        self._broadcasters = make_tf_broadcasters(node)
        if self._broadcasters is not None:
            self._broadcasters[1].sendTransform(_transform(MAP_FRAME, self._odom, Pose(), 0))

    def broadcast(self, pose: Pose, stamp_ns: int) -> None:
        """Broadcast where the robot is [map]; nothing without tf2."""
        if self._broadcasters is not None:
            self._broadcasters[0].sendTransform(_transform(self._odom, self._base, pose, stamp_ns))


def _transform(parent: str, child: str, pose: Pose, stamp_ns: int) -> object:
    message = TransformStamped(header=header(stamp_ns, parent), child_frame_id=child)
    place = message.transform.translation
    place.x, place.y, place.z = pose.position.x, pose.position.y, pose.position.z
    message.transform.rotation = pose.orientation
    return message
