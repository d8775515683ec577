"""The flying robot turns on exact arcs and never faster than it can."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlightCommand, FlyerState, direction_of
from snnav_core.motion.flyer import limit_turn, step_flyer

headings = st.floats(-math.pi, math.pi)
pitches = st.floats(-1.4, 1.4)
numbers = st.floats(-5.0, 5.0)
turns = st.tuples(numbers, numbers, numbers).map(np.array)


def flyer(heading: float, pitch: float, speed: float = 0.7) -> FlyerState:
    return FlyerState("bee", np.array([1.0, 2.0, 3.0]), direction_of(heading, pitch), 5.0, speed)


@given(headings, pitches, turns)
def test_a_limited_turn_is_across_and_not_too_fast(heading: float, pitch: float, turn: np.ndarray) -> None:
    direction = direction_of(heading, pitch)
    limited = limit_turn(turn, direction, 2.0)
    assert abs(float(limited @ direction)) < 1e-9
    assert float(np.linalg.norm(limited)) <= 2.0 + 1e-12


@given(headings, pitches, turns, st.floats(0.01, 1.0))
def test_one_period_is_two_half_periods(heading: float, pitch: float, turn: np.ndarray, dt: float) -> None:
    start = flyer(heading, pitch)
    turn = limit_turn(turn, start.direction, 2.0)
    whole = step_flyer(start, FlightCommand(0.7, turn), 2.0, dt)
    half = step_flyer(start, FlightCommand(0.7, turn), 2.0, dt / 2)
    rate = float(np.linalg.norm(turn))
    swung = half.direction - math.cos(rate * dt / 2) * start.direction
    size = float(np.linalg.norm(swung))
    if size < 1e-6:
        turned = turn
    else:  # the same turn, carried along the arc
        side = turn / rate
        turned = rate * (math.cos(rate * dt / 2) * side - math.sin(rate * dt / 2) * start.direction)
    both = step_flyer(half, FlightCommand(0.7, turned), 2.0, dt / 2)
    np.testing.assert_allclose(both.position, whole.position, atol=1e-9)
    np.testing.assert_allclose(both.direction, whole.direction, atol=1e-9)
    assert both.stamp == pytest.approx(whole.stamp)


@given(headings, pitches, turns)
def test_the_way_has_the_length_of_the_speed(heading: float, pitch: float, turn: np.ndarray) -> None:
    state = flyer(heading, pitch)
    positions = [state.position]
    for _ in range(100):
        carried = limit_turn(turn, state.direction, 2.0)
        state = step_flyer(state, FlightCommand(0.7, carried), 2.0, 0.01)
        positions.append(state.position)
    length = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    assert length == pytest.approx(0.7, rel=1e-3)


def test_a_robot_that_hovers_leaves_in_any_direction_and_one_that_flies_does_not() -> None:
    up = np.array([0.0, 0.0, 1.0])
    command = FlightCommand(0.7, np.zeros(3), up)
    left = step_flyer(flyer(0.0, 0.0, speed=0.0), command, 2.0, 1.0)
    np.testing.assert_allclose(left.position, [1.0, 2.0, 3.7])
    flown = step_flyer(flyer(0.0, 0.0), command, 2.0, 1.0)
    np.testing.assert_allclose(flown.position, [1.7, 2.0, 3.0])


def test_a_turn_that_is_not_finite_is_refused() -> None:
    with pytest.raises(InvalidInput, match="cannot be limited"):
        limit_turn(np.array([math.nan, 0.0, 0.0]), direction_of(0.0, 0.0), 2.0)
