"""The tracker keeps the robot on its path, within its turn rate, and stops when it must."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from snnav_core.errors import InvalidInput
from snnav_core.motion.unicycle import step_unicycle
from snnav_core.tracking.planar import PlanarTracker, TrackerSettings
from snnav_core.types import FloatArray, Pose2D, RobotSpec, TimedPath, VelocityCommand, wrap_angle

STOP = VelocityCommand(0.0, 0.0)
Law = Literal["practical", "printed"]


class Drive(NamedTuple):
    """What a closed-loop run did."""

    poses: list[Pose2D]
    turn_rates: FloatArray
    errors: FloatArray  # distance from the true curve [m], five times per control period


def robot(speed: float = 1.0, max_turn_rate: float = 0.5) -> RobotSpec:
    return RobotSpec("robot_1", 0.3, speed, max_turn_rate)


def s_curve(radius: float) -> tuple[Callable[[FloatArray], FloatArray], float]:
    """Return a left half circle followed by a right one, by length from the origin, and its length."""
    half = math.pi * radius

    def at(distance: FloatArray) -> FloatArray:
        first, second = np.minimum(distance, half) / radius, np.maximum(distance - half, 0.0) / radius
        x = np.where(distance > half, -np.sin(second), np.sin(first))
        y = np.where(distance > half, 3.0 - np.cos(second), 1.0 - np.cos(first))
        return radius * np.column_stack((x, y))

    return at, 2.0 * half


def path_along(at: Callable[[FloatArray], FloatArray], length: float, link: float, speed: float) -> TimedPath:
    distances = np.append(np.arange(0.0, length - 1e-6, link), length)
    return TimedPath(0.0, link / speed, at(distances))


def drive(tracker: PlanarTracker, pose: Pose2D, curve: FloatArray, limit: float) -> Drive:
    """Drive until the tracker stops the robot, at most for `limit` seconds."""
    tree = cKDTree(curve)
    poses, turn_rates, errors = [pose], [], []
    for step in range(int(limit / tracker.control_period)):
        command = tracker.command(pose, step * tracker.control_period)
        if command == STOP:
            break
        assert 0.0 < command.speed <= tracker.robot.speed  # slower in the last period only
        turn_rates.append(command.turn_rate)
        for _ in range(5):
            pose = step_unicycle(pose, command.speed, command.turn_rate, tracker.control_period / 5)
            errors.append(float(tree.query((pose.x, pose.y))[0]))
        poses.append(pose)
    return Drive(poses, np.array(turn_rates), np.array(errors))


def drive_s_curve(
    speed: float, u_max: float, radius: float, link: float, dt: float, law: Law = "practical"
) -> Drive:
    at, length = s_curve(radius)
    tracker = PlanarTracker(robot(speed, u_max), TrackerSettings(law=law), dt)
    tracker.set_path(path_along(at, length, link, speed), initial_heading=0.0)
    return drive(tracker, Pose2D(0.0, 0.0, 0.0), at(np.linspace(0.0, length, 20001)), 2.0 * length / speed)


@pytest.mark.parametrize(
    ("speed", "u_max", "radius", "link", "dt", "bound"),
    [
        (1.0, 0.5, 2.5, 1.0, 0.01, 0.025),
        (1.0, 0.5, 2.5, 1.0, 0.05, 0.025),
        (1.0, 0.5, 2.5, 1.0, 0.1, 0.025),
        (1.0, 0.5, 2.2, 0.5, 0.05, 0.01),
        (0.3, 1.2, 0.5, 0.3, 0.05, 0.012),
        (0.5, 1.5, 0.5, 0.25, 0.05, 0.01),
        (0.5, 2.0, 0.4, 0.125, 0.05, 0.005),
    ],
)
def test_the_practical_law_stays_on_an_s_curve_within_the_turn_rate(
    speed: float, u_max: float, radius: float, link: float, dt: float, bound: float
) -> None:
    run = drive_s_curve(speed, u_max, radius, link, dt)
    at, length = s_curve(radius)
    assert run.errors[:-5].max() <= bound  # the last period may pass the end by half its length
    assert np.abs(run.turn_rates).max() <= u_max
    assert math.dist(run.poses[-1].position, at(np.array([length]))[0]) <= 0.5 * speed * dt + bound
    flips = np.mean(np.sign(run.turn_rates[1:]) != np.sign(run.turn_rates[:-1]))
    assert flips < 0.05, "no chatter"


def test_the_printed_law_chatters_along_the_chain_within_decimetres() -> None:
    run = drive_s_curve(1.0, 0.5, 2.5, 1.0, 0.05, "printed")
    assert set(np.unique(run.turn_rates)) <= {-0.5, 0.0, 0.5}
    assert 0.1 < run.errors.max() < 0.35, "notes: 30 to 35 cm at most"
    fine = drive_s_curve(0.3, 1.2, 0.5, 0.3, 0.05, "printed")
    assert fine.errors.max() < 0.06, "notes: 4 to 6 cm"


robots = st.sampled_from(((1.0, 0.5), (0.3, 1.2), (0.5, 1.5), (0.5, 2.0)))


@given(robots, st.floats(-1.0, 1.0), st.floats(-math.pi, math.pi), st.sampled_from((0.05, 0.1)))
def test_from_any_heading_and_offset_the_robot_comes_to_the_path_and_goes_along_it(
    speeds: tuple[float, float], offset: float, heading: float, dt: float
) -> None:
    spec = robot(*speeds)
    radius = spec.min_turn_radius
    length = 40.0 * radius
    points = np.column_stack((np.linspace(0.0, length, 81), np.zeros(81)))
    tracker = PlanarTracker(spec, TrackerSettings(), dt)
    tracker.set_path(TimedPath(0.0, 0.5 * radius / spec.speed, points))
    pose = Pose2D(10.0 * radius, offset * radius, heading)
    for step in range(int(20.0 * radius / spec.speed / dt)):
        command = tracker.command(pose, 10.0 * radius / spec.speed + step * dt)
        assert abs(command.turn_rate) <= spec.max_turn_rate
        pose = step_unicycle(pose, command.speed, command.turn_rate, dt)
    assert abs(pose.y) < 0.01 * radius
    assert abs(pose.heading) < 0.02
    assert abs(tracker.cross_track_error) < 0.01 * radius
    assert tracker.progress == pytest.approx(pose.x, abs=1.1 * spec.speed * dt)


@pytest.mark.parametrize("heading", [-3.0, -1.7, 1.7, 3.0])
def test_with_the_path_behind_the_robot_turns_at_its_limit_towards_it(heading: float) -> None:
    tracker = PlanarTracker(robot(), TrackerSettings(), 0.05)
    tracker.set_path(TimedPath(0.0, 1.0, np.column_stack((np.arange(5.0), np.zeros(5)))))
    command = tracker.command(Pose2D(1.0, 0.0, heading), 1.0)
    assert command == VelocityCommand(1.0, -math.copysign(0.5, heading))


@given(robots, st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), st.sampled_from((1, 4)))
def test_a_new_path_from_the_present_pose_joins_without_a_jump(
    speeds: tuple[float, float], before: float, after: float, links: int
) -> None:
    """Every sampling interval brings a path from where the robot is: along its heading, with a curvature near."""
    spec = robot(*speeds)
    assume(abs(before - after) < 0.3)
    interval = spec.min_turn_radius / spec.speed / 2.0
    link = 0.5 * spec.min_turn_radius / links
    tracker = PlanarTracker(spec, TrackerSettings(), 0.05)
    pose, time, last = Pose2D(1.0, 2.0, 0.4), 0.0, math.nan
    for round_number in range(6):
        share = before if round_number % 2 == 0 else after
        turns = share * spec.max_turn_rate / spec.speed * link * (np.arange(1, 12) - 0.5)
        steps = link * np.column_stack((np.cos(pose.heading + turns), np.sin(pose.heading + turns)))
        points = np.vstack((pose.position, pose.position + np.cumsum(steps, axis=0)))
        tracker.set_path(TimedPath(time, link / spec.speed, points), initial_heading=pose.heading)
        for step in range(round(interval / 0.05)):
            command = tracker.command(pose, time)
            wanted = share * spec.max_turn_rate
            if step == 0 and round_number > 0:
                change = abs(wanted - (after if round_number % 2 == 0 else before) * spec.max_turn_rate)
                assert abs(command.turn_rate - last) <= change + 0.1 * spec.max_turn_rate
            pose = step_unicycle(pose, command.speed, command.turn_rate, 0.05)
            last, time = command.turn_rate, time + 0.05


def test_the_tracker_stays_on_its_branch_where_the_path_crosses_itself() -> None:
    """A loop: the path crosses its own beginning at a right angle."""
    angle = np.linspace(0.0, 1.5 * math.pi, 40)
    loop = 2.5 * np.column_stack((np.sin(angle), 1.0 - np.cos(angle)))
    straight_in = np.column_stack((np.linspace(-5.0, -0.3, 16), np.zeros(16)))
    straight_out = np.column_stack((np.full(20, -2.5), np.linspace(2.2, -4.0, 20)))
    points = np.vstack((straight_in, loop, straight_out))
    tracker = PlanarTracker(robot(), TrackerSettings(), 0.05)
    tracker.set_path(TimedPath(0.0, 0.3, points), initial_heading=0.0)
    run = drive(tracker, Pose2D(-5.0, 0.0, 0.0), points, 60.0)
    assert math.dist(run.poses[-1].position, points[-1]) < 0.05
    assert max(pose.x for pose in run.poses) > 2.4, "the loop was driven, not cut"


@given(
    robots,
    st.floats(-math.pi, math.pi),
    st.floats(-math.pi, math.pi),
    st.sampled_from((0.05, 0.1)),
)
def test_a_turn_in_place_ends_exactly_without_overshoot(
    speeds: tuple[float, float], heading: float, turn_to: float, dt: float
) -> None:
    spec = robot(*speeds)
    tracker = PlanarTracker(spec, TrackerSettings(), dt)
    tracker.set_path(TimedPath(0.0, 1.0, np.zeros((2, 2)), turn_to=turn_to))
    pose = Pose2D(0.0, 0.0, heading)
    error = abs(wrap_angle(turn_to - heading))
    for step in range(int(math.pi / spec.max_turn_rate / dt) + 3):
        command = tracker.command(pose, step * dt)
        assert command.speed == 0.0
        assert abs(command.turn_rate) <= spec.max_turn_rate
        pose = step_unicycle(pose, command.speed, command.turn_rate, dt)
        left = abs(wrap_angle(turn_to - pose.heading))
        assert left <= error + 2e-6
        error = left
    assert error < 2e-6
    assert tracker.command(pose, 99.0) == STOP
    assert tracker.finished
    assert (pose.x, pose.y) == (0.0, 0.0)


@given(robots, st.floats(0.0, 1.0), st.sampled_from((0.05, 0.1)), st.sampled_from(("practical", "printed")))
def test_the_robot_stops_at_the_last_point_and_stays(
    speeds: tuple[float, float], rest: float, dt: float, law: Law
) -> None:
    spec = robot(*speeds)
    link = 0.5 * spec.min_turn_radius
    along = np.append(np.arange(6.0), 5.0 + rest) * link
    points = np.column_stack((along, np.zeros(7)))
    tracker = PlanarTracker(spec, TrackerSettings(law=law), dt)
    tracker.set_path(TimedPath(0.0, link / spec.speed, points), initial_heading=0.0)
    run = drive(tracker, Pose2D(0.0, 0.0, 0.0), points, 99.0)
    passed = run.poses[-1].x - along[-1]  # nothing beyond the end is certified
    assert -0.03 * spec.speed * dt <= passed <= 0.01 * spec.speed * dt
    assert tracker.finished
    assert tracker.command(Pose2D(0.0, 0.0, 0.0), 1.0) == STOP, "an ended path is not taken up again"


def test_a_path_whose_last_point_repeats_is_followed_to_it() -> None:
    points = np.vstack((np.column_stack((np.arange(5.0), np.zeros(5))), np.tile((4.0, 0.0), (60, 1))))
    tracker = PlanarTracker(robot(), TrackerSettings(), 0.05)
    tracker.set_path(TimedPath(0.0, 1.0, points))
    run = drive(tracker, Pose2D(0.0, 0.3, 0.0), points, 20.0)
    assert run.poses[-1].x == pytest.approx(4.0, abs=0.03)


def test_there_is_no_motion_without_a_path() -> None:
    tracker = PlanarTracker(robot(), TrackerSettings(), 0.05)
    pose = Pose2D(0.0, 0.0, 0.0)
    moving = TimedPath(0.0, 1.0, np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]))
    assert tracker.command(pose, 0.0) == STOP
    tracker.set_path(moving)
    assert tracker.command(pose, 0.0) != STOP
    tracker.set_path(None)
    assert tracker.command(pose, 0.0) == STOP
    tracker.set_path(moving)
    tracker.reset()
    assert tracker.command(pose, 0.0) == STOP
    tracker.set_path(TimedPath(0.0, 1.0, np.zeros((1, 2))))
    assert tracker.command(pose, 0.0) == STOP
    assert tracker.finished


def test_after_its_validity_the_path_is_not_followed() -> None:
    tracker = PlanarTracker(robot(), TrackerSettings(), 0.05)
    pose = Pose2D(0.0, 0.0, 0.0)
    moving = TimedPath(0.0, 1.0, np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]]))
    turning = TimedPath(0.0, 1.0, np.zeros((1, 2)), turn_to=1.0)
    for path in (moving, turning):
        tracker.set_path(path, valid_until=4.0)
        assert tracker.command(pose, 3.95) != STOP
        assert tracker.command(pose, 3.96) == STOP, "it would hold beyond"
        assert tracker.command(pose, 4.0) == STOP


def test_points_in_space_are_tracked_by_their_plan() -> None:
    flat = np.column_stack((np.arange(5.0), 0.1 * np.arange(5.0)))
    tracker = PlanarTracker(robot(), TrackerSettings(), 0.05)
    commands = []
    for points in (flat, np.column_stack((flat, np.full(5, 7.0)))):
        tracker.set_path(TimedPath(0.0, 1.0, points))
        commands.append(tracker.command(Pose2D(0.2, 0.0, 0.0), 0.0))
    assert commands[0] == commands[1]


@pytest.mark.parametrize(
    ("pose", "time"),
    [
        (Pose2D(math.nan, 0.0, 0.0), 0.0),
        (Pose2D(0.0, math.inf, 0.0), 0.0),
        (Pose2D(0.0, 0.0, math.nan), 0.0),
        (Pose2D(0.0, 0.0, 0.0), math.nan),
    ],
)
def test_a_pose_or_time_that_is_not_finite_is_refused(pose: Pose2D, time: float) -> None:
    tracker = PlanarTracker(robot(), TrackerSettings(), 0.05)
    tracker.set_path(TimedPath(0.0, 1.0, np.array([[0.0, 0.0], [1.0, 0.0]])))
    with pytest.raises(InvalidInput, match=r"robot_1.*stop the robot"):
        tracker.command(pose, time)


@pytest.mark.parametrize("values", [{"initial_heading": math.nan}, {"valid_until": math.nan}])
def test_a_path_with_a_bad_heading_or_time_leaves_the_tracker_stopped(values: dict[str, float]) -> None:
    tracker = PlanarTracker(robot(), TrackerSettings(), 0.05)
    path = TimedPath(0.0, 1.0, np.array([[0.0, 0.0], [1.0, 0.0]]))
    tracker.set_path(path)
    with pytest.raises(InvalidInput, match="is nan"):
        tracker.set_path(path, **values)
    assert tracker.command(Pose2D(0.0, 0.0, 0.0), 0.0) == STOP


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"law": "pid"}, "law is 'pid'"),
        ({"convergence_rate": 0.0}, "convergence_rate is 0.0"),
        ({"saturation": -1.0}, "saturation is -1.0"),
        ({"boundary_layer": math.nan}, "boundary_layer is nan"),
    ],
)
def test_settings_out_of_range_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidInput, match=message):
        TrackerSettings(**values)


@pytest.mark.parametrize(
    ("values", "period", "message"),
    [
        ({"convergence_rate": 1.0, "saturation": 0.6}, 0.05, "too large"),
        ({"convergence_rate": 2.0, "saturation": 0.24}, 0.05, "too large"),
        ({}, 0.0, "control period is 0.0"),
        ({}, math.nan, "control period is nan"),
    ],
)
def test_constants_that_would_make_the_robot_circle_are_refused(
    values: dict[str, float], period: float, message: str
) -> None:
    with pytest.raises(InvalidInput, match=message):
        PlanarTracker(robot(), TrackerSettings(**values), period)


@given(st.floats(0.05, 3.0), st.floats(0.05, 4.0), st.floats(0.005, 1.0))
def test_the_defaults_suit_every_robot(speed: float, u_max: float, period: float) -> None:
    tracker = PlanarTracker(robot(speed, u_max), TrackerSettings(), period)
    approach = tracker.convergence_rate * tracker.saturation / speed
    assert approach <= 0.5
    assert tracker.convergence_rate * math.tan(math.asin(approach)) < u_max
