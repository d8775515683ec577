"""Thinned outlines enclose a part of what they enclosed before."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from snnav_core.sensing.scan import PlanarScan, detect_planar
from snnav_core.sensing.thinning import thin_ring
from snnav_core.types import Pose2D


@pytest.mark.parametrize("tolerance", [0.0, 0.003, 0.05, 10.0])
def test_the_region_is_a_part_of_the_one_before(tolerance: float) -> None:
    angles = np.linspace(0.0, 2.0 * math.pi, 90, endpoint=False)
    lengths = 2.0 + 0.03 * np.sin(11.0 * angles)
    ring = lengths[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    thin = thin_ring(ring, tolerance)
    assert 3 <= len(thin) <= len(ring)
    assert shapely.Polygon(ring).buffer(1e-9).covers(shapely.Polygon(thin))


def test_a_sliver_stays_a_ring() -> None:
    """Four beams that end a hand's breadth before a real scanner enclose less than the tolerance."""
    ranges = np.full(8, np.nan)
    ranges[2:6] = (0.160, 0.160, 0.160, 0.196)
    area = detect_planar("laser", PlanarScan(0.0, ranges, -2.36, 0.00614, 0.03, 11.0), Pose2D(0.0, 0.0, 0.0))
    for ring in area.rings:
        assert len(thin_ring(ring, 0.003)) >= 3
        assert shapely.Polygon(ring).covers(shapely.Polygon(thin_ring(ring, 0.003)))
