"""Depth cameras: rays, clouds, what counts as a measurement."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.errors import InvalidInput, ScanError
from snnav_core.sensing.depth import (
    CameraModel,
    DepthCamera,
    DepthImage,
    equal_angle,
    looking_at,
    pinhole,
)

TOF = equal_angle()
KINECT = pinhole(64, 48, (57.0, 57.0), (31.5, 23.5))


def camera(model: CameraModel = TOF) -> DepthCamera:
    position = np.array([1.0, 2.0, 3.0])
    return DepthCamera("cam", position, looking_at(position, np.array([4.0, 2.0, 1.0])), model)


@pytest.mark.parametrize("model", [TOF, KINECT, equal_angle(360, 16, 2.0 * math.pi, math.radians(30.0))])
def test_rays_are_unit_vectors_about_the_axis_ahead(model: CameraModel) -> None:
    rays = model.rays()
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1.0, atol=1e-12)
    np.testing.assert_allclose(rays.mean(axis=(0, 1))[1:], 0.0, atol=1e-9)
    assert (rays[0, :, 2] > rays[-1, :, 2]).all()  # the first row is the upper one
    assert rays[0, 0, 1] > rays[0, 1, 1] or model.around  # the first column is the left one


def test_the_default_is_the_camera_of_the_thesis() -> None:
    edge = np.degrees(np.arctan2(TOF.rays()[64, :, 1], TOF.rays()[64, :, 0]))
    assert TOF.rays().shape == (128, 128, 3)
    assert edge[0] - edge[-1] == pytest.approx(135.0 * 127 / 128)
    assert not TOF.around


@given(st.tuples(*[st.floats(-5.0, 5.0)] * 3).filter(lambda p: np.linalg.norm(np.array(p)) > 1e-3))
def test_a_camera_looks_at_its_target_with_a_level_axis(target: tuple[float, float, float]) -> None:
    rotation = looking_at(np.zeros(3), np.array(target))
    np.testing.assert_allclose(rotation[:, 0], np.array(target) / np.linalg.norm(target), atol=1e-9)
    assert abs(rotation[2, 1]) < 1e-9
    DepthCamera("cam", np.zeros(3), rotation, TOF)


@pytest.mark.parametrize("model", [TOF, KINECT])
def test_image_to_cloud_and_back(model: CameraModel) -> None:
    ranges = np.random.default_rng(3).uniform(0.5, 8.0, (model.rows, model.columns))
    ranges[3, 4] = math.nan
    one = camera(model)
    cloud = one.cloud(DepthImage(1.5, ranges))
    local = (cloud - one.position) @ one.rotation
    back = one.image_from_points(1.5, local)
    np.testing.assert_allclose(back.ranges, ranges, atol=1e-9)
    with pytest.raises(ScanError, match="off the rays"):
        one.image_from_points(1.5, local[:, ::-1])
    with pytest.raises(ScanError, match="cloud has shape"):
        one.image_from_points(1.5, local[1:])


def test_only_ranges_inside_the_limits_are_measurements() -> None:
    model = equal_angle(3, 2, range_min=0.2, range_max=9.0)
    image = DepthImage(0.0, np.array([[math.nan, 0.0, -1.0], [0.1, math.inf, 5.0]]))
    assert np.isfinite(image.measured(model)).sum() == 1
    np.testing.assert_array_equal(image.free_up_to(model, inf_is_free=False), [[0, 0, 0], [0, 0, 5]])
    np.testing.assert_array_equal(image.free_up_to(model, inf_is_free=True), [[0, 0, 0], [0, 9, 5]])
    with pytest.raises(ScanError, match="check its model"):
        image.measured(TOF)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: equal_angle(1, 5), "at least 2 x 2"),
        (lambda: equal_angle(width=7.0), "at most 360 x 180"),
        (lambda: equal_angle(range_max=math.nan), "range_max is nan"),
        (lambda: equal_angle(range_min=10.0), "range_min is 10.0"),
        (lambda: CameraModel("fisheye", 4, 4, 0.1, 0.1, 1.5, 1.5), "'fisheye'"),  # type: ignore[arg-type]
        (lambda: DepthCamera("c", np.zeros(2), np.eye(3), TOF), "'c': position"),
        (lambda: DepthCamera("c", np.zeros(3), np.ones((3, 3)), TOF), "no rotation"),
        (lambda: DepthCamera("c", np.zeros(3), np.diag([1.0, 1.0, -1.0]), TOF), "mirrors"),
        (lambda: looking_at(np.ones(3), np.ones(3)), "own position"),
        (lambda: DepthImage(0.0, np.zeros(3)), "shape"),
        (lambda: DepthImage(math.nan, np.zeros((3, 3))), "stamp nan"),
    ],
)
def test_what_cannot_be_a_camera_or_an_image_is_refused(make: object, message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        make()  # type: ignore[operator]
