"""A robot is where its states say, in between on the line, and nowhere that can be told long after."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.area.robots import LONGEST_EXTRAPOLATION, LONGEST_GAP, RobotTrack
from snnav_core.errors import InvalidInput
from snnav_core.types import Pose2D, RobotSpec

ROBOT = RobotSpec("r1", 0.3, 0.5, 1.0)


def track(*states: tuple[float, float, float]) -> RobotTrack:
    """Return a track of (stamp, x, y), heading along x."""
    made = RobotTrack(ROBOT)
    for stamp, x, y in states:
        made.add(stamp, Pose2D(x, y, 0.0), 0.4)
    return made


@given(st.floats(0.0, 1.0))
def test_between_two_states_it_is_on_the_line(share: float) -> None:
    made = track((1.0, 0.0, 2.0), (1.5, 0.2, 2.4), (2.5, 0.2, 3.0))
    first, second = np.array([0.0, 2.0]), np.array([0.2, 2.4])
    np.testing.assert_allclose(made.position(1.0 + 0.5 * share), first + share * (second - first), atol=1e-5)
    place = made.place(1.0 + 0.5 * share)
    assert place is not None
    assert place[1] == 0.0


@given(st.floats(0.0, LONGEST_EXTRAPOLATION), st.floats(-math.pi, math.pi), st.floats(0.0, ROBOT.speed))
def test_shortly_after_the_last_state_it_is_within_the_slack_whatever_it_did(
    elapsed: float, heading: float, speed: float
) -> None:
    made = RobotTrack(ROBOT)
    made.add(3.0, Pose2D(1.0, 2.0, heading), speed)
    place = made.place(3.0 + elapsed)
    assert place is not None
    centre, slack = place
    assert slack <= ROBOT.speed * LONGEST_EXTRAPOLATION + 1e-6
    ahead = np.array([math.cos(heading), math.sin(heading)])
    for driven in (0.0, speed, ROBOT.speed):  # stopped, went on, speeded up
        assert np.linalg.norm(np.array([1.0, 2.0]) + elapsed * driven * ahead - centre) <= slack + 1e-6


@pytest.mark.parametrize(
    "stamp", [0.9, 2.0 + LONGEST_EXTRAPOLATION + 0.01, 1e9, -1e9, math.nan, math.inf, -math.inf]
)
def test_at_other_times_its_place_is_unknown(stamp: float) -> None:
    assert track((1.0, 0.0, 0.0), (2.0, 0.2, 0.0)).position(stamp) is None


def test_nothing_is_known_without_states_nor_inside_a_long_gap() -> None:
    assert RobotTrack(ROBOT).position(0.0) is None
    made = track((1.0, 0.0, 0.0), (1.0 + LONGEST_GAP + 0.1, 1.0, 0.0))
    assert made.position(2.0) is None
    assert made.position(1.0) is not None
    made.clear()
    assert made.position(1.0) is None
    assert made.last_stamp is None


def test_a_state_of_the_same_time_replaces_and_an_older_one_is_refused() -> None:
    made = track((1.0, 0.0, 0.0), (2.0, 1.0, 0.0), (2.0, 3.0, 0.0))
    np.testing.assert_array_equal(made.position(2.0), [3.0, 0.0])
    with pytest.raises(
        InvalidInput, match=r"'r1': state stamped 1\.900 s is older than its last \(2\.000 s\)"
    ):
        made.add(1.9, Pose2D(0.0, 0.0, 0.0))
    np.testing.assert_array_equal(made.position(2.0), [3.0, 0.0])


@pytest.mark.parametrize(
    ("stamp", "pose", "speed"),
    [
        (math.nan, Pose2D(0.0, 0.0, 0.0), 0.0),
        (3.0, Pose2D(math.nan, 0.0, 0.0), 0.0),
        (3.0, Pose2D(0.0, 0.0, math.inf), 0.0),
        (3.0, Pose2D(0.0, 0.0, 0.0), math.nan),
    ],
)
def test_states_that_are_not_finite_are_refused(stamp: float, pose: Pose2D, speed: float) -> None:
    made = track((1.0, 0.0, 0.0))
    with pytest.raises(InvalidInput, match="not finite; check its odometry"):
        made.add(stamp, pose, speed)
    assert made.last_stamp == 1.0


def test_only_the_newest_states_are_kept() -> None:
    made = track(*((0.1 * index, float(index), 0.0) for index in range(3000)))
    assert made.position(0.0) is None
    np.testing.assert_allclose(made.position(299.9), [2999.0, 0.0], atol=1e-4)
