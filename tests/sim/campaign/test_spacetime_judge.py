"""The global planner against exact references: random problems, ground truth, visibility graph, lower bound in time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely

from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime_problem import SpacetimeProblem
from snnav_core.planning.travel_bound import travel_bound
from snnav_core.types import Pose2D, RobotSpec, TimedPath
from snnav_sim.campaign.spacetime_cases import SpacetimeCase, dynamic_case, static_case
from snnav_sim.campaign.spacetime_judge import Judgement, judge_case, true_clearance
from snnav_sim.report.optimum import reduced, shortest_path

KINDS = {"static": static_case, "dynamic": dynamic_case}
SERIES = [pytest.param(15), pytest.param(200, marks=pytest.mark.nightly)]


def judged(make: Callable[[int], SpacetimeCase], count: int) -> list[tuple[SpacetimeCase, Judgement]]:
    cases = [make(seed) for seed in range(count)]
    return [(case, judge_case(case)) for case in cases]


def broken(series: list[tuple[SpacetimeCase, Judgement]]) -> list[int]:
    """Seeds whose plan comes nearer than the safety margin, at the samples or between them."""
    return [
        seed
        for seed, (case, judgement) in enumerate(series)
        if min(judgement.clearance, judgement.clearance_between) < case.settings.safety_margin
    ]


def gaps(series: list[tuple[SpacetimeCase, Judgement]]) -> np.ndarray:
    return np.array([judgement.gap for _, judgement in series if not judgement.reason])


def told(series: list[tuple[SpacetimeCase, Judgement]]) -> str:
    found, spent = gaps(series), np.array([judgement.seconds for _, judgement in series])
    return (
        f"{len(series)} problems, {sum(judgement.feasible for _, judgement in series)} feasible, {len(found)} solved, "
        f"gap median {np.median(found):.2%}, p95 {np.percentile(found, 95):.2%}, worst {found.max():.1%}; "
        f"CPU median {np.median(spent) * 1e3:.0f} ms, worst {spent.max():.2f} s"
    )


@pytest.mark.parametrize("count", SERIES)
def test_random_static_problems(count: int, record_property: Callable[[str, object], None]) -> None:
    series = judged(static_case, count)
    print("static:", told(series))
    record_property("summary", told(series))
    assert broken(series) == []
    feasible = [judgement for _, judgement in series if judgement.feasible]
    solved = [judgement for judgement in feasible if not judgement.reason]
    assert len(solved) >= 0.99 * len(feasible), [judgement.reason for judgement in feasible]
    found = gaps(series)
    assert np.median(found) <= 0.03
    assert np.percentile(found, 95) <= 0.10
    assert not any(judgement.too_fast for _, judgement in series)
    assert all(judgement.reason for _, judgement in series if not judgement.feasible)


@pytest.mark.parametrize("count", SERIES)
def test_random_dynamic_problems(count: int, record_property: Callable[[str, object], None]) -> None:
    series = judged(dynamic_case, count)
    print("dynamic:", told(series))
    record_property("summary", told(series))
    assert broken(series) == []
    found = gaps(series)
    assert len(found) >= 0.9 * count
    assert np.median(found) <= 0.05
    assert not any(judgement.too_fast for _, judgement in series)


@pytest.mark.parametrize("kind", KINDS)
def test_a_seed_makes_one_problem(kind: str) -> None:
    make = KINDS[kind]
    first, again, other = make(3).problem, make(3).problem, make(4).problem
    assert first.start == again.start != other.start
    for one, two in zip(first.obstacles, again.obstacles, strict=True):
        assert np.array_equal(one.outline, two.outline)
        assert np.array_equal(one.velocity, two.velocity)


@pytest.mark.parametrize("kind", KINDS)
def test_problems_are_what_they_shall_be(kind: str) -> None:
    cases = [KINDS[kind](seed) for seed in range(40)]
    counts = {len(case.problem.obstacles) for case in cases}
    assert min(counts) <= 3
    assert max(counts) >= 10
    outlines = [body.outline for case in cases for body in case.problem.obstacles]
    assert any(len(outline) == 1 for outline in outlines)
    assert any(not _is_convex(outline) for outline in outlines if len(outline) > 3)
    for case in cases:
        problem = case.problem
        stays = TimedPath(0.0, 1.0, problem.target[None].repeat(121, axis=0))
        starts = TimedPath(0.0, 1e-9, problem.start.position[None].repeat(2, axis=0))
        assert true_clearance(problem, stays)[1] >= case.margin
        assert true_clearance(problem, starts)[1] >= case.margin
        moving = sum(body.speed > 0.0 for body in problem.obstacles)
        assert (
            (moving == 0)
            if kind == "static"
            else all(body.speed < 0.9 * problem.robot.speed for body in problem.obstacles)
        )


def _is_convex(outline: np.ndarray) -> bool:
    polygon = shapely.Polygon(outline)
    return bool(polygon.convex_hull.area <= polygon.area * (1.0 + 1e-9))


def test_without_motion_the_bound_is_the_optimum_of_the_visibility_graph() -> None:
    for seed in range(25):
        case = static_case(seed)
        problem = case.problem
        solid = [
            shapely.MultiPoint(body.outline).convex_hull.buffer(body.radius, quad_segs=64)
            if len(body.outline) < 3
            else shapely.Polygon(body.outline)
            for body in problem.obstacles
        ]
        assert problem.workspace is not None
        area = shapely.Polygon(problem.workspace[0]).difference(shapely.union_all(solid))
        bound = travel_bound(problem, case.margin)
        if math.isinf(bound.time):
            continue
        start, target = tuple(problem.start.position), tuple(problem.target)
        optimum, _ = shortest_path(reduced(area, case.margin), start, target)
        assert bound.time * problem.robot.speed == pytest.approx(optimum, rel=1e-3)


def test_the_judge_sees_what_happens_between_samples() -> None:
    """A disk is met head on at 1 m/s: where it is nearest there is no sample."""
    body = MovingObstacle("disk", np.array([[1.02, 0.7]]), 0.1, np.array([-0.5, 0.0]))
    problem = SpacetimeProblem(
        RobotSpec("robot_1", 0.25, 0.5, 2.0), Pose2D(0.0, 0.0, 0.0), 0.0, np.array([3.0, 0.0]), (body,)
    )
    path = TimedPath(0.0, 0.3, np.column_stack((0.15 * np.arange(21), np.zeros(21))))
    sampled, between = true_clearance(problem, path)
    assert between == pytest.approx(0.6, abs=2e-4)
    assert 0.6 <= sampled < 0.61
    walled = replace(problem, workspace=(np.array([[-1.0, -0.5], [4.0, -0.5], [4.0, 2.0], [-1.0, 2.0]]),))
    assert true_clearance(walled, path)[0] == pytest.approx(0.5)
