"""The unoccupied region of space as a PointCloud2."""

from __future__ import annotations

import array
import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from snnav_core.area.grid import Grid
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.area.spatial import SpatialArea
from snnav_core.errors import InvalidInput
from snnav_ros.convert import (
    area_from_message,
    area_to_message,
    is_spatial_area,
    spatial_area_from_message,
    spatial_area_to_grid,
    spatial_area_to_message,
)

SIZES = st.tuples(*[st.integers(1, 6)] * 3)
NUMBER = st.floats(-50.0, 50.0)


@st.composite
def areas(draw: st.DrawFn) -> SpatialArea:
    grid = Grid(np.array([draw(NUMBER) for _ in range(3)]), draw(st.floats(0.01, 3.0)), draw(SIZES))
    draws = np.random.default_rng(draw(st.integers(0, 10**6)))
    moving, static = draws.normal(size=(2, *grid.shape)).astype(np.float32)
    return SpatialArea(draw(st.integers(0, 10**12)) / 10**9, grid, moving, static)


def room() -> SpatialArea:
    """Two cells beside each other free, two above in a known wall, the rest unknown."""
    moving, static = np.zeros((2, 4, 3, 2), dtype=np.float32)
    static[:] = 1.0
    moving[1:3, 1, 0] = 0.4
    static[:2, 2, 1] = -0.02
    return SpatialArea(2.5, Grid(np.array([1.0, -2.0, 0.5]), 0.2, (4, 3, 2)), moving, static)


def through_the_wire(message: PointCloud2) -> PointCloud2:
    return deserialize_message(serialize_message(message), PointCloud2)


@given(areas())
def test_area_survives_exactly(area: SpatialArea) -> None:
    message = through_the_wire(spatial_area_to_message(area))
    assert is_spatial_area(message)
    back = spatial_area_from_message(message)
    assert (back.stamp, back.grid.spacing, back.grid.shape) == (
        area.stamp,
        area.grid.spacing,
        area.grid.shape,
    )
    assert back.grid.origin.tobytes() == area.grid.origin.tobytes()
    assert back.moving.tobytes() == area.moving.tobytes()
    assert back.static.tobytes() == area.static.tobytes()
    points = area.grid.centres().reshape(-1, 3)
    np.testing.assert_array_equal(back.clearance_at(points, 0.1), area.clearance_at(points, 0.1))


def test_fields_say_where_everything_is() -> None:
    area = room()
    message = spatial_area_to_message(area)
    names = ("origin", "spacing", "shape", "moving", "static")
    kinds = {6: "<u4", 7: "<f4", 8: "<f8"}
    values = {
        field.name: np.frombuffer(bytes(message.data), kinds[field.datatype], field.count, field.offset)
        for field in message.fields
        if field.name in names
    }
    assert tuple(values) == names
    assert values["origin"].tolist() == [1.0, -2.0, 0.5]
    assert (values["spacing"].tolist(), values["shape"].tolist()) == ([0.2], [4, 3, 2])
    np.testing.assert_array_equal(values["moving"].reshape(4, 3, 2), area.moving)
    np.testing.assert_array_equal(values["static"].reshape(4, 3, 2), area.static)
    assert len(message.data) == message.point_step == message.row_step


def test_areas_of_the_plane_and_of_space_are_told_apart() -> None:
    planar = area_to_message(UnoccupiedArea.from_rings(0.0, [np.array([(0, 0), (1, 0), (1, 1)])]))
    assert not is_spatial_area(planar)
    assert not is_spatial_area(PointCloud2())
    with pytest.raises(InvalidInput, match="publish an area of space"):
        spatial_area_from_message(planar)
    with pytest.raises(InvalidInput, match="publish boundary vertices"):
        area_from_message(spatial_area_to_message(room()))


def test_one_bit_of_the_data_is_refused() -> None:
    message = spatial_area_to_message(room())
    for bit in range(8 * len(message.data)):
        altered = copy.deepcopy(message)
        altered.data[bit // 8] ^= 1 << bit % 8
        with pytest.raises(InvalidInput, match="seal"):
            spatial_area_from_message(altered)


def test_one_bit_of_everything_else_is_refused() -> None:
    refused = 0
    for read in (
        lambda message: (message.header.stamp, "sec", 31),
        lambda message: (message.header.stamp, "nanosec", 32),
        *((lambda message, name=name: (message, name, 32)) for name in ("height", "width")),
        *((lambda message, name=name: (message, name, 32)) for name in ("point_step", "row_step")),
        *((lambda message, name=name: (message, name, 1)) for name in ("is_bigendian", "is_dense")),
        *(
            (lambda message, index=index, name=name, bits=bits: (message.fields[index], name, bits))
            for index in range(6)
            for name, bits in (("offset", 32), ("datatype", 8), ("count", 32))
        ),
    ):
        for bit in range(read(spatial_area_to_message(room()))[2]):
            message = spatial_area_to_message(room())
            place, name, _ = read(message)
            value = getattr(place, name)
            setattr(place, name, not value if isinstance(value, bool) else value ^ (1 << bit))
            with pytest.raises(InvalidInput):
                spatial_area_from_message(message)
            refused += 1
    assert refused == 31 + 32 + 4 * 32 + 2 + 6 * 72


def sealed_anew(message: Any, change: Callable[[SpatialArea], SpatialArea]) -> Any:
    """Return the message of another area: what a program that is wrong, not damaged, would send."""
    return spatial_area_to_message(change(spatial_area_from_message(message)))


def with_value(value: float) -> Callable[[SpatialArea], SpatialArea]:
    def change(area: SpatialArea) -> SpatialArea:
        moving = area.moving.copy()
        moving[1, 1, 0] = value
        return SpatialArea(area.stamp, area.grid, moving, area.static)

    return change


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_clearance_that_is_no_number_is_refused(value: float) -> None:
    with pytest.raises(InvalidInput, match="unoccupied_area: a clearance is not finite"):
        spatial_area_from_message(sealed_anew(spatial_area_to_message(room()), with_value(value)))


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda m: setattr(m.header, "frame_id", "odom"), "frame_id is 'odom'"),
        (lambda m: m.fields.pop(), "publish an area of space"),
        (lambda m: setattr(m, "fields", []), "publish an area of space"),
        (lambda m: setattr(m.fields[4], "name", "motion"), "publish an area of space"),
        (lambda m: setattr(m, "data", array.array("B")), "publish an area of space"),
        (lambda m: setattr(m, "data", m.data[:-8]), "publish an area of space"),
        (lambda m: setattr(m, "data", m.data[:-1]), "area of space|damaged"),
        (lambda m: setattr(m, "data", m.data[:20]), "publish an area of space"),
    ],
)
def test_other_messages_are_refused(spoil: Callable[[Any], None], said: str) -> None:
    message = spatial_area_to_message(room())
    spoil(message)
    with pytest.raises(InvalidInput, match=said):
        spatial_area_from_message(message)


def test_grid_shows_slices_stacked_along_y() -> None:
    area = room()
    message = spatial_area_to_grid(area)
    assert (message.info.width, message.info.height) == (4, 6)
    origin = message.info.origin.position
    assert (origin.x, origin.y, origin.z) == (1.0, -2.0, 0.5)
    assert message.info.resolution == pytest.approx(0.2)
    cells = np.array(message.data).reshape(2, 3, 4)
    expected = np.full((2, 3, 4), -1)
    expected[0, 1, 1:3] = 0
    expected[1, 2, :2] = 100
    np.testing.assert_array_equal(cells, expected)


def test_free_cell_of_the_grid_is_free_to_its_corners() -> None:
    area = room()
    half = area.grid.half_diagonal
    for clearance, shown in ((0.999 * half, -1), (1.001 * half, 0)):
        moving = np.full(area.grid.shape, clearance, dtype=np.float32)
        whole = SpatialArea(0.0, area.grid, moving, np.ones_like(moving))
        assert set(spatial_area_to_grid(whole).data) == {shown}
