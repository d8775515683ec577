"""The distance to other robots is exact in time, and holds also should they stop on their way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.planning.separation import OtherRobot, Traffic, separation, stops_within
from snnav_core.types import FloatArray, TimedPath

STEP, INTERVAL, END = 0.25, 1.0, 4.0
EAST = TimedPath(0.0, STEP, np.column_stack((0.25 * np.arange(21), np.zeros(21))))

seeds = st.integers(0, 2**32 - 1)


def robot(points: FloatArray | list[list[float]], start: float = 0.0, step: float = STEP) -> OtherRobot:
    return OtherRobot("robot_2", 0.3, TimedPath(start, step, np.array(points, dtype=np.float64)))


def moving(start: tuple[float, float], velocity: tuple[float, float]) -> OtherRobot:
    return robot(np.array(start) + STEP * np.arange(21)[:, None] * np.array(velocity))


def random_way(generator: np.random.Generator, count: int) -> FloatArray:
    return np.cumsum(generator.normal(0.0, 0.3, (count, 2)), axis=0)


def test_without_others_nothing_is_near() -> None:
    assert separation(EAST, [], END, 1.0, INTERVAL) == (math.inf, math.inf, "")


def test_behind_a_robot_there_is_room_to_stop() -> None:
    """It drives as fast as this one: no nearer, unless it stops; 1 m is driven up to the next decision."""
    for gap, until in ((2.31, math.inf), (2.29, 0.75), (1.6, 0.25)):
        result = separation(EAST, [moving((gap, 0.0), (1.0, 0.0))], END, 1.0, INTERVAL)
        assert result[0] == until
        assert result[1] == pytest.approx(gap - 0.3), "where it is expected"
        assert (result[2] == "") == math.isinf(until)
    assert result[2] == "comes within 0.800 m of robot robot_2 after 0.25 s, margin 1.000 m"


def test_a_robot_that_crosses_in_front_may_stop_in_the_way() -> None:
    crossing = moving((1.5, 1.9), (0.0, -3.0))
    until, least, fault = separation(EAST, [crossing], END, 0.4, INTERVAL)
    assert least > 0.4, "it would have passed in time"
    assert until < INTERVAL
    assert "robot_2" in fault


def test_beyond_the_next_decision_others_are_expected_to_follow_their_paths() -> None:
    leaving = moving((3.0, 0.0), (1.0, 0.0))
    assert separation(EAST, [leaving], END, 1.0, INTERVAL)[0] == math.inf
    assert separation(EAST, [leaving], END, 1.0, 2.0)[0] == 1.5


@given(seeds, st.integers(2, 30), st.floats(-2.0, 0.0), st.sampled_from((0.2, 0.25, 0.5)))
def test_it_agrees_with_dense_sampling_with_and_without_a_stop(
    seed: int, count: int, start: float, step: float
) -> None:
    generator = np.random.default_rng(seed)
    path = TimedPath(0.0, STEP, random_way(generator, 20))
    other = robot(random_way(generator, count) + generator.normal(0.0, 1.0, 2), start, step)
    until, least, fault = separation(path, [other], END, 0.5, INTERVAL)
    times = np.linspace(0.0, END, 2001)
    own, its = path.positions_at(times), other.path.positions_at(times)
    gaps = np.linalg.norm(own - its, axis=1) - 0.3
    assert gaps.min() - 0.01 <= least <= gaps.min() + 1e-9
    margin = min(0.5, gaps[0])
    assert (gaps[times <= until] >= margin - 1e-6).all()
    assert (fault == "") == math.isinf(until)
    for stop in stop_times(other.path):
        soon = times <= min(until, INTERVAL)
        standing = other.path.positions_at(np.minimum(times[soon], stop))
        assert (np.linalg.norm(own[soon] - standing, axis=1) - 0.3 >= margin - 1e-6).all()


def stop_times(path: TimedPath) -> FloatArray:
    """The start and the times of the points within the first interval."""
    knots = path.start_time + path.step * np.arange(len(path))
    return np.concatenate(([0.0], knots[(knots > 0.0) & (knots < INTERVAL)]))


@given(seeds, st.integers(1, 12), st.sampled_from((-2.9, -1.1, -0.5, -0.13, 0.0)))
def test_the_stops_are_at_the_start_and_at_every_point_up_to_the_next_decision(
    seed: int, count: int, start: float
) -> None:
    path = TimedPath(start, STEP, random_way(np.random.default_rng(seed), count))
    stops = list(stops_within(path, 0.0, INTERVAL))
    if path.end_time <= 0.0:
        assert stops == []
        return
    ends = np.array([stop.points[-1] for stop in stops])
    expected = path.positions_at(stop_times(path)[: len(stops)])
    np.testing.assert_allclose(ends, expected, atol=1e-9)
    final = [time for time in stop_times(path) if time < path.end_time - 1e-9]
    assert len(stops) == len(final)


def test_a_robot_that_stands_or_turns_has_no_way_to_stop_on() -> None:
    assert list(stops_within(TimedPath(0.0, STEP, np.zeros((1, 2))), 0.0, INTERVAL)) == []
    turn = TimedPath(0.0, STEP, np.zeros((9, 2)), turn_to=1.0)
    assert list(stops_within(turn, 0.0, INTERVAL)) == []


def approach(first: TimedPath, second: TimedPath, end: float) -> tuple[FloatArray, FloatArray]:
    """Start times of all uniform motions and the least distances in them, plainly."""
    start = first.start_time
    knots = np.concatenate(
        [[start, end], *(way.start_time + np.arange(len(way)) * way.step for way in (first, second))]
    )
    knots = np.unique(knots[(knots >= start) & (knots <= end)])
    relative = first.positions_at(knots)[:, :2] - second.positions_at(knots)[:, :2]
    begin, change = relative[:-1], np.diff(relative, axis=0)
    squared = np.einsum("ij,ij->i", change, change)
    share = np.clip(-np.einsum("ij,ij->i", begin, change) / np.maximum(squared, 1e-300), 0.0, 1.0)
    return knots[:-1], np.linalg.norm(begin + share[:, None] * change, axis=1)


def plain_separation(path: TimedPath, others: list[OtherRobot], margin: float) -> tuple[float, float]:
    """Nobody is left out, every stop is a path of its own."""
    until, least = math.inf, math.inf
    for other in others:
        times, gaps = approach(path, other.path, END)
        least = min(least, float(gaps.min()) - other.radius)
        present = other.path.positions_at(np.array([path.start_time]))[0] - path.points[0]
        limit = min(margin, float(np.linalg.norm(present)) - other.radius)
        ways = [(times, gaps)]
        ways += [approach(path, way, INTERVAL) for way in stops_within(other.path, 0.0, INTERVAL)]
        for times, gaps in ways:
            failing = np.flatnonzero(gaps - other.radius < limit - 1e-9)
            if len(failing):
                until = min(until, float(times[failing[0]]))
    return until, least


def random_other(generator: np.random.Generator, index: int) -> OtherRobot:
    points = random_way(generator, int(generator.integers(1, 30))) + generator.normal(0.0, 4.0, 2)
    turn_to = 0.5 if index % 7 == 6 else None
    if turn_to is not None:
        points[:] = points[0]
    start, step = (
        float(generator.choice([-1.3, -1.0, -0.25, 0.0, 0.1])),
        float(generator.choice([0.2, 0.25, 0.4])),
    )
    return OtherRobot(f"r{index}", generator.uniform(0.2, 0.8), TimedPath(start, step, points, turn_to))


@given(seeds, st.integers(1, 25))
def test_leaving_out_who_is_far_away_changes_nothing(seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    path = TimedPath(0.0, STEP, random_way(generator, int(generator.integers(1, 20))))
    others = [random_other(generator, index) for index in range(count)]
    until, least, fault = separation(path, Traffic(others), END, 0.5, INTERVAL)
    expected = plain_separation(path, others, 0.5)
    assert (until, least) == (pytest.approx(expected[0]), pytest.approx(expected[1], abs=1e-9))
    assert (fault == "") == math.isinf(until)
    assert separation(path, others, END, 0.5, INTERVAL) == (until, least, fault)


def test_the_robot_that_is_too_near_first_is_named() -> None:
    later, sooner = moving((4.0, 0.0), (-1.0, 0.0)), moving((3.0, 0.0), (-1.0, 0.0))
    others = [OtherRobot("later", 0.3, later.path), OtherRobot("sooner", 0.3, sooner.path)]
    assert "robot sooner after" in separation(EAST, others, END, 0.5, INTERVAL)[2]


@given(seeds)
def test_the_outlook_bounds_where_others_can_be(seed: int) -> None:
    generator = np.random.default_rng(seed)
    others = [random_other(generator, index) for index in range(12)]
    positions, reach = Traffic(others).outlook(0.0, END)
    times = np.linspace(0.0, END, 401)
    for other, position, most in zip(others, positions, reach, strict=True):
        way = np.linalg.norm(other.path.positions_at(times) - position, axis=1)
        assert way[0] == pytest.approx(0.0, abs=1e-9)
        assert way.max() - 1e-9 <= most <= way.max() + 0.2
