"""What is seen along straight lines in a reduced area agrees with shapely, also through corners and along edges."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import MultiPolygon, Polygon

from snnav_core.planning import curves as curves_module
from snnav_core.planning.curves import AreaCurves

RegionMaker = Callable[[int, float], MultiPolygon]
ROOM = shapely.box(-5.0, -10.0, 25.0, 10.0)
DIAMOND = Polygon([(8.0, 0.0), (10.0, -2.0), (12.0, 0.0), (10.0, 2.0)])

seeds = st.integers(0, 2**32 - 1)


def largest(region: MultiPolygon) -> Polygon:
    return max(region.geoms, key=shapely.area)


def points_in(polygon: Polygon, generator: np.random.Generator, count: int) -> np.ndarray:
    low, high = np.array(polygon.bounds).reshape(2, 2)
    points = generator.uniform(low, high, (60 * count, 2))
    return points[shapely.contains_xy(polygon, points[:, 0], points[:, 1])][:count]


def hit(curves: AreaCurves, source: tuple[float, float], target: tuple[float, float]) -> float:
    share, edge = curves.first_hits(np.array([source]), np.array([target]))
    assert (edge[0] >= 0) == math.isfinite(share[0])
    return float(share[0])


@given(seeds)
def test_the_first_hit_is_where_the_segment_leaves_the_area(random_region: RegionMaker, seed: int) -> None:
    polygon = largest(random_region(seed, 0.4))
    curves = AreaCurves(polygon)
    inside = points_in(polygon, np.random.default_rng(seed), 60)
    sources, targets = inside[::2], inside[1::2]
    sources = sources[: len(targets)]
    share, edge = curves.first_hits(sources, targets)
    for i, (source, target) in enumerate(zip(sources, targets, strict=True)):
        line = shapely.LineString([source, target])
        assert math.isinf(share[i]) == polygon.covers(line)
        if math.isfinite(share[i]):
            at = source + share[i] * (target - source)
            assert polygon.covers(shapely.LineString([source, source + 0.999999 * (at - source)]))
            edge_line = shapely.LineString([curves.starts[edge[i]], curves.ends[edge[i]]])
            assert edge_line.distance(shapely.Point(at)) < 1e-9


def test_a_line_through_two_opposite_corners_of_an_obstacle_is_blocked_and_along_an_edge_is_not() -> None:
    curves = AreaCurves(ROOM.difference(DIAMOND))
    assert hit(curves, (0.0, 0.0), (20.0, 0.0)) == pytest.approx(0.4)
    assert hit(curves, (20.0, 0.0), (0.0, 0.0)) == pytest.approx(0.4)
    assert hit(curves, (0.0, 0.0), (12.0, 0.0)) == pytest.approx(8.0 / 12.0)
    assert math.isinf(hit(curves, (0.0, 0.0), (8.0, 0.0))), "up to the corner"
    assert math.isinf(hit(curves, (0.0, 2.0), (20.0, 2.0))), "touching one corner"
    assert math.isinf(hit(curves, (6.0, 2.0), (12.0, -4.0))), "along one edge"
    box = AreaCurves(ROOM.difference(shapely.box(8.0, -2.0, 12.0, 2.0)))
    assert math.isinf(hit(box, (0.0, 2.0), (20.0, 2.0)))
    assert hit(box, (6.0, -4.0), (14.0, 4.0)) == pytest.approx(0.25), "through its diagonal"
    stairs = AreaCurves(Polygon([(0, 0), (9, 0), (9, 9), (6, 9), (6, 5), (3, 5), (3, 9), (0, 9)]))
    assert math.isinf(hit(stairs, (1.0, 5.0), (8.0, 5.0)))
    step = AreaCurves(Polygon([(0, 0), (9, 0), (9, 5), (6, 5), (6, 9), (0, 9)]))
    assert math.isinf(hit(step, (1.0, 5.0), (9.0, 5.0))), "the edge is part of the area"
    crossed = AreaCurves(
        Polygon([(0, 0), (4, 0), (4, 5), (6, 5), (6, 0), (9, 0), (9, 9), (6, 9), (6, 5.5), (0, 5.5)])
    )
    assert math.isinf(hit(crossed, (2.0, 5.0), (8.0, 5.0)))
    wall = AreaCurves(Polygon([(0, 0), (9, 0), (9, 9), (6, 9), (6, 5), (3, 5), (3, 0.5), (0, 0.5)]))
    assert hit(wall, (8.0, 5.0), (1.0, 5.0)) == pytest.approx(2.0 / 7.0), "along an edge, and out behind it"


@settings(max_examples=25)
@given(seeds)
def test_bitangents_are_the_free_lines_that_touch_both_corners(random_region: RegionMaker, seed: int) -> None:
    polygon = largest(random_region(seed, 0.4))
    curves = AreaCurves(polygon)
    rows, columns, lengths = curves.tangents
    corners = curves.starts[curves.corners]
    lines = shapely.linestrings(np.stack((corners[rows], corners[columns]), axis=1))
    np.testing.assert_allclose(lengths, shapely.length(lines))
    assert shapely.covers(polygon.buffer(1e-7, join_style="mitre"), lines).all()
    found = set(zip(rows.tolist(), columns.tolist(), strict=True))
    touches = curves.touches_corner(corners)
    for i in range(len(corners)):
        for j in range(i + 1, len(corners)):
            line = shapely.LineString([corners[i], corners[j]])
            free = polygon.buffer(-1e-7).disjoint(line) or polygon.covers(line)
            if (i, j) not in found and touches[i, j] and touches[j, i]:
                assert not free or not polygon.covers(line)


@given(seeds)
def test_the_boundary_is_walked_with_the_free_side_on_the_left(random_region: RegionMaker, seed: int) -> None:
    polygon = largest(random_region(seed, 0.4))
    curves = AreaCurves(polygon)
    along = curves.ends - curves.starts
    length = np.linalg.norm(along, axis=1, keepdims=True)
    left = np.column_stack((-along[:, 1], along[:, 0])) / length
    beside = 0.5 * (curves.starts + curves.ends) + 1e-6 * left
    long = length[:, 0] > 1e-3
    assert shapely.contains_xy(polygon, beside[long, 0], beside[long, 1]).all()
    for edge in range(len(curves.starts)):
        curve, index = curves.locate(edge)
        np.testing.assert_array_equal(curves.rings[curve][index], curves.starts[edge])
    np.testing.assert_array_equal(curves.rings[0], np.array(curves.polygon.exterior.coords)[:-1])


def test_the_nearest_point_lies_in_the_component() -> None:
    curves = AreaCurves(ROOM.difference(DIAMOND))
    np.testing.assert_allclose(curves.nearest(np.array([30.0, 3.0])), (25.0, 3.0))
    np.testing.assert_allclose(curves.nearest(np.array([1.0, 3.0])), (1.0, 3.0))
    assert curves.covers(np.array([25.0, 3.0]))
    assert not curves.covers(np.array([10.0, 0.0]))


def test_a_convex_room_has_no_corners_to_bend_around() -> None:
    curves = AreaCurves(ROOM)
    assert len(curves.corners) == 0
    assert all(len(part) == 0 for part in curves.tangents)
    assert curves.touches_corner(np.zeros((2, 2))).shape == (2, 0)


def test_edges_in_line_do_not_hide_what_stands_between_them() -> None:
    """Two passages flush with a wall, a box against the wall between them: the way leads around the box."""
    hall = shapely.union_all([shapely.box(0, 0, 10, 6), shapely.box(0, -5, 2, 0), shapely.box(8, -5, 10, 0)])
    curves = AreaCurves(hall.difference(shapely.box(4, 0, 6, 2)))
    corners = curves.starts[curves.corners].tolist()
    left, right = corners.index([2.0, 0.0]), corners.index([8.0, 0.0])
    rows, columns, _ = curves.tangents
    assert (min(left, right), max(left, right)) not in set(zip(rows.tolist(), columns.tolist(), strict=True))
    assert math.isfinite(hit(curves, (2.0, 0.0), (8.0, 0.0)))
    assert math.isfinite(hit(curves, (1.0, 0.0), (9.0, 0.0)))
    assert math.isinf(hit(curves, (1.0, 0.0), (4.0, 0.0)))


def test_tangents_worked_out_on_two_threads_are_those_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    generator = np.random.default_rng(5)
    disks = shapely.buffer(
        shapely.points(generator.uniform((-4.0, -9.0), (24.0, 9.0), (40, 2))), 0.5, quad_segs=4
    )
    polygon = largest(MultiPolygon([shapely.difference(ROOM, shapely.union_all(disks))]))
    together = AreaCurves(polygon).tangents
    assert len(AreaCurves(polygon).corners) >= curves_module._MANY_CORNERS
    monkeypatch.setattr(curves_module, "_MANY_CORNERS", 10**9)
    alone = AreaCurves(polygon).tangents
    assert len(alone[0]) > 100
    for one, other in zip(together, alone, strict=True):
        assert np.array_equal(one, other)
