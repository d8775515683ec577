"""Areas that the tests of area, planning and navigator share."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
import shapely
from shapely.geometry import MultiPolygon, Polygon

from snnav_core.area.planar import as_multipolygon

RegionMaker = Callable[[int, float], MultiPolygon]


def _blob(generator: np.random.Generator, centre: np.ndarray, radius: float, roughness: float) -> Polygon:
    """Return a star polygon with 3 to 11 corners about a centre."""
    count = int(generator.integers(3, 12))
    angle = 2.0 * math.pi * (np.arange(count) + generator.uniform(0.0, 0.9, count)) / count
    distance = radius * (1.0 + roughness * generator.uniform(-1.0, 1.0, count))
    return Polygon(centre + distance[:, None] * np.column_stack((np.cos(angle), np.sin(angle))))


@pytest.fixture(scope="session")
def random_region() -> RegionMaker:
    """Return a maker of regions by seed and roughness: two rooms that may meet, obstacles cut out of them."""

    def make(seed: int, roughness: float = 0.4) -> MultiPolygon:
        generator = np.random.default_rng(seed)
        rooms = [_blob(generator, generator.uniform(-5.0, 5.0, 2), 8.0, roughness) for _ in range(2)]
        obstacles = [_blob(generator, generator.uniform(-8.0, 8.0, 2), 1.2, roughness) for _ in range(6)]
        region = shapely.difference(shapely.union_all(rooms), shapely.union_all(obstacles))
        return as_multipolygon(region)

    return make
