"""What silent sensors saw last survives the wire; a damaged message is refused in words."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from shapely.geometry import MultiPolygon
from visualization_msgs.msg import Marker, MarkerArray

from snnav_core.area.planar import LostPart, UnoccupiedArea, as_multipolygon
from snnav_core.errors import InvalidInput
from snnav_core.sensing.scan import PlanarScan, ScanSettings, detect_planar
from snnav_core.types import Pose2D
from snnav_ros.convert import grid_points, lost_from_message, lost_to_message, seen_to_message

HOLED = shapely.box(0.0, 0.0, 4.0, 4.0).difference(shapely.box(1.0, 1.0, 2.0, 2.0))


def through_the_wire(message: Any) -> Any:
    return deserialize_message(serialize_message(message), type(message))


def sectors(seed: int) -> MultiPolygon:
    """Return what a scanner with lost beams saw: sectors that all begin at the scanner."""
    generator = np.random.default_rng(seed)
    ranges = generator.uniform(1.0, 5.0, 90)
    ranges[generator.uniform(size=90) < 0.3] = np.nan
    scan = PlanarScan(0.0, ranges, 0.0, 0.03, 0.0, 8.0)
    return as_multipolygon(detect_planar("s", scan, Pose2D(1.0, 2.0, 0.3), ScanSettings()).polygon)


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**53))
def test_parts_survive_exactly(seed: int, stamp_ns: int) -> None:
    parts = (
        LostPart("lms_1", 1.25, sectors(seed)),
        LostPart("lms_2", 0.0, MultiPolygon([HOLED])),
        LostPart("lms_3", 3.5, MultiPolygon()),
        LostPart("lms_4", None, MultiPolygon()),
    )
    area = UnoccupiedArea(stamp_ns / 10**9, MultiPolygon(), lost=parts)
    stamp, back = lost_from_message(through_the_wire(lost_to_message(area)))
    assert stamp == pytest.approx(stamp_ns, abs=2)
    assert [(part.sensor_id, part.stamp) for part in back] == [(part.sensor_id, part.stamp) for part in parts]
    for first, second in zip(parts, back, strict=True):
        assert shapely.equals(shapely.normalize(first.region), shapely.normalize(second.region))
        assert second.region.area == pytest.approx(first.region.area, rel=1e-12)


def test_an_area_without_silent_sensors_deletes_what_was_shown() -> None:
    message = through_the_wire(lost_to_message(UnoccupiedArea(2.0, MultiPolygon())))
    assert [marker.action for marker in message.markers] == [Marker.DELETEALL]
    assert lost_from_message(message) == (2 * 10**9, ())


def damaged(change: Any) -> MarkerArray:
    message = lost_to_message(UnoccupiedArea(2.0, MultiPolygon(), lost=(LostPart("a", 1.0, sectors(1)),)))
    change(message)
    return message


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda m: m.markers.clear(), "the first of 0 markers must delete all"),
        (lambda m: m.markers.pop(0), "the first of 1 markers must delete all"),
        (lambda m: setattr(m.markers[1], "type", Marker.SPHERE), "type 2, expected LINE_LIST"),
        (lambda m: setattr(m.markers[1].header, "frame_id", "odom"), "frame_id is 'odom'"),
        (lambda m: m.markers[1].points.pop(), "give two for every edge"),
        (lambda m: (m.markers[1].points.pop(), m.markers[1].points.pop()), "is not closed"),
        (
            lambda m: setattr(m.markers[1].points[2], "x", float("nan")),
            "expected at least three finite points",
        ),
    ],
)
def test_damaged_messages_are_refused(change: Any, text: str) -> None:
    with pytest.raises(InvalidInput, match=text):
        lost_from_message(damaged(change))


def test_points_on_a_grid_lie_inside_and_bear_sensor_and_age() -> None:
    area = UnoccupiedArea(2.0, MultiPolygon([HOLED]))
    points = grid_points(area, 0.5)
    assert (area.clearance(points) >= 0.0).all()
    assert len(points) == 9 * 9 - 1
    np.testing.assert_allclose(points, np.round(points / 0.5) * 0.5)
    assert grid_points(UnoccupiedArea(2.0, MultiPolygon()), 0.5).shape == (0, 2)
    sensor, age = np.full(len(points), 1), np.full(len(points), 0.5)
    sensor[0], age[0] = -1, np.nan
    message = through_the_wire(seen_to_message(points, sensor, age, 2 * 10**9))
    assert not message.is_dense
    assert message.width == len(points)
    values = np.frombuffer(bytes(message.data), dtype="<f4").reshape(-1, 5)
    np.testing.assert_array_equal(values[:, :2], points.astype(np.float32))
    np.testing.assert_array_equal(values[:, 4], age.astype(np.float32))
    np.testing.assert_array_equal(values[:, 3].copy().view("<i4"), sensor)
