"""Distances of segments to the boundary are exact, with a bound and without."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import MultiPolygon

from snnav_core.planning.boundary_index import BoundaryIndex
from support.certificates import box_at, hall_without, random_area, random_path


def test_the_distance_of_segments_is_exact_and_zero_outside() -> None:
    region = hall_without(box_at(3.0, 3.0))
    starts = np.array([[0, 0], [3, 0], [2, 3], [50, 0], [1, 1], [3, 3]], dtype=np.float64)
    ends = np.array([[1, 0], [3, 2], [4, 3], [51, 0], [1, 1], [3, 3.1]], dtype=np.float64)
    segments = np.stack((starts, ends), axis=1)
    expected = shapely.distance(shapely.linestrings(segments), region.boundary)
    expected[[3, 5]] = 0.0
    np.testing.assert_allclose(BoundaryIndex(region).distances(segments), expected, atol=1e-8)
    assert BoundaryIndex(region).distances(np.empty((0, 2, 2))).shape == (0,)
    np.testing.assert_array_equal(BoundaryIndex(MultiPolygon()).distances(segments), 0.0)


@given(st.integers(0, 2**32 - 1), st.floats(0.05, 2.0))
def test_distances_up_to_a_bound_are_those_without_one(seed: int, enough: float) -> None:
    generator = np.random.default_rng(seed)
    points = random_path(generator, 30) + generator.uniform(-42.0, 42.0, 2) * (seed % 3 == 0)
    index = BoundaryIndex(random_area(generator, points, -1.0 if seed % 2 else 0.2))
    segments = np.stack((points[:-1], points[1:]), axis=1)
    bounds = enough * generator.uniform(0.2, 1.0, len(segments))
    exact, bounded = index.distances(segments), index.distances_below(segments, bounds)
    near = exact <= bounds
    np.testing.assert_array_equal(bounded[near], exact[near])
    assert np.isinf(bounded[exact > bounds + 1e-9]).all()
    if (exact > 0.0).all():
        assert index.least_distance(points) == pytest.approx(exact.min(), abs=1e-9)
