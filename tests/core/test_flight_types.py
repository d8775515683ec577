"""Values of flying robots."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlightCommand, FlyerState, direction_of

angles = st.floats(-3.0, 3.0)


@given(angles, st.floats(-1.5, 1.5))
def test_heading_and_pitch_make_a_direction_that_a_state_accepts(heading: float, pitch: float) -> None:
    direction = direction_of(heading, pitch)
    assert math.asin(direction[2]) == pytest.approx(pitch, abs=1e-9)
    assert math.atan2(direction[1], direction[0]) == pytest.approx(heading, abs=1e-9)
    assert FlyerState("bee", np.zeros(3), direction, 0.0).speed == 0.0


@pytest.mark.parametrize(
    ("position", "direction", "message"),
    [
        ([0.0, 0.0], [1.0, 0.0, 0.0], "position is"),
        ([0.0, math.nan, 0.0], [1.0, 0.0, 0.0], "position is"),
        ([0.0, 0.0, 0.0], [1.0, 1.0, 0.0], "direction has length 1.41421"),
    ],
)
def test_wrong_states_are_refused_by_name(
    position: list[float], direction: list[float], message: str
) -> None:
    with pytest.raises(InvalidInput, match=rf"'bee': {message}"):
        FlyerState("bee", np.array(position), np.array(direction), 0.0)


def test_a_command_needs_a_finite_turn() -> None:
    with pytest.raises(InvalidInput, match="turn is"):
        FlightCommand(0.7, np.array([0.0, math.inf, 0.0]))
