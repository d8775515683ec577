"""LaserScan and PlanarScan, through the wire."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import LaserScan

from snnav_core.errors import ScanError
from snnav_core.sensing.scan import PlanarScan
from snnav_ros.convert import is_nothing, nothing_to_message, scan_from_message, scan_to_message

SINGLE = st.floats(width=32, allow_nan=True, allow_infinity=True)
ANGLE = st.floats(-3.0, 3.0, width=32)


@st.composite
def scans(draw: st.DrawFn) -> PlanarScan:
    ranges = draw(st.lists(SINGLE, min_size=2, max_size=40))
    return PlanarScan(
        stamp=draw(st.integers(0, 10**12)) / 10**9,
        ranges=np.array(ranges),
        angle_min=draw(ANGLE),
        angle_increment=draw(st.floats(0.0009765625, 0.125, width=32)) * draw(st.sampled_from([1, -1])),
        range_min=draw(st.floats(0.0, 1.0, width=32)),
        range_max=draw(st.floats(2.0, 100.0, width=32)),
    )


def through_the_wire(message: LaserScan) -> LaserScan:
    return deserialize_message(serialize_message(message), LaserScan)


@given(scans())
def test_scan_of_single_precision_survives_exactly(scan: PlanarScan) -> None:
    message = through_the_wire(scan_to_message(scan, "lms_1", round(scan.stamp * 10**9)))
    back = scan_from_message(message)
    assert message.header.frame_id == "lms_1"
    assert len(message.ranges) == scan.ranges.size
    np.testing.assert_array_equal(back.ranges, scan.ranges)
    for name in ("stamp", "angle_min", "angle_increment", "range_min", "range_max"):
        assert getattr(back, name) == getattr(scan, name)


@given(scans())
def test_message_survives_exactly(scan: PlanarScan) -> None:
    first = through_the_wire(scan_to_message(scan, "x", 7))
    second = through_the_wire(scan_to_message(scan_from_message(first), "x", 7))
    assert serialize_message(first) == serialize_message(second)


def test_scan_without_ranges_is_refused() -> None:
    with pytest.raises(ScanError, match="at least 2 beams"):
        scan_from_message(LaserScan(range_max=8.0, angle_increment=0.01))


def test_the_message_without_beams_says_nothing_more_and_is_no_scan() -> None:
    message = through_the_wire(nothing_to_message("lms_1", 1_500_000_000))
    assert is_nothing(message)
    assert (message.header.frame_id, message.header.stamp.sec) == ("lms_1", 1)
    with pytest.raises(ScanError):
        scan_from_message(message)


@given(scans())
def test_no_scan_passes_for_nothing(scan: PlanarScan) -> None:
    assert not is_nothing(scan_to_message(scan, "lms_1", 0))
