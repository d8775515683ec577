"""A robot without a safe way to its target makes room for what comes nearer, and goes on when it has passed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.navigator.attempt import Attempt
from snnav_core.navigator.context import AreaContext
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.plans import turn_and_leg, turn_on
from snnav_core.navigator.search import find_route
from snnav_core.navigator.settings import NavigatorSettings, RobotDistances
from snnav_core.types import PathSource, PlannedPath, Pose2D, RobotSpec, Stop, StopReason, TimedPath

HALL = shapely.box(0.0, 0.0, 20.0, 12.0)
SETTINGS = NavigatorSettings(0.5, 0.5, 4, boundary_speed=0.4)
CART = RobotSpec("cart", 0.3, 0.8, 1.5)
RADIUS = 0.3  # of the walker [m]
SHUT = shapely.box(12.0, 0.0, 12.4, 12.0)


def walker(begin: tuple[float, float], velocity: tuple[float, float], time: float) -> shapely.Geometry:
    return shapely.Point(np.add(begin, np.multiply(velocity, time))).buffer(RADIUS, quad_segs=32)


def rooms(
    begin: tuple[float, float], velocity: tuple[float, float], shut_until: float
) -> Callable[[float], UnoccupiedArea]:
    def area_at(time: float) -> UnoccupiedArea:
        bodies = [walker(begin, velocity, time)] + ([SHUT] if time < shut_until else [])
        return UnoccupiedArea(time, as_multipolygon(HALL.difference(shapely.union_all(bodies))))

    return area_at


@pytest.mark.parametrize(
    ("begin", "velocity", "start"),
    [
        ((9.0, 6.0), (-0.4, 0.0), Pose2D(4.0, 6.0, 0.0)),  # straight at the waiting robot
        ((2.0, 6.3), (0.3, 0.0), Pose2D(8.0, 6.0, 0.0)),  # from behind
        ((6.0, 11.0), (0.0, -0.35), Pose2D(6.0, 5.0, 1.0)),  # from the side
    ],
)
def test_a_waiting_robot_keeps_the_margin_to_what_walks_at_it_and_arrives_later(
    closed_loop: Callable[..., Any],
    begin: tuple[float, float],
    velocity: tuple[float, float],
    start: Pose2D,
) -> None:
    area_at = rooms(begin, velocity, shut_until=20.0)
    log = closed_loop(
        GroundNavigator([CART], SETTINGS), area_at, {"cart": start}, {"cart": (17.0, 6.0)}, 80.0
    )
    assert "evasion" in log.reasons("cart")
    last = log.last("cart")
    assert isinstance(last, Stop)
    assert last.reason is StopReason.ARRIVED
    times = 0.05 * np.arange(len(log.poses["cart"]))
    centres = np.add(begin, times[:, None] * np.asarray(velocity))
    gap = np.linalg.norm(log.positions("cart") - centres, axis=1) - RADIUS
    assert gap.min() >= SETTINGS.safety_margin
    standing = np.linalg.norm(start.position - centres, axis=1) - RADIUS
    assert standing[: round(20.0 / 0.05)].min() < SETTINGS.safety_margin, "it had to move"


def test_where_nothing_comes_nearer_than_the_margin_a_waiting_robot_stands(
    closed_loop: Callable[..., Any],
) -> None:
    area_at = rooms((2.0, 10.0), (0.3, 0.0), shut_until=100.0)
    log = closed_loop(
        GroundNavigator([CART], SETTINGS),
        area_at,
        {"cart": Pose2D(6.0, 4.0, 0.0)},
        {"cart": (17.0, 6.0)},
        20.0,
    )
    assert set(log.reasons("cart")) == {"goal_unreachable"}
    assert np.ptp(log.positions("cart"), axis=0).max() == 0.0


def test_when_nothing_can_move_nobody_evades(closed_loop: Callable[..., Any]) -> None:
    still = NavigatorSettings(0.5, 0.5, 4)
    area_at = rooms((4.2, 4.0), (0.0, 0.0), shut_until=100.0)
    log = closed_loop(
        GroundNavigator([CART], still), area_at, {"cart": Pose2D(5.4, 4.0, 0.0)}, {"cart": (17.0, 6.0)}, 5.0
    )
    assert not any(isinstance(result.decisions["cart"], PlannedPath) for result in log.results)


def test_a_turn_in_place_that_was_begun_is_ended_when_another_one_would_do_as_well() -> None:
    context = AreaContext(UnoccupiedArea(0.0, as_multipolygon(HALL)), 0.0)
    distances, pose = RobotDistances(CART, SETTINGS), Pose2D(5.0, 6.0, 0.0)
    attempt = Attempt(context, CART, pose, np.array([17.0, 6.0]), 0.0, (), distances, SETTINGS, 0.6)
    points = np.tile([5.0, 6.0], (9, 1))
    begun = attempt.planned(TimedPath(0.0, distances.step, points, turn_to=2.0), PathSource.TURN_IN_PLACE)
    later = replace(attempt, time=0.5, pose=Pose2D(5.0, 6.0, 0.75))
    going_on = turn_on(later, begun)
    assert going_on is not None
    assert going_on.path.turn_to == pytest.approx(2.0)
    assert going_on.certificate.accepted
    assert turn_on(replace(attempt, pose=Pose2D(5.0, 6.0, 2.0)), begun) is None
    assert turn_on(later, None) is None


@pytest.mark.parametrize(("off", "drives"), [(0.05, True), (-0.14, True), (0.2, False)])
def test_a_robot_that_has_turned_drives_off_although_noise_has_moved_the_bend(
    off: float, drives: bool
) -> None:
    context = AreaContext(UnoccupiedArea(0.0, as_multipolygon(HALL)), 0.0)
    distances, pose, target = RobotDistances(CART, SETTINGS), Pose2D(5.0, 6.0, off), np.array([17.0, 6.0])
    attempt = Attempt(context, CART, pose, target, 0.5, (), distances, SETTINGS, 0.6)
    route = find_route(context, CART, pose, target, distances, SETTINGS, ())
    points = np.tile([5.0, 6.0], (9, 1))
    turned = attempt.planned(TimedPath(0.0, distances.step, points, turn_to=off), PathSource.TURN_IN_PLACE)
    plan = turn_and_leg(attempt, route, turned)
    assert plan is not None
    assert plan.certificate.accepted
    assert (plan.path.turn_to is None) == drives
    if drives:
        way = plan.path.points[-1, :2] - plan.path.points[0, :2]
        assert np.arctan2(way[1], way[0]) == pytest.approx(off)
    again = turn_and_leg(attempt, route, None)
    assert again is not None
    assert again.path.turn_to == pytest.approx(0.0, abs=1e-6)
