"""Clearances between the centres of cells: never too much, and exact beside a corner."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_core.types import FloatArray

GRID = Grid(np.array([-1.0, 0.5, 0.0]), 0.1, (12, 10, 8))


def field(bodies: FloatArray) -> FloatArray:
    away, _ = cKDTree(bodies).query(GRID.centres())
    return np.asarray(away)


@given(st.integers(0, 100_000), st.integers(1, 12), st.floats(0.0, 0.3))
def test_the_bound_is_below_the_distance_to_any_bodies(seed: int, count: int, growth: float) -> None:
    rng = np.random.default_rng(seed)
    bodies, walls = (rng.uniform(GRID.origin - 0.5, GRID.high + 0.5, (count, 3)) for _ in range(2))
    lost = rng.uniform(0.0, 0.2, GRID.shape) * rng.integers(
        0, 2
    )  # what is remembered is often less than true
    moving = np.maximum(field(bodies) - lost, 0.0).astype(np.float32)
    area = SpatialArea(0.0, GRID, moving, field(walls).astype(np.float32))
    points = rng.uniform(GRID.origin, GRID.high, (500, 3))
    true = np.minimum(cKDTree(bodies).query(points)[0] - growth, cKDTree(walls).query(points)[0])
    assert (area.clearance_at(points, growth) <= np.maximum(true, 0.0) + 1e-5).all()


@given(st.integers(0, 100_000))
def test_beside_a_single_corner_the_bound_is_exact(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corner = rng.uniform(GRID.origin - 0.5, GRID.high + 0.5, (1, 3))
    area = SpatialArea(
        0.0, GRID, field(corner).astype(np.float32), np.full(GRID.shape, 9.0, dtype=np.float32)
    )
    points = rng.uniform(GRID.origin + 0.05, GRID.high - 0.05, (300, 3))
    np.testing.assert_allclose(area.clearance_at(points), np.linalg.norm(points - corner, axis=1), atol=1e-3)
