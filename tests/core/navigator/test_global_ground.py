"""The global navigator: plans once, publishes what holds, plans again for good reasons, stops with typed ones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from snnav_core.area.tracks import TrackedScene
from snnav_core.errors import InvalidInput
from snnav_core.motion.unicycle import step_unicycle
from snnav_core.navigator.global_ground import GlobalNavigator
from snnav_core.navigator.global_settings import GlobalSettings
from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime_problem import SpacetimeSettings
from snnav_core.tracking.planar import PlanarTracker, TrackerSettings
from snnav_core.types import (
    PathSource,
    PlannedPath,
    Pose2D,
    RobotSpec,
    RobotState,
    StepResult,
    Stop,
    StopReason,
    TimedPath,
)

DELTA, PERIOD = 0.3, 0.05
SETTINGS = GlobalSettings(SpacetimeSettings(sampling_interval=DELTA, safety_margin=0.6))
HALL = (np.array([[-2.0, -5.0], [12.0, -5.0], [12.0, 5.0], [-2.0, 5.0]]),)
ROBOT = RobotSpec("robot", 0.3, 0.5, 2.0)
GOALS = {"robot": (8.0, 0.0)}


def block(
    x: float, y: float, velocity: tuple[float, float] = (0.0, 0.0), half: float = 0.5
) -> MovingObstacle:
    corners = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    outline = np.array((x, y)) + corners
    return MovingObstacle("block", outline, velocity=np.array(velocity))


def seen(time: float, *bodies: MovingObstacle) -> TrackedScene:
    """Bodies measured at a time, known exactly."""
    moved = (replace(body, outline=body.outline_at(time), stamp=time) for body in bodies)
    return TrackedScene(time, tuple(moved), HALL)


class Drive:
    """Robots that follow what a navigator decides."""

    def __init__(
        self, robots: list[RobotSpec], poses: dict[str, Pose2D], settings: GlobalSettings = SETTINGS
    ):
        self.navigator = GlobalNavigator(robots, settings)
        self.robots = {robot.id: robot for robot in robots}
        self.poses = dict(poses)
        self.trackers = {robot.id: PlanarTracker(robot, TrackerSettings(), PERIOD) for robot in robots}
        self.tick = 0

    @property
    def time(self) -> float:
        return round(self.tick * PERIOD, 9)

    def states(self) -> dict[str, RobotState]:
        return {name: RobotState(name, pose, self.time, 0.0) for name, pose in self.poses.items()}

    def decide(self, goals: dict[str, tuple[float, float]], *bodies: MovingObstacle) -> StepResult:
        result = self.navigator.step(self.time, seen(self.time, *bodies), self.states(), goals)
        self.tell(result)
        return result

    def tell(self, result: StepResult) -> None:
        for name, decision in result.decisions.items():
            if isinstance(decision, PlannedPath):
                until = decision.certificate.valid_until
                self.trackers[name].set_path(decision.path, self.poses[name].heading, until)
            else:
                self.trackers[name].set_path(None)

    def move(self, ticks: int = round(DELTA / PERIOD)) -> None:
        for _ in range(ticks):
            for name, tracker in self.trackers.items():
                command = tracker.command(self.poses[name], self.time)
                self.poses[name] = step_unicycle(self.poses[name], command.speed, command.turn_rate, PERIOD)
            self.tick += 1


def one(heading: float = 0.0, settings: GlobalSettings = SETTINGS) -> Drive:
    return Drive([ROBOT], {"robot": Pose2D(0.0, 0.0, heading)}, settings)


def path_of(result: StepResult, name: str = "robot") -> PlannedPath:
    decision = result.decisions[name]
    assert isinstance(decision, PlannedPath), decision
    return decision


def stop_of(result: StepResult, name: str = "robot") -> Stop:
    decision = result.decisions[name]
    assert isinstance(decision, Stop), decision
    return decision


def test_a_plan_is_made_once_and_its_rest_published_until_the_robot_is_there() -> None:
    drive, body = one(), block(4.0, 0.2)
    plans, ends = [], set()
    for _ in range(80):
        result = drive.decide(GOALS, body)
        decision = result.decisions["robot"]
        if isinstance(decision, Stop):
            break
        verdict = decision.certificate
        assert verdict.accepted
        assert drive.time < verdict.valid_until <= drive.time + SETTINGS.time_window * DELTA + 1e-9
        assert decision.path.start_time == pytest.approx(drive.time)
        assert verdict.path_digest == decision.path.digest()
        if decision.source is PathSource.SPACETIME:
            place = drive.poses["robot"]
            assert math.dist(decision.path.points[0], (place.x, place.y)) <= 0.02
            ends.add(tuple(decision.path.points[-1].tolist()))
        plans.append(drive.navigator.plans["robot"])
        drive.move()
    assert stop_of(result).reason is StopReason.ARRIVED
    assert all(plan is plans[0] for plan in plans)
    assert ends == {(8.0, 0.0)}
    assert math.dist((drive.poses["robot"].x, drive.poses["robot"].y), (8.0, 0.0)) <= 0.05
    drive.move()
    assert stop_of(drive.decide(GOALS, body)).reason is StopReason.ARRIVED


def test_a_robot_turns_in_place_before_it_starts_when_it_heads_elsewhere() -> None:
    drive = one(heading=math.pi)
    first = path_of(drive.decide(GOALS))
    assert first.source is PathSource.TURN_IN_PLACE
    assert first.path.turn_to == pytest.approx(0.0, abs=1e-6)
    starts = drive.navigator.plans["robot"].path.start_time
    assert starts == pytest.approx(math.ceil(math.pi / (2.0 * DELTA)) * DELTA)
    while drive.time < starts - 1e-9:
        assert path_of(drive.decide(GOALS)).source is PathSource.TURN_IN_PLACE
        drive.move()
    assert path_of(drive.decide(GOALS)).source is PathSource.SPACETIME
    assert drive.poses["robot"].x == 0.0
    assert abs(drive.poses["robot"].heading) <= SETTINGS.heading_tolerance


def test_paths_may_start_later_where_computing_takes_time() -> None:
    drive = one(settings=replace(SETTINGS, lead=3))
    drive.decide(GOALS)
    assert drive.navigator.plans["robot"].path.start_time == pytest.approx(3 * DELTA)


def test_a_silent_navigator_stops_its_robots() -> None:
    drive = one()
    until = path_of(drive.decide(GOALS)).certificate.valid_until
    drive.move(100)
    assert drive.poses["robot"].x == pytest.approx(0.5 * until, abs=0.03)


def test_another_goal_is_another_plan() -> None:
    drive = one()
    drive.decide(GOALS)
    before = drive.navigator.plans["robot"]
    drive.move()
    drive.decide({"robot": (6.0, 2.0)})
    assert drive.navigator.plans["robot"] is not before
    assert drive.navigator.plans["robot"].path.points[-1].tolist() == [6.0, 2.0]


def test_a_robot_that_was_pushed_off_its_path_gets_another_one() -> None:
    drive = one()
    for _ in range(5):
        drive.decide(GOALS)
        drive.move()
    pose = drive.poses["robot"]
    drive.poses["robot"] = Pose2D(pose.x, pose.y + 0.3, pose.heading)
    decision = path_of(drive.decide(GOALS))
    assert decision.path.points[0].tolist() == pytest.approx([pose.x, pose.y + 0.3])


def test_a_robot_that_is_late_keeps_its_plan_timed_anew() -> None:
    drive = one()
    for _ in range(5):
        drive.decide(GOALS)
        drive.move()
    before, pose = drive.navigator.plans["robot"], drive.poses["robot"]
    drive.poses["robot"] = Pose2D(pose.x - 0.08, pose.y, pose.heading)
    decision = path_of(drive.decide(GOALS))
    assert drive.navigator.plans["robot"] is before
    assert decision.source is PathSource.SPACETIME
    assert math.dist(decision.path.points[0], (pose.x - 0.08, pose.y)) <= 0.01
    assert decision.path.length == pytest.approx(8.0 - (pose.x - 0.08), abs=0.01)


def test_a_body_that_moves_otherwise_is_planned_around_again() -> None:
    drive = one()
    calm, changed = block(4.0, 2.4), block(4.0, 2.4, (0.0, -0.25))
    before = path_of(drive.decide(GOALS, calm)).path
    drive.move()
    after = path_of(drive.decide(GOALS, changed)).path

    def clearance(path: TimedPath) -> float:
        times = np.arange(path.start_time, path.end_time, 0.05)
        places = path.positions_at(times) - np.outer(times, changed.velocity)
        return float(shapely.distance(shapely.points(places), shapely.Polygon(changed.outline)).min())

    assert clearance(before) < 0.3
    assert clearance(after) >= 0.6


def test_a_robot_does_not_set_out_before_bodies_are_known() -> None:
    drive, unknown = one(), replace(block(4.0, 2.4), velocity_deviation=0.5)
    stop = stop_of(drive.decide(GOALS, unknown))
    assert stop.reason is StopReason.NOT_TRACKED
    assert "the velocity of block is not yet known to 0.05 m/s" in stop.message
    drive.move()
    assert isinstance(drive.decide(GOALS, block(4.0, 2.4)).decisions["robot"], PlannedPath)
    drive.move()
    again = drive.decide(GOALS, block(4.0, 2.4), replace(block(9.0, 4.0), id="new", velocity_deviation=0.5))
    assert isinstance(again.decisions["robot"], PlannedPath), (
        "one that is under way goes on while its path holds"
    )


def test_a_robot_that_is_boxed_in_or_has_no_free_target_says_so() -> None:
    wall = np.array([[2.0, -5.0], [2.4, -5.0], [2.4, 5.0], [2.0, 5.0]])
    boxed = stop_of(one().decide(GOALS, MovingObstacle("wall", wall)))
    assert boxed.reason is StopReason.GOAL_UNREACHABLE
    blocked = stop_of(one().decide(GOALS, block(8.3, 0.3)))
    assert blocked.reason is StopReason.GOAL_BLOCKED
    assert "block" in blocked.message
    near = stop_of(one().decide(GOALS, block(0.6, 0.0)))
    assert near.reason is StopReason.START_BLOCKED
    later = stop_of(one().decide(GOALS, block(8.0, 4.0, (0.0, -0.15))))
    assert later.reason is StopReason.GOAL_BLOCKED, "a body passes over the target when the robot is there"


def test_without_state_or_goal_a_robot_stands() -> None:
    navigator = GlobalNavigator([ROBOT], SETTINGS)
    assert stop_of(navigator.step(0.0, seen(0.0), {}, GOALS)).reason is StopReason.NO_STATE
    state = {"robot": RobotState("robot", Pose2D(0.0, math.nan, 0.0), 0.3)}
    assert stop_of(navigator.step(0.3, seen(0.3), state, GOALS)).reason is StopReason.NO_STATE
    old = {"robot": RobotState("robot", Pose2D(0.0, 0.0, 0.0), 0.3)}
    assert stop_of(navigator.step(2.0, seen(2.0), old, GOALS)).reason is StopReason.NO_STATE
    state = {"robot": RobotState("robot", Pose2D(0.0, 0.0, 0.0), 2.3)}
    assert stop_of(navigator.step(2.3, seen(2.3), state, {})).reason is StopReason.NO_GOAL
    broken = stop_of(navigator.step(2.3, seen(2.3), state, {"robot": (math.nan, 0.0)}))
    assert broken.reason is StopReason.NO_GOAL
    with pytest.raises(InvalidInput, match="must be finite"):
        navigator.step(math.nan, seen(0.0), state, GOALS)


def test_time_that_jumps_back_forgets_all_plans() -> None:
    drive = one()
    drive.decide(GOALS)
    before = drive.navigator.plans["robot"]
    drive.tick = 60
    drive.decide(GOALS)
    drive.tick = 0
    drive.decide(GOALS)
    assert drive.navigator.plans["robot"] is not before


def crossing() -> Drive:
    robots = [replace(ROBOT, id="first"), replace(ROBOT, id="second")]
    poses = {"first": Pose2D(0.0, 0.0, 0.0), "second": Pose2D(4.0, -4.0, 0.5 * math.pi)}
    return Drive(robots, poses)


CROSSING = {"first": (8.0, 0.0), "second": (4.0, 4.0)}


def test_two_robots_that_would_meet_keep_their_distance_and_arrive() -> None:
    drive, gaps = crossing(), []
    for _ in range(80):
        result = drive.decide(CROSSING)
        for _ in range(6):
            drive.move(1)
            a, b = drive.poses.values()
            gaps.append(math.dist((a.x, a.y), (b.x, b.y)))
        reasons = {one.reason for one in result.decisions.values() if isinstance(one, Stop)}
        if len(result.decisions) == sum(isinstance(one, Stop) for one in result.decisions.values()):
            break
    assert reasons == {StopReason.ARRIVED}
    assert min(gaps) >= 0.6
    assert drive.navigator.plans == {}


@pytest.mark.parametrize("order", [("first", "second"), ("second", "first")])
def test_a_robot_that_stopped_when_it_was_not_heard_of_any_more_is_not_run_into(
    order: tuple[str, str],
) -> None:
    """It was told to stop, and did, later than where it was measured last and short of its path."""
    for lost in np.arange(3.6, 5.5, 0.3):
        poses = {"first": Pose2D(0.0, 0.0, 0.0), "second": Pose2D(4.0, -2.5, 0.5 * math.pi)}
        drive = Drive([replace(ROBOT, id=name, max_turn_rate=2.5) for name in order], poses)
        for _ in range(35):
            states = {
                name: one for name, one in drive.states().items() if name == "first" or drive.time < lost
            }
            drive.tell(drive.navigator.step(drive.time, seen(drive.time), states, CROSSING))
            for _ in range(6):
                drive.move(1)
                a, b = drive.poses.values()
                assert math.dist((a.x, a.y), (b.x, b.y)) >= 0.6


def test_the_first_robot_goes_straight_and_the_second_around() -> None:
    drive = crossing()
    drive.decide(CROSSING)
    plans = drive.navigator.plans
    assert plans["first"].travel_time == pytest.approx(16.0, abs=0.05)
    times = np.arange(0.0, 20.0, 0.05)
    gap = plans["first"].path.positions_at(times) - plans["second"].path.positions_at(times)
    assert np.hypot(*gap.T).min() >= 0.6


def test_a_robot_waits_for_one_that_stands_in_its_way_for_good() -> None:
    """In a corridor that two do not fit side by side."""
    walls = [
        MovingObstacle("north", np.array([[1.0, 0.8], [7.0, 0.8], [7.0, 4.9], [1.0, 4.9]])),
        MovingObstacle("south", np.array([[1.0, -4.9], [7.0, -4.9], [7.0, -0.8], [1.0, -0.8]])),
        MovingObstacle("above", np.array([[1.0, 4.9], [7.0, 4.9], [7.0, 5.2], [1.0, 5.2]])),
        MovingObstacle("below", np.array([[1.0, -5.2], [7.0, -5.2], [7.0, -4.9], [1.0, -4.9]])),
    ]
    robots = [replace(ROBOT, id="stays"), ROBOT]
    drive = Drive(robots, {"stays": Pose2D(4.0, 0.0, 0.0), "robot": Pose2D(0.0, 0.0, 0.0)})
    result = drive.decide(GOALS, *walls)
    assert stop_of(result, "stays").reason is StopReason.NO_GOAL
    waits = stop_of(result)
    assert waits.reason in (StopReason.BLOCKED_BY_ROBOT, StopReason.NO_PATH)
    assert "stays" in waits.message


def test_robots_are_added_and_removed_by_name() -> None:
    navigator = GlobalNavigator([ROBOT], SETTINGS)
    with pytest.raises(InvalidInput, match="is there already"):
        navigator.add_robot(ROBOT)
    with pytest.raises(InvalidInput, match="not all different"):
        GlobalNavigator([ROBOT, ROBOT], SETTINGS)
    with pytest.raises(InvalidInput, match="below the radius"):
        navigator.add_robot(RobotSpec("wide", 0.9, 0.5, 2.0))
    navigator.remove_robot("robot")
    navigator.remove_robot("robot")
    assert navigator.step(0.0, seen(0.0), {}, {}).decisions == {}


@pytest.mark.parametrize(
    ("name", "value"),
    [("time_window", 0), ("retry", 0), ("lead", -1), ("planning_reserve", math.nan), ("body_speed", -1.0),
     ("arrival_distance", 0.0), ("robot_distance", math.inf)],
)  # fmt: skip
def test_settings_out_of_range_are_named(name: str, value: float) -> None:
    with pytest.raises(InvalidInput, match=name):
        replace(SETTINGS, **{name: value})
