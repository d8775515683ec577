"""The parts of the planner in space-time: distances, the loop, the modes of the end, the lattice."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.homotopy_search import coarse_gains
from snnav_core.planning.lattice import lattice_way
from snnav_core.planning.prolonging import TARGET, Chain, Event, prolong
from snnav_core.planning.settling import fine_gains, settle
from snnav_core.planning.spacetime import plan_in_spacetime
from snnav_core.planning.spacetime_bodies import cuts, distance
from snnav_core.planning.spacetime_problem import (
    CandidateOutcome,
    OtherRobot,
    SpacetimeProblem,
    SpacetimeSettings,
)
from snnav_core.planning.spacetime_world import Layout, TurningReserve, lay_out
from snnav_core.types import FloatArray, Pose2D, RobotSpec, TimedPath

ROBOT = RobotSpec("robot", 0.3, 0.5, 2.0)
SETTINGS = SpacetimeSettings()
DISK = MovingObstacle("disk", np.array([[5.0, 0.1]]), radius=0.5)


def layout(*bodies: MovingObstacle, workspace: tuple[FloatArray, ...] | None = None) -> Layout:
    problem = SpacetimeProblem(
        ROBOT, Pose2D(0.0, 0.0, 0.0), 2.0, np.array([10.0, 0.0]), bodies, (), workspace
    )
    return lay_out(problem, SETTINGS, TurningReserve.CORNERS)


def shape(outline: FloatArray) -> shapely.Geometry:
    return (
        (shapely.Point, shapely.LineString)[len(outline) - 1](outline)
        if len(outline) < 3
        else shapely.Polygon(outline)
    )


@st.composite
def bodies(draw: st.DrawFn) -> MovingObstacle:
    """Return a disk, a capsule or a polygon, convex or not, that moves."""
    draws = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    sides = draw(st.integers(1, 8))
    angles = 2.0 * math.pi * (np.arange(sides) + draws.uniform(0.0, 0.7, sides)) / sides
    outline = draws.uniform(0.3, 1.5, sides)[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    place = draws.uniform((3.0, -2.0), (7.0, 2.0))
    return MovingObstacle("body", place + outline, draws.uniform(0.1, 0.5), draws.uniform(-0.3, 0.3, 2), 1.0)


@settings(max_examples=150, deadline=None)
@given(body=bodies(), k=st.integers(0, 40), x=st.floats(0.0, 10.0), y=st.floats(-5.0, 5.0))
def test_signed_distance_and_gradient_are_those_of_the_body_at_that_time(
    body: MovingObstacle, k: int, x: float, y: float
) -> None:
    placed = layout(body)
    truth = shape(body.outline_at(2.0 + placed.step * k))
    point = shapely.Point(x, y)
    expected = float(truth.distance(point))
    if len(body.outline) > 2 and truth.contains(point):
        expected = -float(truth.boundary.distance(point))
    rho, gx, gy = distance(placed.world, 0, k, x, y)
    assert rho == pytest.approx(expected - body.radius, abs=1e-9)
    assert math.hypot(gx, gy) == pytest.approx(1.0)
    ahead, _, _ = distance(placed.world, 0, k, x + 1e-6 * gx, y + 1e-6 * gy)
    assert ahead >= rho + 0.99e-6 - 1e-9


@settings(max_examples=100, deadline=None)
@given(body=bodies(), k=st.integers(0, 40), y=st.floats(-6.0, 6.0), to=st.floats(-6.0, 6.0))
def test_a_segment_cuts_what_it_comes_too_near_to(body: MovingObstacle, k: int, y: float, to: float) -> None:
    placed = layout(body)
    truth = shape(body.outline_at(2.0 + placed.step * k))
    # Somewhere else than start and target, near which less may be demanded.
    kept = float(placed.world.kept[0, 0])
    if placed.world.kept[0, 1:].min() < kept:
        return
    gap = float(truth.distance(shapely.LineString([(0.0, y), (10.0, to)]))) - body.radius
    allowed = SETTINGS.graze * kept
    answer = cuts(placed.world, 0, k, 0.0, y, 10.0, to, SETTINGS.graze)
    if gap < 0.95 * (kept - allowed):
        assert answer
    if gap >= kept - allowed + 1e-6:
        assert not answer


def test_less_is_demanded_near_a_start_that_is_near_a_body() -> None:
    placed = layout(MovingObstacle("wall", np.array([[-3.0, 0.5], [13.0, 0.5], [13.0, 1.0], [-3.0, 1.0]])))
    assert placed.world.kept[0, 1] == pytest.approx(0.5)
    assert not cuts(placed.world, 0, 0, 0.0, 0.0, 1.0, -0.3, SETTINGS.graze)
    assert cuts(placed.world, 0, 0, 0.0, 0.0, 1.0, 0.2, SETTINGS.graze)


def test_following_knows_both_directions_and_ends_when_the_way_is_free() -> None:
    placed = layout(DISK)
    gains = coarse_gains(placed.link, SETTINGS.adjustment)
    chain = Chain.begin(placed.world.ends[0], placed.most_points)
    events = []
    while not events:
        event, body = prolong(chain, placed.world, gains, SETTINGS.graze, 60)
        if event is not Event.NOTHING:
            events.append((event, body))
    assert events == [(Event.HIT, 0)]
    rho, _, _ = distance(placed.world, 0, chain.n, *chain.points[chain.n])
    assert rho == pytest.approx(placed.world.kept[0, 0], abs=0.02 * placed.link)
    for side in (1, -1):
        twin = chain.copy()
        twin.follow(0, side)
        for _ in range(60):
            event, _ = prolong(twin, placed.world, gains, SETTINGS.graze, 60)
            if event is Event.LEFT:
                break
        assert event is Event.LEFT
        # gamma = +1: the body lies on the right, so that the chain is above it
        assert side * (twin.points[twin.n, 1] - 0.1) > 0.5
        assert twin.turns == ((0, side),)


def test_a_settled_chain_keeps_its_distance_with_even_links_and_is_as_short_as_can_be() -> None:
    placed = layout(DISK)
    way = np.column_stack((np.linspace(0.0, 10.0, 72), np.zeros(72)))
    way[:, 1] = 2.0 * np.sin(math.pi * way[:, 0] / 10.0)
    chain = Chain.along(way, placed.link, 20)
    gains = fine_gains(placed.link, 0.28, 72, SETTINGS.adjustment)
    assert settle(chain, placed.world, gains, SETTINGS.adjustment, 3000)
    points = chain.chain
    assert chain.followed == TARGET
    links = np.hypot(*np.diff(points, axis=0).T)
    assert links == pytest.approx(placed.link, rel=2e-3)
    kept = float(placed.world.kept[0, 0])
    centre = np.array([5.0, 0.1])
    assert np.hypot(*(points - centre).T).min() >= 0.5 + kept - 1e-6
    shortest = shapely.Point(centre).buffer(0.5 + kept, quad_segs=90)
    hull = shapely.convex_hull(shapely.union(shortest, shapely.MultiPoint([(0.0, 0.0), (10.0, 0.0)])))
    upper = shapely.intersection(hull.boundary, shapely.box(-1.0, 0.0, 11.0, 5.0)).length
    length = links.sum() + math.dist(points[-1], (10.0, 0.0))
    assert length == pytest.approx(upper, rel=1.5e-3)


def test_a_candidate_that_would_have_to_be_faster_is_stretched_and_no_answer() -> None:
    # Passing before the other robot, which crosses the way at the same time, takes more than the speed.
    way = np.column_stack((np.full(80, 5.0), np.linspace(4.2, -5.8, 80)))
    crossing = OtherRobot("crossing", TimedPath(0.0, 10.0 / 79.0 / 0.5, way), 0.8)
    problem = SpacetimeProblem(ROBOT, Pose2D(0.0, 0.0, 0.0), 0.0, np.array([10.0, 0.0]), others=(crossing,))
    answer = plan_in_spacetime(problem, SETTINGS, np.random.default_rng(0))
    stretched = [one for one in answer.candidates if one.outcome is CandidateOutcome.STRETCHED]
    assert stretched
    assert all("links" in one.reason for one in stretched)
    assert all(one.travel_time == math.inf for one in stretched)


@settings(max_examples=25, deadline=None)
@given(body=bodies(), other=bodies())
def test_a_way_over_the_lattice_keeps_away_from_everything_at_all_times(
    body: MovingObstacle, other: MovingObstacle
) -> None:
    placed = layout(body, other)
    way = lattice_way(placed.world, placed.link, 0.6, placed.most_points, 20_000)
    if way is None:
        return
    assert np.hypot(*np.diff(way, axis=0).T) == pytest.approx(placed.link)
    assert math.dist(way[-1], (10.0, 0.0)) < 3.0 * placed.link
    for k, (x, y) in enumerate(way):
        for i in range(2):
            rho, _, _ = distance(placed.world, i, k, x, y)
            # near the start no more than that is there
            assert rho >= min(placed.world.kept[i]) - 1e-9


def test_the_border_of_a_workspace_is_the_last_body() -> None:
    hall = np.array([[-2.0, -2.0], [12.0, -2.0], [12.0, 2.0], [-2.0, 2.0]])
    pillar = np.array([[5.0, -0.3], [5.0, 0.3], [5.6, 0.3], [5.6, -0.3]])
    placed = layout(workspace=(hall, pillar))
    assert placed.names == ("workspace hole 0", "workspace")
    assert distance(placed.world, 1, 0, 1.0, 0.5)[0] == pytest.approx(1.5)
    assert distance(placed.world, 1, 0, 1.0, 2.5)[0] == pytest.approx(-0.5)
    assert distance(placed.world, 0, 0, 4.0, 0.0)[0] == pytest.approx(1.0)


@pytest.mark.parametrize("reserve", list(TurningReserve))
def test_corners_leave_the_turning_radius_where_a_reserve_is_asked_for(reserve: TurningReserve) -> None:
    wide = RobotSpec("wide", 0.3, 0.5, 0.5)  # R_min = 1 m
    moving = MovingObstacle(
        "moving", np.array([[4.0, 3.0], [5.0, 3.0], [5.0, 4.0]]), velocity=np.array([0.1, 0.0])
    )
    problem = SpacetimeProblem(wide, Pose2D(0.0, 0.0, 0.0), 0.0, np.array([10.0, 0.0]), (moving,))
    kept = float(lay_out(problem, SETTINGS, reserve).world.kept[0, 0])
    wanted = {TurningReserve.CORNERS: 1.15, TurningReserve.FOLLOWING: 1.15 * 1.2**2}
    assert kept == pytest.approx(wanted.get(reserve, math.hypot(0.62, 0.5 * 1.02 * 0.15 * 1.2)))
