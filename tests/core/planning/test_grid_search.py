"""A way from cell to cell is found whenever there is one, and keeps its distance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from snnav_core.area.cell_distance import distance_to_cells
from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_core.planning.flight_edges import NOBODY, clear_edges
from snnav_core.planning.grid_search import GridSearch
from snnav_core.types import FloatArray

GRID = Grid(np.zeros(3), 0.1, (40, 30, 20))
START, GOAL = np.array([0.65, 0.65, 0.65]), np.array([3.35, 2.35, 1.35])


def area_of(solid: np.ndarray) -> SpatialArea:
    walls = np.ones(np.array(GRID.shape) + 2, dtype=np.uint8)
    walls[1:-1, 1:-1, 1:-1] = 0
    static = distance_to_cells(walls, 0.1, 2.0)[0][1:-1, 1:-1, 1:-1].copy()
    return SpatialArea(0.0, GRID, distance_to_cells(solid, 0.1, 2.0)[0], static)


def wall(hole: slice | None) -> np.ndarray:
    solid = np.zeros(GRID.shape, dtype=np.uint8)
    solid[19:21] = 1
    if hole is not None:
        solid[19:21, hole, hole] = 0
    return solid


def search(area: SpatialArea, distance: float, spheres: FloatArray = NOBODY) -> GridSearch:
    return GridSearch(area, START, GOAL, distance, 0.0, 0.0, spheres)


@pytest.mark.parametrize(("distance", "found"), [(0.29, True), (0.36, False)])
def test_a_hole_of_seven_cells_is_passed_up_to_its_width(distance: float, found: bool) -> None:
    area = area_of(wall(slice(6, 13)))
    way = search(area, distance).way()
    assert search(area, distance).is_connected() == found == (way is not None)
    if way is not None:
        np.testing.assert_array_equal(way[[0, -1]], (START, GOAL))
        assert clear_edges(area, way[:-1], way[1:], distance - 0.02, 0.0).all()


def test_a_sphere_in_the_hole_closes_it() -> None:
    area = area_of(wall(slice(6, 13)))
    assert search(area, 0.29, np.array([[2.0, 0.95, 0.95, 0.3]])).way() is None
    assert search(area, 0.29, np.array([[2.0, 2.5, 0.95, 0.3]])).way() is not None


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 100_000))
def test_what_is_found_agrees_with_the_components(seed: int) -> None:
    rng = np.random.default_rng(seed)
    solid = np.zeros(GRID.shape, dtype=np.uint8)
    for x, y, z in rng.integers((0, 0, 0), GRID.shape, (9, 3)):
        solid[x : x + 9, y : y + 9, z : z + 14] = 1
    area = area_of(solid)
    ends = np.array([area.clearance_at(point[None])[0] for point in (START, GOAL)])
    if ends.min() < 0.25:
        return
    labels, _ = ndimage.label(area.reduced(0.2), np.ones((3, 3, 3)))
    at = [int(labels[tuple(np.floor(point / 0.1).astype(int))]) for point in (START, GOAL)]
    way = search(area, 0.2).way()
    assert (way is not None) == (at[0] == at[1] > 0)
    if way is not None:
        assert clear_edges(area, way[:-1], way[1:], 0.17, 0.0).all()
