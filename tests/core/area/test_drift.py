"""Fits of a velocity to hits on a body, and what the tracker is built of."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.area.clusters import cluster_returns
from snnav_core.area.drift import BodySample, fit_drift
from snnav_core.area.returns import FusedReturns, fused_returns
from snnav_core.area.sightings import Sightings
from snnav_core.area.tracker_settings import TrackerSettings
from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray


def returns_of(points: FloatArray, time: float, beams: FloatArray | None = None) -> FusedReturns:
    """Hits of one scanner at the origin, one beam after the other."""
    count = len(points)
    numbers = np.arange(count) if beams is None else beams
    zeros = np.zeros(count, dtype=np.int64)
    return FusedReturns(points, np.full(count, time), zeros, numbers, np.zeros((1, 2)), np.array([0.01]))


def disk(time: float, velocity: tuple[float, float], beams: int, shift: float) -> BodySample:
    """Exact hits all around a disk."""
    angles = shift + np.linspace(0.0, 2.0 * math.pi, beams, endpoint=False)
    normals = np.column_stack((np.cos(angles), np.sin(angles)))
    points = np.array([3.0, 2.0]) + 0.5 * normals + time * np.array(velocity)
    numbers = np.zeros(beams, dtype=np.int64)
    fill = np.full(beams, 0.05)
    return BodySample(time, points, normals, np.full(beams, time), fill, numbers, np.arange(beams), fill)


@given(
    st.floats(0.1, 1.5),
    st.floats(-math.pi, math.pi),
    st.integers(20, 45),
    st.lists(st.floats(0, 6), min_size=5),
)
def test_the_velocity_of_a_disk_is_exact(
    speed: float, direction: float, beams: int, shifts: list[float]
) -> None:
    velocity = (speed * math.cos(direction), speed * math.sin(direction))
    drift = fit_drift([disk(0.3 * k, velocity, beams, shifts[k]) for k in range(5)], 0.005)
    assert np.hypot(*(drift.velocity - velocity)) < 0.01 * speed + 1e-3
    assert drift.rigid
    assert drift.deviation < 0.05


def test_along_a_face_nothing_is_sure() -> None:
    samples = []
    for k in range(5):
        y = np.linspace(1.0, 2.0, 21)
        points = np.column_stack((np.full(21, 3.0) + 0.06 * k, y))
        normals = np.tile([-1.0, 0.0], (21, 1))
        fill, numbers = np.full(21, 0.05), np.zeros(21, dtype=np.int64)
        times = np.full(21, 0.3 * k)
        samples.append(BodySample(0.3 * k, points, normals, times, fill, numbers, np.arange(21), fill))
    drift = fit_drift(samples, 0.005)
    assert drift.velocity == pytest.approx([0.2, 0.0], abs=0.01)
    across, along = np.sqrt(np.diag(drift.covariance))
    assert along > 5.0 * across


def test_hits_apart_are_bodies_of_their_own() -> None:
    points = np.array([[2.0, 0.0], [2.0, 0.1], [2.0, 1.0], [2.0, 1.1], [2.0, 1.6]])
    returns = returns_of(points, 0.0, np.array([0, 5, 50, 55, 80]))
    nothing, unknown = np.zeros(5, dtype=np.bool_), np.full(5, -1)
    numbers = cluster_returns(returns, 0.3, unknown, nothing, 0.6, np.zeros(0, dtype=np.bool_))
    assert [numbers[0] == numbers[1], numbers[1] == numbers[2], numbers[2] == numbers[3]] == [
        True,
        False,
        True,
    ]
    assert numbers[3] != numbers[4]
    walking = cluster_returns(returns, 0.3, unknown, ~nothing, 0.6, np.zeros(0, dtype=np.bool_))
    assert walking[3] == walking[4]  # a step apart
    known = np.array([0, 1, -1, -1, -1])
    apart = cluster_returns(returns, 0.3, known, nothing, 0.6, np.ones(2, dtype=np.bool_))
    assert apart[0] != apart[1]  # known to be two


def test_a_hit_has_arrived_where_beams_looked_farther() -> None:
    def scan(distance: float) -> FusedReturns:
        angles = 0.01 * np.arange(40)
        far = np.where(np.abs(np.arange(40) - 20) <= 4, distance, 5.0)
        return returns_of(far[:, None] * np.column_stack((np.cos(angles), np.sin(angles))), 0.0)

    sightings = Sightings(1.0, 0.05)
    assert not sightings.take(0.0, scan(5.0)).any()  # nothing is known yet
    assert np.flatnonzero(sightings.take(0.3, scan(4.0))).tolist() == list(range(16, 25))
    body = np.arange(16, 25)
    zeros = np.zeros(9, dtype=np.int64)
    assert sightings.left(zeros, body, np.full(9, 4.0)) == 0
    assert not sightings.take(0.6, scan(4.0))[:10].any()
    sightings.take(0.9, scan(5.0))
    assert sightings.left(zeros, body, np.full(9, 4.0)) == 9
    assert not sightings.take(5.0, scan(4.0)).any()  # beyond the window nothing is known


def test_corners_and_single_hits_have_no_normal() -> None:
    face = np.column_stack((np.full(11, 3.0), np.linspace(-0.5, 0.0, 11)))
    side = np.column_stack((3.0 + np.linspace(0.05, 0.5, 10), np.zeros(10)))
    normals = returns_of(np.concatenate((face, side)), 0.0).normals
    assert normals[:8] == pytest.approx(np.tile([-1.0, 0.0], (8, 1)), abs=1e-6)
    assert not normals[10].any()
    assert not returns_of(np.array([[3.0, 0.0], [9.0, 0.0]]), 0.0).normals.any()


def test_returns_that_do_not_fit_together() -> None:
    with pytest.raises(InvalidInput, match="times has shape"):
        FusedReturns(np.zeros((2, 2)), np.zeros(1), np.zeros(2), np.zeros(2), np.zeros((1, 2)), np.ones(1))
    with pytest.raises(InvalidInput, match="NaN"):
        returns_of(np.array([[math.nan, 0.0]]), 0.0)
    with pytest.raises(InvalidInput, match="sensor index"):
        FusedReturns(np.ones((1, 2)), np.zeros(1), np.ones(1), np.zeros(1), np.zeros((1, 2)), np.ones(1))
    assert len(fused_returns([])) == 0


@pytest.mark.parametrize(("name", "value"), [("window", 0.0), ("top_speed", math.nan), ("least_samples", 1)])
def test_settings_out_of_range(name: str, value: float) -> None:
    with pytest.raises(InvalidInput, match=name):
        TrackerSettings(**{name: value})  # type: ignore[arg-type]
