"""Corners between two beams: what a fan encloses stays out of obstacles whose sides several beams hit."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.sensing.scan import PlanarScan, ScanSettings, detect_planar
from snnav_core.types import FloatArray, Pose2D

STEP = math.radians(0.5)
BEAMS = 361


def scan_of(obstacle: shapely.Polygon) -> PlanarScan:
    """Exact ranges from the origin, looking along x, into a room of 12 m half width that holds the obstacle."""
    room = shapely.box(-12.0, -12.0, 12.0, 12.0).boundary
    outline = shapely.union_all([room, obstacle.boundary])
    angles = -0.5 * math.pi + STEP * np.arange(BEAMS)
    ends = 40.0 * np.column_stack((np.cos(angles), np.sin(angles)))
    rays = shapely.linestrings(np.stack((np.zeros_like(ends), ends), axis=1))
    ranges = shapely.distance(shapely.intersection(rays, outline), shapely.points(0.0, 0.0))
    return PlanarScan(0.0, ranges, -0.5 * math.pi, STEP, 0.0, 80.0)


def depth_inside(obstacle: shapely.Polygon, settings: ScanSettings | None = None) -> float:
    """How deep the detected area reaches into the obstacle [m]."""
    detected = detect_planar("s", scan_of(obstacle), Pose2D(0.0, 0.0, 0.0), settings).polygon
    overlap = shapely.get_coordinates(detected.intersection(obstacle))
    if len(overlap) == 0:
        return 0.0
    return float(shapely.distance(shapely.points(overlap), obstacle.boundary).max())


@given(st.floats(3.0, 10.0), st.floats(-1.2, 1.2), st.floats(0.0, 2.0 * math.pi), st.floats(1.5, 2.5))
def test_boxes_seen_from_anywhere_keep_their_corners(
    distance: float, bearing: float, turned: float, size: float
) -> None:
    corners: FloatArray = size * np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    rotation = np.array([[math.cos(turned), -math.sin(turned)], [math.sin(turned), math.cos(turned)]])
    centre = distance * np.array([math.cos(bearing), math.sin(bearing)])
    box = shapely.Polygon(corners @ rotation.T + centre)
    gap = (distance + size) * STEP
    # A side seen at a grazing angle may be hit by no beam at all: then the gap bound of C3-7 is all there is.
    assert depth_inside(box) <= 0.5 * gap


@pytest.mark.parametrize("offset", [0.1, 0.3, 0.5, 0.7])
def test_a_right_angle_towards_the_sensor_is_exact(offset: float) -> None:
    bearing = offset * STEP
    tip = 8.0 * np.array([math.cos(bearing), math.sin(bearing)])
    diamond = shapely.Polygon(tip + np.array([[0.0, 0.0], [1.5, -1.5], [3.0, 0.0], [1.5, 1.5]]))
    assert depth_inside(diamond) < 1e-6
    lost = 0.5 * 8.0 * STEP
    assert lost > 0.03, "without the corner rule the chord would cut off this much"


def test_a_flat_wall_gets_no_corner() -> None:
    wall = shapely.box(6.0, -11.0, 7.0, 11.0)
    ring = detect_planar("s", scan_of(wall), Pose2D(0.0, 0.0, 0.0)).rings[0]
    beyond = ring[:, 0] > 6.0 + 1e-9
    inside = np.abs(ring[:, 1]) < 10.0
    assert not (beyond & inside).any()
    assert len(ring) <= BEAMS + 12
