"""With a window of a few tenths of a second a robot sees coming what the certificate does not ask for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.navigator.context import AreaContext
from snnav_core.navigator.forecast import Forecast, Trend
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.types import PlannedPath, Pose2D, RobotSpec, Stop, StopReason

ROOM = shapely.box(0.0, 0.0, 12.0, 8.0)
SHORT = NavigatorSettings(0.1, 0.25, 3, boundary_speed=1.2)
LONG = replace(SHORT, time_window=20)
CART = RobotSpec("cart", 0.2, 1.5, 3.0)
RADIUS = 0.3  # of a walker [m]


def area_with(time: float, begin: tuple[float, float], velocity: tuple[float, float]) -> UnoccupiedArea:
    walker = shapely.Point(np.add(begin, np.multiply(velocity, time))).buffer(RADIUS, quad_segs=32)
    return UnoccupiedArea(time, as_multipolygon(ROOM.difference(walker)))


def standing(forecast: Forecast, places: list[tuple[float, float]]) -> np.ndarray:
    return np.repeat(np.array(places)[:, None], len(forecast.times), axis=1)


@given(angle=st.floats(0.0, 6.28), speed=st.floats(0.5, 1.1))
def test_what_walks_on_is_foreseen_where_it_will_be_and_nowhere_else(angle: float, speed: float) -> None:
    direction = np.array([np.cos(angle), np.sin(angle)])
    begin, velocity = (6.0, 4.0), (float(speed * direction[0]), float(speed * direction[1]))
    forecast = Forecast(area_with(0.5, begin, velocity), area_with(0.0, begin, velocity), 1.2)
    assert not forecast.is_quiet
    now = np.array(begin) + 0.5 * np.array(velocity)
    ahead, aside = now + 1.5 * direction, now + 1.5 * np.array([-direction[1], direction[0]])
    room = forecast.room(standing(forecast, [tuple(ahead), tuple(aside), tuple(now - 1.5 * direction)]))
    expected = np.abs(1.5 - speed * forecast.times) - RADIUS
    until = forecast.times <= (1.5 - RADIUS) / speed
    np.testing.assert_allclose(room[0, until], expected[until], atol=0.08)
    assert room[0, -1] <= max(expected[-1], 0.0) + 0.15, "what is passed does not count as free again"
    assert room[1:, -1].min() > 0.6, "beside and behind"
    assert forecast.risk(standing(forecast, [tuple(now + 0.9 * direction)]), 0.25)[0] > 1e-3


def test_where_nothing_changes_nothing_is_foreseen() -> None:
    area = area_with(0.0, (6.0, 4.0), (0.0, 0.0))
    for earlier in (None, area, area_with(0.0, (6.01, 4.0), (0.0, 0.0))):
        forecast = Forecast(area.restamped(0.5), earlier, 1.2)
        assert forecast.is_quiet
        places = [(2.0, 2.0), (6.0, 5.0)]
        room = forecast.room(standing(forecast, places))
        np.testing.assert_allclose(
            room, area.clearance(np.array(places))[:, None].repeat(len(forecast.times), 1)
        )


def test_the_trend_looks_back_for_half_a_second_and_only_for_short_windows() -> None:
    trend, context = Trend(SHORT), None
    for step in range(30):
        area = area_with(0.1 * step, (2.0, 4.0), (1.0, 0.0))
        context, changed = trend.follow(context, AreaContext(area, 0.0))
        assert changed
    assert trend.forecast is not None
    front = trend.forecast.room(standing(trend.forecast, [(2.0 + 2.9 + RADIUS + 1.0, 4.0)]))[0]
    np.testing.assert_allclose(front[:5], 1.0 - trend.forecast.times[:5], atol=0.08)
    for settings in (LONG, replace(SHORT, boundary_speed=0.0)):
        trend = Trend(settings)
        context, _ = trend.follow(None, AreaContext(area_with(0.0, (2.0, 4.0), (1.0, 0.0)), 0.0))
        trend.follow(context, AreaContext(area_with(0.1, (2.0, 4.0), (1.0, 0.0)), 0.0))
        assert trend.forecast is None


@pytest.mark.parametrize(
    ("begin", "velocity", "start"),
    [
        ((9.0, 4.0), (-1.0, 0.0), Pose2D(4.0, 4.0, 0.0)),  # straight at the waiting robot
        ((0.5, 4.1), (0.9, 0.0), Pose2D(5.0, 4.0, 0.0)),  # from behind
        ((4.0, 7.6), (0.0, -0.9), Pose2D(4.0, 3.0, 1.0)),  # from the side
    ],
)
def test_a_waiting_robot_with_a_short_window_keeps_the_margin(
    closed_loop: Callable[..., Any],
    begin: tuple[float, float],
    velocity: tuple[float, float],
    start: Pose2D,
) -> None:
    shut = shapely.box(10.0, 0.0, 10.4, 8.0)

    def area_at(time: float) -> UnoccupiedArea:
        area = area_with(time, begin, velocity)
        return UnoccupiedArea(time, as_multipolygon(area.region.difference(shut))) if time < 6.0 else area

    log = closed_loop(GroundNavigator([CART], SHORT), area_at, {"cart": start}, {"cart": (11.2, 4.0)}, 30.0)
    times = 0.05 * np.arange(len(log.poses["cart"]))
    centres = np.add(begin, times[:, None] * np.asarray(velocity))
    gap = np.linalg.norm(log.positions("cart") - centres, axis=1) - RADIUS
    standing_still = np.linalg.norm(start.position - centres, axis=1) - RADIUS
    assert standing_still[:120].min() < 0.0, "it would have been walked over"
    assert gap.min() >= SHORT.safety_margin
    last = log.last("cart")
    assert isinstance(last, Stop)
    assert last.reason is StopReason.ARRIVED


def test_a_robot_waits_for_what_will_cross_its_way(closed_loop: Callable[..., Any]) -> None:
    begin, velocity, start = (6.0, 0.6), (0.0, 1.0), Pose2D(3.0, 4.0, 0.0)

    def area_at(time: float) -> UnoccupiedArea:
        return area_with(time, begin, velocity)

    log = closed_loop(GroundNavigator([CART], SHORT), area_at, {"cart": start}, {"cart": (10.0, 4.0)}, 30.0)
    times = 0.05 * np.arange(len(log.poses["cart"]))
    gap = np.linalg.norm(log.positions("cart") - np.add(begin, times[:, None] * np.array(velocity)), axis=1)
    assert gap.min() - RADIUS >= SHORT.safety_margin
    last = log.last("cart")
    assert not isinstance(last, PlannedPath)
    assert last.reason is StopReason.ARRIVED
