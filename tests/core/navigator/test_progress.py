"""A robot that drives or turns and gets nowhere stops, says so, and tries again later."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import shapely

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.types import Pose2D, RobotSpec, RobotState, Stop, StopReason

HALL = shapely.box(0.0, 0.0, 20.0, 16.0)
WALL = shapely.box(14.0, 0.0, 14.4, 16.0)
DOORS = (shapely.box(14.0, 1.0, 14.4, 3.0), shapely.box(14.0, 13.0, 14.4, 15.0))
SETTINGS = NavigatorSettings(0.5, 0.5, 4)
CART = RobotSpec("cart", 0.3, 1.0, 1.5)
START, TARGET = Pose2D(8.0, 8.0, 1.0), (18.0, 8.0)
RESTS = StopReason.NO_PROGRESS
ALTERNATE = 4.0  # [s]: too short for the robot to get to a door


def doors(always_from: float) -> Callable[[float], UnoccupiedArea]:
    """Return a hall with a wall in it: one door is open, or the other one, from a time on both."""

    def area_at(time: float) -> UnoccupiedArea:
        both = time >= always_from
        shut = [] if both else [DOORS[int(time // ALTERNATE) % 2]]
        free = shapely.union_all([HALL.difference(WALL), *DOORS]).difference(shapely.union_all(shut))
        return UnoccupiedArea(time, as_multipolygon(free))

    return area_at


def test_a_robot_sent_to_and_fro_stops_with_a_reason_and_tries_again(closed_loop: Callable[..., Any]) -> None:
    navigator = GroundNavigator([CART], SETTINGS)
    log = closed_loop(navigator, doors(always_from=150.0), {"cart": START}, {"cart": TARGET}, 320.0)
    decisions = [(result.time, result.decisions["cart"]) for result in log.results]
    stops = [(time, d) for time, d in decisions if isinstance(d, Stop) and d.reason is RESTS]
    first, last = stops[0][0], stops[-1][0]
    assert 30.0 < first < 140.0, "not before it has tried for long, but soon enough"
    assert len(stops) == round((last - first) / 0.5) + 1 == round(120.0 / 0.5), "one rest of two minutes"
    message = stops[0][1].message
    assert "cart gets nowhere" in message
    assert "from the boundary" in message
    assert "reduce the safety margin (0.50 m)" in message
    assert decisions[-1][1].reason is StopReason.ARRIVED


def test_another_goal_ends_the_rest_at_once(closed_loop: Callable[..., Any]) -> None:
    navigator = GroundNavigator([CART], SETTINGS)
    area_at = doors(always_from=1e9)
    log = closed_loop(navigator, area_at, {"cart": START}, {"cart": TARGET}, 140.0)
    assert log.last("cart").reason is RESTS
    pose, time = log.poses["cart"][-1], log.results[-1].time + 0.5
    for goal, later in ((TARGET, 0.0), ((2.0, 8.0), 0.5)):
        state = RobotState("cart", pose, time + later, 0.0)
        result = navigator.step(time + later, area_at(time + later), {"cart": state}, {"cart": goal})
        rests = isinstance(result.decisions["cart"], Stop)
        assert rests == (goal == TARGET)


def test_waiting_is_not_counted(closed_loop: Callable[..., Any]) -> None:
    """A robot before a shut door has a reason already, and goes on when the door is open."""

    def area_at(time: float) -> UnoccupiedArea:
        free = HALL.difference(WALL) if time < 100.0 else HALL.difference(WALL).union(DOORS[0])
        return UnoccupiedArea(time, as_multipolygon(free))

    navigator = GroundNavigator([CART], SETTINGS)
    log = closed_loop(navigator, area_at, {"cart": START}, {"cart": TARGET}, 150.0)
    reasons = log.reasons("cart")
    assert set(reasons[:200]) == {"goal_unreachable"}
    assert "no_progress" not in reasons
    assert reasons[-1] == "arrived"


def test_going_back_all_the_way_is_no_standstill(closed_loop: Callable[..., Any]) -> None:
    """The door shuts in front of the robot: it goes back where it came from, for longer than it may get nowhere."""
    long_hall = shapely.box(0.0, 0.0, 30.0, 4.0)
    wall = shapely.box(3.0, 1.6, 30.0, 2.0)
    hole = shapely.box(27.0, 1.6, 29.0, 2.0)

    def area_at(time: float) -> UnoccupiedArea:
        shut = time >= 40.0
        free = long_hall.difference(wall) if shut else long_hall.difference(wall).union(hole)
        return UnoccupiedArea(time, as_multipolygon(free))

    robot = RobotSpec("cart", 0.3, 0.5, 1.0)
    log = closed_loop(
        GroundNavigator([robot], SETTINGS),
        area_at,
        {"cart": Pose2D(6.0, 0.8, 0.0)},
        {"cart": (28.0, 3.0)},
        300.0,
    )
    reasons = log.reasons("cart")
    assert "no_progress" not in reasons
    assert reasons[-1] == "arrived"
