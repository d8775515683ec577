"""The certificate in space-time refuses every single violation, and accepts nothing that dense sampling refutes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st

from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime_certificate import (
    DEVIATIONS,
    certify_in_spacetime,
)
from snnav_core.planning.spacetime_problem import OtherRobot, SpacetimeProblem, SpacetimeSettings
from snnav_core.planning.workspace import workspace_region
from snnav_core.types import Certificate, FloatArray, Pose2D, RobotSpec, TimedPath

ROBOT = RobotSpec("robot_1", 0.3, 0.5, 2.0)  # R_min = 0.25 m
SETTINGS = SpacetimeSettings()
START, STEP, LINK = 7.0, 0.3, 0.15
DEMANDED = SETTINGS.safety_margin + SETTINGS.tracking_tolerance
SQUARE = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
HALL = (np.array([[-2.0, -3.0], [9.0, -3.0], [9.0, 3.0], [-2.0, 3.0]]),)

seeds = st.integers(0, 2**32 - 1)


def straight(links: int = 40) -> FloatArray:
    return np.column_stack((LINK * np.arange(links + 1), np.zeros(links + 1)))


def check(points: FloatArray | TimedPath, *bodies: MovingObstacle, **changes: Any) -> Certificate:
    path = points if isinstance(points, TimedPath) else TimedPath(START, STEP, points)
    start = Pose2D(*path.points[0, :2].tolist(), 0.0)
    problem = SpacetimeProblem(ROBOT, start, START, np.array([6.1, 0.0]), bodies)
    return certify_in_spacetime(path, replace(problem, **changes), SETTINGS)


def refused(certificate: Certificate, *words: str) -> bool:
    return not certificate.accepted and all(word in certificate.reason for word in words)


def block(y: float, vx: float = 0.0, vy: float = 0.0, x: float = 3.0, **more: Any) -> MovingObstacle:
    return MovingObstacle(
        "block", SQUARE + np.array([x, y]), velocity=np.array([vx, vy]), stamp=START, **more
    )


def test_a_free_path_is_accepted_for_ever_with_its_figures() -> None:
    path = TimedPath(START, STEP, straight())
    verdict = check(path, block(2.0), workspace=HALL)
    assert verdict.accepted, verdict.reason
    assert verdict.least_clearance == pytest.approx(1.5)
    assert verdict.least_separation == math.inf
    assert verdict.least_radius == math.inf
    assert verdict.valid_until == math.inf
    assert verdict.path_digest == path.digest()


def test_what_is_too_near_is_named_with_place_time_and_figures() -> None:
    assert refused(
        check(straight(), block(1.0)),
        "0.559 m from body block at (2.25, 0.00) after 4.50 s, demanded 0.620 m",
    )
    # It comes from above and is over the line, 3 m from the start, when the robot is there after 6 s.
    verdict = check(straight(), block(3.0, vy=-0.5))
    assert refused(verdict, "body block", "(2.", "demanded 0.620 m")
    assert check(straight(), block(6.0, vy=-0.5, x=2.5)).accepted


def test_the_margin_is_kept_between_the_points_too() -> None:
    disk = MovingObstacle("post", np.array([[3.075, DEMANDED + 0.0001]]), 1e-4, stamp=START)
    corner = math.hypot(0.075, DEMANDED + 0.0001)
    assert corner - 1e-4 > DEMANDED + 0.004  # at the points there is enough
    assert check(straight(), disk).accepted
    assert refused(check(straight(), replace(disk, radius=2e-4)), "body post")


def test_a_robot_that_starts_too_near_may_leave_but_come_no_nearer() -> None:
    assert check(straight(), block(0.0, x=-1.11)).accepted
    assert refused(check(straight(), block(0.0, x=-1.11, vx=0.6)), "demanded 0.610 m")
    assert refused(check(straight(), block(0.0, x=0.2)), "0.000 m from body block")
    # What it lacks it has to make up for, soon.
    assert refused(check(straight(), block(1.1, x=0.0)), "0.600 m from body block", "demanded 0.620 m")
    disk = MovingObstacle("disk", np.array([[0.2, 0.0]]), 0.5, stamp=START)
    assert refused(check(straight(), disk), "demanded 0.620 m")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((20, (0.01, 0.0)), "link"),
        ((20, (0.0, 0.06)), "link"),
        ((40, (-0.5, 0.0)), "from the target"),
    ],
)
def test_a_bent_or_short_chain_is_refused(change: tuple[int, tuple[float, float]], words: str) -> None:
    points = straight()
    points[change[0]] += change[1]
    assert refused(check(points), words)


def test_links_that_are_a_little_too_long_add_up() -> None:
    """A robot at its speed falls behind: 1 % of 15 links is 2.2 cm."""
    for share, count, accepted in (
        (1.01, 15, False),
        (1.01, 13, True),
        (1.003, 40, True),
        (1.004, 40, False),
    ):
        points = straight(count) * np.array([share, 1.0])
        assert check(points, target=points[-1]).accepted == accepted
    assert refused(check(straight() * np.array([1.01, 1.0])), "m behind its timed path, tolerated 0.020 m")
    # What short links leave in reserve counts only afterwards.
    uneven = np.concatenate((np.full(20, 0.99), np.full(20, 1.01))) * LINK
    late = np.column_stack((np.concatenate(([0.0], np.cumsum(uneven))), np.zeros(41)))
    assert refused(check(late), "behind its timed path")


def test_the_radius_is_that_of_the_robot() -> None:
    def circle(radius: float) -> FloatArray:
        turn = 2.0 * math.asin(LINK / (2.0 * radius)) * np.arange(10)
        return radius * np.column_stack((np.sin(turn), 1.0 - np.cos(turn)))

    for radius, accepted in ((0.24, True), (0.23, False)):
        points = circle(radius)
        verdict = check(points, target=points[-1])
        assert verdict.accepted == accepted, verdict.reason
        assert verdict.least_radius == pytest.approx(radius)
    assert refused(check(circle(0.23), target=circle(0.23)[-1]), "least radius", "0.237 m")


def test_a_base_that_cannot_turn_in_place_starts_along_its_heading() -> None:
    assert check(straight(), start=Pose2D(0.0, 0.0, 2.0)).accepted
    stiff = replace(ROBOT, can_turn_in_place=False)
    assert refused(check(straight(), start=Pose2D(0.0, 0.0, 2.0), robot=stiff), "off the heading")
    assert check(straight(), start=Pose2D(0.0, 0.0, 0.3), robot=stiff).accepted


def test_the_path_starts_at_the_robot() -> None:
    assert refused(check(straight(), start=Pose2D(0.01, 0.0, 0.0)), "starts 0.010 m away")


def test_a_turn_in_place_stands_and_is_watched_meanwhile() -> None:
    turn = TimedPath(START, STEP, np.zeros((6, 2)), turn_to=1.0)
    assert check(turn).accepted
    assert refused(check(turn, block(2.5, x=0.0, vy=-1.0)), "body block")
    assert refused(check(turn, robot=replace(ROBOT, can_turn_in_place=False)), "cannot turn in place")


def test_the_workspace_binds_and_so_do_its_holes() -> None:
    hole = SQUARE[::-1] + np.array([3.0, 1.0])
    assert refused(check(straight(), workspace=(*HALL, hole)), "border of the workspace")
    assert check(straight(), workspace=(*HALL, hole + np.array([0.0, 0.2]))).accepted
    narrow = (HALL[0] * (1.0, 0.2),)
    assert refused(check(straight(), workspace=narrow), "border of the workspace")
    assert refused(check(straight(), workspace=(HALL[0] + (20.0, 0.0),)), "0.000 m from the border")
    assert workspace_region((*HALL, hole)).area == pytest.approx(65.0)


def other(points: FloatArray, start: float = START, distance: float = 0.8) -> OtherRobot:
    return OtherRobot("robot_2", TimedPath(start, STEP, points), distance)


def test_other_robots_are_met_in_time_and_stay_at_their_ends() -> None:
    across = np.column_stack((np.full(41, 3.0), 3.0 - LINK * np.arange(41)))
    assert refused(check(straight(), others=(other(across),)), "robot robot_2", "demanded 0.840 m")
    late = check(straight(), others=(other(across, START + 9.0),))
    assert late.accepted, late.reason
    times = np.linspace(START, START + 12.0, 4001)
    apart = np.hypot(
        *(
            TimedPath(START, STEP, straight()).positions_at(times)
            - TimedPath(START + 9.0, STEP, across).positions_at(times)
        ).T
    )
    assert late.least_separation == pytest.approx(apart.min(), abs=1e-5)
    assert refused(check(straight(), others=(other(across[:21]),)), "robot robot_2")
    # It crosses the end of the path when the robot has long been there.
    assert refused(
        check(straight(), others=(other(across + np.array([3.0, 0.0]), START + 60.0),)), "robot robot_2"
    )


def test_a_last_link_is_safe_at_full_speed_too() -> None:
    points = np.vstack((straight(), [[6.075, 0.0]]))
    path = TimedPath(START, STEP, points)
    # It runs ahead, a little slower than the robot, but faster than one that takes the whole step for half a link.
    begin = START + 40 * STEP
    disk = MovingObstacle("disk", np.array([[6.104 + DEMANDED, 0.0]]), 0.1, np.array([0.45, 0.0]), begin)
    times = np.linspace(START, path.end_time, 2000)
    apart = disk.outline[0, 0] + 0.45 * (times - begin) - path.positions_at(times)[:, 0] - 0.1
    assert apart.min() > DEMANDED + 0.003
    assert refused(check(points, disk), "body disk", "(6.0", "after 12.1")
    assert check(straight(), disk).accepted


def test_it_holds_until_a_body_comes_to_the_end() -> None:
    body = block(0.0, x=20.0, vx=-0.5)
    verdict = check(straight(), body)
    assert verdict.accepted
    assert verdict.valid_until == pytest.approx(START + (20.0 - 0.5 - DEMANDED - 6.0) / 0.5, abs=1e-4)
    assert check(straight(), block(3.0, x=20.0, vx=-0.5)).valid_until == math.inf


def test_deviations_limit_the_time_and_not_the_margin() -> None:
    near = block(0.5 + DEMANDED + 1e-6)
    assert check(straight(), near).valid_until == math.inf
    doubtful = replace(near, velocity_deviation=0.03)
    verdict = check(straight(), doubtful)
    assert verdict.accepted
    # up to one link the time at which three deviations eat the way from the margin to the robot's body
    least = math.hypot(DEMANDED, max(0.0, 2.5 - 0.5 * (verdict.valid_until - START)))
    assert least >= 0.32 + DEVIATIONS * 0.03 * (verdict.valid_until - START)
    assert verdict.valid_until > START + 2.0


@given(seeds)
def test_nothing_is_accepted_that_sampling_refutes_and_figures_are_exact(seed: int) -> None:
    draws = np.random.default_rng(seed)
    turns = np.cumsum(draws.uniform(-0.5, 0.5, 30)) * draws.integers(0, 2)
    points = np.vstack(
        ([[0.0, 0.0]], np.cumsum(LINK * np.column_stack((np.cos(turns), np.sin(turns))), axis=0))
    )
    bodies = tuple(
        MovingObstacle(
            f"body_{k}",
            draws.uniform(-3.0, 6.0, 2) + draws.uniform(-0.8, 0.8, (int(draws.integers(1, 5)), 2)),
            float(draws.uniform(0.05, 0.4)),
            draws.uniform(-0.4, 0.4, 2),
            START + float(draws.uniform(-2.0, 2.0)),
        )
        for k in range(3)
    )
    path = TimedPath(START, STEP, points)
    times = np.linspace(START, path.end_time, 3001)
    places = path.positions_at(times)
    sampled = np.full(len(times), math.inf)
    for body in bodies:
        moved = shapely.points(places - body.velocity * (times - body.stamp)[:, None])
        shape = shapely.MultiPoint(body.outline).convex_hull
        exact = shape if len(body.outline) < 4 else shapely.Polygon(body.outline)
        sampled = np.minimum(
            sampled, shapely.distance(moved, exact if exact.is_valid else shape) - body.radius
        )
    assume(sampled[0] > 0.0)
    verdict = check(path, *bodies, target=points[-1])
    moving = (0.5 + 0.6) * (times[1] - times[0])
    assert sampled.min() - moving <= verdict.least_clearance <= sampled.min() + 1e-9
    if verdict.accepted:
        assert sampled.min() >= min(DEMANDED, sampled[0]) - 1e-8
    elif "from body" in verdict.reason:
        assert sampled.min() - moving < DEMANDED
