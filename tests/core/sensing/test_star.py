"""Shortening a fan to what other sensors saw takes free space away and never adds any."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.sensing.star import BeamFan, shorten_fan, star_rings
from snnav_core.types import FloatArray, Pose2D


def region(fan: BeamFan, pose: Pose2D, corners: bool = True) -> shapely.MultiPolygon:
    return shapely.MultiPolygon([shapely.Polygon(ring) for ring in star_rings(fan, pose, corners)])


def fan_of(generator: np.random.Generator, beams: int, increment: float) -> BeamFan:
    """Return smooth stretches, small and large jumps, and beams that saw nothing."""
    free = np.where(generator.random(beams) < 0.5, 5.0, 5.0 + 3.0 * generator.random(beams))
    free[generator.random(beams) < 0.03] = 0.0
    return BeamFan(free, generator.uniform(-4.0, 4.0), increment, 5.0, 0.03)


def points_about(generator: np.random.Generator, pose: Pose2D) -> FloatArray:
    bearing, distance = generator.uniform(-math.pi, math.pi, 40), generator.uniform(3.0, 8.0, 40)
    return pose.position + distance[:, None] * np.column_stack((np.cos(bearing), np.sin(bearing)))


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(((90, 90), (91, 90), (90, 180), (46, 90), (181, 360))),
    st.sampled_from((1.0, -1.0)),
    st.sampled_from((0.1, 3.0)),
)
def test_a_shortened_fan_encloses_no_more_than_before(
    seed: int, beams: tuple[int, int], side: float, depth: float
) -> None:
    generator = np.random.default_rng(seed)
    fan = fan_of(generator, beams[0], side * 2.0 * math.pi / beams[1])
    pose = Pose2D(2.0, -1.0, 0.7)
    obstacles = points_about(generator, pose)
    shortened, _ = shorten_fan(fan, pose, obstacles, depth)
    assert (shortened.free <= fan.free).all()
    before, after = region(fan, pose), region(shortened, pose)
    assert after.is_valid
    assert after.difference(before).area < 1e-9


@given(st.integers(0, 2**32 - 1), st.sampled_from(((90, 90), (90, 180), (181, 360))))
def test_no_point_within_the_depth_stays_inside(seed: int, beams: tuple[int, int]) -> None:
    generator = np.random.default_rng(seed)
    fan = fan_of(generator, beams[0], 2.0 * math.pi / beams[1])
    pose = Pose2D(2.0, -1.0, 0.7)
    obstacles = points_about(generator, pose)
    shortened, inside = shorten_fan(fan, pose, obstacles, 99.0)
    points = shapely.points(obstacles)
    assert not shapely.contains(region(shortened, pose), points).any()
    was_inside = shapely.contains(region(fan, pose), points)
    assert (inside[was_inside] > 0.0).all()
    beyond = np.hypot(*(obstacles - pose.position).T) > fan.free.max()
    assert (inside[beyond] <= 0.0).all()


def test_a_jump_before_stays_a_jump_when_the_longer_beam_is_shortened() -> None:
    fan = BeamFan(np.array([5.0, 5.0, 8.0, 8.0]), 0.0, 0.05, 5.0, 0.03)
    shortened = replace(fan, free=np.array([5.0, 5.0, 5.2, 5.2]), measured=fan.free)
    pose = Pose2D(0.0, 0.0, 0.0)
    beside = shapely.Point(5.15 * math.cos(0.095), 5.15 * math.sin(0.095))
    for corners in (True, False):
        assert not region(shortened, pose, corners).contains(beside)
    assert region(replace(shortened, measured=None), pose, corners=False).contains(beside)
