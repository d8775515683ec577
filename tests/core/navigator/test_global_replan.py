"""What the global navigator does when the world is not as its plan took it to be."""

from __future__ import annotations

import numpy as np
import pytest

from snnav_core.area.tracks import TrackedScene
from snnav_core.navigator.global_ground import GlobalNavigator
from snnav_core.navigator.global_settings import GlobalSettings
from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime_problem import SpacetimeSettings
from snnav_core.types import PlannedPath, Pose2D, RobotSpec, RobotState, Stop, StopReason

HALL = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 8.0], [0.0, 8.0]])
GOAL = {"cart": (10.0, 2.0)}


def navigator(lead: int = 0) -> GlobalNavigator:
    settings = GlobalSettings(SpacetimeSettings(safety_margin=0.6), retry=1, lead=lead)
    return GlobalNavigator([RobotSpec("cart", 0.3, 0.5, 2.0)], settings)


def decide(
    planner: GlobalNavigator, time: float, x: float, *bodies: MovingObstacle, workspace: tuple = (HALL,)
) -> PlannedPath | Stop:
    states = {"cart": RobotState("cart", Pose2D(x, 2.0, 0.0), time)}
    return planner.step(time, TrackedScene(time, bodies, workspace), states, GOAL).decisions["cart"]


def test_path_that_does_not_hold_is_left_at_once_although_another_one_arrives_later() -> None:
    planner = navigator()
    first = decide(planner, 1.0, 2.0, MovingObstacle("body_1", [[5.0, 3.3]], 0.3, [0.0, 0.1], 1.0))
    assert isinstance(first, PlannedPath)
    plan = planner.plans["cart"]
    turned = MovingObstacle("body_1", [[5.0, 3.33]], 0.3, [0.0, -0.3], 1.3)
    second = decide(planner, 1.3, 2.15, turned)
    assert isinstance(second, PlannedPath)
    assert planner.plans["cart"] is not plan
    assert planner.plans["cart"].path.end_time > first.path.end_time


def test_nothing_free_is_a_typed_stop_and_no_open_plane() -> None:
    planner = navigator()
    assert isinstance(decide(planner, 1.0, 2.0), PlannedPath)
    stop = decide(planner, 1.3, 2.15, workspace=())
    assert isinstance(stop, Stop)
    assert stop.reason is StopReason.NO_AREA
    assert isinstance(decide(planner, 1.6, 2.15), PlannedPath)


def test_robot_that_drives_does_not_stop_for_another_path_where_computing_takes_time() -> None:
    planner = navigator(lead=4)
    first = decide(planner, 1.0, 2.0, MovingObstacle("body_1", [[5.0, 3.3]], 0.3, [0.0, 0.1], 1.0))
    assert isinstance(first, PlannedPath)
    assert planner.plans["cart"].path.start_time == pytest.approx(2.2)
    decide(planner, 2.2, 2.0, MovingObstacle("body_1", [[5.0, 3.42]], 0.3, [0.0, 0.1], 2.2))
    turned = MovingObstacle("body_1", [[5.0, 3.5]], 0.3, [0.0, -0.3], 2.5)
    second = decide(planner, 2.5, 2.15, turned)
    assert isinstance(second, PlannedPath)
    assert planner.plans["cart"].path.start_time < 2.5 + 4 * 0.3
