"""Reductions never add free space, and rings carry an area without loss."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import LineString, MultiPolygon, Point, Polygon

from snnav_core.area.planar import (
    UnoccupiedArea,
    as_multipolygon,
    component_at,
    grow,
    reduce_area,
    remove_disks,
    shrink,
)
from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray

RegionMaker = Callable[[int, float], MultiPolygon]
SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
HOLE = np.array([[4.0, 4.0], [4.0, 6.0], [6.0, 6.0], [6.0, 4.0]])

seeds = st.integers(0, 2**32 - 1)
distances = st.sampled_from((0.01, 0.1, 0.5, 1.5))


def signed_area(ring: FloatArray) -> float:
    x, y = ring[:, 0], ring[:, 1]
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def outline(geometry: shapely.Geometry) -> Any:
    """Return points along the whole boundary, vertices included."""
    return shapely.points(shapely.get_coordinates(shapely.segmentize(geometry.boundary, 0.03)))


@given(seeds, st.sampled_from((0.0, 0.4, 0.9)))
def test_rings_keep_the_free_side_on_the_left_and_every_number(
    random_region: RegionMaker, seed: int, roughness: float
) -> None:
    area = UnoccupiedArea(3.0, random_region(seed, roughness), {"a": 2})
    turned = UnoccupiedArea(3.0, area.region.reverse())
    assert sum(signed_area(ring) for ring in area.rings) == pytest.approx(area.region.area)
    assert sum(signed_area(ring) > 0.0 for ring in area.rings) == len(area.region.geoms)
    again = UnoccupiedArea.from_rings(3.0, area.rings, area.contradictions)
    assert shapely.equals(again.region, area.region)
    assert again.contradictions == {"a": 2}
    for first, second in zip(area.rings, again.rings, strict=True):
        np.testing.assert_array_equal(first, second)
    for ring in turned.rings:
        assert any(
            len(ring) == len(other) and signed_area(ring) == signed_area(other) for other in area.rings
        )


@pytest.mark.parametrize(
    ("rings", "message"),
    [
        ([HOLE], "ring 0 is a hole"),
        ([SQUARE, SQUARE[:2]], "ring 1 has shape"),
        ([SQUARE, np.zeros((4, 3))], "ring 1 has shape"),
        ([SQUARE, np.where(HOLE == 6.0, np.nan, HOLE)], "finite"),
        ([np.where(SQUARE == 10.0, np.inf, SQUARE)], "finite"),
    ],
)
def test_rings_that_are_no_area_are_refused(rings: list[FloatArray], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        UnoccupiedArea.from_rings(0.0, rings)


def test_no_rings_are_the_empty_area() -> None:
    area = UnoccupiedArea.from_rings(1.0, [])
    assert area.is_empty
    assert area.rings == ()
    assert area.clearance(np.zeros((2, 2))).tolist() == [-math.inf, -math.inf]


def test_a_restamped_area_shares_what_was_computed() -> None:
    area = UnoccupiedArea(1.0, MultiPolygon([Polygon(SQUARE)]), {"a": 1})
    later = area.restamped(2.0)
    assert (later.stamp, later.contradictions) == (2.0, {"a": 1})
    assert later.rings is area.rings
    assert later.clearance_field is area.clearance_field
    assert area.restamped(3.0, {}).contradictions == {}
    assert area.stamp == 1.0


@given(seeds, st.sampled_from((0.0, 0.4, 0.9)), distances)
def test_what_is_left_by_a_shrink_keeps_the_distance_and_little_is_lost(
    random_region: RegionMaker, seed: int, roughness: float, distance: float
) -> None:
    region = random_region(seed, roughness)
    left = shrink(region, distance)
    assert left.is_valid
    if not left.is_empty:
        assert shapely.covers(region, outline(left)).all()
        assert shapely.distance(outline(left), region.boundary).min() >= distance - 1e-9
    missed = shapely.difference(region.buffer(-1.022 * distance, quad_segs=64), left)
    assert missed.area < 1e-6


@given(seeds, distances, st.sampled_from((0.0, 0.003, 0.02, 0.2)), st.booleans())
def test_a_reduction_with_simplification_keeps_the_distance_and_loses_what_it_says(
    random_region: RegionMaker, seed: int, distance: float, simplification: float, quick: bool
) -> None:
    generator = np.random.default_rng(seed)
    # Many short edges and tiny obstacles near the walls: what simplification likes to leave out.
    rough = shapely.segmentize(random_region(seed, 0.4), 0.3)
    rough = shapely.transform(rough, lambda points: points + 0.015 * np.sin(977.0 * points[:, ::-1]))
    crumbs = shapely.points(shapely.get_coordinates(rough)[::40] + generator.normal(0.0, 0.03, 2))
    region = as_multipolygon(
        shapely.difference(
            shapely.make_valid(rough), shapely.union_all(shapely.buffer(crumbs, 0.01, quad_segs=1))
        )
    )
    left = reduce_area(region, distance, simplification, quick)
    if not left.is_empty:
        assert shapely.covers(region, outline(left)).all()
        assert shapely.distance(outline(left), region.boundary).min() >= distance - 1e-9
    exact = region.buffer(-(1.022 * distance + 5.0 * simplification), quad_segs=64)
    assert shapely.difference(exact, left).area < 1e-6


@given(seeds, distances)
def test_what_is_grown_holds_every_point_within_the_distance(
    random_region: RegionMaker, seed: int, distance: float
) -> None:
    region = random_region(seed, 0.4)
    grown = grow(region, distance)
    assert shapely.distance(outline(grown), region).min() >= distance - 1e-9
    assert shapely.covers(grown, region)


def test_a_distance_of_zero_leaves_the_region_as_it_is() -> None:
    region = MultiPolygon([Polygon(SQUARE, [HOLE])])
    assert shapely.equals(shrink(region, 0.0), region)
    assert shapely.equals(reduce_area(region, 0.0), region)


@given(seeds, st.integers(0, 5), st.booleans())
def test_removed_disks_are_gone_and_nothing_else(
    random_region: RegionMaker, seed: int, count: int, simple: bool
) -> None:
    generator = np.random.default_rng(seed)
    region = random_region(seed, 0.4)
    centres, radii = generator.uniform(-8.0, 8.0, (count, 2)), generator.uniform(0.1, 2.0, count)
    left = remove_disks(region, centres, radii, simple)
    points = generator.uniform(-12.0, 12.0, (400, 2))
    away = np.linalg.norm(points[:, None] - centres, axis=2) - radii
    kept = shapely.contains_xy(left, points[:, 0], points[:, 1])
    inside = shapely.contains_xy(region, points[:, 0], points[:, 1])
    assert not kept[(away < 0.0).any(axis=1)].any()
    assert inside[kept].all()
    assert kept[inside & (away > 0.021 * radii).all(axis=1)].all()


@given(seeds)
def test_a_point_is_in_the_component_that_covers_it(random_region: RegionMaker, seed: int) -> None:
    region = shrink(random_region(seed, 0.4), 0.8)
    for point in np.random.default_rng(seed).uniform(-8.0, 8.0, (20, 2)):
        component = component_at(region, point)
        assert (component is not None) == region.covers(Point(point))
        assert component is None or component.covers(Point(point))
    for polygon in region.geoms:
        corner = np.array(polygon.exterior.coords[0])
        assert shapely.equals(component_at(region, corner), polygon), "the boundary belongs to it"


def test_only_polygons_are_left_of_a_mixed_geometry() -> None:
    polygon = Polygon(SQUARE)
    mixed = shapely.GeometryCollection([polygon, LineString([(0, 0), (9, 20)]), Point(30, 0)])
    assert list(as_multipolygon(mixed).geoms) == [polygon]
    assert as_multipolygon(Polygon()).is_empty
    assert as_multipolygon(LineString([(0, 0), (1, 1)])).is_empty


@given(seeds, st.sampled_from((0.0003, 0.01, 0.1)))
def test_a_fan_of_slits_shrinks_like_anything_else(seed: int, distance: float) -> None:
    """What scanners full of holes leave: slits that all meet at the scanner, whose offset lines cross one another."""
    draws = np.random.default_rng(seed)
    angles = np.linspace(0.0, math.pi, 500)
    lengths = np.where(draws.random(500) < 0.5, 8.0, draws.uniform(0.5, 7.0, 500))
    outline = lengths[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    fan = as_multipolygon(Polygon(np.vstack(([[0.0, -0.5]], outline))))
    fan = as_multipolygon(shapely.difference(fan, Point(2.0, 3.0).buffer(0.2, quad_segs=40)))
    assert shapely.get_num_coordinates(fan) > 500
    assert fan.length > 12.0 * math.sqrt(fan.area)
    left = shrink(fan, distance)
    assert left.is_valid
    assert (
        shapely.distance(shapely.points(shapely.get_coordinates(left)), fan.boundary).min() >= distance - 1e-9
    )
    assert shapely.difference(left, fan).area < 1e-9
    assert shapely.difference(fan.buffer(-1.01 * distance, quad_segs=32), left).area < 1e-6
