"""Fits of a velocity to hits on a body, and what the tracker is built of."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.area.body_sample import BodySample
from snnav_core.area.clusters import cluster_returns
from snnav_core.area.drift import fit_drift
from snnav_core.area.parting import Measurements
from snnav_core.area.returns import FusedReturns, fused_returns
from snnav_core.area.sightings import Sightings
from snnav_core.area.silhouette import narrow_velocity, passing_beams, velocity_limits
from snnav_core.area.track import Track
from snnav_core.area.tracker_settings import TrackerSettings
from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray


def returns_of(points: FloatArray, time: float, beams: FloatArray | None = None) -> FusedReturns:
    """Hits of one scanner at the origin, one beam after the other."""
    count = len(points)
    numbers = np.arange(count) if beams is None else beams
    zeros = np.zeros(count, dtype=np.int64)
    return FusedReturns(points, np.full(count, time), zeros, numbers, np.zeros((1, 2)), np.array([0.01]))


def sample_of(time: float, points: FloatArray, normals: FloatArray, baseline: float) -> BodySample:
    """A sample of which no beam passed the body."""
    count = len(points)
    fill, numbers, zeros = np.full(count, 0.05), np.zeros(count, dtype=np.int64), np.zeros((count, 2))
    nothing = passing_beams(returns_of(points, time), np.ones(count, dtype=np.bool_), numbers > 0, numbers)
    return BodySample(
        time,
        points,
        normals,
        np.full(count, time),
        fill,
        numbers,
        np.arange(count),
        fill,
        zeros,
        np.full(count, baseline),
        nothing,
    )


def disk(time: float, velocity: tuple[float, float], beams: int, shift: float) -> BodySample:
    """Exact hits all around a disk."""
    angles = shift + np.linspace(0.0, 2.0 * math.pi, beams, endpoint=False)
    normals = np.column_stack((np.cos(angles), np.sin(angles)))
    points = np.array([3.0, 2.0]) + 0.5 * normals + time * np.array(velocity)
    return sample_of(time, points, normals, 0.15)


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
        samples.append(sample_of(0.3 * k, points, normals, 0.15))
    drift = fit_drift(samples, 0.005)
    assert drift.velocity == pytest.approx([0.2, 0.0], abs=0.01)
    across, along = np.sqrt(np.diag(drift.covariance))
    assert along > 5.0 * across


def test_where_a_silhouette_ends_tells_the_motion_along_a_face() -> None:
    """A face of 1 m in front of a wall, seen by one scanner at the origin, slides along itself."""
    speed, angles = 0.3, np.arctan(np.arange(-60, 61) * 0.01)
    samples, passing = [], []
    for k in range(5):
        middle = speed * 0.3 * k - 0.2
        on_face = np.abs(4.0 * np.tan(angles) - middle) <= 0.5
        depth = np.where(on_face, 4.0, 6.0)
        returns = returns_of(np.column_stack((depth, depth * np.tan(angles))), 0.3 * k)
        found = passing_beams(
            returns, on_face, np.zeros(len(angles), dtype=np.bool_), np.full(len(angles), -1)
        )
        passing.append(found.past(returns.points[on_face]))
        assert sorted(passing[-1].ends) == [0, 1]
        samples.append(returns.points[on_face])
    points, times = np.concatenate(samples), np.repeat(0.3 * np.arange(5), [len(part) for part in samples])
    beams = points / np.hypot(*points.T)[:, None]
    passed = functools.reduce(lambda one, other: one.joined(other), passing)
    flat = np.diag([1e-6, 1.0])
    narrowed = narrow_velocity(velocity_limits(passed, points, times, beams, 0.005), np.zeros(2), flat)
    assert narrowed is not None
    velocity, covariance = narrowed
    deviation = math.sqrt(covariance[1, 1])
    assert deviation < 0.03  # 4 cm between two beams
    assert abs(velocity[1] - speed) < 3.0 * deviation
    # a hit far outside contradicts what passed
    points[0, 1] -= 1.0
    limits = velocity_limits(passed, points, times, beams, 0.005)
    assert narrow_velocity(limits, np.zeros(2), flat) is None


def test_what_hides_the_end_of_a_body_does_not_tell_where_it_ends() -> None:
    y = np.linspace(-1.0, 1.0, 41)
    depth = np.where(y < -0.3, 2.0, np.where(y < 0.4, 3.0, 5.0))
    returns = returns_of(np.column_stack((depth, depth * y)), 0.0)
    bodies = np.where(depth == 5.0, 7, -1)
    found = passing_beams(returns, depth == 3.0, np.zeros(41, dtype=np.bool_), bodies)
    assert set(found.ends) == {1}
    assert set(found.bodies) == {7}  # what they met
    single = np.zeros(41, dtype=np.bool_)
    single[np.flatnonzero(depth == 5.0)[0]] = True
    other = passing_beams(returns, depth == 3.0, single, bodies)
    assert other.beams.min() == found.beams.min() + 1


def test_what_stands_behind_was_seen_twice() -> None:
    def scan(far: float) -> FusedReturns:
        angles = 0.01 * np.arange(40)
        length = np.where(np.arange(40) < 20, 3.0, far)
        return returns_of(length[:, None] * np.column_stack((np.cos(angles), np.sin(angles))), 0.0)

    sightings = Sightings(1.5, 0.05)
    sightings.take(0.0, scan(5.0))
    zeros = np.zeros(2, dtype=np.int64)
    asked = zeros, np.array([5, 30]), np.array([3.0, 5.0])
    assert not sightings.steady(*asked).any()
    sightings.take(0.3, scan(5.0))
    assert sightings.steady(*asked).all()
    sightings.take(0.6, scan(6.0))
    assert sightings.steady(*asked).tolist() == [True, False]


def test_hits_apart_are_bodies_of_their_own() -> None:
    points = np.array([[2.0, 0.0], [2.0, 0.1], [2.0, 1.0], [2.0, 1.1], [2.0, 1.6]])
    returns = returns_of(points, 0.0, np.array([0, 5, 50, 55, 80]))
    nothing, unknown = np.zeros(5, dtype=np.bool_), np.full(5, -1)
    one = np.zeros(0, dtype=np.bool_)
    numbers, _ = cluster_returns(returns, 0.3, unknown, nothing, 0.6, one, nothing)
    assert [numbers[0] == numbers[1], numbers[1] == numbers[2], numbers[2] == numbers[3]] == [
        True,
        False,
        True,
    ]
    assert numbers[3] != numbers[4]
    walking, _ = cluster_returns(returns, 0.3, unknown, ~nothing, 0.6, one, nothing)
    assert walking[3] == walking[4]  # a step apart
    known = np.array([0, 1, -1, -1, -1])
    apart, _ = cluster_returns(returns, 0.3, known, nothing, 0.6, np.ones(2, dtype=np.bool_), nothing)
    assert apart[0] != apart[1]  # known to be two


def test_what_stands_is_not_linked_to_what_has_arrived() -> None:
    wall = np.column_stack((np.full(9, 3.0), np.linspace(0.0, 0.8, 9)))
    points = np.concatenate((wall, [[2.75, 0.3], [2.75, 0.4]], [[3.02, 1.05]]))
    returns = returns_of(points, 0.0, np.concatenate((np.arange(9), [20, 21, 30])))
    steady, nobody = np.arange(12) < 9, np.zeros(0, dtype=np.bool_)
    unknown = np.full(12, -1)
    numbers, stands = cluster_returns(returns, 0.3, unknown, ~steady, 0.6, nobody, steady)
    assert stands.tolist() == steady.tolist()
    assert numbers[9] == numbers[10] != numbers[0]
    assert numbers[11] == numbers[0]  # in line with the wall: it goes on there
    together, stands = cluster_returns(returns, 0.3, unknown, ~steady, 0.6, nobody, ~steady)
    assert not stands.any()
    assert together[9] == together[0]


def test_earlier_hits_are_divided_when_something_turns_out_to_stand() -> None:
    measurements, track = Measurements(1.5), Track(1)
    post = np.column_stack((np.full(4, 3.0), 0.1 * np.arange(4)))
    nothing = np.zeros(8, dtype=np.bool_)
    for time in (0.0, 0.3, 0.6):
        cart = np.column_stack((np.full(4, 3.0), 0.6 + time + 0.1 * np.arange(4)))
        measurements.take(
            time, returns_of(np.concatenate((post, cart)), time), nothing, np.full(8, -1), ~nothing
        )
        own = np.arange(8) >= (4 if time > 0.5 else 0)  # one body at first
        track.take(measurements.sample(own), 1.5)
    other = Track(2, track.samples.copy())
    measurements.part(track, post, keep=False)
    assert [len(sample.points) for sample in track.samples] == [4, 4, 4]
    assert all((sample.points[:, 1] > 0.5).all() for sample in track.samples)
    measurements.part(other, post, keep=True)
    assert [len(sample.points) for sample in other.samples] == [4, 4, 4]
    assert (other.samples[0].points[:, 1] < 0.5).all()


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
