"""The complete search finds the shortest way of a brute-force visibility graph, and leaves along the heading."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import shortest_path
from shapely.geometry import MultiPolygon, Polygon

from snnav_core.planning.curves import AreaCurves
from snnav_core.planning.shortest import GoalTree, InitialCircle, initial_circles
from snnav_core.types import FloatArray, Pose2D

RegionMaker = Callable[[int, float], MultiPolygon]
seeds = st.integers(0, 2**32 - 1)
headings = st.floats(-math.pi, math.pi)


def visibility_distances(polygon: Polygon, points: FloatArray) -> FloatArray:
    """Return the shortest distances between points inside a polygon, over all its vertices, by brute force."""
    nodes = np.vstack((points, shapely.get_coordinates(polygon)))
    rows, columns = np.triu_indices(len(nodes), 1)
    widened = polygon.buffer(1e-9, join_style="mitre")
    shapely.prepare(widened)
    lines = shapely.linestrings(np.stack((nodes[rows], nodes[columns]), axis=1))
    free = shapely.covers(widened, lines)
    weight = np.zeros((len(nodes), len(nodes)))
    weight[rows[free], columns[free]] = np.maximum(shapely.length(lines[free]), 1e-12)
    return np.asarray(shortest_path(weight, directed=False))[: len(points), : len(points)]


def inside(polygon: Polygon, generator: np.random.Generator, count: int) -> FloatArray:
    low, high = np.array(polygon.bounds).reshape(2, 2)
    points = generator.uniform(low, high, (400, 2))
    return points[shapely.contains_xy(polygon, points[:, 0], points[:, 1])][:count]


def length_of(chain: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum())


@settings(max_examples=15)
@given(seeds, st.booleans())
def test_the_shortest_way_from_any_point_is_that_of_the_visibility_graph(
    random_region: RegionMaker, seed: int, on_grid: bool
) -> None:
    """On a grid many corners are in line with each other."""
    polygon = max(random_region(seed, 0.4).geoms, key=shapely.area)
    generator = np.random.default_rng(seed)
    points = inside(polygon, generator, 6)
    if on_grid:
        corners = generator.integers(-3, 3, (8, 2))
        boxes = [
            shapely.box(x, y, x + w, y + h)
            for (x, y), (w, h) in zip(corners, generator.integers(1, 3, (8, 2)), strict=True)
        ]
        room = shapely.box(-5, -5, 6, 6).difference(shapely.union_all(boxes))
        polygon = max(shapely.get_parts(room), key=shapely.area)
        points = np.array([[-4.0, 0.0], [5.0, 0.0], [5.0, 5.0], [-4.0, -4.0], [0.0, 5.0], [0.0, -4.0]])
    expected = visibility_distances(polygon, points)
    tree = GoalTree(AreaCurves(polygon), points[0])
    for point, distance in zip(points[1:], expected[0, 1:], strict=True):
        chain = tree.from_point(point)
        assert chain is not None
        np.testing.assert_array_equal(chain[0], point)
        np.testing.assert_array_equal(chain[-1], points[0])
        assert length_of(chain) == pytest.approx(distance, abs=1e-6)
        assert polygon.buffer(1e-6).covers(shapely.LineString(chain))


def test_there_is_no_way_to_a_point_that_nothing_is_seen_from() -> None:
    tree = GoalTree(AreaCurves(shapely.box(0, 0, 4, 4)), np.array([1.0, 1.0]))
    assert tree.from_point(np.array([9.0, 1.0])) is None


@given(seeds, headings, st.floats(0.05, 3.0))
def test_the_initial_circles_touch_the_heading_at_the_robot(seed: int, heading: float, radius: float) -> None:
    x, y = np.random.default_rng(seed).normal(0.0, 5.0, 2)
    pose = Pose2D(float(x), float(y), heading)
    for circle, rotation in zip(initial_circles(pose, radius), (1, -1), strict=True):
        assert circle.rotation == rotation
        arc = circle.arc(1.0, 0.01)
        np.testing.assert_allclose(arc[0], (x, y), atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(arc - circle.centre, axis=1), radius)
        across = math.cos(heading) * (circle.centre[1] - y) - math.sin(heading) * (circle.centre[0] - x)
        assert across == pytest.approx(rotation * radius), "left circle first"
        first = arc[1] - arc[0]
        off = math.remainder(math.atan2(first[1], first[0]) - heading, 2.0 * math.pi)
        assert abs(off) <= 0.51 * 0.01 / radius + 1e-9
        assert off * rotation > 0.0


@given(seeds, headings, st.floats(0.05, 3.0))
def test_a_departure_leaves_the_circle_along_its_tangent_in_the_driving_direction(
    seed: int, heading: float, radius: float
) -> None:
    targets = np.random.default_rng(seed).normal(0.0, 5.0, (20, 2))
    for circle in initial_circles(Pose2D(0.3, -0.2, heading), radius):
        angle, points, straight = circle.departures(targets)
        outside = np.linalg.norm(targets - circle.centre, axis=1) > radius
        np.testing.assert_array_equal(np.isfinite(angle), outside)
        for index in np.flatnonzero(outside):
            assert 0.0 <= angle[index] < 2.0 * math.pi
            arc = circle.arc(float(angle[index]), 0.02)
            np.testing.assert_allclose(arc[-1], points[index], atol=1e-6 * radius)
            way = targets[index] - points[index]
            assert np.linalg.norm(way) == pytest.approx(straight[index], abs=1e-6)
            radial = points[index] - circle.centre
            driving = circle.rotation * np.array([-radial[1], radial[0]])
            assert abs(radial @ way) < 1e-6 * max(1.0, straight[index])
            assert driving @ way >= -1e-9


def test_a_robot_that_heads_for_the_target_does_not_turn_once_around() -> None:
    for circle in initial_circles(Pose2D(0.0, 0.0, 0.0), 1.0):
        angle, points, _ = circle.departures(np.array([[7.0, 0.0], [7.0, 1e-9], [7.0, -1e-9]]))
        np.testing.assert_allclose(angle, 0.0, atol=1e-6)
        np.testing.assert_allclose(points, 0.0, atol=1e-6)


@settings(max_examples=20)
@given(seeds, headings)
def test_the_ways_off_a_circle_are_free_and_come_shortest_first(
    random_region: RegionMaker, seed: int, heading: float
) -> None:
    polygon = max(random_region(seed, 0.4).geoms, key=shapely.area)
    start, target = inside(polygon, np.random.default_rng(seed), 2)
    tree = GoalTree(AreaCurves(polygon), target)
    assume(float(np.linalg.norm(start - target)) > 1.0)
    direct = tree.from_point(start)
    assert direct is not None
    shortest = []
    for circle in initial_circles(Pose2D(*start.tolist(), heading), 0.02):
        lengths = []
        for length, angle, chain in tree.options(circle, 0.0):
            lengths.append(length)
            assert length == pytest.approx(circle.radius * angle + length_of(chain), abs=1e-6)
            np.testing.assert_array_equal(chain[-1], target)
            assert length >= length_of(direct) - 1e-9
            assert_free(polygon, circle, chain)
        assert lengths == sorted(lengths)
        shortest.extend(lengths[:1])
    # Circles of 2 cm cost little: half a turn on them, or a corner nearer than that.
    if (
        polygon.exterior.distance(shapely.Point(start)) > 0.05
        and polygon.boundary.distance(shapely.Point(start)) > 0.05
    ):
        assert min(shortest) <= length_of(direct) + 2.0 * math.pi * 0.02


def assert_free(polygon: Polygon, circle: InitialCircle, chain: FloatArray) -> None:
    """The straight parts stay inside; the first starts on the circle, which need not."""
    line = shapely.LineString(chain)
    if polygon.covers(shapely.Point(chain[0])):
        assert line.difference(polygon.buffer(1e-6)).length < 1e-6
    assert np.linalg.norm(chain[0] - circle.centre) == pytest.approx(circle.radius)
