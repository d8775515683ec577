"""Bodies in uniform motion as a PointCloud2."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from snnav_core.errors import InvalidInput
from snnav_core.obstacles import MovingObstacle
from snnav_ros.convert import (
    obstacles_from_message,
    obstacles_to_message,
    rings_from_message,
    rings_to_message,
)
from snnav_ros.convert.obstacles import OBSTACLE_FIELDS

SECOND = 10**9
NUMBER = st.floats(-1e6, 1e6)
AMOUNT = st.floats(0.0, 1e3)
POINT = st.tuples(NUMBER, NUMBER)
DTYPE = np.dtype([(name, {5: "<i4", 8: "<f8"}[kind]) for name, _, kind in OBSTACLE_FIELDS])


@st.composite
def bodies(draw: st.DrawFn) -> tuple[MovingObstacle, ...]:
    made = []
    names = st.builds("{}_{}".format, st.sampled_from(("body", "unseen")), st.integers(1, 2**31 - 1))
    for name in draw(st.lists(names, max_size=5, unique=True)):
        outline = draw(st.lists(POINT, min_size=1, max_size=6))
        radius = draw(st.floats(1e-6, 1e3) if len(outline) == 1 else AMOUNT)
        stamp = draw(st.floats(0.0, 100.0))
        velocity = np.array(draw(POINT))
        made.append(
            MovingObstacle(name, np.array(outline), radius, velocity, stamp, draw(AMOUNT), draw(AMOUNT))
        )
    return tuple(made)


def through_the_wire(message: PointCloud2) -> PointCloud2:
    return deserialize_message(serialize_message(message), PointCloud2)


@given(bodies())
def test_bodies_survive_exactly(made: tuple[MovingObstacle, ...]) -> None:
    back = obstacles_from_message(through_the_wire(obstacles_to_message(made, 100 * SECOND)))
    assert len(back) == len(made)
    for ours, theirs in zip(made, back, strict=True):
        np.testing.assert_array_equal(ours.outline, theirs.outline)
        np.testing.assert_array_equal(ours.velocity, theirs.velocity)
        for name in ("id", "radius", "stamp", "position_deviation", "velocity_deviation"):
            assert getattr(ours, name) == getattr(theirs, name)


@given(st.lists(st.lists(POINT, min_size=1, max_size=6), max_size=4))
def test_rings_survive_exactly(drawn: list[list[tuple[float, float]]]) -> None:
    rings = tuple(np.array(ring) for ring in drawn)
    back = rings_from_message(through_the_wire(rings_to_message(rings, SECOND)), "obstacles/workspace")
    assert len(back) == len(rings)
    for ours, theirs in zip(rings, back, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_no_body_is_a_message_without_points() -> None:
    message = through_the_wire(obstacles_to_message((), SECOND))
    assert message.width == 0
    assert message.header.frame_id == "map"
    assert obstacles_from_message(message) == ()


def test_id_that_is_no_number_is_refused() -> None:
    for name in ("walker", "7", "body_01", "body_0", "body_-1", "unseen_2147483648", "body_\u0663", ""):
        with pytest.raises(InvalidInput, match="name it body_1"):
            obstacles_to_message((MovingObstacle(name, np.zeros((1, 2)), 0.3),), SECOND)


def two_bodies() -> PointCloud2:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    walker = MovingObstacle("body_7", [[4.0, 4.0], [5.0, 4.0]], 0.3, [0.2, 0.1], 1.0, 0.01, 0.02)
    message: PointCloud2 = obstacles_to_message(
        (MovingObstacle("unseen_3", square, stamp=1.0), walker), SECOND
    )
    return message


def altered(vertex: int, **values: float) -> PointCloud2:
    message = two_bodies()
    vertices = np.frombuffer(bytes(message.data), dtype=DTYPE).copy()
    for name, value in values.items():
        vertices[name][vertex] = value
    message.data = array.array("B", vertices.tobytes())
    return message


def changed(**changes: Any) -> PointCloud2:
    message = two_bodies()
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def test_what_is_malformed_is_refused_by_name() -> None:
    other_frame = two_bodies()
    other_frame.header.frame_id = "laser"
    for message, text in [
        (other_frame, "frame_id is 'laser', expected 'map'"),
        (changed(fields=two_bodies().fields[:4]), "fields are .* publish a point per vertex"),
        (changed(is_bigendian=True), "little-endian"),
        (changed(width=6), "damaged"),
        (altered(0, x=np.nan), "body 'unseen_3': outline, velocity or stamp contain NaN"),
        (altered(3, radius=np.nan), "radius of body_7 is nan at one vertex"),
        (altered(4, vx=0.3), "vx of body_7 is 0.2 at one vertex"),
        (altered(4, obstacle=-3), "vertices of unseen_3 are not in one piece"),
        (altered(4, obstacle=0), "has the number 0"),
        (altered(4, obstacle=9, radius=0.0), "body 'body_9' is a single point"),
        (altered(4, obstacle=9, radius=-1.0), "radius is -1.0, must be a number of at least 0"),
        (altered(4, obstacle=9, velocity_deviation=np.inf), "velocity_deviation is inf"),
        (altered(4, obstacle=9, vy=np.inf), "body 'body_9': outline, velocity or stamp"),
        (altered(4, obstacle=9, stamp=1.5), "body_9 is stamped 0.500 s ahead of the message"),
    ]:
        with pytest.raises(InvalidInput, match=text):
            obstacles_from_message(message)
