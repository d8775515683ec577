"""The curve that the tracker follows runs through the points, smoothly and without swinging out."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from snnav_core.tracking.spline import Track, chain_track, spline_track
from snnav_core.types import FloatArray


def arc(radius: float, link: float, turn: float, last: float = 1.0) -> FloatArray:
    """Return points every `link` along a left arc from the origin; the last link is shortened."""
    distance = np.arange(0.0, radius * turn, link)
    distance[-1] -= (1.0 - last) * link
    return radius * np.column_stack((np.sin(distance / radius), 1.0 - np.cos(distance / radius)))


def off_the_circle(track: Track, radius: float) -> float:
    centre = np.array((0.0, radius))
    return float(np.abs(np.linalg.norm(track.points - centre, axis=1) - radius).max())


@given(st.integers(2, 12), st.integers(0, 2**32 - 1), st.booleans())
def test_the_spline_passes_every_point_in_order(count: int, seed: int, given_heading: bool) -> None:
    generator = np.random.default_rng(seed)
    steps = generator.uniform(0.4, 1.0, count) * np.exp(1j * np.cumsum(generator.uniform(-0.5, 0.5, count)))
    points = np.concatenate(([0.0], np.cumsum(steps)))
    chain = np.column_stack((points.real, points.imag))
    track = spline_track(chain, 0.1 if given_heading else None)
    assert track is not None
    at = 0.0
    for point in chain:
        nearest = track.closest(point[0], point[1], at, track.length)
        assert math.dist((nearest.x, nearest.y), point) < 1e-9
        assert nearest.distance >= at
        at = nearest.distance
    assert at == pytest.approx(track.length)
    assert (np.diff(track.distances) > 0.0).all()


@pytest.mark.parametrize("last", [1.0, 0.5, 0.29, 0.05, 0.002])
@pytest.mark.parametrize(("radius", "link"), [(2.5, 1.0), (2.0, 1.0), (0.5, 0.25), (0.4, 0.125)])
def test_an_arc_with_its_tangent_is_met_within_a_hundredth_of_a_link(
    radius: float, link: float, last: float
) -> None:
    track = spline_track(arc(radius, link, 4.0, last), 0.0)
    assert track is not None
    assert off_the_circle(track, radius) < 0.01 * link
    middle = slice(len(track.curvatures) // 4, 3 * len(track.curvatures) // 4)
    assert_allclose(track.curvatures[middle], 1.0 / radius, rtol=0.05)


def test_a_jittering_short_last_link_does_not_bend_the_end() -> None:
    chain = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0], [3.0, 0.02]])
    track = spline_track(chain)
    assert track is not None
    assert math.dist(track.points[-1], chain[-1]) < 1e-12, "the last point is kept"
    assert np.abs(track.headings).max() < math.radians(3.0)
    assert np.abs(track.points[:, 1]).max() <= 0.02 + 1e-9


@pytest.mark.parametrize("heading", [-3.0, -1.0, -0.2, 0.2, 1.0, 3.0])
def test_the_first_tangent_is_the_heading_of_the_robot_but_the_curve_does_not_swing_out(
    heading: float,
) -> None:
    chain = np.column_stack((np.arange(6.0), np.zeros(6)))
    track = spline_track(chain, heading)
    assert track is not None
    assert track.headings[0, 0] == pytest.approx(math.copysign(min(abs(heading), math.pi / 3), heading))
    assert np.abs(track.points[:, 1]).max() < 0.3
    assert (np.diff(track.points[:, 0]) > 0.0).all(), "no loop"


def test_repeated_points_are_dropped_and_one_point_is_no_track() -> None:
    chain = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 1e-5], [2.0, 0.0], [2.0, 0.0], [2.0, 1e-6]])
    for build in (spline_track, chain_track):
        track = build(chain)
        assert track is not None
        assert_allclose(track.points[-1], (2.0, 1e-6))
        assert track.length == pytest.approx(2.0, abs=1e-6)
        assert build(np.zeros((4, 2))) is None
        assert build(np.zeros((1, 2))) is None


def test_the_closest_point_is_sought_in_the_window_only() -> None:
    chain = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [0.0, 1.0]])
    track = chain_track(chain)
    assert track is not None
    near = track.closest(1.0, 0.9, 0.0, 2.0)
    assert (near.x, near.y, near.heading) == (1.0, 0.0, 0.0)
    far = track.closest(1.0, 0.9, 6.0, 9.0)
    assert (far.x, far.y, far.distance) == (1.0, 1.0, 8.0)
    for begin, end in ((-5.0, -1.0), (100.0, 200.0)):
        assert 0.0 <= track.closest(1.0, 0.9, begin, end).distance <= track.length


def test_the_chain_is_the_polygon_itself() -> None:
    chain = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    track = chain_track(chain)
    assert track is not None
    assert shapely.LineString(track.points).equals(shapely.LineString(chain))
    assert_allclose(track.headings, [[0.0, 0.0], [math.pi / 2, math.pi / 2]])
    assert track.curvature_at(1.5) == 0.0
