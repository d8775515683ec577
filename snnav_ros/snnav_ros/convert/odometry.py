"""nav_msgs/Odometry and RobotState, geometry_msgs/PoseStamped and goals."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlightCommand, FlyerState
from snnav_core.types import FloatArray, Pose2D, RobotState
from snnav_ros.available import new_message
from snnav_ros.convert.frames import (
    MAP_FRAME,
    attitude_of,
    check_frame,
    direction_from_message,
    direction_to_message,
    header,
    yaw_from_message,
    yaw_to_message,
)
from snnav_ros.convert.stamps import seconds_from_stamp

__all__ = [
    "flight_command_to_message",
    "flight_to_message",
    "flyer_state_from_message",
    "goal_from_message",
    "goal_in_space_from_message",
    "odometry_to_message",
    "state_from_message",
]


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


def flight_to_message(state: FlyerState, rate: FloatArray, stamp_ns: int) -> Any:
    """Return the Odometry of a flying robot: its direction is the x axis of its body.

    `rate` (3,) is the angular velocity [rad/s, map].
    """
    message = new_message("nav_msgs/Odometry", header=header(stamp_ns, MAP_FRAME))
    message.child_frame_id = f"{state.id}/base_link"
    place = message.pose.pose.position
    place.x, place.y, place.z = state.position.tolist()
    message.pose.pose.orientation = direction_to_message(state.direction)
    message.twist.twist.linear.x = state.speed
    _set_rate(message.twist.twist.angular, state.direction, rate)
    return message


def flyer_state_from_message(
    message: Any, robot_id: str, topic: str = "odom", frames: Collection[str] = (MAP_FRAME,)
) -> FlyerState:
    """Return the state of a flying robot that an Odometry tells: the same as was sent, to the last bit.

    Parameters and errors are those of `state_from_message`.
    """
    check_frame(message, topic, frames)
    position, speed = message.pose.pose.position, float(message.twist.twist.linear.x)
    place = np.array((position.x, position.y, position.z), dtype=np.float64)
    if not (np.isfinite(place).all() and math.isfinite(speed)):
        raise InvalidInput(f"{topic}: position {place.tolist()} or speed {speed} is not finite")
    ahead = direction_from_message(message.pose.pose.orientation)
    return FlyerState(robot_id, place, ahead, seconds_from_stamp(message.header.stamp), speed)


def flight_command_to_message(command: FlightCommand, state: FlyerState) -> Any:
    """Return the geometry_msgs/Twist of a command to a robot in a state, in the axes of its body.

    `linear` is the velocity that it shall have: ahead, or in any direction for one that leaves a hover. `angular` turns
    it on from there.
    """
    twist = new_message("geometry_msgs/Twist")
    ahead = state.direction if command.direction is None else command.direction
    velocity = command.speed * (attitude_of(state.direction).T @ ahead)
    if command.direction is None:
        velocity = np.array((command.speed, 0.0, 0.0))
    twist.linear.x, twist.linear.y, twist.linear.z = velocity.tolist()
    _set_rate(twist.angular, state.direction, np.cross(ahead, command.turn))
    return twist


def _set_rate(angular: Any, direction: FloatArray, rate: FloatArray) -> None:
    """Write an angular velocity [rad/s, map] in the axes of the body that heads in a direction."""
    angular.x, angular.y, angular.z = (attitude_of(direction).T @ rate).tolist()


def goal_in_space_from_message(message: Any, topic: str = "goal_pose") -> tuple[float, float, float]:
    """Return the target with its height [m, map] of a PoseStamped; its orientation is not used.

    Raises
    ------
    InvalidInput
        If it is not given in the map, or not finite.
    """
    x, y = goal_from_message(message, topic)
    z = float(message.pose.position.z)
    if not math.isfinite(z):
        raise InvalidInput(f"{topic}: height {z} is not finite; give a point of the map")
    return x, y, z
