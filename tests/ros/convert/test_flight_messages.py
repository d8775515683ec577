"""States, commands, paths and goals of flying robots through the wire."""

from __future__ import annotations

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, Twist
from hypothesis import example, given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry, Path
from rclpy.serialization import deserialize_message, serialize_message

from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlightCommand, FlyerState, direction_of
from snnav_core.motion.flyer import limit_turn, step_flyer
from snnav_core.types import TimedPath
from snnav_ros.convert import (
    flight_command_to_message,
    flight_to_message,
    flyer_state_from_message,
    goal_in_space_from_message,
    path_from_message,
    path_to_message,
)
from snnav_ros.convert.frames import attitude_of, direction_from_message

NUMBER = st.floats(-1e4, 1e4)
HEADING, PITCH = st.floats(-math.pi, math.pi), st.floats(-math.pi / 2, math.pi / 2)
TURN = st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(np.array)


def state_of(heading: float, pitch: float, speed: float = 0.7) -> FlyerState:
    return FlyerState("bee", np.array([1.0, 2.0, 3.0]), direction_of(heading, pitch), 1.5, speed)


@given(NUMBER, HEADING, PITCH, st.floats(0.0, 5.0), TURN, st.integers(0, 10**15))
@example(0.0, math.pi / 4, 0.0, 0.7, np.zeros(3), 0)
@example(0.0, 0.0, math.pi / 2, 0.7, np.zeros(3), 0)
@example(0.0, 1.0, -math.pi / 2, 0.7, np.ones(3), 0)
def test_odometry_gives_back_the_state_to_the_last_bit(
    z: float, heading: float, pitch: float, speed: float, turn: np.ndarray, stamp: int
) -> None:
    sent = FlyerState("bee", np.array([1.0, 2.0, z]), direction_of(heading, pitch), stamp / 10**9, speed)
    message = deserialize_message(serialize_message(flight_to_message(sent, turn, stamp)), Odometry)
    assert (message.header.frame_id, message.child_frame_id) == ("map", "bee/base_link")
    state = flyer_state_from_message(message, "bee")
    np.testing.assert_array_equal(state.position, sent.position)
    np.testing.assert_array_equal(state.direction, sent.direction)
    assert (state.stamp, state.speed) == (sent.stamp, sent.speed)


def test_odometry_that_lies_is_refused() -> None:
    messages = [flight_to_message(state_of(0.3, 0.2), np.zeros(3), 0) for _ in range(4)]
    messages[0].header.frame_id = "odom"
    messages[1].pose.pose.position.z = math.nan
    messages[2].twist.twist.linear.x = math.inf
    messages[3].pose.pose.orientation.w = math.nan
    for message, text in zip(messages, ("frame_id", "not finite", "not finite", "no rotation"), strict=True):
        with pytest.raises(InvalidInput, match=text):
            flyer_state_from_message(message, "bee")


def flown(message: Twist, state: FlyerState) -> FlyerState:
    """Return where a base gets to that reads a command as documented: velocity, then angular velocity, in its axes."""
    axes = attitude_of(state.direction)
    velocity = axes @ [message.linear.x, message.linear.y, message.linear.z]
    rate = axes @ [message.angular.x, message.angular.y, message.angular.z]
    speed = float(np.linalg.norm(velocity))
    ahead = velocity / speed
    return step_flyer(state, FlightCommand(speed, np.cross(rate, ahead), ahead), 2.0, 0.05)


@given(HEADING, PITCH, TURN, HEADING, PITCH)
def test_a_command_says_all_that_a_base_has_to_know(
    heading: float, pitch: float, turn: np.ndarray, other: float, up: float
) -> None:
    for state, leaves in (
        (state_of(heading, pitch), None),
        (state_of(heading, pitch, 0.0), direction_of(other, up)),
    ):
        ahead = state.direction if leaves is None else leaves
        command = FlightCommand(0.7, limit_turn(turn, ahead, 2.0), leaves)
        there = step_flyer(state, command, 2.0, 0.05)
        read = flown(flight_command_to_message(command, state), state)
        np.testing.assert_allclose(read.position, there.position, atol=1e-9)
        np.testing.assert_allclose(read.direction, there.direction, atol=1e-9)


def test_a_path_in_space_heads_where_it_goes_and_keeps_its_height_of_zero() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    path = TimedPath(1.0, 0.1, points)
    message = deserialize_message(serialize_message(path_to_message(path)), Path)
    ahead = [direction_from_message(pose.pose.orientation) for pose in message.poses]
    np.testing.assert_allclose(ahead, [[1, 0, 0], [0, 1, 0], [0, 1, 0], [0, 1, 0]], atol=1e-12)
    back = path_from_message(message, in_space=True)
    assert back is not None
    np.testing.assert_array_equal(back.points, points)
    assert back.digest() == path.digest()
    climbing = path_to_message(TimedPath(0.0, 0.1, np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]])))
    np.testing.assert_allclose(
        direction_from_message(climbing.poses[0].pose.orientation), [0, 0, 1], atol=1e-12
    )


def test_a_goal_has_a_height() -> None:
    message = PoseStamped()
    message.header.frame_id = "map"
    place = message.pose.position
    place.x, place.y, place.z = 1.0, 2.0, 3.0
    assert goal_in_space_from_message(message) == (1.0, 2.0, 3.0)
    place.z = math.nan
    with pytest.raises(InvalidInput, match="height nan is not finite"):
        goal_in_space_from_message(message)
