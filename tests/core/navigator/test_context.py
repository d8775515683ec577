"""What is computed once per area is right for every distance, target and set of standing robots."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import MultiPolygon

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.navigator.context import AreaContext
from snnav_core.planning.shortest import GoalTree

RegionMaker = Callable[[int, float], MultiPolygon]
ROOM = MultiPolygon([shapely.box(0.0, 0.0, 10.0, 8.0)])

seeds = st.integers(0, 2**32 - 1)


def context(region: MultiPolygon = ROOM, grain: float = 0.0) -> AreaContext:
    return AreaContext(UnoccupiedArea(0.0, region), 0.02, grain)


@given(seeds)
def test_equal_regions_and_no_others_have_equal_digests(random_region: RegionMaker, seed: int) -> None:
    region = random_region(seed, 0.4)
    first = context(region)
    assert first.digest == context(region).digest
    assert first.digest == AreaContext(UnoccupiedArea(9.0, region), 0.5).digest, (
        "stamp and settings are no part of it"
    )
    rings = UnoccupiedArea(0.0, region).rings
    moved = [rings[0] + 1e-9, *rings[1:]]
    assert first.digest != AreaContext(UnoccupiedArea.from_rings(0.0, moved), 0.02).digest
    if len(rings) > 1:
        assert first.digest != AreaContext(UnoccupiedArea.from_rings(0.0, rings[:-1]), 0.02).digest


@settings(max_examples=20)
@given(seeds, st.floats(0.2, 1.5), st.integers(0, 3), st.sampled_from([0.0, 0.01]))
def test_a_region_keeps_the_distance_to_the_boundary_and_to_standing_robots(
    random_region: RegionMaker, seed: int, distance: float, count: int, grain: float
) -> None:
    generator = np.random.default_rng(seed)
    one = context(random_region(seed, 0.4), grain)
    disks = tuple((float(x), float(y), 0.6) for x, y in generator.uniform(-6.0, 6.0, (count, 2)))
    left = one.region(distance, disks)
    assert left is one.region(distance, disks)
    points = shapely.get_coordinates(left)
    if len(points):
        assert one.area.clearance(points).min() >= distance - 1e-6
    for x, y, radius in disks:
        assert left.distance(shapely.Point(x, y)) >= radius - 1e-9


def test_in_a_crowd_distances_that_differ_by_millimetres_share_what_follows() -> None:
    one, target = context(grain=0.01), np.array([5.0, 4.0])
    assert one.region(0.6083, ()) is one.region(0.61, ())
    assert one.curves(0.602, (), target) is one.curves(0.6083, (), target)
    assert one.opened(0.602, 0.4) is one.opened(0.6083, 0.4)
    assert one.rounded(0.61) == one.rounded(one.rounded(0.6001)) == one.rounded(0.6001) >= 0.61 - 1e-9
    assert context().region(0.6083, ()) is not context().region(0.61, ())
    assert context().rounded(0.6083) == 0.6083


@settings(max_examples=30)
@given(seeds, st.floats(0.2, 1.0))
def test_the_nearest_point_inside_is_covered_by_its_component(
    random_region: RegionMaker, seed: int, distance: float
) -> None:
    one = context(random_region(seed, 0.4))
    for point in np.random.default_rng(seed).uniform(-10.0, 10.0, (10, 2)):
        nearest = one.nearest_inside(point, distance, ())
        region = one.region(distance, ())
        if region.is_empty:
            assert nearest is None
            continue
        assert nearest is not None
        gap = region.distance(shapely.Point(point))
        assert abs(math.dist(point, nearest) - gap) < 1e-5
        assert region.distance(shapely.Point(nearest)) < 1e-6


def test_curves_and_goal_trees_are_shared() -> None:
    one, target = context(), np.array([5.0, 5.0])
    curves = one.curves(0.5, (), target)
    assert curves is not None
    assert one.curves(0.5, (), np.array([2.0, 2.0])) is curves
    tree = one.goal_tree(curves, target)
    assert one.goal_tree(curves, target) is tree
    assert one.goal_tree(curves, np.array([5.0, 4.0])) is not tree
    assert one.curves(0.5, (), np.array([0.2, 5.0])) is None
    assert one.curves(9.0, (), target) is None
    assert one.nearest_inside(target, 9.0, ()) is None


def test_robots_that_stop_here_and_there_for_days_do_not_fill_the_memory() -> None:
    one, target = context(), np.array([9.0, 7.0])
    for step in range(300):
        disks = ((2.0 + 0.01 * step, 4.0, 0.5),)
        curves = one.curves(0.5, disks, target)
        assert curves is not None
        assert not curves.covers(np.array([2.0 + 0.01 * step, 4.0]))
        tree = one.goal_tree(curves, target)
        assert isinstance(tree, GoalTree)
        assert tree.curves is curves, "never the tree of other curves"
    assert max(len(one._without), len(one._curves), len(one._trees)) <= 65
