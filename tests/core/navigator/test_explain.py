"""A refusal says what blocks the way: the place, and the silent sensor that used to watch it."""

from __future__ import annotations

import re

import numpy as np
import pytest
import shapely
from shapely.geometry import MultiPolygon

from snnav_core.area.planar import LostPart, UnoccupiedArea, as_multipolygon
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.types import PlannedPath, Pose2D, RobotSpec, RobotState, Stop, StopReason

SETTINGS = NavigatorSettings(0.5, 0.4, 4, boundary_speed=0.2)
WEST, MIDDLE, EAST = shapely.box(0, 0, 8, 10), shapely.box(8, 0, 12, 10), shapely.box(12, 0, 20, 10)
GOAL = (18.0, 5.0)


def decide(
    area: UnoccupiedArea, goal: tuple[float, float] = GOAL, pose: Pose2D | None = None
) -> PlannedPath | Stop:
    navigator = GroundNavigator([RobotSpec("cart", 0.2, 0.5, 1.5)], SETTINGS)
    state = RobotState("cart", pose or Pose2D(2.0, 5.0, 0.0), area.stamp)
    return navigator.step(area.stamp, area, {"cart": state}, {"cart": goal}).decisions["cart"]


def seen(*parts: shapely.Geometry, lost: tuple[LostPart, ...] = ()) -> UnoccupiedArea:
    return UnoccupiedArea(30.0, as_multipolygon(shapely.union_all(parts)), {}, lost)


def lost(name: str, region: shapely.Geometry, stamp: float | None = 12.5) -> LostPart:
    return LostPart(name, stamp, as_multipolygon(region))


def place(message: str) -> np.ndarray:
    found = re.search(r"blocked at \((-?[\d.]+), (-?[\d.]+)\)", message)
    assert found, message
    return np.array([float(found[1]), float(found[2])])


def test_the_silent_sensor_that_watched_the_way_is_named_and_no_other() -> None:
    parts = (
        lost("middle", MIDDLE),
        lost("far_away", shapely.box(0, 20, 9, 30)),
        lost("never", MultiPolygon(), None),
    )
    stop = decide(seen(WEST, EAST, lost=parts))
    assert isinstance(stop, Stop)
    assert stop.reason is StopReason.GOAL_UNREACHABLE
    assert "cart" in stop.message
    assert "middle is silent since 12.50 s" in stop.message
    assert "far_away" not in stop.message
    assert "nothing was ever heard of sensor never" in stop.message
    assert np.allclose(place(stop.message)[0], 10.0, atol=0.5)


def test_without_a_silent_sensor_the_place_is_named() -> None:
    stop = decide(seen(WEST, EAST))
    assert isinstance(stop, Stop)
    assert "silent" not in stop.message
    assert 8.0 <= place(stop.message)[0] <= 12.0


def test_a_silent_sensor_whose_part_would_not_help_is_not_blamed() -> None:
    stop = decide(seen(WEST, EAST, lost=(lost("other", shapely.box(0, 10, 4, 14)),)))
    assert isinstance(stop, Stop)
    assert "other" not in stop.message


@pytest.mark.parametrize(
    ("goal", "pose", "reason", "where"),
    [
        ((10.0, 5.0), None, StopReason.GOAL_BLOCKED, (10.0, 5.0)),
        ((7.9, 5.0), None, StopReason.GOAL_BLOCKED, (8.0, 5.0)),
        ((6.0, 5.0), Pose2D(0.1, 5.0, 0.0), StopReason.START_BLOCKED, (0.0, 5.0)),
    ],
)
def test_the_place_is_next_to_what_is_blocked(
    goal: tuple[float, float], pose: Pose2D | None, reason: StopReason, where: tuple[float, float]
) -> None:
    stop = decide(seen(WEST, lost=(lost("middle", MIDDLE),)), goal, pose)
    assert isinstance(stop, Stop)
    assert stop.reason is reason
    assert np.allclose(place(stop.message), where, atol=1e-6)
    assert ("middle is silent" in stop.message) == (reason is StopReason.GOAL_BLOCKED)


def test_when_nothing_is_free_all_silent_sensors_are_named() -> None:
    stop = decide(UnoccupiedArea(30.0, MultiPolygon(), {}, (lost("a", WEST), lost("b", EAST))))
    assert isinstance(stop, Stop)
    assert stop.reason is StopReason.NO_AREA
    assert "sensor a is silent since" in stop.message
    assert "sensor b is silent since" in stop.message


def test_what_is_lost_changes_no_decision() -> None:
    whole = shapely.union_all([WEST, MIDDLE, EAST])
    first, second = decide(seen(whole)), decide(seen(whole, lost=(lost("middle", MIDDLE),)))
    assert isinstance(first, PlannedPath)
    assert isinstance(second, PlannedPath)
    assert first.path.digest() == second.path.digest()
