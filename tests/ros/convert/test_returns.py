"""The hits of all sensors as a PointCloud2."""

from __future__ import annotations

import array
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from snnav_core.area.returns import FusedReturns
from snnav_core.errors import InvalidInput
from snnav_ros.convert import returns_from_message, returns_to_message
from snnav_ros.convert.returns import RETURN_FIELDS

SECOND = 10**9
NUMBER = st.floats(-1e6, 1e6)
DTYPE = np.dtype([(name, {6: "<u4", 8: "<f8"}[kind]) for name, _, kind in RETURN_FIELDS])


@st.composite
def hits(draw: st.DrawFn) -> FusedReturns:
    origins = np.array(draw(st.lists(st.tuples(NUMBER, NUMBER, st.floats(0.0, 1.0)), min_size=1, max_size=4)))
    rows = draw(st.lists(st.tuples(NUMBER, NUMBER, NUMBER, st.integers(0, len(origins) - 1)), max_size=8))
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    beams = np.arange(len(table)) * 3
    return FusedReturns(
        table[:, :2], table[:, 2], table[:, 3].astype(np.int64), beams, origins[:, :2], origins[:, 2]
    )


@given(hits())
def test_hits_survive_exactly(made: FusedReturns) -> None:
    message = deserialize_message(serialize_message(returns_to_message(made, SECOND)), PointCloud2)
    back = returns_from_message(message)
    for name in ("points", "times", "sensors", "beams", "spacing", "surfaces", "normals"):
        np.testing.assert_array_equal(getattr(made, name), getattr(back, name))
    np.testing.assert_array_equal(made.origins[made.sensors], back.origins[back.sensors])


def altered(**values: Any) -> PointCloud2:
    origins = np.array([[0.0, 0.0], [5.0, 5.0]])
    made = FusedReturns(np.ones((3, 2)), np.ones(3), [0, 0, 1], [4, 5, 4], origins, [0.01, 0.01])
    message: PointCloud2 = returns_to_message(made, SECOND)
    table = np.frombuffer(bytes(message.data), dtype=DTYPE).copy()
    for name, value in values.items():
        table[name][0] = value
    message.data = array.array("B", table.tobytes())
    return message


def test_what_is_malformed_is_refused_by_name() -> None:
    assert len(returns_from_message(altered())) == 3
    other_frame = altered()
    other_frame.header.frame_id = "laser"
    for message, text in [
        (other_frame, "frame_id is 'laser'"),
        (altered(x=np.nan), "points contain NaN"),
        (altered(stamp=np.inf), "times contain NaN or infinity"),
        (altered(origin_x=1.0), "disagree about its origin"),
        (altered(increment=np.nan), "disagree about its origin"),
        (altered(sensor=4_000_000_000), "number the sensors 0, 1"),
    ]:
        with pytest.raises(InvalidInput, match=f"unoccupied_area/returns: .*{text}"):
            returns_from_message(message)
