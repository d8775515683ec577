"""The loop compiled for space does what the loop for any dimension does, but for rounding."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.area.cell_distance import distance_to_cells
from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_core.planning.adjustment import AdjustmentSettings, adjust, resample
from snnav_core.planning.fields import Barrier, DiskBarrier
from snnav_core.planning.flight_fields import RegionBarrier, TorusBarrier
from snnav_core.types import FloatArray

GRID = Grid(np.zeros(3), 0.1, (60, 40, 25))
TARGET = np.array([5.2, 2.0, 1.2])
LINK = 0.14


class Hidden:
    """A barrier that does not look like one that the kernel knows."""

    def __init__(self, barrier: Barrier) -> None:
        self._barrier = barrier

    def violation(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self._barrier.violation(points)

    def reset(self) -> None:
        self._barrier.reset()


def hall(rng: np.random.Generator) -> SpatialArea:
    solid = np.zeros(GRID.shape, dtype=np.uint8)
    for x, y, z in rng.integers((10, 5, 0), (45, 30, 15), (4, 3)):
        solid[x : x + 6, y : y + 6, z : z + 8] = 1
    edge = np.ones(GRID.shape, dtype=np.uint8)
    edge[1:-1, 1:-1, 1:-1] = 0
    return SpatialArea(0.0, GRID, distance_to_cells(solid, 0.1, 2.0)[0], distance_to_cells(edge, 0.1, 2.0)[0])


@given(st.integers(0, 10_000), st.integers(1, 6))
def test_both_loops_give_the_same_points(seed: int, passes: int) -> None:
    rng = np.random.default_rng(seed)
    knots = np.vstack(
        ([0.6, 2.0, 1.2], rng.uniform((1.0, 0.6, 0.5), (5.0, 3.4, 2.0), (2, 3)), [4.8, 2.0, 1.2])
    )
    points = resample(knots, LINK)
    centres = np.linspace(*rng.uniform((1.0, 0.6, 0.5), (5.0, 3.4, 2.0), (2, 3)), 30)
    axis = rng.normal(size=3)
    barriers = [
        RegionBarrier(hall(rng), 0.4, 0.02 * np.arange(1, 15)),
        DiskBarrier(centres, np.append(np.full(29, 0.7), 0.0)),
        TorusBarrier(points[0], axis / np.linalg.norm(axis), 0.38, 18),
    ]
    compiled, plain = (
        adjust(points, TARGET, LINK, list(chosen), AdjustmentSettings(), passes, 200)
        for chosen in (barriers, [Hidden(one) for one in barriers])
    )
    assert (compiled.settled, compiled.passes) == (plain.settled, plain.passes)
    apart = np.linalg.norm(compiled.points - plain.points, axis=1)
    # At the edge of a barrier, rounding decides for single points.
    assert (apart > 1e-6).mean() <= 0.05
    assert apart.max() < 0.02
