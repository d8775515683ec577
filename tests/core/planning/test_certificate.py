"""The certificate refuses every single violation, and never accepts what dense sampling refutes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from shapely.geometry import MultiPolygon

from snnav_core.errors import InvalidInput
from snnav_core.planning.certificate import (
    PIECES_PER_LINK,
)
from snnav_core.types import Pose2D, TimedPath
from support.certificates import (
    ROBOT,
    SETTINGS,
    START,
    STEP,
    box_at,
    check,
    dense,
    hall_without,
    random_area,
    random_path,
    refused,
    seeds,
    straight,
)


def test_a_clean_path_is_accepted_for_the_whole_window_with_its_figures() -> None:
    path = TimedPath(START, STEP, straight())
    certificate = check(path, hall_without(box_at(3.0, 1.7)))
    assert certificate.accepted
    assert certificate.reason == ""
    assert certificate.robot_id == "robot_1"
    assert certificate.valid_until == START + 4.0
    assert certificate.least_clearance == pytest.approx(1.5)
    assert certificate.least_separation == math.inf
    assert certificate.least_radius == math.inf
    assert certificate.area_stamp == 6.5
    assert certificate.path_digest == path.digest()


def test_a_corner_beside_a_link_refuses_though_both_ends_are_far_enough() -> None:
    spike = shapely.Polygon([(0.75, 1.0), (0.7, 9.0), (0.8, 9.0)])
    region = hall_without(spike)
    ends = shapely.distance(shapely.points(straight()), region.boundary)
    assert ends.min() > 1.03
    assert refused(check(straight(), region), "clearance 1.000 m at (0.75, 0.00) after 1.00 s, demanded 1.0")
    assert check(straight(), region, tracking_tolerance=0.0).accepted


def test_the_demand_grows_with_the_boundary_speed_over_the_window() -> None:
    corridor = shapely.box(-5.0, -2.0, 40.0, 2.0)
    assert check(straight(), corridor).accepted
    assert check(straight(), corridor, boundary_speed=0.2).accepted
    assert refused(check(straight(), corridor, boundary_speed=0.3), "clearance 2.000 m")
    assert check(straight(), corridor).least_clearance == 2.0


@pytest.mark.parametrize(("speed", "window"), [(0.2, 4), (0.3, 3), (0.4, 2), (0.6, 1)])
def test_the_window_is_shortened_to_whole_intervals_where_the_margin_holds(speed: float, window: int) -> None:
    corridor = shapely.box(-5.0, -2.0, 40.0, 2.0)
    certificate = check(straight(), corridor, boundary_speed=speed, least_window=1)
    assert certificate.accepted
    assert certificate.valid_until == START + window
    assert check(straight(), corridor, boundary_speed=speed, least_window=window).accepted
    assert (
        not check(straight(), corridor, boundary_speed=speed, least_window=window + 1).accepted or window == 4
    )


def test_less_than_one_interval_is_not_enough() -> None:
    narrowing = shapely.Polygon([(-5, -2.5), (40, 2.0), (40, 9), (-5, 9)])
    certificate = check(straight(), narrowing, boundary_speed=1.2, least_window=1)
    assert refused(certificate, "demanded 1.9")
    assert certificate.valid_until == START


def test_in_the_first_interval_coming_no_nearer_is_as_good_as_standing() -> None:
    """Else a robot within V_max delta of its margin could neither drive away nor turn on the spot."""
    beside = shapely.box(-5.0, -1.2, 40.0, 20.0)
    turn = TimedPath(START, STEP, np.zeros((9, 2)), turn_to=2.0)
    for path in (straight(), turn):
        certificate = check(path, beside, boundary_speed=0.5, least_window=1)
        assert certificate.accepted
        assert certificate.valid_until == START + 1.0
        assert not check(path, beside, boundary_speed=0.5, least_window=2).accepted
    nearer = straight() - (0.0, 0.001) * np.arange(21)[:, None]
    assert not check(nearer, beside, boundary_speed=0.5, least_window=1).accepted


def test_beyond_the_certified_window_the_path_still_keeps_the_margin_to_what_is_known() -> None:
    """Whether the window is the whole one or a shortened one: no published path runs into a known obstacle."""
    assert refused(check(straight(), hall_without(box_at(6.0, 0.9)), least_window=1), "beyond the window")
    assert check(straight(), hall_without(box_at(6.0, 1.25))).accepted
    blocked = check(straight(), hall_without(box_at(2.5, 0.0, 0.1)), least_window=1)
    assert refused(blocked, "beyond the window")
    touching = check(straight(), hall_without(box_at(3.5, 1.205)), least_window=1)
    assert touching.accepted, "less than margin and tolerance, but the margin: a shorter window"
    assert touching.valid_until == START + 3.0


def test_a_path_that_ends_within_the_window_is_valid_while_the_robot_may_stand_at_its_end() -> None:
    """It stays there, and the boundary may go on coming nearer."""
    corridor = shapely.box(-5.0, -1.6, 40.0, 1.6)
    for speed, until in ((0.0, 4.0), (0.1, 4.0), (0.2, 3.0), (0.4, 1.5), (0.6, 1.0)):
        certificate = check(straight(2), corridor, boundary_speed=speed, least_window=1)
        assert certificate.accepted
        assert certificate.valid_until == pytest.approx(START + until)


def test_too_tight_a_curve_is_refused() -> None:
    """On a circle of 2 m the circumscribed radius is 2 m; 5 % less is still accepted."""
    for radius, accepted in ((2.0, True), (1.91, True), (1.89, False)):
        angle = 2.0 * math.asin(STEP / (2.0 * radius)) * np.arange(9)
        points = radius * np.column_stack((np.sin(angle), 1.0 - np.cos(angle)))
        certificate = check(points, pose=Pose2D(0.0, 0.0, 0.5 * angle[1]))
        assert certificate.accepted == accepted
        assert certificate.least_radius == pytest.approx(radius)
    assert "the least radius of the path is 1.890 m, the robot needs 1.900 m" in certificate.reason
    back = np.vstack((straight(6), straight(6)[-2::-1]))
    assert refused(check(back), "least radius of the path is 0.000 m")


@pytest.mark.parametrize(
    ("degrees", "accepted"), [(7.5, True), (-7.5, True), (7.6, False), (-90, False), (180, False)]
)
def test_the_first_link_leaves_along_the_heading(degrees: float, accepted: bool) -> None:
    """At most arcsin(0.5 / 3.8) = 7.56 degrees."""
    certificate = check(straight(), pose=Pose2D(0.0, 0.0, math.radians(degrees)))
    assert certificate.accepted == accepted
    assert accepted or "deg off the heading, allowed 7.6 deg" in certificate.reason


def test_a_path_of_one_short_link_may_point_a_little_more_aside() -> None:
    short = np.array([[0.0, 0.0], [0.05, 0.0]])
    assert check(short, pose=Pose2D(0.0, 0.0, 0.1)).accepted
    assert refused(check(short, pose=Pose2D(0.0, 0.0, 0.2)), "off the heading")


def test_stretched_and_short_links_are_refused() -> None:
    for factor, reason in ((1.03, "a link is 0.515 m long"), (0.89, "only 0.445 m long")):
        assert refused(check(straight() * (factor, 1.0)), reason)
    assert check(straight() * (1.015, 1.0)).accepted
    one_long = straight()
    one_long[10:, 0] += 0.02
    assert refused(check(one_long), "a link is 0.520 m")
    assert check(np.vstack((straight(), [[10.01, 0.0]]))).accepted, "the last link may be short"
    assert refused(check(np.zeros((2, 2))), "the first link has no length")


def test_a_path_that_leaves_the_area_is_refused() -> None:
    for region in (shapely.box(-5.0, -10.0, 3.0, 10.0), hall_without(shapely.box(3.0, -10.0, 3.01, 10.0))):
        certificate = check(straight(), region)
        assert refused(certificate, "clearance")
        assert certificate.least_clearance == 0.0


@pytest.mark.parametrize(
    "region", [MultiPolygon(), shapely.box(20.0, -5.0, 40.0, 5.0), box_at(0.0, 0.0, 1e-12)]
)
def test_a_robot_outside_the_area_gets_no_path(region: shapely.Geometry) -> None:
    for path in (straight(), TimedPath(START, STEP, np.zeros((9, 2)), turn_to=1.0)):
        assert refused(check(path, region, least_window=1), "outside the unoccupied area")


def test_a_robot_too_near_the_boundary_may_only_be_led_away() -> None:
    """Deviation C3-13, never closer than it is; once it has the margin it keeps it."""
    near = hall_without(shapely.box(-5.0, -10.0, 40.0, -0.6))
    angle = 2.0 * math.asin(STEP / (2.0 * 2.2)) * (np.arange(8) + 0.5)
    away = np.vstack(
        ([[0.0, 0.0]], np.cumsum(STEP * np.column_stack((np.cos(angle), np.sin(angle))), axis=0))
    )
    assert check(away, near).accepted
    assert check(straight(), near).accepted
    assert refused(check(away * (1.0, -1.0), near), "clearance")
    # Back to another wall as near as the first one was.
    both = hall_without(shapely.box(-5.0, -10.0, 0.3, -0.6), box_at(3.0, 0.9))
    assert refused(check(straight(), both), "clearance")
    later = hall_without(shapely.box(-5.0, -10.0, 0.3, -0.6), box_at(8.0, 0.9))
    assert refused(check(straight(), later, least_window=1), "beyond the window")


def test_a_path_that_does_not_start_at_the_robot_is_refused() -> None:
    assert refused(check(straight(), pose=Pose2D(0.0, 0.01, 0.0)), "starts 0.010 m away from the robot")


@pytest.mark.parametrize(
    "pose", [Pose2D(math.nan, 0.0, 0.0), Pose2D(0.0, 0.0, math.nan), Pose2D(0.0, math.inf, 0.0)]
)
def test_a_pose_that_is_not_finite_is_refused(pose: Pose2D) -> None:
    assert not check(straight(), pose=pose).accepted


def test_a_single_point_is_no_path() -> None:
    assert refused(check(np.zeros((1, 2))), "single point")


def test_a_turn_in_place_stands_the_whole_window() -> None:
    turn = TimedPath(START, STEP, np.zeros((9, 2)), turn_to=2.0)
    assert check(turn).accepted
    assert check(turn).valid_until == START + 4.0
    assert refused(check(turn, robot=replace(ROBOT, can_turn_in_place=False)), "robot_1 cannot turn in place")
    moving = TimedPath(START, STEP, straight(), turn_to=2.0)
    assert refused(check(moving), "a turn in place moves by 10.000 m")
    wall_near = hall_without(shapely.box(-5.0, -10.0, 40.0, -2.0))
    assert not check(turn, wall_near, boundary_speed=0.5).accepted
    assert check(turn, wall_near, boundary_speed=0.5, least_window=1).valid_until == START + 1.0


@pytest.mark.parametrize(
    "changes",
    [
        {"safety_margin": 0.0},
        {"safety_margin": math.nan},
        {"sampling_interval": 0.0},
        {"time_window": 0},
        {"boundary_speed": -0.1},
        {"boundary_speed": math.nan},
        {"tracking_tolerance": -0.1},
    ],
)
def test_settings_out_of_range_are_refused(changes: dict[str, Any]) -> None:
    with pytest.raises(InvalidInput, match="must be"):
        replace(SETTINGS, **changes)


@given(seeds, st.sampled_from((0.0, 0.2, 0.5)), st.integers(8, 20))
def test_what_dense_sampling_refutes_is_never_accepted_and_the_converse(
    seed: int, speed: float, links: int
) -> None:
    generator = np.random.default_rng(seed)
    points = random_path(generator, links)
    region = random_area(generator, points, 0.9)
    certificate = check(points, region, boundary_speed=speed, least_window=1)
    times, positions = dense(points, 4.0)
    distance = shapely.distance(shapely.points(positions), region.boundary)
    distance[~shapely.contains_xy(region, positions[:, 0], positions[:, 1])] = 0.0
    assume(distance[0] >= 1.0)
    piece = STEP / PIECES_PER_LINK if speed > 0.0 else STEP
    demand = 1.0 + speed * np.where(times > piece, times, 0.0)
    demand[times <= 1.0] = np.minimum(demand[times <= 1.0], distance[0])
    if certificate.accepted:
        proved = times <= certificate.valid_until - START + 1e-9
        assert (distance[proved] >= demand[proved] - 1e-6).all()
        assert (distance >= 1.0 - 1e-6).all()
        assert certificate.least_clearance <= distance[proved].min() + 1e-6
    generous = 1.0 + speed * (times + piece) + 0.01
    tail = shapely.distance(shapely.LineString(points), region.boundary)
    if (distance >= generous + 1e-3).all() and tail >= 1.0:
        assert certificate.accepted
        assert certificate.valid_until == START + 4.0


@given(seeds, st.sampled_from((0.0, 0.2)), st.floats(1e-5, 0.5))
def test_an_accepted_path_moved_nearer_by_more_than_its_reserve_is_refused(
    seed: int, speed: float, excess: float
) -> None:
    generator = np.random.default_rng(seed)
    points = random_path(generator, 12)
    region = random_area(generator, points, 1.0)
    assume(check(points, region, boundary_speed=speed).accepted)
    moved = int(generator.integers(1, 9))
    here = shapely.Point(points[moved])
    nearest = np.array(shapely.shortest_line(here, region.boundary).coords[1])
    gap = nearest - points[moved]
    distance = float(np.linalg.norm(gap))
    demanded = 1.0 + speed * STEP * moved
    if STEP * moved <= 1.0:
        demanded = min(demanded, float(shapely.distance(shapely.Point(points[0]), region.boundary)))
    reserve = max(distance - demanded, 0.0)
    assume(reserve + excess < distance)
    nearer = points.copy()
    nearer[moved] += gap / distance * (reserve + excess)
    assert not check(nearer, region, boundary_speed=speed).accepted


def test_a_path_in_the_open_tells_its_distance_to_what_is_far_away() -> None:
    wide = shapely.box(-50.0, -50.0, 50.0, 50.0)
    assert check(straight(), wide).least_clearance == pytest.approx(46.0), "after 4 s"
    standing = TimedPath(START, STEP, np.zeros((9, 2)), turn_to=1.0)
    assert check(standing, wide).least_clearance == pytest.approx(50.0)
