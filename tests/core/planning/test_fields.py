"""The vector fields have the values of Ch. 3 and do not depend on how the map is turned."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.planning.fields import BoundaryBarrier, CircleBarrier, DiskBarrier, interval_field, pull_field
from snnav_core.types import FloatArray


@dataclass(frozen=True)
class Field:
    """A distance field from a function."""

    query: Callable[[FloatArray], tuple[FloatArray, FloatArray]]


CHAIN = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [5.0, 5.0]])
seeds = st.integers(0, 2**32 - 1)


def wall(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return distance and gradient of the half plane y > 0."""
    return points[:, 1].copy(), np.tile((0.0, 1.0), (len(points), 1))


def test_the_interval_field_is_that_of_two_springs_a_point() -> None:
    """Links 2, 1 and 5 long at L = 2: b = 0, -1 and 3/5; l_k leads from p_k to p_(k-1)."""
    expected = 0.5 * np.array(
        [
            [-1.0 * 0.0, 1.0 * -1.0],  # -b_2 l_2 with l_2 = (0, -1)
            [0.6 * 3.0, 1.0 + 0.6 * 4.0],  # b_2 l_2 - b_3 l_3 with l_3 = (-3, -4)
            [0.6 * -3.0, 0.6 * -4.0],
        ]
    )
    np.testing.assert_allclose(interval_field(CHAIN, 2.0, 0.5), expected, atol=1e-12)


def test_the_pull_has_one_size_towards_the_target() -> None:
    np.testing.assert_allclose(pull_field(np.array([1.0, 1.0]), np.array([4.0, 5.0]), 0.1), (0.06, 0.08))
    np.testing.assert_array_equal(pull_field(np.ones(2), np.ones(2), 0.1), 0.0)


def test_the_boundary_barrier_asks_each_point_for_its_own_margin() -> None:
    barrier = BoundaryBarrier(Field(wall), np.array([1.0, 1.5]))
    points = np.array([[0.0, 0.4], [1.0, 1.5], [2.0, -0.5], [3.0, 4.0]])
    depth, outward = barrier.violation(points)
    np.testing.assert_allclose(depth, [0.6, 0.0, 2.0, -2.5])
    np.testing.assert_array_equal(outward, np.tile((0.0, 1.0), (4, 1)))
    np.testing.assert_array_equal(barrier.demanded(1), [1.0])
    np.testing.assert_array_equal(barrier.demanded(4), [1.0, 1.5, 1.5, 1.5])


def test_the_circle_barrier_holds_for_the_first_points_only() -> None:
    barrier = CircleBarrier(np.array([0.0, 2.0]), 2.0, 2)
    depth, outward = barrier.violation(np.array([[0.0, 1.0], [3.0, 2.0], [0.0, 2.0]]))
    np.testing.assert_allclose(depth, [1.0, -1.0, -math.inf])
    np.testing.assert_allclose(outward[:2], [[0.0, -1.0], [1.0, 0.0]])


def test_the_disk_barrier_moves_with_the_other_robot_and_stays_at_its_end() -> None:
    barrier = DiskBarrier(np.array([[0.0, 0.0], [1.0, 0.0]]), np.array([1.2, 1.5]))
    depth, outward = barrier.violation(np.array([[0.0, 1.0], [1.0, -1.0], [3.0, 0.0], [1.0, 0.0]]))
    np.testing.assert_allclose(depth, [0.2, 0.5, -0.5, 1.5])
    np.testing.assert_allclose(outward[:3], [[0.0, 1.0], [0.0, -1.0], [1.0, 0.0]])
    assert np.isfinite(outward).all()


@given(seeds, st.floats(-math.pi, math.pi), st.integers(1, 12))
def test_the_fields_turn_with_the_map(seed: int, angle: float, links: int) -> None:
    generator = np.random.default_rng(seed)
    points, target, centre = (generator.normal(0.0, 2.0, shape) for shape in ((links + 1, 2), 2, 2))
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    shift = generator.normal(0.0, 5.0, 2)

    def moved(values: FloatArray) -> FloatArray:
        return values @ turn.T + shift

    plain, turned = interval_field(points, 0.7, 0.4), interval_field(moved(points), 0.7, 0.4)
    np.testing.assert_allclose(turned, plain @ turn.T, atol=1e-9)
    pull = pull_field(points[-1], target, 0.1)
    np.testing.assert_allclose(pull_field(moved(points)[-1], moved(target), 0.1), turn @ pull, atol=1e-9)
    for make in (lambda at: CircleBarrier(at, 1.5, links), lambda at: DiskBarrier(at[None], np.array([1.5]))):
        depth, outward = make(centre).violation(points[1:])
        depth_turned, outward_turned = make(moved(centre)).violation(moved(points[1:]))
        np.testing.assert_allclose(depth_turned, depth, atol=1e-9)
        np.testing.assert_allclose(outward_turned, outward @ turn.T, atol=1e-6)


@given(seeds, st.sampled_from((0.01, 0.2, 1.0)))
def test_what_the_boundary_barrier_remembers_never_hides_a_violation(seed: int, stride: float) -> None:
    generator = np.random.default_rng(seed)
    centre = np.array([0.3, -0.2])

    def disk(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        offset = points - centre
        distance = np.linalg.norm(offset, axis=1)
        return distance - 0.5, offset / distance[:, None]

    barrier = BoundaryBarrier(Field(disk), generator.uniform(0.2, 1.0, 5))
    points = generator.normal(0.0, 2.0, (8, 2))
    for _ in range(30):
        points = points + generator.normal(0.0, stride, points.shape)
        depth, outward = barrier.violation(points)
        distance, gradient = disk(points)
        true_depth = barrier.demanded(8) - distance
        np.testing.assert_array_equal(depth > 0.0, true_depth > 0.0)
        violating = true_depth > 0.0
        np.testing.assert_array_equal(depth[violating], true_depth[violating])
        np.testing.assert_array_equal(outward[violating], gradient[violating])


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_fields_take_points_of_the_plane_and_of_space(dimension: int) -> None:
    points = np.random.default_rng(0).normal(size=(6, dimension))
    assert interval_field(points, 1.0, 0.4).shape == (5, dimension)
    assert pull_field(points[-1], points[0], 0.1).shape == (dimension,)
    for barrier in (CircleBarrier(points[0], 1.0, 3), DiskBarrier(points[:2], np.ones(2))):
        depth, outward = barrier.violation(points)
        assert (depth.shape, outward.shape) == ((6,), (6, dimension))
