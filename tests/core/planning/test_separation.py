"""The distance to other robots is exact in time, and holds also should they stop on their way."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.planning.separation import OtherRobot, separation, stops_within
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
