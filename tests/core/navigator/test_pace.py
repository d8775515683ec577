"""Timed paths: what is left of them, how far a robot is off them, and the same way timed anew."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.navigator.pace import offset, remainder, retimed
from snnav_core.types import TimedPath

SPEED, STEP = 0.5, 0.15
LINK = SPEED * STEP


def arc(radius: float = 1.0, links: int = 40, rest: float = 0.4) -> TimedPath:
    """A path along a circle with a last link that is shorter."""
    stations = np.append(LINK * np.arange(links), LINK * (links - 1 + rest)) / radius
    points = radius * np.stack((np.sin(stations), 1.0 - np.cos(stations)), axis=-1)
    return TimedPath(2.0, STEP, points)


def test_what_is_left_at_the_time_of_a_point_are_the_points() -> None:
    path = arc()
    rest = remainder(path, SPEED, 2.0 + 7 * STEP)
    assert rest.start_time == 2.0 + 7 * STEP
    assert np.array_equal(rest.points, path.points[7:])
    assert remainder(path, SPEED, 1.0) is path
    assert len(remainder(path, SPEED, path.end_time + 9.0)) == 1


@given(st.floats(0.0, 5.5))
def test_what_is_left_in_between_stays_on_the_curve(passed: float) -> None:
    path = arc()
    rest = remainder(path, SPEED, 2.0 + passed)
    links = np.linalg.norm(np.diff(rest.points, axis=0), axis=1)
    assert np.allclose(np.hypot(rest.points[:, 0], rest.points[:, 1] - 1.0), 1.0, atol=2e-3)
    assert np.allclose(links[:-1], LINK, rtol=0.005)
    assert np.array_equal(rest.points[-1], path.points[-1])


@given(st.floats(0.5, 4.5), st.floats(-0.1, 0.1), st.floats(-0.03, 0.03))
def test_offset_tells_early_from_late_and_off_from_on(passed: float, ahead: float, across: float) -> None:
    path, time = arc(), 2.0 + passed
    angle = passed * SPEED + ahead
    place = np.array((math.sin(angle) * (1.0 - across), 1.0 - math.cos(angle) * (1.0 - across)))
    gap = offset(path, SPEED, place, time)
    assert gap.ahead == pytest.approx(ahead, abs=0.006)
    assert gap.across == pytest.approx(abs(across), abs=0.003)
    again = retimed(path, SPEED, time, gap.ahead)
    assert again.start_time == time
    assert np.linalg.norm(again.points[0] - place) <= abs(across) + 0.006


def test_a_short_last_link_is_driven_at_full_speed() -> None:
    path = arc(rest=0.4)
    gap = offset(path, SPEED, path.points[-1], path.end_time - 0.6 * STEP)
    assert gap.distance == pytest.approx(0.0, abs=1e-9)


def test_a_straight_path_of_one_link() -> None:
    path = TimedPath(0.0, STEP, np.array([[0.0, 0.0], [LINK, 0.0]]))
    rest = remainder(path, SPEED, 0.5 * STEP)
    assert rest.points.tolist() == pytest.approx(np.array([[0.5 * LINK, 0.0], [LINK, 0.0]]))
