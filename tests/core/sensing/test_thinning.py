"""Thinned outlines enclose a part of what they enclosed before."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.sensing.scan import PlanarScan, ScanSettings, detect_planar
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


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from((0.05, 0.3, 0.6, 0.9)),
    st.sampled_from((0.003, 0.01, 0.05)),
    st.sampled_from((0.25, 0.5, 1.0)),
)
def test_what_is_left_of_a_scan_full_of_holes_is_valid(
    seed: int, lost: float, tolerance: float, step_deg: float
) -> None:
    """Thin wedges between beams that see nothing, some as thin as the tolerance (a real one ended the fusion)."""
    draws = np.random.default_rng(seed)
    count = round(180.0 / step_deg) + 1
    ranges = draws.uniform(0.3, 3.0) + np.cumsum(draws.normal(0.0, 0.01, count))
    ranges[draws.random(count) < 0.1] *= 0.8
    ranges[draws.random(count) < lost] = 0.0
    scan = PlanarScan(0.0, np.round(ranges, 2), -math.pi / 2, math.radians(step_deg), 0.0, 30.0)
    pose = Pose2D(*draws.uniform(-5.0, 5.0, 3).tolist())
    area = detect_planar("laser", scan, pose, ScanSettings(range_accuracy=0.02))
    thin = replace(area, simplification=tolerance)
    assert thin.polygon.is_valid, shapely.is_valid_reason(thin.polygon)
    assert shapely.difference(thin.polygon, area.polygon).area < 1e-9
