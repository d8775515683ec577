"""The six rules of Ch. 3 in scenes where each kind of point occurs and the outcome is known by hand."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shapely.geometry import MultiPolygon, Polygon

from snnav_core.planning.curves import AreaCurves
from snnav_core.planning.tangent_graph import Candidate, chain_length, rule_candidates
from snnav_core.types import FloatArray, PathSource, Pose2D

ROOM = shapely.box(-5.0, -12.0, 25.0, 12.0)
TARGET = np.array([20.0, 0.0])
EAST = Pose2D(0.0, 0.0, 0.0)
RADIUS, SPACING = 2.0, 0.1


def candidates(
    free: Polygon, pose: Pose2D = EAST, target: FloatArray = TARGET, limit: int = 32
) -> list[Candidate]:
    return rule_candidates(AreaCurves(free), pose, target, RADIUS, SPACING, limit)


def without(*obstacles: shapely.Geometry) -> Polygon:
    return ROOM.difference(shapely.union_all(obstacles))


def lengths(found: list[Candidate], rotation: int) -> list[float]:
    return [candidate.length for candidate in found if candidate.rotation == rotation]


def way(*corners: tuple[float, float]) -> float:
    return chain_length(np.array(corners))


def passes(candidate: Candidate, corner: tuple[float, float]) -> bool:
    return bool((np.linalg.norm(candidate.polyline - corner, axis=1) < 1e-6).any())


def test_with_a_free_view_the_b_point_leads_straight_to_the_target() -> None:
    """Rules 1, 2 and 6, (BT): arcs of 90 and 270 degrees but for the tangent."""
    pose = Pose2D(0.0, 0.0, 0.5 * math.pi)
    found = candidates(ROOM, pose)
    assert [candidate.rotation for candidate in found] == [-1, 1]
    opening = math.acos(RADIUS / 18.0)
    right = RADIUS * (math.pi - opening) + math.sqrt(18.0**2 - RADIUS**2)
    left = RADIUS * (2.0 * math.pi - math.acos(RADIUS / 22.0)) + math.sqrt(22.0**2 - RADIUS**2)
    np.testing.assert_allclose([candidate.length for candidate in found], [right, left], atol=0.01)
    assert {candidate.source for candidate in found} == {PathSource.TANGENT_GRAPH}


def test_a_robot_that_faces_the_target_goes_straight_on_either_circle() -> None:
    assert [candidate.length for candidate in candidates(ROOM)] == pytest.approx([20.0, 20.0])


@pytest.mark.parametrize(
    ("obstacle", "around"),
    [
        (shapely.box(8.0, -2.0, 12.0, 2.0), ((8.0, 0.0), (8.0, 2.0), (12.0, 2.0))),
        (Polygon([(8.0, 0.0), (10.0, -2.0), (12.0, 0.0), (10.0, 2.0)]), ((8.0, 0.0), (10.0, 2.0))),
    ],
)
def test_one_obstacle_in_the_way_forks_both_circles_into_both_ways_around(
    obstacle: Polygon, around: tuple[tuple[float, float], ...]
) -> None:
    """Rules 2 and 3: (B') on the obstacle, then (A) at its last corner, (AT)."""
    found = candidates(without(obstacle))
    expected = way((0.0, 0.0), *around, (20.0, 0.0))
    for rotation in (1, -1):
        assert lengths(found, rotation) == pytest.approx([expected, expected])
    above = [passes(candidate, around[-1]) for candidate in found]
    assert sum(above) == 2


def test_a_second_obstacle_behind_the_first_forks_again() -> None:
    """Rule 2 with (AA'): above the first box the second one is in the way, below it is not."""
    found = candidates(without(shapely.box(4.0, -2.0, 6.0, 2.0), shapely.box(10.0, -1.0, 12.0, 3.0)))
    second = (10.0, 2.0 * 10.0 / 14.0)
    over = ((0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (6.0, 2.0), second)
    expected = [
        way((0.0, 0.0), (4.0, 0.0), (4.0, -2.0), (6.0, -2.0), (20.0, 0.0)),
        way(*over, (10.0, 3.0), (12.0, 3.0), (20.0, 0.0)),
        way(*over, (10.0, -1.0), (12.0, -1.0), (20.0, 0.0)),
    ]
    for rotation in (1, -1):
        assert lengths(found, rotation) == pytest.approx(sorted(expected))


def test_a_curve_can_block_its_own_tangent() -> None:
    """Deviation C3-19: the first arm of a U hides the second one of the same curve."""
    shape = shapely.union_all(
        [shapely.box(4, -2, 5, 2), shapely.box(4, -2, 12, -1), shapely.box(11, -2, 12, 4)]
    )
    found = candidates(without(shape))
    best = min(found, key=lambda candidate: candidate.length)
    assert passes(best, (12.0, -2.0))
    assert any(passes(candidate, (5.0, 2.0)) and passes(candidate, (12.0, 4.0)) for candidate in found)


def test_a_walk_that_reaches_the_ray_behind_the_robot_is_abandoned() -> None:
    """Rule 5: past the (S)-point the way along C_0 would lead around the room and over the upper wall."""
    room = shapely.box(0.0, 0.0, 20.0, 10.0)
    free = room.difference(shapely.union_all([shapely.box(9, 0, 11, 6), shapely.box(9, 7, 11, 10)]))
    pose, target = Pose2D(4.0, 3.0, math.atan2(6.0, 12.0)), np.array([16.0, 9.0])
    found = candidates(free, pose, target)
    expected = way((4.0, 3.0), (9.0, 5.5), (9.0, 6.0), (16.0, 9.0))
    assert [candidate.length for candidate in found] == pytest.approx([expected, expected])
    # With the upper wall only, the same walk does not come by the ray and is the way.
    low = room.difference(shapely.box(9, 1, 11, 10))
    found = candidates(low, pose, target)
    assert found
    assert all(passes(candidate, (11.0, 1.0)) for candidate in found)


def test_an_initial_circle_that_meets_an_obstacle_goes_on_along_it() -> None:
    """Rule 4: the (V)-point at cos(angle) = 3/4 on the left face, then up the box to the (A)-point."""
    free = without(shapely.box(5.5, 0.5, 7.5, 4.0))
    pose, target = Pose2D(5.0, 0.0, 0.5 * math.pi), np.array([20.0, 1.0])
    found = candidates(free, pose, target)
    angle = math.acos(0.75)
    meeting = (5.5, RADIUS * math.sin(angle))
    right = RADIUS * angle + way(meeting, (5.5, 4.0), (7.5, 4.0), (20.0, 1.0))
    assert lengths(found, -1) == pytest.approx([right], abs=0.01)
    left = lengths(found, 1)
    assert len(left) == 1
    assert left[0] > 4.0 + way((3.0, -2.0), (20.0, 1.0)), "around the free circle, then straight"


def test_a_circle_into_a_plain_wall_yields_nothing() -> None:
    """A convex room has no tangent to leave its wall by."""
    room = shapely.box(0.0, 0.0, 20.0, 10.0)
    found = candidates(room, Pose2D(5.0, 1.0, math.pi), np.array([15.0, 5.0]))
    assert {candidate.rotation for candidate in found} == {-1}


def test_a_target_inside_a_circle_has_no_tangent_there() -> None:
    found = candidates(ROOM, EAST, np.array([0.0, 1.0]))
    assert {candidate.rotation for candidate in found} <= {-1}


def test_a_robot_outside_the_area_gets_no_candidates() -> None:
    assert candidates(ROOM, Pose2D(-50.0, 0.0, 0.0)) == []


def test_there_are_never_more_candidates_than_asked_for() -> None:
    halves = ((3.0, 0.0), (7.0, 1.5), (7.0, -1.6), (11.0, 0.2), (15.0, -1.4), (15.0, 1.7))
    free = without(*(shapely.box(x - 0.5, y - 1.3, x + 0.5, y + 1.3) for x, y in halves))
    assert len(candidates(free)) > 5
    for limit in (1, 3, 5):
        assert 0 < len(candidates(free, limit=limit)) <= limit


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(-math.pi, math.pi), st.sampled_from((0.05, 0.4, 1.0)))
def test_every_candidate_leads_from_the_robot_along_its_heading_through_the_area_to_the_target(
    random_region: Callable[[int, float], MultiPolygon], seed: int, heading: float, radius: float
) -> None:
    polygon = max(random_region(seed, 0.4).geoms, key=shapely.area)
    low, high = np.array(polygon.bounds).reshape(2, 2)
    points = np.random.default_rng(seed).uniform(low, high, (200, 2))
    points = points[shapely.contains_xy(polygon, points[:, 0], points[:, 1])]
    start, target = points[:2]
    assume(float(np.linalg.norm(target - start)) > 2.0 * radius)
    pose = Pose2D(float(start[0]), float(start[1]), heading)
    found = rule_candidates(AreaCurves(polygon), pose, target, radius, 0.1 * radius)
    assert [candidate.length for candidate in found] == sorted(candidate.length for candidate in found)
    widened = polygon.buffer(1e-6)
    for candidate in found:
        line = candidate.polyline
        np.testing.assert_allclose(line[0], start, atol=1e-9)
        np.testing.assert_array_equal(line[-1], target)
        assert candidate.length == pytest.approx(chain_length(line))
        assert candidate.length >= np.linalg.norm(target - start) - 1e-9
        # But for the sagitta of the chords that stand for the arc.
        assert shapely.LineString(line).difference(widened).length < 1e-6
        steps = np.diff(line, axis=0)
        first = steps[np.linalg.norm(steps, axis=1) > 1e-9][0]
        off = math.remainder(math.atan2(first[1], first[0]) - heading, 2.0 * math.pi)
        assert abs(off) <= 0.051 + 1e-6
        assert abs(off) < 1e-6 or off * candidate.rotation > 0.0
