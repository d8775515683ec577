"""The unoccupied area as a PointCloud2."""

from __future__ import annotations

import array

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.errors import InvalidInput
from snnav_ros.convert import area_from_message, area_to_message

NUMBER = st.floats(-50.0, 50.0)
DISK = st.tuples(NUMBER, NUMBER, st.floats(0.5, 20.0))


@st.composite
def areas(draw: st.DrawFn) -> UnoccupiedArea:
    disks = [shapely.Point(x, y).buffer(r, quad_segs=4) for x, y, r in draw(st.lists(DISK, max_size=5))]
    holes = [shapely.Point(x, y).buffer(r / 4, quad_segs=3) for x, y, r in draw(st.lists(DISK, max_size=5))]
    region = as_multipolygon(shapely.union_all(disks).difference(shapely.union_all(holes)))
    return UnoccupiedArea(draw(st.integers(0, 10**12)) / 10**9, region)


def two_parts() -> UnoccupiedArea:
    with_hole = shapely.box(0, 0, 10, 10).difference(shapely.box(4, 4, 6, 6))
    return UnoccupiedArea(2.5, shapely.MultiPolygon([with_hole, shapely.box(20, 0, 30, 10)]))


def through_the_wire(message: PointCloud2) -> PointCloud2:
    return deserialize_message(serialize_message(message), PointCloud2)


@given(areas())
def test_area_survives_exactly(area: UnoccupiedArea) -> None:
    back = area_from_message(through_the_wire(area_to_message(area)))
    assert back.stamp == area.stamp
    assert len(back.rings) == len(area.rings)
    for ours, theirs in zip(area.rings, back.rings, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    # the same geometry to the last bit, so that whatever is computed from it is the same
    assert back.region.wkb == area.region.wkb


def test_rings_come_in_order_with_their_orientation() -> None:
    message = area_to_message(two_parts())
    assert [(f.name, f.offset, f.datatype, f.count) for f in message.fields] == [
        ("x", 0, 8, 1), ("y", 8, 8, 1), ("z", 16, 8, 1), ("ring", 24, 6, 1),
    ]  # fmt: skip
    dtype = np.dtype([("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("ring", "<u4")])
    vertices = np.frombuffer(bytes(message.data), dtype=dtype)
    assert vertices["ring"].tolist() == [0] * 4 + [1] * 4 + [2] * 4
    signs = []
    for ring in range(3):
        x, y = vertices["x"][vertices["ring"] == ring], vertices["y"][vertices["ring"] == ring]
        signs.append(np.sign(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))
    assert signs == [1.0, -1.0, 1.0]
    assert message.header.frame_id == "map"
    assert message.row_step == len(message.data) == 12 * message.point_step


def test_nothing_free_is_a_message_without_points() -> None:
    message = through_the_wire(area_to_message(UnoccupiedArea(1.0, shapely.MultiPolygon())))
    assert message.width == 0
    assert area_from_message(message).is_empty


def test_other_frames_fields_sizes_and_orders_are_refused() -> None:
    def broken(**changes: object) -> PointCloud2:
        message = area_to_message(two_parts())
        for name, value in changes.items():
            setattr(message, name, value)
        return message

    other_frame = broken()
    other_frame.header.frame_id = "odom"
    swapped = broken()
    data = bytearray(swapped.data)
    data[24:28] = (1).to_bytes(4, "little")
    not_finite = broken()
    damaged = bytearray(not_finite.data)
    damaged[0:8] = np.float64(np.nan).tobytes()
    for message, text in [
        (other_frame, "frame_id is 'odom', expected 'map'"),
        (broken(fields=area_to_message(two_parts()).fields[:3]), "fields are"),
        (broken(is_bigendian=True), "little-endian"),
        (broken(width=11), "damaged"),
        (broken(data=array.array("B", bytes(data))), "ring numbers"),
        (broken(data=array.array("B", bytes(damaged))), "finite"),
    ]:
        with pytest.raises(InvalidInput, match=text):
            area_from_message(message)
