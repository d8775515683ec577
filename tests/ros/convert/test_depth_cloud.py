"""Images of depth cameras as organized clouds."""

from __future__ import annotations

import array
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from snnav_core.errors import InvalidInput
from snnav_core.sensing.depth import DepthCamera, DepthImage, equal_angle, pinhole
from snnav_ros.convert import image_from_message, image_to_message, is_no_cloud, no_cloud_to_message

EYE = DepthCamera("eye", np.zeros(3), np.eye(3), equal_angle(8, 6, 1.6, 1.2, 0.1, 9.0))
MODELS = st.sampled_from([EYE.model, equal_angle(12, 4, 2 * np.pi), pinhole(9, 5, (6.0, 7.0), (4.1, 2.3))])
ODD = st.sampled_from([np.nan, np.inf, -np.inf, 0.0, 1e-3, 30.0])
RANGES = st.one_of(st.floats(0.25, 8.875, width=32), ODD)


def drawn(seed: int, model: Any = EYE.model) -> DepthImage:
    ranges = np.random.default_rng(seed).uniform(0.2, 8.9, (model.rows, model.columns))
    return DepthImage(1.5, ranges.astype(np.float32))


def cloud(image: DepthImage | None = None) -> Any:
    return image_to_message(image or drawn(1), EYE.model, "eye", 1_500_000_000)


def through_the_wire(message: PointCloud2) -> PointCloud2:
    return deserialize_message(serialize_message(message), PointCloud2)


@given(st.data(), MODELS, st.integers(0, 10**12))
def test_what_is_measured_survives_exactly(data: st.DataObject, model: Any, stamp: int) -> None:
    values = data.draw(
        st.lists(RANGES, min_size=model.rows * model.columns, max_size=model.rows * model.columns)
    )
    image = DepthImage(stamp / 10**9, np.array(values, dtype=np.float32).reshape(model.rows, model.columns))
    camera = replace(EYE, model=model)
    back = image_from_message(through_the_wire(image_to_message(image, model, "eye", stamp)), camera)
    assert back.stamp == image.stamp
    for inf_is_free in (False, True):
        np.testing.assert_array_equal(back.measured(model), image.measured(model))
        np.testing.assert_array_equal(
            back.free_up_to(model, inf_is_free), image.free_up_to(model, inf_is_free)
        )


def test_points_stand_in_rows_with_nan_where_nothing_returned() -> None:
    ranges = np.full((6, 8), 2.0)
    ranges[0, 0], ranges[0, 1], ranges[5, 7] = np.inf, np.nan, 20.0
    message = cloud(DepthImage(1.5, ranges))
    assert (message.height, message.width, message.point_step, message.row_step) == (6, 8, 16, 128)
    assert [(f.name, f.offset, f.datatype, f.count) for f in message.fields] == [
        ("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1), ("range", 12, 7, 1),
    ]  # fmt: skip
    assert message.header.frame_id == "eye"
    assert not message.is_dense
    values = np.frombuffer(bytes(message.data), "<f4").reshape(6, 8, 4)
    assert np.isnan(values[[0, 0, 5], [0, 1, 7], :3]).all()
    np.testing.assert_array_equal(values[[0, 0, 5], [0, 1, 7], 3], np.float32([np.inf, np.nan, 20.0]))
    left_top = values[1, 0, :3]
    assert (left_top > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(values[2], axis=-1)[3], np.hypot(2.0, 2.0), rtol=1e-6)


def test_clouds_of_other_cameras_are_read_wherever_their_fields_stand() -> None:
    image = drawn(2)
    points = (EYE.model.rays() * image.ranges[..., None]).astype("<f4")
    names, offsets = ["z", "x", "rgb", "y"], [4, 8, 12, 20]
    kind = np.dtype({"names": names, "formats": ["<f4"] * 4, "offsets": offsets, "itemsize": 32})
    values = np.zeros((6, 8), dtype=kind)
    values["x"], values["y"], values["z"] = np.moveaxis(points, -1, 0)
    message = PointCloud2(height=6, width=8, point_step=32, row_step=8 * 32 + 16)
    message.fields = [
        PointField(name=name, offset=at, datatype=7, count=1) for name, at in zip(names, offsets, strict=True)
    ]
    rows = [row.tobytes() + bytes(16) for row in values]
    message.data = array.array("B", b"".join(rows))
    np.testing.assert_allclose(image_from_message(message, EYE).ranges, image.ranges, rtol=1e-6)


def test_points_in_an_optical_frame_are_turned() -> None:
    image = drawn(3)
    points = EYE.model.rays() * image.ranges[..., None]
    optical = np.stack((-points[..., 1], -points[..., 2], points[..., 0]), axis=-1).astype("<f4")
    message = PointCloud2(height=6, width=8, point_step=12, row_step=96)
    message.fields = [
        PointField(name=name, offset=4 * i, datatype=7, count=1) for i, name in enumerate("xyz")
    ]
    message.data = array.array("B", optical.tobytes())
    np.testing.assert_allclose(image_from_message(message, EYE, optical=True).ranges, image.ranges, rtol=1e-6)
    with pytest.raises(InvalidInput, match="off the rays of their pixels"):
        image_from_message(message, EYE)


def with_value(field: int, value: float, at: tuple[int, int] = (2, 3)) -> Callable[[Any], None]:
    def change(message: Any) -> None:
        values = np.frombuffer(bytes(message.data), "<f4").reshape(6, 8, 4).copy()
        values[(*at, field)] = value
        message.data = array.array("B", values.tobytes())

    return change


def together(**values: Any) -> Callable[[Any], None]:
    def change(message: Any) -> None:
        for name, value in values.items():
            setattr(message, name, value)

    return change


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (together(height=8, width=6), "points: cloud has 6 x 8 points, expected 8 x 6"),
        (together(height=1, width=48), "cloud has 48 x 1 points.*NaN where nothing was measured"),
        (together(is_bigendian=True), "big-endian, expected little-endian x, y and z"),
        (together(fields=[]), r"fields are \[\], expected"),
        (lambda m: setattr(m.fields[1], "datatype", 8), r"\('y', 8\).*expected"),
        (lambda m: setattr(m.fields[1], "count", 3), "expected little-endian x, y and z"),
        (lambda m: setattr(m.fields[0], "name", "u"), "expected little-endian x, y and z"),
        (lambda m: setattr(m.fields[2], "offset", 14), "field at byte 14; the message is damaged"),
        (together(point_step=0), "the message is damaged"),
        (together(row_step=100), "the message is damaged"),
        (lambda m: setattr(m, "data", m.data[:-1]), "767 bytes for 6 rows of 128 bytes"),
        (with_value(0, np.inf), "infinite coordinate; write NaN"),
        (with_value(1, 5.0), "off the rays of their pixels"),
        (with_value(3, 5.0), r"has range 5\.0000; the field range must hold the distance"),
        (with_value(3, np.nan), "has range nan"),
        (with_value(3, np.inf), "has range inf"),
    ],
)
def test_clouds_that_lie_are_refused(spoil: Callable[[Any], None], said: str) -> None:
    ranges = np.array(drawn(1).ranges)
    ranges[2, 3] = 2.0
    message = cloud(DepthImage(1.5, ranges))
    spoil(message)
    with pytest.raises(InvalidInput, match=said):
        image_from_message(message, EYE)


def test_a_range_without_a_point_says_nothing() -> None:
    message = cloud()
    for field in range(3):
        with_value(field, np.nan)(message)
    image = image_from_message(message, EYE)
    assert np.isnan(image.ranges[2, 3])
    assert np.isnan(image.measured(EYE.model)).sum() == 1


def test_a_cloud_without_points_says_nothing_more() -> None:
    message = through_the_wire(no_cloud_to_message("eye", 2_500_000_000))
    assert is_no_cloud(message)
    assert (message.header.frame_id, message.header.stamp.nanosec) == ("eye", 500_000_000)
    assert not is_no_cloud(cloud())
    with pytest.raises(InvalidInput, match="0 x 0 points"):
        image_from_message(message, EYE)
