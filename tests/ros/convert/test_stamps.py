"""Stamps: the same float on every side, and nothing lost on the way."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.errors import InvalidInput
from snnav_ros.convert import nanoseconds, nanoseconds_from_stamp, seconds, seconds_from_stamp, stamp_message

INT32 = 2**31 - 1
STAMPS = st.integers(0, INT32 * 10**9 + 999_999_999)


@given(STAMPS)
def test_message_holds_every_nanosecond(stamp: int) -> None:
    message = stamp_message(stamp)
    assert nanoseconds_from_stamp(message) == stamp
    assert 0 <= message.nanosec < 10**9


@given(STAMPS)
def test_seconds_are_the_nearest_float(stamp: int) -> None:
    exact = Fraction(stamp, 10**9)
    time = seconds(stamp)
    for neighbour in (math.nextafter(time, math.inf), math.nextafter(time, -math.inf)):
        assert abs(Fraction(time) - exact) <= abs(Fraction(neighbour) - exact)


@given(st.integers(0, 2**23 * 10**9))
def test_nanoseconds_survive_seconds_for_97_days(stamp: int) -> None:
    assert nanoseconds(seconds(stamp)) == stamp


@given(STAMPS)
def test_seconds_survive_the_message_at_any_time(stamp: int) -> None:
    time = seconds(stamp)
    assert seconds_from_stamp(stamp_message(nanoseconds(time))) == time


@given(st.integers(0, 10**6), st.sampled_from([0.05, 0.1, 0.02, 0.025, 1.0, 0.5, 0.2]))
def test_ticks_are_the_floats_of_the_run_without_ros(tick: int, period: float) -> None:
    # the closed loop without ROS computes its time this way
    assert seconds(tick * nanoseconds(period)) == round(tick * period, 9)


@pytest.mark.parametrize("time", [math.nan, math.inf])
def test_time_that_is_not_finite_is_refused(time: float) -> None:
    with pytest.raises(InvalidInput, match="must be finite"):
        nanoseconds(time)
