"""Distances to solid cells are exact, and the nearest cell is one that has this distance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.area import cell_distance
from snnav_core.area.cell_distance import distance_to_cells


@settings(max_examples=60, deadline=None)
@given(
    st.tuples(*[st.integers(1, 9)] * 3),
    st.integers(0, 2**32 - 1),
    st.floats(0.0, 0.2),
    st.floats(0.05, 1.5),
)
def test_against_all_pairs(shape: tuple[int, int, int], seed: int, share: float, reach: float) -> None:
    solid = (np.random.default_rng(seed).random(shape) < share).astype(np.uint8)
    distance, nearest = distance_to_cells(solid, 0.1, reach)
    centres = np.argwhere(np.ones(shape, dtype=bool))
    cells = np.argwhere(solid)
    apart = np.abs(centres[:, None] - cells[None]).astype(float)
    away = 0.1 * np.linalg.norm(np.where(apart > 0, apart - 0.5, 0.0), axis=-1)
    expected = np.minimum(away.min(axis=1, initial=np.inf), reach)
    np.testing.assert_allclose(distance.ravel(), expected, atol=1e-6)
    found = np.flatnonzero(nearest.ravel() >= 0)
    assert solid.ravel()[nearest.ravel()[found]].all()
    index = np.array(np.unravel_index(nearest.ravel()[found], shape)).T
    apart = np.abs(centres[found] - index).astype(float)
    away = 0.1 * np.linalg.norm(np.where(apart > 0, apart - 0.5, 0.0), axis=-1)
    np.testing.assert_allclose(away, expected[found], atol=1e-6)
    assert (expected[nearest.ravel() < 0] >= reach - 1e-6).all()


def test_two_threads_find_what_one_finds(monkeypatch: pytest.MonkeyPatch) -> None:
    solid = (np.random.default_rng(3).random((90, 70, 50)) < 0.002).astype(np.uint8)
    assert solid.size > cell_distance._MANY
    shared = cell_distance.distance_to_cells(solid, 0.1, 0.9)
    monkeypatch.setattr(cell_distance, "_MANY", solid.size + 1)
    for one, other in zip(shared, cell_distance.distance_to_cells(solid, 0.1, 0.9), strict=True):
        np.testing.assert_array_equal(one, other)
