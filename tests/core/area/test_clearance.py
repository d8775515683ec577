"""The clearance field is the exact signed distance to the boundary, whatever the rings and wherever the point."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import MultiPolygon

from snnav_core.area.clearance import ClearanceField, nearby_boundary, nearest_of
from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.types import FloatArray

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])

seeds = st.integers(0, 2**32 - 1)
boxes = st.lists(
    st.tuples(st.integers(0, 8), st.integers(0, 8), st.integers(1, 4), st.integers(1, 4)),
    min_size=1,
    max_size=6,
)


def true_clearance(region: MultiPolygon, points: FloatArray) -> FloatArray:
    distance = shapely.distance(shapely.points(points), region.boundary)
    return np.where(shapely.intersects_xy(region, points[:, 0], points[:, 1]), distance, -distance)


def field_of(region: MultiPolygon) -> ClearanceField:
    return UnoccupiedArea(0.0, region).clearance_field


@given(seeds, st.sampled_from((0.0, 0.4, 0.9)))
def test_the_distance_is_that_of_shapely(
    random_region: Callable[[int, float], MultiPolygon], seed: int, roughness: float
) -> None:
    region = random_region(seed, roughness)
    generator = np.random.default_rng(seed)
    near = shapely.get_coordinates(region.boundary) + generator.normal(0.0, 1e-3, (1, 2))
    points = np.vstack((generator.uniform(-20.0, 20.0, (200, 2)), near))
    distance, gradient = field_of(region).query(points)
    np.testing.assert_allclose(distance, true_clearance(region, points), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(gradient, axis=1), 1.0, atol=1e-9)


@given(boxes, boxes)
def test_shared_corners_and_touching_holes_do_not_change_the_distance(
    pieces: list[tuple[int, int, int, int]], holes: list[tuple[int, int, int, int]]
) -> None:
    """Boxes on a grid touch each other in corners and along edges."""

    def union(rows: list[tuple[int, int, int, int]]) -> shapely.Geometry:
        return shapely.union_all([shapely.box(x, y, x + w, y + h) for x, y, w, h in rows])

    region = as_multipolygon(shapely.difference(union(pieces), union(holes)))
    lattice = np.stack(np.meshgrid(np.arange(-1.0, 14.0, 0.5), np.arange(-1.0, 14.0, 0.5)), axis=-1).reshape(
        -1, 2
    )
    points = np.vstack((lattice, np.random.default_rng(0).uniform(-1.0, 14.0, (300, 2))))
    distance, _ = field_of(region).query(points)
    expected = np.full(len(points), -np.inf) if region.is_empty else true_clearance(region, points)
    np.testing.assert_allclose(distance, expected, rtol=0.0, atol=1e-9)


@given(seeds)
def test_the_gradient_is_that_of_the_distance(
    random_region: Callable[[int, float], MultiPolygon], seed: int
) -> None:
    field = field_of(random_region(seed, 0.4))
    points = np.random.default_rng(seed).uniform(-12.0, 12.0, (200, 2))
    step = 1e-6
    distance, gradient = field.query(points)
    numeric = np.empty_like(points)
    for axis in range(2):
        shift = np.eye(2)[axis] * step
        numeric[:, axis] = (field.query(points + shift)[0] - field.query(points - shift)[0]) / (2.0 * step)
    # On the medial axis two boundary points are equally near and there is no gradient.
    smooth = (np.linalg.norm(numeric, axis=1) > 1.0 - 1e-6) & (np.abs(distance) > 0.01)
    assert smooth.mean() > 0.9
    np.testing.assert_allclose(gradient[smooth], numeric[smooth], atol=1e-3)


@given(seeds)
def test_on_the_boundary_itself_the_gradient_leads_inside(
    random_region: Callable[[int, float], MultiPolygon], seed: int
) -> None:
    area = UnoccupiedArea(0.0, random_region(seed, 0.4))
    for ring in area.rings:
        middle = 0.5 * (ring + np.roll(ring, -1, axis=0))
        long = np.linalg.norm(ring - np.roll(ring, -1, axis=0), axis=1) > 0.01
        distance, gradient = area.clearance_field.query(middle)
        np.testing.assert_allclose(distance, 0.0, atol=1e-9)
        inside = area.clearance((middle + 1e-6 * gradient)[long])
        np.testing.assert_allclose(inside, 1e-6, atol=1e-9)


@given(seeds, st.floats(0.0, 5.0))
def test_a_limit_changes_nothing_below_it(
    random_region: Callable[[int, float], MultiPolygon], seed: int, limit: float
) -> None:
    field = field_of(random_region(seed, 0.4))
    points = np.random.default_rng(seed).uniform(-20.0, 20.0, (200, 2))
    full, full_gradient = field.query(points)
    limited, gradient = field.query(points, limit)
    below = np.abs(full) < limit
    np.testing.assert_array_equal(limited[below], full[below])
    np.testing.assert_array_equal(gradient[below], full_gradient[below])
    np.testing.assert_array_equal(limited[~below], limit)
    np.testing.assert_array_equal(gradient[~below], 0.0)


@pytest.mark.parametrize("rings", [[], [np.empty((0, 2))], [np.ones((3, 2))]])
def test_in_an_empty_area_every_point_is_infinitely_far_outside(rings: list[FloatArray]) -> None:
    field = ClearanceField(rings)
    distance, gradient = field.query(np.array([[0.0, 0.0], [5.0, -1.0]]))
    assert field.is_empty
    assert field.segment_count == 0
    np.testing.assert_array_equal(distance, -np.inf)
    np.testing.assert_array_equal(gradient, 0.0)


def test_repeated_points_of_a_ring_are_ignored() -> None:
    doubled = np.repeat(np.vstack((SQUARE, SQUARE[:1])), 2, axis=0)
    points = np.random.default_rng(1).uniform(-3.0, 13.0, (100, 2))
    field = ClearanceField([doubled])
    assert field.segment_count == 4
    np.testing.assert_array_equal(field.query(points)[0], ClearanceField([SQUARE]).query(points)[0])


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, -1e9])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_point_that_is_no_place_is_never_free(value: float, axis: int) -> None:
    point = np.array([[5.0, 5.0]])
    point[0, axis] = value
    distance, gradient = ClearanceField([SQUARE]).query(np.vstack((point, [[5.0, 4.0]])))
    assert distance.tolist() == [-math.inf, 4.0]
    np.testing.assert_array_equal(gradient[0], 0.0)


def test_points_far_outside_are_found_at_once() -> None:
    field = ClearanceField([SQUARE])
    field.query(np.zeros((1, 2)))
    far = 10.0 ** np.arange(2, 8)
    points = np.vstack([np.column_stack((x * far, y * far)) for x, y in ((1, 1), (-1, 1), (0, -1), (1, 0.3))])
    begin = time.perf_counter()
    distance, _ = field.query(points)
    assert time.perf_counter() - begin < 0.5, (
        "24 points; took 0.35 s each before bins outside the grid were skipped"
    )
    expected = np.hypot(*(points - np.clip(points, 0.0, 10.0)).T)
    np.testing.assert_allclose(distance, -expected, rtol=1e-9)


def test_a_large_area_with_small_details_is_exact() -> None:
    """Bins grow with the area; many segments share one."""
    angle = np.linspace(0.0, 2.0 * math.pi, 400, endpoint=False)
    unit = np.column_stack((np.cos(angle), np.sin(angle)))
    region = MultiPolygon([shapely.Polygon(3000.0 * unit, [[5.0, 5.0] + 0.1 * unit, -1000.0 + 20.0 * unit])])
    points = np.random.default_rng(2).uniform(-2500.0, 2500.0, (300, 2))
    points[:150] = 5.0 + np.random.default_rng(3).uniform(-2.0, 2.0, (150, 2))
    np.testing.assert_allclose(field_of(region).query(points)[0], true_clearance(region, points), atol=1e-7)


def sector(begin: float, end: float, radius: float) -> shapely.Polygon:
    angle = np.linspace(begin, end, 20)
    return shapely.Polygon(
        [(1.0, 2.0), *np.column_stack((1.0 + radius * np.cos(angle), 2.0 + radius * np.sin(angle)))]
    )


@given(st.lists(st.integers(1, 40), min_size=3, max_size=12), st.integers(0, 359), st.booleans())
def test_holes_and_sectors_that_meet_at_a_scanner_have_the_right_side(
    widths: list[int], turned: int, holes: bool
) -> None:
    """Their corners touch in one vertex, and what lies behind it is as near to all of them."""
    bounds = np.radians(turned + np.concatenate(([0], np.cumsum(widths))))
    bounds = bounds[bounds <= bounds[0] + math.radians(175.0)]
    pairs = list(zip(bounds[1::2], bounds[2::2], strict=False))
    region = shapely.union_all([sector(*pair, 3.0) for pair in pairs])
    if holes:
        region = shapely.difference(sector(bounds[0], bounds[-1] + 0.01, 5.0), region)
    behind = bounds[:, None] + np.radians(np.arange(60, 301, 5))
    points = np.array([1.0, 2.0]) + 2.5 * np.stack((np.cos(behind), np.sin(behind)), axis=-1).reshape(-1, 2)
    region = as_multipolygon(region)
    np.testing.assert_allclose(
        field_of(region).query(points)[0], true_clearance(region, points), rtol=0.0, atol=1e-9
    )


@given(seeds, st.sampled_from((0.0, 0.4, 0.9)), st.floats(0.01, 0.5))
def test_while_a_point_moves_little_the_segments_near_it_are_all_that_counts(
    random_region: Callable[[int, float], MultiPolygon], seed: int, roughness: float, slack: float
) -> None:
    generator = np.random.default_rng(seed)
    field = field_of(random_region(seed, roughness))
    starts, ends, normals_start, normals_end, *bins = field.arrays
    found, gathered = np.empty(12, dtype=np.int64), 0
    for place in generator.uniform(-12.0, 12.0, (40, 2)):
        count = nearby_boundary(*place, slack, found, starts, ends, *bins)
        if count < 0:
            continue
        gathered += 1
        way = generator.normal(0.0, 1.0, (20, 2))
        way *= (0.5 * slack * generator.uniform(0.0, 1.0, 20) / np.linalg.norm(way, axis=1))[:, None]
        expected, gradient = field.query(place + way)
        for point, distance, direction in zip(place + way, expected, gradient, strict=True):
            near = nearest_of(*point, found, count, starts, ends, normals_start, normals_end)
            assert near == (
                pytest.approx(distance, abs=1e-12),
                *(pytest.approx(d, abs=1e-6) for d in direction),
            )
    assert gathered or slack > 0.1, "most places have few segments near them"


def test_segments_are_not_gathered_where_there_are_too_many() -> None:
    angles = np.linspace(0.0, 2.0 * math.pi, 100, endpoint=False)
    field = ClearanceField([5.0 * np.column_stack((np.cos(angles), np.sin(angles)))])
    starts, ends, _, _, *bins = field.arrays
    found = np.empty(12, dtype=np.int64)
    assert nearby_boundary(0.0, 0.0, 0.1, found, starts, ends, *bins) == -1
    assert 0 < nearby_boundary(4.5, 0.0, 0.1, found, starts, ends, *bins) <= 12
    assert nearby_boundary(math.nan, 0.0, 0.1, found, starts, ends, *bins) == -1
