"""Paths through the wire: the receiver's digest is the sender's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from nav_msgs.msg import Path
from rclpy.serialization import deserialize_message, serialize_message

from snnav_core.errors import InvalidInput
from snnav_core.types import TimedPath
from snnav_ros.convert import (
    path_from_message,
    path_to_message,
    stamp_message,
    stop_to_path,
    yaw_from_message,
)

NUMBER = st.floats(-1e4, 1e4)
TIMES = st.integers(0, 10**15).map(lambda stamp: stamp / 10**9)
STEPS = st.one_of(st.integers(1, 10**10).map(lambda stamp: stamp / 10**9), st.floats(1e-3, 10.0))


@st.composite
def paths(draw: st.DrawFn) -> TimedPath:
    size = draw(st.sampled_from([2, 3]))
    points = draw(st.lists(st.tuples(*[NUMBER] * size), min_size=2, max_size=12))
    return TimedPath(draw(TIMES), draw(STEPS), np.array(points))


def through_the_wire(message: Path) -> Path:
    return deserialize_message(serialize_message(message), Path)


@given(paths())
def test_path_keeps_its_digest_and_its_points(path: TimedPath) -> None:
    back = path_from_message(through_the_wire(path_to_message(path)))
    assert back is not None
    assert back.digest() == path.digest()
    np.testing.assert_array_equal(back.points[:, :2], path.points[:, :2])
    assert back.start_time == path.start_time
    assert back.step == pytest.approx(path.step, abs=1e-9)
    assert back.turn_to is None


@given(TIMES, STEPS, NUMBER, NUMBER, st.integers(2, 20), st.floats(-10.0, 10.0))
@example(0.0, 1.0, 0.0, 0.0, 2, math.pi)
@example(0.0, 1.0, 0.0, 0.0, 2, -math.pi)
@example(0.0, 1.0, 0.0, 0.0, 2, math.nextafter(-math.pi, 0.0))
@example(0.0, 1.0, 0.0, 0.0, 2, 0.0)
def test_turn_in_place_keeps_its_digest(
    time: float, step: float, x: float, y: float, count: int, heading: float
) -> None:
    path = TimedPath(time, step, np.tile([x, y], (count, 1)), turn_to=heading)
    message = through_the_wire(path_to_message(path))
    back = path_from_message(message)
    assert back is not None
    assert back.turn_to == path.turn_to
    assert back.digest() == path.digest()
    turn = yaw_from_message(message.poses[0].pose.orientation)
    assert math.remainder(turn - heading, math.tau) == pytest.approx(0.0, abs=1e-6)


def test_waiting_on_the_spot_is_no_turn() -> None:
    path = TimedPath(3.0, 0.5, np.ones((4, 2)))
    back = path_from_message(through_the_wire(path_to_message(path)))
    assert back is not None
    assert back.turn_to is None
    assert back.digest() == path.digest()


def test_poses_are_stamped_and_head_to_the_next() -> None:
    message = path_to_message(TimedPath(10.0, 0.25, np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])))
    assert message.header.frame_id == "map"
    assert message.header.stamp == stamp_message(10 * 10**9)
    assert [pose.header.stamp for pose in message.poses] == [
        stamp_message(10 * 10**9 + k * 250_000_000) for k in range(3)
    ]
    headings = [yaw_from_message(pose.pose.orientation) for pose in message.poses]
    assert headings == pytest.approx([0.0, math.pi / 2, math.pi / 2])


def test_stop_is_a_path_without_poses() -> None:
    message = through_the_wire(stop_to_path(5))
    assert message.header.stamp.nanosec == 5
    assert path_from_message(message) is None


def test_what_a_message_cannot_say_is_not_sent() -> None:
    with pytest.raises(InvalidInput, match="two points or more"):
        path_to_message(TimedPath(0.0, 1.0, np.zeros((1, 2))))
    with pytest.raises(InvalidInput, match="all equal"):
        path_to_message(TimedPath(0.0, 1.0, np.array([[0.0, 0.0], [1.0, 0.0]]), turn_to=1.0))


def test_broken_messages_are_refused() -> None:
    def message() -> Path:
        return path_to_message(TimedPath(1.0, 0.5, np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])))

    frame, late, uneven, short, endless = (message() for _ in range(5))
    frame.header.frame_id = "base_link"
    late.header.stamp.sec = 0
    uneven.poses[2].header.stamp.nanosec = 1
    del short.poses[1:]
    endless.poses[1].pose.position.x = math.nan
    for broken, text in [
        (frame, "frame_id is 'base_link'"),
        (late, "stamp pose k"),
        (uneven, "stamp pose k"),
        (short, "one pose only"),
        (endless, "NaN or infinity"),
    ]:
        with pytest.raises(InvalidInput, match=text):
            path_from_message(broken, "robot_1/path")
