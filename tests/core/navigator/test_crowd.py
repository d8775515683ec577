"""What one robot sees of the others: nobody who matters is left out."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.navigator.crowd import Crowd, Turns
from snnav_core.navigator.settings import NavigatorSettings, RobotDistances
from snnav_core.planning.separation import OtherRobot
from snnav_core.types import FloatArray, Pose2D, RobotSpec, TimedPath

SETTINGS = NavigatorSettings(1.0, 0.5, time_window=4)
ROBOT = RobotSpec("robot", 0.3, 1.0, 1.0)
DISTANCES = RobotDistances(ROBOT, SETTINGS)
HERE = Pose2D(0.0, 0.0, 0.0)
STEP = 0.25


def other(
    name: str, points: FloatArray | list[list[float]], start: float = 0.0, parked: bool = False
) -> OtherRobot:
    return OtherRobot(name, 0.3, TimedPath(start, STEP, np.array(points, dtype=np.float64)), parked)


def crowd(*others: OtherRobot) -> Crowd:
    return Crowd(others, HERE, 0.0, DISTANCES, SETTINGS)


def along(length: float) -> FloatArray:
    """A straight way to the east, a point for every link."""
    return np.column_stack(
        (np.arange(0.0, length, DISTANCES.link), np.zeros(math.ceil(length / DISTANCES.link)))
    )


def test_who_stands_and_how_far_away() -> None:
    seen = crowd(
        other("stands", [[3.0, 4.0]]),
        other("has_ended", [[0.0, 2.0], [0.0, 1.0]], start=-2.0),
        other("drives", [[2.0, 0.0], [2.5, 0.0]]),
    )
    assert seen.stands.tolist() == [True, True, False]
    assert seen.gaps.tolist() == pytest.approx([5.0, 1.0, 2.0])


def test_nobody_is_nothing_to_keep_away_from() -> None:
    assert crowd().barriers(along(5.0)) == []
    assert crowd().gaps.shape == crowd().stands.shape == (0,)


@pytest.mark.parametrize(
    ("points", "count"),
    [
        ([[30.0 + 0.25 * k, 0.0] for k in range(37)], 0),  # drives ahead
        ([[30.0, 0.0]], 1),  # stands in the way far ahead
        ([[30.0, 5.0]], 0),  # beside it
        ([[10.0, 9.0], [10.0, 8.7]], 0),  # drives elsewhere
        ([[30.0, 9.0 - 0.25 * k] for k in range(37)], 0),  # crosses the way, but not within the window
    ],
)
def test_far_robots_count_only_when_they_stand_in_the_way(points: list[list[float]], count: int) -> None:
    assert len(crowd(other("r", points, parked=len(points) == 1)).barriers(along(40.0))) == count


def test_in_a_large_crowd_those_who_will_go_on_count_within_the_window_only() -> None:
    far = [other(f"r{k}", [[30.0, 9.0]]) for k in range(SETTINGS.crowd - 1)]
    waits, stays = other("waits", [[30.0, 0.0]]), other("stays", [[30.0, 0.0]], parked=True)
    assert len(crowd(*far[1:], waits).barriers(along(40.0))) == 1
    assert len(crowd(*far, waits).barriers(along(40.0))) == 0
    assert len(crowd(*far, stays).barriers(along(40.0))) == 1
    assert len(crowd(*far, other("waits", [[3.0, 0.0]])).barriers(along(40.0))) == 1


def test_a_robot_near_by_may_also_stop_at_every_point_up_to_the_next_decision() -> None:
    way = [[1.5, 1.0 - 0.25 * k] for k in range(9)]
    barriers = crowd(other("r", way)).barriers(along(10.0))
    assert len(barriers) == 1 + 4
    for stop, barrier in enumerate(barriers[1:]):
        assert barrier.centres[-1].tolist() == pytest.approx(way[stop])
        assert np.isneginf(barrier.distances[-1]), "the points beyond need not keep away"


@given(st.integers(0, 2**32 - 1))
def test_who_comes_near_within_the_window_is_kept_away_from(seed: int) -> None:
    generator = np.random.default_rng(seed)
    others = []
    for index in range(8):
        turns = np.cumsum(generator.normal(0.0, 0.3, 20))
        steps = generator.uniform(0.0, 0.3) * np.column_stack((np.cos(turns), np.sin(turns)))
        others.append(other(f"r{index}", generator.uniform(-12.0, 12.0, 2) + np.cumsum(steps, axis=0)))
    seen = crowd(*others)
    chain = along(30.0)
    kept = {tuple(barrier.centres[-1]) for barrier in seen.barriers(chain)}
    assert all(np.isneginf(b.distances[-1]) for b in seen.barriers(chain)), "all are under way"
    times = DISTANCES.step * np.arange(1, DISTANCES.window_points + 1)
    for one in others:
        centres = one.path.positions_at(times)
        gaps = np.linalg.norm(centres - chain[1 : len(times) + 1], axis=1)
        if gaps.min() < 0.3 + 0.5:
            assert tuple(centres[-1]) in kept


def test_turns_are_taken_first_come_first_served_and_after_six_steps_in_any_case() -> None:
    turns = Turns(2)
    assert [turns.take(name, 0) for name in "abcd"] == [True, True, False, False]
    assert [turns.take(name, waited) for name, waited in zip("abcd", range(4, 8), strict=True)] == [
        False,
        False,
        True,
        True,
    ]


def test_turns_are_kept_for_those_that_have_waited_longer_until_they_are_decided() -> None:
    turns = Turns(3, {"late": 5, "later": 3, "last": 1})
    assert not turns.take("new", 0)
    assert turns.take("last", 1)
    turns.skip("later")
    assert turns.take("other", 0)
    assert not turns.take("another", 0)
    assert turns.take("late", 5)
    assert not turns.take("one more", 4)


def test_a_search_that_found_nothing_takes_two_turns() -> None:
    turns = Turns(3)
    assert turns.take("first", 0)
    turns.pay()
    assert turns.take("second", 0)
    assert not turns.take("third", 0)
