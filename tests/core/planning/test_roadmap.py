"""Roadmaps have samples where the region is narrow, when that is asked for."""

from __future__ import annotations

import numpy as np

from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_core.planning.roadmap import RoadmapSettings, build_roadmap

GRID = Grid(np.zeros(3), 0.1, (30, 12, 10))


def test_a_hole_between_two_rooms_gets_half_of_the_samples() -> None:
    clearance = np.zeros(GRID.shape, dtype=np.float32)
    clearance[:12], clearance[18:] = 1.0, 1.0
    clearance[12:18, 5:7, 4:7] = 1.0  # 36 cells of 2916
    area = SpatialArea(0.0, GRID, clearance, np.ones(GRID.shape, dtype=np.float32))
    share = {}
    for narrow in (False, True):
        settings = RoadmapSettings(600, 12, 1, narrow=narrow)
        points = build_roadmap(area, 0.5, 0.0, settings, np.random.default_rng(1)).points
        share[narrow] = float(((points[:, 0] > 1.2) & (points[:, 0] < 1.8)).mean())
    assert share[False] < 0.03
    assert 0.45 < share[True] < 0.55
