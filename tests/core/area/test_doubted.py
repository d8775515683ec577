"""The free region of cameras whose ranges and poses are wrong by no more than they may be holds nothing solid."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from snnav_core.area.doubted import CameraErrors, Outlook, common_area, least_of
from snnav_core.area.grid import Grid
from snnav_core.errors import InvalidInput
from snnav_core.sensing.depth import DepthCamera, DepthImage, looking_at, pinhole
from snnav_core.types import FloatArray
from support.box_world import distance, image

ROOM = np.array([[0.0, 0.0, 0.0], [4.0, 3.0, 2.4]])
BOXES = np.array([[[2.0, 1.0, 0.0], [2.4, 1.5, 1.2]], [[2.8, 2.2, 0.0], [3.4, 2.6, 1.9]]])
GRID = Grid.covering(np.array([-0.4, -0.4, -0.4]), np.array([4.4, 3.4, 2.8]), 0.1)
PLACES = {"one": (np.array([0.2, 0.3, 1.5]), np.array([3.0, 2.0, 0.9])),
          "two": (np.array([0.3, 2.7, 1.2]), np.array([3.0, 1.0, 1.0]))}  # fmt: skip


def camera(name: str, shift: FloatArray | None = None, turn: FloatArray | None = None) -> DepthCamera:
    position, aim = PLACES[name]
    rotation = looking_at(position, aim)
    if turn is not None:
        rotation = Rotation.from_rotvec(turn).as_matrix() @ rotation
    moved = position if shift is None else position + shift
    return DepthCamera(name, moved, rotation, pinhole(160, 120, (140.0, 140.0), (79.5, 59.5)))


def solid_depth(points: FloatArray) -> FloatArray:
    """Distance of points to anything solid."""
    to_walls = np.minimum(points - ROOM[0], ROOM[1] - points).min(axis=-1)
    return np.minimum(to_walls, distance(points, BOXES))


@settings(max_examples=12, deadline=None)
@given(
    shift=st.tuples(*[st.floats(-0.05, 0.05)] * 3),
    turn=st.tuples(*[st.floats(-0.01, 0.01)] * 3),
    seed=st.integers(0, 10_000),
)
def test_nothing_solid_is_called_free_within_the_errors(
    shift: tuple[float, float, float], turn: tuple[float, float, float], seed: int
) -> None:
    errors = CameraErrors(0.02, 0.004, pose_accuracy=0.18)  # sqrt(3) 0.05 m and sqrt(3) 0.01 rad at 5 m
    rng = np.random.default_rng(seed)
    clearances = []
    for name in PLACES:
        exact = image(camera(name), BOXES, ROOM).ranges
        wrong = exact + rng.uniform(-1.0, 1.0, exact.shape) * (0.02 + 0.003 * exact**2)
        believed = camera(name, np.array(shift), np.array(turn))
        clearances.append(Outlook(believed, GRID, errors).clearance(DepthImage(0.0, wrong)))
    area = common_area(clearances, GRID, errors.pose_accuracy, 0.0)
    free = area.moving > 0.0
    assert np.count_nonzero(free) > 500
    centres = GRID.centres()
    assert (solid_depth(centres[free]) > 0.0).all()
    bound = area.clearance_at(centres.reshape(-1, 3))
    assert (bound <= np.maximum(solid_depth(centres.reshape(-1, 3)), 0.0) + 1e-6).all()


def test_without_the_margin_a_wrong_pose_calls_solid_space_free() -> None:
    exact = image(camera("one"), BOXES, ROOM)
    believed = camera("one", np.array([0.3, 0.1, 0.1]))
    free = Outlook(believed, GRID, CameraErrors(0.0, 0.0, 0.0)).clearance(exact)
    called = common_area([free], GRID, 0.0, 0.0).moving > 0.0
    assert (solid_depth(GRID.centres()[called]) < 0.0).any()


def test_each_camera_is_reduced_before_both_are_united() -> None:
    ends = np.zeros(GRID.shape, dtype=np.float32)
    one, two = ends.copy(), ends.copy()
    one[:20], two[20:] = 1.0, 1.0  # each ends where the other begins
    x = np.arange(GRID.shape[0])[:, None, None] + 0.5
    one = np.minimum(one, np.maximum(20 - x, 0.0) * GRID.spacing).astype(np.float32)
    two = np.minimum(two, np.maximum(x - 20, 0.0) * GRID.spacing).astype(np.float32)
    together = common_area([one, two], GRID, 0.15, 0.0).moving
    assert (together[19:21] == 0.0).all()
    assert (together[10] > 0.0).any()
    assert (together[30] > 0.0).any()


@given(st.lists(st.floats(0.1, 9.0), min_size=1, max_size=20))
def test_ranges_only_become_shorter_and_what_is_no_range_stays(ranges: list[float]) -> None:
    row = np.array([[*ranges, math.nan, math.inf, -math.inf]])
    shortened = CameraErrors(0.0, 0.003, 0.0).shortened(DepthImage(1.0, row)).ranges
    assert shortened[0, : len(ranges)] == pytest.approx(
        row[0, : len(ranges)] - 0.003 * row[0, : len(ranges)] ** 2
    )
    assert np.array_equal(shortened[0, len(ranges) :], row[0, len(ranges) :], equal_nan=True)


def test_the_least_of_images_counts_what_stood_there_once() -> None:
    one = DepthImage(0.0, np.array([[3.0, math.nan, 2.0, math.nan, 0.0], [1.0] * 5]))
    two = DepthImage(1.0, np.array([[1.5, 4.0, 2.5, math.nan, math.inf], [2.0] * 5]))
    least = least_of([one, two], 5.0)
    assert least.stamp == 5.0
    assert np.array_equal(least.ranges, [[1.5, 4.0, 2.0, math.nan, math.nan], [1.0] * 5], equal_nan=True)


@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_errors_that_are_no_lengths_are_refused(value: float) -> None:
    with pytest.raises(InvalidInput, match="pose_accuracy"):
        CameraErrors(pose_accuracy=value)


def test_images_of_several_sizes_have_no_least() -> None:
    with pytest.raises(InvalidInput, match="same size"):
        least_of([DepthImage(0.0, np.ones((2, 3))), DepthImage(1.0, np.ones((3, 2)))], 0.0)
    with pytest.raises(InvalidInput, match="at least one"):
        least_of([], 0.0)
