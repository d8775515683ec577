"""One decision step: typed reasons with their values, and no path on inputs that lie."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
import shapely

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.errors import InvalidInput
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.types import (
    PathSource,
    PlannedPath,
    Pose2D,
    RobotSpec,
    RobotState,
    StepResult,
    Stop,
    StopReason,
)
from support.hall import area

Decision = PlannedPath | Stop
START, GOAL = Pose2D(2.0, 6.0, 0.0), (18.0, 6.0)
SETTINGS = NavigatorSettings(0.5, 0.4, 4)


def navigator(settings: NavigatorSettings = SETTINGS, names: Sequence[str] = ("robot",)) -> GroundNavigator:
    return GroundNavigator([RobotSpec(name, 0.2, 0.5, 1.5) for name in names], settings)


def step(
    nav: GroundNavigator,
    time: float = 0.0,
    free: UnoccupiedArea | None = None,
    pose: Pose2D = START,
    goal: tuple[float, float] | None = GOAL,
    stamp: float | None = None,
) -> Decision:
    """Return the decision for one robot."""
    states = {"robot": RobotState("robot", pose, time if stamp is None else stamp)}
    goals = {} if goal is None else {"robot": goal}
    return nav.step(time, area().restamped(time) if free is None else free, states, goals).decisions["robot"]


def stopped(decision: Decision, reason: StopReason, *words: str) -> bool:
    return (
        isinstance(decision, Stop) and decision.reason is reason and all(w in decision.message for w in words)
    )


def planned(decision: Decision) -> PlannedPath:
    assert isinstance(decision, PlannedPath), decision
    return decision


def test_a_path_in_a_free_hall_is_certified_for_the_whole_window() -> None:
    plan = planned(step(navigator(), time=3.0))
    assert plan.certificate.accepted
    assert plan.certificate.valid_until == 5.0
    assert plan.certificate.path_digest == plan.path.digest()
    assert plan.path.start_time == 3.0
    assert plan.path.length == pytest.approx(16.0, abs=0.01)
    np.testing.assert_allclose(plan.path.points[-1], GOAL, atol=1e-6)


@pytest.mark.parametrize("distance", [0.0, 0.05, 0.0999])
def test_near_the_target_the_robot_has_arrived(distance: float) -> None:
    decision = step(navigator(), pose=Pose2D(18.0 - distance, 6.0, 1.0))
    assert stopped(decision, StopReason.ARRIVED, f"robot is {distance:.2f} m from its target")


def test_arrived_it_stays_so_until_another_goal_is_set() -> None:
    nav = navigator()
    assert stopped(step(nav, 0.0, pose=Pose2D(18.0, 6.0, 0.0)), StopReason.ARRIVED)
    assert stopped(step(nav, 0.5, pose=Pose2D(17.5, 6.0, 0.0)), StopReason.ARRIVED), "pushed away"
    planned(step(nav, 1.0, pose=Pose2D(17.5, 6.0, 0.0), goal=(2.0, 6.0)))


def test_without_goal_state_or_area_there_is_no_path() -> None:
    assert stopped(step(navigator(), goal=None), StopReason.NO_GOAL, "robot robot has no goal")
    missing = navigator().step(0.0, area(), {}, {"robot": GOAL}).decisions["robot"]
    assert stopped(missing, StopReason.NO_STATE, "pose of robot robot is missing")
    nothing = UnoccupiedArea.from_rings(0.0, [])
    assert stopped(step(navigator(), free=nothing), StopReason.NO_AREA, "0.00 s", "check the sensors")


@pytest.mark.parametrize(
    ("pose", "clearance"),
    [(Pose2D(-3.0, 6.0, 0.0), "-3.00"), (Pose2D(0.1, 6.0, 0.0), "0.10"), (Pose2D(10.0, 6.0, 0.0), "-1.00")],
)
def test_outside_the_area_or_touching_its_boundary_the_start_is_blocked(pose: Pose2D, clearance: str) -> None:
    decision = step(navigator(), free=area(shapely.box(9.0, 5.0, 11.0, 7.0)), pose=pose)
    place = f"({pose.x:.2f}, {pose.y:.2f})"
    assert stopped(decision, StopReason.START_BLOCKED, place, f"{clearance} m", "radius 0.20 m")


@pytest.mark.parametrize("goal", [(18.0, 0.2), (18.0, -5.0), (1e12, 6.0), (-1e150, 1e150)])
def test_a_target_too_near_the_boundary_or_outside_is_blocked(goal: tuple[float, float]) -> None:
    decision = step(navigator(), goal=goal)
    assert stopped(
        decision, StopReason.GOAL_BLOCKED, f"({goal[0]:.2f}, {goal[1]:.2f})", "safety margin 0.40 m"
    )


def test_a_target_a_little_too_near_is_replaced_by_a_point_that_counts_as_arrived(
    closed_loop: Callable[..., Any],
) -> None:
    goal = (18.0, 0.35)
    log = closed_loop(navigator(), area().restamped, {"robot": START}, {"robot": goal}, 60.0)
    assert stopped(log.last("robot"), StopReason.ARRIVED)
    end = log.positions("robot")[-1]
    assert math.dist(end, goal) <= 0.125 + 0.1
    assert area().clearance(log.positions("robot")).min() >= 0.4


@pytest.mark.parametrize("gap", [0.0, 0.7])
def test_a_target_behind_a_wall_or_too_narrow_a_gap_is_unreachable(gap: float) -> None:
    wall = shapely.union_all([shapely.box(9, 0, 11, 6 - 0.5 * gap), shapely.box(9, 6 + 0.5 * gap, 11, 12)])
    decision = step(navigator(), free=area(wall))
    assert stopped(
        decision, StopReason.GOAL_UNREACHABLE, "0.403 m", "(2.00, 6.00) to (18.00, 6.00)", "margin (0.40 m)"
    )


def test_without_turning_on_the_spot_a_dead_end_yields_no_path() -> None:
    robot = RobotSpec("robot", 0.2, 0.5, 0.5, can_turn_in_place=False)
    nav = GroundNavigator([robot], NavigatorSettings(0.5, 0.4, 4))
    pocket = area(shapely.box(0, 2, 6, 5.4), shapely.box(0, 6.6, 6, 10))
    decision = step(nav, free=pocket, pose=Pose2D(1.0, 6.0, math.pi))
    assert stopped(decision, StopReason.NO_PATH, "candidates, none certified")


@pytest.mark.parametrize(
    "pose", [Pose2D(math.nan, 6.0, 0.0), Pose2D(2.0, math.inf, 0.0), Pose2D(2.0, 6.0, math.nan)]
)
def test_a_pose_that_is_not_finite_is_no_state(pose: Pose2D) -> None:
    assert stopped(step(navigator(), pose=pose), StopReason.NO_STATE, "check its odometry")


@pytest.mark.parametrize("stamp", [9.4, 8.0, 10.6, 99.0, math.nan, -math.inf])
def test_a_state_from_another_time_is_no_state(stamp: float) -> None:
    assert stopped(step(navigator(), 10.0, stamp=stamp), StopReason.NO_STATE, "s ago")


def test_a_state_one_interval_old_is_still_used() -> None:
    planned(step(navigator(), 10.0, stamp=9.5))


@pytest.mark.parametrize("goal", [(math.nan, 6.0), (18.0, math.inf)])
def test_a_goal_that_is_not_finite_is_none(goal: tuple[float, float]) -> None:
    assert stopped(step(navigator(), goal=goal), StopReason.NO_GOAL, "not finite")


@pytest.mark.parametrize("time", [math.nan, math.inf, -math.inf])
def test_a_time_that_is_not_finite_is_refused(time: float) -> None:
    nav = navigator()
    with pytest.raises(InvalidInput, match="must be finite"):
        step(nav, time, free=area())
    planned(step(nav, 1.0))


@pytest.mark.parametrize("stamp", [7.9, 10.6, 1e9, math.nan, -math.inf])
def test_an_area_older_than_the_window_or_from_the_future_counts_as_none(stamp: float) -> None:
    assert stopped(step(navigator(), 10.0, area(stamp=stamp)), StopReason.NO_AREA)


def test_an_older_area_is_reduced_by_what_its_boundary_may_have_moved_since() -> None:
    nav = navigator(NavigatorSettings(0.5, 0.4, 4, boundary_speed=0.2))
    wall = shapely.box(0.0, 6.8, 20.0, 12.0)
    assert planned(step(nav, 10.0, area(wall, stamp=10.0), pose=START)).certificate.area_stamp == 10.0
    old = planned(step(nav, 10.0, area(wall, stamp=9.0), pose=Pose2D(2.0, 5.0, 0.0), goal=(18.0, 4.0)))
    assert old.certificate.area_stamp == 9.0
    fresh = planned(step(nav, 10.0, area(wall, stamp=10.0), pose=Pose2D(2.0, 5.0, 0.0), goal=(18.0, 4.0)))
    assert old.certificate.least_clearance <= fresh.certificate.least_clearance - 0.19
    blocked = step(navigator(NavigatorSettings(0.5, 0.4, 4, boundary_speed=0.4)), 10.0, area(wall, stamp=8.4))
    assert stopped(blocked, StopReason.START_BLOCKED, "0.16 m")


def test_states_and_goals_of_unknown_robots_are_ignored() -> None:
    states = {name: RobotState(name, START, 0.0) for name in ("robot", "stranger")}
    result = navigator().step(0.0, area(), states, {"robot": GOAL, "stranger": GOAL})
    assert set(result.decisions) == {"robot"}
    planned(result.decisions["robot"])


def test_a_new_goal_is_planned_for_at_once_also_after_a_failure_in_the_same_situation() -> None:
    nav = navigator()
    assert stopped(step(nav, 0.0, goal=(18.0, 0.1)), StopReason.GOAL_BLOCKED)
    assert stopped(step(nav, 0.0, goal=(18.0, 0.1)), StopReason.GOAL_BLOCKED)
    plan = planned(step(nav, 0.0, goal=(18.0, 9.0)))
    np.testing.assert_allclose(plan.path.points[-1], (18.0, 9.0), atol=1e-6)
    turned = planned(step(nav, 0.5, goal=(18.0, 3.0)))
    np.testing.assert_allclose(turned.path.points[-1], (18.0, 3.0), atol=1e-6)


def test_a_failure_ends_when_the_way_is_free_again() -> None:
    nav, wall = navigator(), shapely.box(9.0, 0.0, 11.0, 12.0)
    for k in range(4):
        assert stopped(step(nav, 0.5 * k, area(wall, stamp=0.5 * k)), StopReason.GOAL_UNREACHABLE)
    decisions = [step(nav, 0.5 * k, area(stamp=0.5 * k)) for k in range(4, 12)]
    assert isinstance(decisions[-1], PlannedPath)


def test_a_plan_made_for_another_area_is_never_kept_against_the_present_one() -> None:
    """The last path leads through what is a wall now."""
    nav = navigator()
    planned(step(nav, 0.0))
    for x in (2.7, 4.0, 10.0):
        wall = shapely.box(x, 0.0, x + 0.3, 12.0)
        decision = step(nav, 0.5, area(wall, stamp=0.5), pose=Pose2D(2.25, 6.0, 0.0))
        assert stopped(decision, StopReason.GOAL_UNREACHABLE) or stopped(decision, StopReason.START_BLOCKED)
        nav.reset()
        planned(step(nav, 0.0))
    around = planned(step(nav, 0.5, area(shapely.box(5, 4, 6, 8), stamp=0.5), pose=Pose2D(2.25, 6.0, 0.0)))
    assert around.certificate.least_clearance >= 0.4


def results_of(nav: GroundNavigator, times: Sequence[float]) -> list[StepResult]:
    states = {"robot": RobotState("robot", START, 0.0)}
    box = area(shapely.box(9.0, 5.0, 11.0, 7.2))
    return [
        nav.step(
            t, box.restamped(t), {k: RobotState(k, s.pose, t) for k, s in states.items()}, {"robot": GOAL}
        )
        for t in times
    ]


def digests(results: Sequence[StepResult]) -> list[str]:
    return [planned(result.decisions["robot"]).path.digest() for result in results]


def test_a_jump_of_time_backwards_forgets_everything() -> None:
    fresh = digests(results_of(navigator(), (0.0, 0.5)))
    nav = navigator()
    results_of(nav, (5.0, 5.5, 6.0))
    assert digests(results_of(nav, (0.0, 0.5))) == fresh
    nav.reset()
    assert digests(results_of(nav, (0.0, 0.5))) == fresh


def test_the_same_time_twice_is_allowed_and_gives_the_same_path_length() -> None:
    first, second = results_of(navigator(), (1.0, 1.0))
    lengths = [planned(result.decisions["robot"]).path.length for result in (first, second)]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.01)


def test_ids_must_differ_and_robots_must_fit_the_settings() -> None:
    with pytest.raises(InvalidInput, match="not all different"):
        navigator(names=("a", "a"))
    with pytest.raises(InvalidInput, match=r"safety_margin 0\.4 m is below the radius 0\.5 m of robot big"):
        GroundNavigator([RobotSpec("big", 0.5, 0.5, 1.5)], SETTINGS)
    with pytest.raises(InvalidInput, match=r"boundary_speed 0\.5 m/s must be below the speed 0\.5 m/s"):
        navigator(NavigatorSettings(0.5, 0.4, 4, boundary_speed=0.5))


@pytest.mark.parametrize("bearing", [0.0, 1.0, 2.2, math.pi, -1.6])
@pytest.mark.parametrize("distance", [0.13, 0.2, 0.35, 0.8])
def test_a_target_close_by_is_reached_from_any_heading(
    closed_loop: Callable[..., Any], distance: float, bearing: float
) -> None:
    pose = Pose2D(10.0, 6.0, 0.0)
    goal = (10.0 + distance * math.cos(bearing), 6.0 + distance * math.sin(bearing))
    log = closed_loop(navigator(), area().restamped, {"robot": pose}, {"robot": goal}, 20.0)
    assert stopped(log.last("robot"), StopReason.ARRIVED)


@pytest.mark.parametrize("heading", [0.0, 0.5, math.pi])
@pytest.mark.parametrize("extra", [-0.15, 0.0, 0.05, 0.15])
def test_a_robot_near_its_margin_turns_and_leaves(
    closed_loop: Callable[..., Any], extra: float, heading: float
) -> None:
    """With V_max delta = 0.1 m a boundary nearer than 0.5 m may come too near while it stands."""
    nav = navigator(NavigatorSettings(0.5, 0.4, 4, boundary_speed=0.2))
    pose = Pose2D(5.0, 0.4 + extra, heading)
    log = closed_loop(nav, area().restamped, {"robot": pose}, {"robot": (12.0, 6.0)}, 40.0)
    assert stopped(log.last("robot"), StopReason.ARRIVED)
    clearance = area().clearance(log.positions("robot"))
    assert clearance.min() >= min(0.4, 0.4 + extra) - 0.004, "never nearer than the tracking tolerance"


def test_in_a_dead_end_the_robot_turns_on_the_spot(closed_loop: Callable[..., Any]) -> None:
    pocket = area(shapely.box(0, 2, 6, 5.4), shapely.box(0, 6.6, 6, 10))
    log = closed_loop(
        navigator(), pocket.restamped, {"robot": Pose2D(1.0, 6.0, math.pi)}, {"robot": GOAL}, 60.0
    )
    assert log.reasons("robot")[0] == PathSource.TURN_IN_PLACE.value
    assert stopped(log.last("robot"), StopReason.ARRIVED)
    assert pocket.clearance(log.positions("robot")).min() >= 0.4


def test_between_two_equal_ways_the_robot_does_not_waver(closed_loop: Callable[..., Any]) -> None:
    """The obstacle in the middle changes by a centimetre in every step, now here, now there."""

    def free(time: float) -> UnoccupiedArea:
        shift = 0.01 if round(time / 0.5) % 2 else -0.01
        return area(shapely.box(9.0, 4.0 + shift, 11.0, 8.0 + shift), stamp=time)

    log = closed_loop(navigator(), free, {"robot": START}, {"robot": GOAL}, 60.0)
    assert stopped(log.last("robot"), StopReason.ARRIVED)
    sides = set()
    for result in log.results:
        decision = result.decisions["robot"]
        if isinstance(decision, PlannedPath) and decision.path.points[0, 0] < 9.0:
            beside = decision.path.points[np.abs(decision.path.points[:, 0] - 10.0) < 0.5]
            sides.update((beside[:, 1] > 6.0).tolist())
    assert len(sides) == 1


def test_a_robot_that_stands_and_faces_away_turns_where_its_circles_would_take_it_far_round(
    closed_loop: Callable[..., Any],
) -> None:
    """A block beside it leaves the circle on one side only: three quarters of a turn, or a turn on the spot."""
    free, begin, goal = area(shapely.box(2.6, 5.5, 6.0, 9.0)), Pose2D(2.0, 7.0, math.pi / 2), (2.0, 2.0)
    nav = GroundNavigator([RobotSpec("robot", 0.2, 0.5, 0.8)], SETTINGS)
    log = closed_loop(nav, free.restamped, {"robot": begin}, {"robot": goal}, 40.0)
    assert log.reasons("robot")[0] == PathSource.TURN_IN_PLACE.value
    assert stopped(log.last("robot"), StopReason.ARRIVED)
    travelled = float(np.hypot(*np.diff(log.positions("robot"), axis=0).T).sum())
    assert travelled < 1.1 * math.dist((2.0, 7.0), goal)
