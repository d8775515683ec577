"""nav_msgs/Odometry and RobotState, geometry_msgs/PoseStamped and goals."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

from snnav_core.errors import InvalidInput
from snnav_core.types import Pose2D, RobotState
from snnav_ros.available import new_message
from snnav_ros.convert.frames import MAP_FRAME, check_frame, header, yaw_from_message, yaw_to_message
from snnav_ros.convert.stamps import seconds_from_stamp

__all__ = ["goal_from_message", "odometry_to_message", "state_from_message"]


def odometry_to_message(robot_id: str, pose: Pose2D, speed: float, turn_rate: float, stamp_ns: int) -> Any:
    """Return the Odometry of a robot: pose [map], speed [m/s] and turn rate [rad/s] of its base."""
    message = new_message("nav_msgs/Odometry", header=header(stamp_ns, MAP_FRAME))
    message.child_frame_id = f"{robot_id}/base_link"
    message.pose.pose.position.x, message.pose.pose.position.y = pose.x, pose.y
    message.pose.pose.orientation = yaw_to_message(pose.heading)
    message.twist.twist.linear.x, message.twist.twist.angular.z = speed, turn_rate
    return message


def state_from_message(
    message: Any, robot_id: str, topic: str = "odom", frames: Collection[str] = (MAP_FRAME,)
) -> RobotState:
    """Return the state that an Odometry tells.

    Parameters
    ----------
    message : nav_msgs/Odometry
    robot_id : str
    topic : str
        For messages of errors.
    frames : collection of str
        Names of frames that coincide with the map.

    Raises
    ------
    InvalidInput
        If the frame is another one, or a number is not finite.
    """
    check_frame(message, topic, frames)
    position, speed = message.pose.pose.position, float(message.twist.twist.linear.x)
    if not all(math.isfinite(value) for value in (position.x, position.y, speed)):
        raise InvalidInput(f"{topic}: position ({position.x}, {position.y}) or speed {speed} is not finite")
    pose = Pose2D(float(position.x), float(position.y), yaw_from_message(message.pose.pose.orientation))
    return RobotState(robot_id, pose, seconds_from_stamp(message.header.stamp), speed)


def goal_from_message(message: Any, topic: str = "goal_pose") -> tuple[float, float]:
    """Return the target [m, map] of a PoseStamped; its orientation is not used.

    Raises
    ------
    InvalidInput
        If it is not given in the map, or not finite.
    """
    check_frame(message, topic)
    x, y = float(message.pose.position.x), float(message.pose.position.y)
    if not (math.isfinite(x) and math.isfinite(y)):
        raise InvalidInput(f"{topic}: position ({x}, {y}) is not finite; give a point of the map")
    return x, y
