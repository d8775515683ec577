"""A state measured before the decision is carried on along the path that the robot follows."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.motion.unicycle import step_unicycle
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.prediction import predicted_pose
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.tracking.planar import PlanarTracker, TrackerSettings
from snnav_core.types import PathSource, PlannedPath, Pose2D, RobotSpec, RobotState, TimedPath

CART = RobotSpec("cart", 0.2, 0.5, 1.5)
SETTINGS = NavigatorSettings(0.5, 0.4, 4)
AREA = UnoccupiedArea(0.0, as_multipolygon(shapely.box(0, 0, 20, 12).difference(shapely.box(6, 4.5, 8, 9))))
GOAL = (18.0, 6.0)


def first_plan(pose: Pose2D, goal: tuple[float, float] = GOAL) -> PlannedPath:
    navigator = GroundNavigator([CART], SETTINGS)
    plan = navigator.step(0.0, AREA, {"cart": RobotState("cart", pose, 0.0)}, {"cart": goal}).decisions[
        "cart"
    ]
    assert isinstance(plan, PlannedPath)
    return plan


@given(st.floats(0.0, 1.0), st.floats(0.0, 0.45), st.floats(-0.6, 0.6))
def test_it_is_where_the_tracked_robot_really_is(begin: float, age: float, heading: float) -> None:
    pose = Pose2D(2.0, 6.0, heading)
    plan = first_plan(pose)
    tracker = PlanarTracker(CART, TrackerSettings(), 0.01)
    tracker.set_path(plan.path, pose.heading, plan.certificate.valid_until)
    poses = []
    for tick in range(150):
        poses.append(pose)
        command = tracker.command(pose, 0.01 * tick)
        pose = step_unicycle(pose, command.speed, command.turn_rate, 0.01)
    measured, now = round(begin * 100), round((begin + age) * 100)
    state = RobotState("cart", poses[measured], 0.01 * measured)
    predicted = predicted_pose(CART, state, plan, 0.01 * now)
    assert np.linalg.norm(predicted.position - poses[now].position) < 0.01 + 0.02 * age
    assert abs(math.remainder(predicted.heading - poses[now].heading, 2.0 * math.pi)) < 0.12


def test_a_robot_that_stands_or_was_measured_now_stays_where_it_is() -> None:
    pose = Pose2D(2.0, 6.0, 0.3)
    state = RobotState("cart", pose, 0.2)
    assert predicted_pose(CART, state, None, 0.5) == pose
    assert predicted_pose(CART, state, first_plan(pose), 0.2) == pose


def test_it_goes_no_farther_than_the_certified_window() -> None:
    pose = Pose2D(2.0, 6.0, 0.0)
    plan = first_plan(pose)
    end = plan.certificate.valid_until
    late = predicted_pose(CART, RobotState("cart", pose, 0.0), plan, end + 5.0)
    assert late == predicted_pose(CART, RobotState("cart", pose, 0.0), plan, end)


def test_a_robot_that_turns_has_turned_on() -> None:
    points = np.tile([2.0, 6.0], (9, 1))
    plan = first_plan(Pose2D(2.0, 6.0, 0.0))
    turning = PlannedPath(
        "cart", TimedPath(0.0, 0.25, points, turn_to=1.0), plan.certificate, PathSource.TURN_IN_PLACE, 0.4
    )
    state = RobotState("cart", Pose2D(2.0, 6.0, 0.0), 0.0)
    assert predicted_pose(CART, state, turning, 0.4).heading == pytest.approx(0.6)
    assert predicted_pose(CART, state, turning, 1.5).heading == pytest.approx(1.0)


@pytest.mark.parametrize("age", [0.0, 0.05, 0.3])
def test_a_certified_path_starts_where_the_robot_will_be(age: float) -> None:
    pose = Pose2D(2.0, 6.0, 0.0)
    navigator = GroundNavigator([CART], SETTINGS)
    first = navigator.step(0.0, AREA, {"cart": RobotState("cart", pose, 0.0)}, {"cart": GOAL}).decisions[
        "cart"
    ]
    assert isinstance(first, PlannedPath)
    (x, y), then = first.path.positions_at(np.array([0.5 - age, 0.5]))
    ahead = first.path.positions_at(np.array([0.55 - age]))[0] - (x, y)
    state = RobotState("cart", Pose2D(x, y, math.atan2(ahead[1], ahead[0])), 0.5 - age)
    plan = navigator.step(0.5, AREA.restamped(0.5), {"cart": state}, {"cart": GOAL}).decisions["cart"]
    assert isinstance(plan, PlannedPath)
    assert np.allclose(plan.path.points[0], then, atol=1e-9)
