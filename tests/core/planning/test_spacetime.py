"""Plans in space-time keep their margins, know both sides of a body, and fail for typed reasons."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from snnav_core.errors import GoalBlocked, NoPathFound, PlanningError, StartBlocked
from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime import plan_in_spacetime, plan_in_turn
from snnav_core.planning.spacetime_problem import (
    CandidateOutcome,
    SpacetimePlan,
    SpacetimeProblem,
    SpacetimeSettings,
)
from snnav_core.types import FloatArray, Pose2D, RobotSpec

ROBOT = RobotSpec("robot", 0.3, 0.5, 2.0)
SETTINGS = SpacetimeSettings()


def box(x: float, y: float, width: float, height: float) -> FloatArray:
    return np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])


def problem(*obstacles: MovingObstacle, target: tuple[float, float] = (10.0, 0.0)) -> SpacetimeProblem:
    return SpacetimeProblem(ROBOT, Pose2D(0.0, 0.0, 0.0), 0.0, np.array(target), obstacles)


def plan(given: SpacetimeProblem, settings: SpacetimeSettings = SETTINGS) -> SpacetimePlan:
    return plan_in_spacetime(given, settings, np.random.default_rng(1))


def clearance(answer: SpacetimePlan, obstacle: MovingObstacle) -> float:
    """Return the least distance at many instants, against shapely."""
    path = answer.path
    times = np.linspace(path.start_time, path.end_time, 20 * len(path))
    least = math.inf
    for time, place in zip(times, path.positions_at(times), strict=True):
        outline = obstacle.outline_at(float(time))
        body = shapely.Polygon(outline) if len(outline) > 2 else shapely.MultiPoint(outline)
        least = min(least, shapely.distance(shapely.Point(place), body) - obstacle.radius)
    return least


def test_an_empty_plane_is_crossed_on_a_straight_line() -> None:
    answer = plan(problem())
    assert answer.travel_time == pytest.approx(20.0, abs=0.01)
    assert answer.path.length == pytest.approx(10.0, abs=1e-3)


def test_both_sides_of_a_disk_are_candidates() -> None:
    answer = plan(problem(MovingObstacle("disk", [[5.0, 0.1]], radius=0.5)))
    reached = [one for one in answer.candidates if one.travel_time < math.inf]
    assert {one.turns for one in reached} == {(("disk", 1),), (("disk", -1),)}
    # The centre is on the left of the straight line, so that passing it on the right is shorter.
    assert answer.path.points[len(answer.path) // 2, 1] < 0.0
    assert answer.travel_time == min(one.travel_time for one in reached)


def test_the_margin_is_kept_from_moving_bodies() -> None:
    bodies = (
        MovingObstacle("block", box(3.0, -1.0, 1.0, 1.5)),
        MovingObstacle("down", [[6.0, 3.0]], 0.4, [0.0, -0.18]),
        MovingObstacle("up", [[8.0, -4.0]], 0.5, [-0.1, 0.2]),
    )
    answer = plan(problem(*bodies), replace(SETTINGS, safety_margin=0.8))
    assert answer.certificate.accepted
    for body in bodies:
        assert clearance(answer, body) >= 0.8 + SETTINGS.tracking_tolerance - 1e-6
    links = np.hypot(*np.diff(answer.path.points, axis=0).T)
    assert links[:-1] == pytest.approx(0.15, rel=0.02)


def test_a_blocked_start_names_body_place_and_time() -> None:
    with pytest.raises(StartBlocked, match=r"\(0\.00, 0\.00\).*crate.*0\.00 s"):
        plan(problem(MovingObstacle("crate", box(0.1, -1.0, 1.0, 2.0))))


def test_a_target_that_a_body_passes_later_is_blocked() -> None:
    late = MovingObstacle("late", [[10.0, 8.0]], 0.5, [0.0, -0.2])
    with pytest.raises(GoalBlocked, match=r"\(10\.00, 0\.00\).*late at 3\d\.\d\d s"):
        plan(problem(late))


def test_a_body_that_passes_the_target_before_anyone_can_be_there_does_not_block_it() -> None:
    early = MovingObstacle("early", [[10.0, 2.0]], 0.5, [0.0, -0.4])
    assert plan(problem(early)).travel_time == pytest.approx(20.0, abs=0.5)


def test_a_robot_between_walls_of_bodies_finds_no_path() -> None:
    walls = (
        MovingObstacle("south", box(-3.0, -3.0, 6.0, 1.0)),
        MovingObstacle("north", box(-3.0, 2.0, 6.0, 1.0)),
        MovingObstacle("west", box(-3.0, -2.5, 1.0, 5.0)),
        MovingObstacle("east", box(2.0, -2.5, 1.0, 5.0)),
    )
    with pytest.raises(PlanningError):
        plan(problem(*walls))


def test_the_same_seed_gives_the_same_history() -> None:
    given = problem(MovingObstacle("a", [[3.0, 0.0]], 0.5), MovingObstacle("b", [[7.0, 0.0]], 0.5))
    first, second = plan(given), plan(given)
    assert first.path.digest() == second.path.digest()
    assert [one.turns for one in first.candidates] == [one.turns for one in second.candidates]
    reached = {one.turns for one in first.candidates if one.travel_time < math.inf}
    assert reached == {(("a", p), ("b", q)) for p in (-1, 1) for q in (-1, 1)}


def test_robots_planned_in_turn_keep_apart() -> None:
    turns = (0.0, 1.3, 3.3, 4.4)
    problems = [
        SpacetimeProblem(
            RobotSpec(f"r{i}", 0.3, 0.5, 2.0),
            Pose2D(4.0 * math.cos(angle), 4.0 * math.sin(angle), angle + math.pi),
            0.0,
            np.array([-4.0 * math.cos(angle + 0.1), -4.0 * math.sin(angle + 0.1)]),
        )
        for i, angle in enumerate(turns)
    ]
    answers = plan_in_turn(problems, replace(SETTINGS, safety_margin=0.8), np.random.default_rng(1))
    paths = [answer.path for answer in answers.values() if isinstance(answer, SpacetimePlan)]
    assert len(paths) == 4
    times = np.arange(0.0, max(path.end_time for path in paths), 0.05)
    places = np.stack([path.positions_at(times) for path in paths])
    gaps = np.linalg.norm(places[:, None] - places[None], axis=-1)[~np.eye(4, dtype=np.bool_)]
    assert gaps.min() >= 0.8


def test_what_the_certificate_refuses_is_never_returned() -> None:
    sharp = RobotSpec("slow turner", 0.3, 0.5, 0.5)
    given = replace(problem(MovingObstacle("post", box(4.9, -0.1, 0.2, 0.2))), robot=sharp)
    try:
        answer = plan(given)
    except NoPathFound:
        return
    assert answer.certificate.least_radius >= 0.95 * sharp.min_turn_radius
    assert all(one.reason for one in answer.candidates if one.outcome is not CandidateOutcome.REACHED)
