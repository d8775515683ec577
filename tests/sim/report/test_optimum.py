"""The exact shortest path against lengths computed by hand and against a plain visibility graph."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from snnav_core.errors import GoalBlocked, GoalUnreachable, StartBlocked
from snnav_sim.report.optimum import reduced, shortest_path

ROOM = shapely.box(0.0, 0.0, 10.0, 10.0)


def test_straight_ahead() -> None:
    length, points = shortest_path(ROOM, (1.0, 1.0), (9.0, 7.0))
    assert length == pytest.approx(10.0)
    assert points == pytest.approx(np.array([[1.0, 1.0], [9.0, 7.0]]))


def test_round_a_block() -> None:
    length, points = shortest_path(ROOM.difference(shapely.box(4, 2, 6, 9)), (1.0, 5.0), (9.0, 5.0))
    assert length == pytest.approx(2.0 + 2.0 * math.hypot(3.0, 3.0))
    assert points == pytest.approx(np.array([[1.0, 5.0], [4.0, 2.0], [6.0, 2.0], [9.0, 5.0]]))


def test_round_a_disk() -> None:
    """Two tangents and an arc: 2 sqrt(16 - 4) + 2 (pi - 2 arccos(1/2))."""
    region = ROOM.difference(shapely.Point(5, 5).buffer(2.0, quad_segs=64))
    length, _ = shortest_path(region, (1.0, 5.0), (9.0, 5.0))
    exact = 2.0 * math.sqrt(12.0) + 2.0 * (math.pi - 2.0 * math.acos(0.5))
    assert exact * 0.998 < length < exact * 1.0005


def test_round_a_corner_at_a_distance() -> None:
    """The reduction rounds the corner of a wall that ends at (5, 5): two tangents to a circle of 1 m and an arc."""
    wall = shapely.box(4.999, 5.0, 5.001, 10.0)
    length, _ = shortest_path(reduced(ROOM.difference(wall), 1.0), (2.0, 5.0), (8.0, 5.0))
    exact = 2.0 * math.sqrt(9.0 - 1.0) + (math.pi - 2.0 * math.acos(1.0 / 3.0))
    assert length == pytest.approx(exact, rel=2e-3)


def test_along_a_wall_and_through_a_corner() -> None:
    region = shapely.Polygon([(0, 0), (6, 0), (6, 2), (2, 2), (2, 6), (0, 6)])
    length, points = shortest_path(region, (6.0, 2.0), (2.0, 6.0))
    assert length == pytest.approx(8.0)
    assert points == pytest.approx(np.array([[6.0, 2.0], [2.0, 2.0], [2.0, 6.0]]))


def test_start_is_target() -> None:
    assert shortest_path(ROOM, (1.0, 1.0), (1.0, 1.0))[0] == 0.0


def test_typed_failures() -> None:
    parts = shapely.union_all([shapely.box(0, 0, 1, 1), shapely.box(2, 0, 3, 1)])
    with pytest.raises(StartBlocked, match=r"\(1.500, 0.500\)"):
        shortest_path(parts, (1.5, 0.5), (2.5, 0.5))
    with pytest.raises(GoalBlocked):
        shortest_path(parts, (0.5, 0.5), (1.5, 0.5))
    with pytest.raises(GoalUnreachable):
        shortest_path(parts, (0.5, 0.5), (2.5, 0.5))
    with pytest.raises(StartBlocked):
        shortest_path(shapely.Polygon(), (0.5, 0.5), (2.5, 0.5))


def plain_visibility_graph(
    region: shapely.Polygon, start: tuple[float, float], target: tuple[float, float]
) -> float:
    """Return the length by testing every pair of corners with shapely."""
    nodes = np.unique(np.vstack((shapely.get_coordinates(region), [start, target])), axis=0)
    wide = region.buffer(1e-7)
    weights = np.zeros((len(nodes), len(nodes)))
    for i, j in itertools.combinations(range(len(nodes)), 2):
        if wide.covers(shapely.LineString(nodes[[i, j]])):
            weights[i, j] = weights[j, i] = math.dist(nodes[i], nodes[j])
    ends = [int(np.argmin(np.hypot(*(nodes - end).T))) for end in (start, target)]
    return float(dijkstra(csr_array(weights), indices=ends[0])[ends[1]])


@given(
    st.lists(
        st.tuples(st.integers(1, 8), st.integers(1, 8), st.integers(1, 3), st.integers(1, 3)), max_size=6
    )
)
def test_against_a_plain_visibility_graph(boxes: list[tuple[int, int, int, int]]) -> None:
    """Boxes on a grid: many corners in one line and many walls that touch."""
    solids = [shapely.box(x, y, min(9.5, x + 0.9 * w), min(9.5, y + 0.9 * h)) for x, y, w, h in boxes]
    region = ROOM.difference(shapely.union_all(solids))
    start, target = (0.5, 0.5), (9.75, 9.6)
    if not isinstance(region, shapely.Polygon):
        return
    length, points = shortest_path(region, start, target)
    assert length == pytest.approx(plain_visibility_graph(region, start, target), abs=1e-6)
    assert region.buffer(1e-7).covers(shapely.LineString(points))
