"""The independent margin check against brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.types import Pose2D
from snnav_ros.bag.margins import MarginCheck, recorded_returns
from snnav_sim.scene import Polygon, Scene, SensorScene

AREA = shapely.Polygon(
    [(0, 0), (10, 0), (10, 6), (6, 6), (6, 4), (4, 4), (4, 6), (0, 6)], [[(2, 2), (3, 2), (3, 3), (2, 3)]]
)
PERIOD = 0.05


def arc(row: np.ndarray, parts: int, period: float = PERIOD) -> np.ndarray:
    """Return exact positions along the motion that begins at a row (time, x, y, heading, speed, turn rate)."""
    _, x, y, heading, speed, rate = row
    turned = rate * period * np.linspace(0, 1, parts + 1)
    way = speed * period * np.linspace(0, 1, parts + 1)
    chord = way * np.sinc(turned / (2 * np.pi))
    return np.column_stack(
        (x + chord * np.cos(heading + turned / 2), y + chord * np.sin(heading + turned / 2))
    )


def drive(pose: Pose2D, speed: float, turn_rate: float, count: int) -> np.ndarray:
    """Return exact samples of a constant motion."""
    times = PERIOD * np.arange(count)
    start = np.array([0.0, pose.x, pose.y, pose.heading, speed, turn_rate])
    points = arc(start, count - 1, period=PERIOD * (count - 1))
    steady = np.full(count, speed), np.full(count, turn_rate)
    return np.column_stack((times, points, pose.heading + turn_rate * times, *steady))


@given(
    x=st.floats(-1, 11),
    y=st.floats(-1, 7),
    heading=st.floats(-3, 3),
    speed=st.floats(0, 2),
    turn_rate=st.sampled_from([0.0, 0.3, -1.5, 4.0]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=60, deadline=None)
def test_clearances_are_lower_bounds_and_close(x, y, heading, speed, turn_rate, seed) -> None:
    returns = np.random.default_rng(seed).uniform(-1, 11, size=(30, 2))
    rows = drive(Pose2D(x, y, heading), speed, turn_rate, 12)
    to_area, to_returns = MarginCheck(AREA, returns).clearances(rows, PERIOD)
    bulge = speed * abs(turn_rate) * PERIOD**2 / 8
    for k, row in enumerate(rows[:-1]):
        motion = arc(row, 20)
        points = shapely.points(motion)
        inside = shapely.intersects(AREA, points)
        exact = np.where(inside, 1, -1) * shapely.distance(shapely.boundary(AREA), points)
        assert to_area[k] <= exact.min() + 1e-9 or (~inside).any()
        if inside.all() and to_area[k] > 0:
            assert to_area[k] >= exact.min() - 2 * bulge - speed * PERIOD / 20 - 1e-9
        nearest = np.hypot(*(motion[:, None] - returns).transpose(2, 0, 1)).min()
        assert nearest - 2 * bulge - speed * PERIOD / 20 - 1e-9 <= to_returns[k] <= nearest + 1e-9


def test_a_wall_crossed_between_two_samples_is_found() -> None:
    thin = shapely.Polygon([(0, 0), (10, 0), (10, 4), (0, 4)], [[(5, 1), (5.01, 1), (5.01, 3), (5, 3)]])
    rows = np.array([(0, 4.9, 2.0, 0, 4.0, 0), (PERIOD, 5.1, 2.0, 0, 4.0, 0)])
    to_area, _ = MarginCheck(thin, np.zeros((0, 2))).clearances(rows, PERIOD)
    assert to_area[0] == 0.0
    assert to_area[1] == pytest.approx(0.09)


def test_nothing_free_and_no_returns() -> None:
    rows = drive(Pose2D(1, 1, 0), 0.5, 0.0, 3)
    to_area, to_returns = MarginCheck(shapely.MultiPolygon(), np.zeros((0, 2))).clearances(rows, PERIOD)
    assert (to_area == -math.inf).all()
    assert (to_returns == math.inf).all()


def test_returns_are_placed_by_pose_and_bearing() -> None:
    sensor = SensorScene(
        id="node_1",
        device="recorded",
        position=(1.0, 2.0),
        heading=math.pi / 2,
        field_of_view=math.pi,
        resolution=math.pi / 6,
        range_max=50.0,
        angle_min=-math.pi / 2,
        range_min=0.1,
        no_return="unknown",
        ranges=(3.0, math.nan, 0.0, 30.0, 0.05, 60.0, math.inf),
        range_cut=20.0,
    )
    scene = Scene("two", 0.5, Polygon(((0, 0), (9, 0), (9, 9))), 0.4, (sensor,))
    # the first beam points along +x, the fourth along +y; the latter is a return although it lies beyond the cut
    np.testing.assert_allclose(recorded_returns(scene), [(4.0, 2.0), (1.0, 32.0)], atol=1e-12)
