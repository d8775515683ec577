"""The unicycle moves along exact arcs."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from snnav_core.errors import InvalidInput
from snnav_core.motion.unicycle import clip_turn_rate, integrate_unicycle, step_unicycle
from snnav_core.types import Pose2D, wrap_angle

poses = st.builds(Pose2D, st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-3.0, 3.0))
speeds = st.floats(0.0, 3.0)
turn_rates = st.floats(-3.0, 3.0)
periods = st.floats(0.0, 2.0)


@given(poses, speeds, turn_rates, periods, st.integers(1, 7))
def test_many_short_steps_equal_one_long_step(
    pose: Pose2D, speed: float, turn_rate: float, dt: float, count: int
) -> None:
    short = pose
    for _ in range(count):
        short = step_unicycle(short, speed, turn_rate, dt / count)
    long = step_unicycle(pose, speed, turn_rate, dt)
    assert_allclose((short.x, short.y), (long.x, long.y), atol=1e-12 * 50.0)
    assert abs(wrap_angle(short.heading - long.heading)) < 1e-12


@given(poses, st.floats(0.1, 3.0), st.floats(0.1, 3.0), st.sampled_from((-1.0, 1.0)), periods)
def test_a_turning_robot_stays_on_its_circle(
    pose: Pose2D, speed: float, rate: float, side: float, dt: float
) -> None:
    radius = speed / rate
    centre_x = pose.x - side * radius * math.sin(pose.heading)
    centre_y = pose.y + side * radius * math.cos(pose.heading)
    moved = step_unicycle(pose, speed, side * rate, dt)
    assert_allclose(math.hypot(moved.x - centre_x, moved.y - centre_y), radius, rtol=1e-9)
    assert abs(wrap_angle(moved.heading - pose.heading - side * rate * dt)) < 1e-12


@given(poses, speeds, st.floats(-1e-7, 1e-7), periods)
def test_hardly_turning_is_driving_straight(pose: Pose2D, speed: float, turn_rate: float, dt: float) -> None:
    moved = step_unicycle(pose, speed, turn_rate, dt)
    straight = (
        pose.x + speed * dt * math.cos(pose.heading),
        pose.y + speed * dt * math.sin(pose.heading),
    )
    assert_allclose((moved.x, moved.y), straight, atol=1e-6)


def test_driving_backwards_undoes_driving_forwards() -> None:
    start = Pose2D(1.0, 2.0, 0.3)
    back = step_unicycle(step_unicycle(start, 1.0, 0.7, 0.5), -1.0, -0.7, 0.5)
    assert_allclose((back.x, back.y, back.heading), (1.0, 2.0, 0.3), atol=1e-14)


def test_many_robots_at_once_move_as_each_alone_and_headings_count_turns() -> None:
    generator = np.random.default_rng(0)
    batch = generator.uniform(-3.0, 3.0, (4, 5, 3))
    speed, turn_rate = generator.uniform(0.0, 2.0, (4, 5)), generator.uniform(-9.0, 9.0, (4, 5))
    moved = integrate_unicycle(batch, speed, turn_rate, 0.7)
    assert_allclose(moved[..., 2], batch[..., 2] + 0.7 * turn_rate)
    for index in np.ndindex(4, 5):
        alone = step_unicycle(Pose2D(*batch[index]), float(speed[index]), float(turn_rate[index]), 0.7)
        assert_allclose(moved[index][:2], (alone.x, alone.y))
        assert -math.pi < alone.heading <= math.pi


@given(st.floats(-10.0, 10.0), st.floats(0.0, 3.0))
def test_the_turn_rate_is_limited_to_the_side_it_has(turn_rate: float, limit: float) -> None:
    clipped = clip_turn_rate(turn_rate, limit)
    assert abs(clipped) == min(abs(turn_rate), limit)
    assert clipped * turn_rate >= 0.0


@pytest.mark.parametrize(("turn_rate", "limit"), [(math.nan, 1.0), (0.5, -1.0), (0.5, math.nan)])
def test_a_turn_rate_that_cannot_be_limited_is_refused(turn_rate: float, limit: float) -> None:
    with pytest.raises(InvalidInput, match="turn rate"):
        clip_turn_rate(turn_rate, limit)
