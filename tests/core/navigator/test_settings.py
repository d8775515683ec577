"""Settings out of range are refused by name; the distances for a robot cover what the certificate demands."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.errors import InvalidInput
from snnav_core.navigator.attempt import margin_profiles
from snnav_core.navigator.settings import NavigatorSettings, RobotDistances
from snnav_core.planning.certificate import PIECES_PER_LINK
from snnav_core.types import RobotSpec

speeds = st.floats(0.1, 2.0)
rates = st.floats(0.2, 4.0)
intervals = st.floats(0.1, 2.0)
margins = st.floats(0.2, 3.0)
shares = st.floats(0.0, 0.9)


def distances(
    speed: float, rate: float, interval: float, margin: float, share: float, window: int = 4
) -> tuple[RobotSpec, NavigatorSettings, RobotDistances]:
    robot = RobotSpec("robot", 0.2, speed, rate)
    settings = NavigatorSettings(interval, margin, window, boundary_speed=share * speed)
    return robot, settings, RobotDistances(robot, settings)


@given(speeds, rates, intervals, margins, shares, st.integers(1, 8))
def test_the_links_divide_a_sampling_interval_and_bend_within_the_radius(
    speed: float, rate: float, interval: float, margin: float, share: float, window: int
) -> None:
    robot, settings, result = distances(speed, rate, interval, margin, share, window)
    assert result.parts * result.step == pytest.approx(interval)
    assert result.parts * result.link == pytest.approx(speed * interval)
    assert result.link <= max(0.5 * robot.min_turn_radius, 0.5 * margin) + 1e-9
    assert result.window_points == window * result.parts
    assert result.turn_radius >= robot.min_turn_radius
    assert result.circle_radius >= robot.min_turn_radius
    assert result.arrival <= max(result.stride, 0.1) + 1e-9
    assert result.certificate.time_window == settings.time_window
    assert result.certificate.boundary_speed == settings.boundary_speed


@given(speeds, rates, intervals, margins, shares, st.integers(1, 8))
def test_points_at_the_planned_distance_satisfy_the_certificate_between_them_too(
    speed: float, rate: float, interval: float, margin: float, share: float, window: int
) -> None:
    """The chord between two points beside a corner dips; a piece has to keep what is demanded at its end."""
    _, settings, result = distances(speed, rate, interval, margin, share, window)
    times = np.arange(1, result.window_points + 1) * result.step
    dip = np.sqrt(result.demanded() ** 2 - 0.25 * result.link**2)
    piece = result.step / PIECES_PER_LINK
    assert (dip >= margin + settings.boundary_speed * (times + piece) + result.tolerance - 1e-9).all()
    assert result.tightest <= result.least <= result.demanded()[0] + 1e-9


@given(speeds, rates, intervals, margins, shares, st.floats(0.0, 4.0), st.floats(0.0, 4.0))
def test_margin_profiles_climb_from_where_the_robot_stands_and_stay_reachable(
    speed: float, rate: float, interval: float, margin: float, share: float, present: float, above: float
) -> None:
    robot, settings, result = distances(speed, rate, interval, margin, share)
    route = result.tightest + above
    profiles = margin_profiles(result, settings, robot, route, present)
    assert 1 <= len(profiles) <= 3
    steps = np.arange(1, result.window_points + 2)
    for profile in profiles:
        assert len(profile) == result.window_points + 1
        assert (profile <= present + result.link * steps + 1e-9).all(), "no faster than the robot drives"
        assert (profile >= 0.0).all()
    assert (profiles[-1] <= max(route, 0.0) + 1e-9).all(), "the last one fits the way to the target"
    far = margin_profiles(result, settings, robot, route, 100.0)
    np.testing.assert_array_less(result.demanded() - 1e-9, far[0][:-1])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("sampling_interval", 0.0),
        ("safety_margin", -1.0),
        ("safety_margin", math.nan),
        ("boundary_speed", -0.1),
        ("boundary_speed", math.inf),
        ("planning_reserve", -0.1),
        ("simplification", math.nan),
        ("switch_gain", -0.1),
        ("time_window", 0),
        ("search_interval", 0),
        ("max_adjusted", 0),
        ("turn_radius_factor", 0.9),
        ("circle_radius_factor", math.nan),
        ("tracking_tolerance", -0.1),
        ("tracking_tolerance", math.nan),
        ("arrival_distance", 0.0),
        ("path_spacing", math.inf),
    ],
)
def test_settings_out_of_range_are_refused(name: str, value: float) -> None:
    changes: dict[str, Any] = {"sampling_interval": 0.5, "safety_margin": 0.5, name: value}
    with pytest.raises(InvalidInput, match=f"{name} is {value}"):
        NavigatorSettings(**changes)
