"""The simulated base keeps to its limits."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.errors import InvalidInput
from snnav_core.types import Pose2D, RobotSpec, VelocityCommand
from snnav_sim.devices.base import PioneerBase

SPEC = RobotSpec("r", 0.3, 0.8, 1.2)


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(0.001, 0.1))
def test_speed_and_turn_rate_stay_within_the_limits(speed: float, turn_rate: float, period: float) -> None:
    base = PioneerBase(Pose2D(1.0, 2.0, 0.5), SPEC)
    pose = base.apply(VelocityCommand(speed, turn_rate), period)
    assert math.hypot(pose.x - 1.0, pose.y - 2.0) <= 0.8 * period + 1e-12
    assert abs(math.remainder(pose.heading - 0.5, math.tau)) <= 1.2 * period + 1e-12
    assert 0.0 <= base.command.speed <= 0.8
    assert abs(base.command.turn_rate) <= 1.2


def test_a_full_circle_comes_back() -> None:
    base = PioneerBase(Pose2D(0.0, 0.0, 0.0), SPEC)
    for _ in range(100):
        base.apply(VelocityCommand(0.8, 1.2), math.tau / 1.2 / 100)
    assert base.pose.x == pytest.approx(0.0, abs=1e-9)
    assert base.pose.y == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("command", [VelocityCommand(math.nan, 0.0), VelocityCommand(0.0, math.inf)])
def test_a_command_that_is_no_number_is_refused(command: VelocityCommand) -> None:
    base = PioneerBase(Pose2D(0.0, 0.0, 0.0), SPEC)
    with pytest.raises(InvalidInput, match="not finite"):
        base.apply(command, 0.05)
