"""The compiled loop does what the loop for any dimension does, but for rounding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.area.clearance import ClearanceField
from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.planning.adjustment import AdjustmentResult, AdjustmentSettings, adjust, resample
from snnav_core.planning.adjustment_kernel import adjust_in_plane
from snnav_core.planning.fields import Barrier, BoundaryBarrier, CircleBarrier, DiskBarrier, DistanceField
from snnav_core.types import FloatArray

TARGET = np.array([18.0, 6.0])
LINK = 0.2


@dataclass(frozen=True)
class Hidden:
    """A clearance field that does not look like one: the loop for any dimension takes it."""

    field: ClearanceField

    def query(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.field.query(points)


def hall(generator: np.random.Generator) -> ClearanceField:
    centres = generator.uniform((3.0, 1.0), (15.0, 11.0), (4, 2))
    sizes = generator.uniform(0.3, 1.5, 4)
    solids = [
        shapely.box(x - size, y - size, x + size, y + size)
        for (x, y), size in zip(centres, sizes, strict=True)
    ]
    free = shapely.box(0.0, 0.0, 20.0, 12.0).difference(shapely.union_all(solids))
    return UnoccupiedArea(0.0, as_multipolygon(free)).clearance_field


def run(points: FloatArray, field: DistanceField, rest: Sequence[Barrier], passes: int) -> AdjustmentResult:
    margins = np.append(np.linspace(0.4, 0.8, 15), 0.8)
    barriers = [BoundaryBarrier(field, margins), *rest]
    return adjust(points, TARGET, LINK, barriers, AdjustmentSettings(), passes, 200)


@given(st.integers(0, 10_000), st.integers(1, 120))
def test_both_loops_give_the_same_points(seed: int, passes: int) -> None:
    generator = np.random.default_rng(seed)
    field = hall(generator)
    knots = np.vstack(([1.0, 6.0], generator.uniform((2.0, 1.0), (17.0, 11.0), (2, 2)), [17.0, 6.0]))
    points = resample(knots, LINK)
    centres = np.linspace(generator.uniform(1.0, 11.0, 2), generator.uniform(1.0, 11.0, 2), 30)
    rest = [
        DiskBarrier(centres, np.append(np.full(25, 0.8), np.full(5, -np.inf))),
        CircleBarrier(np.array([1.0, 7.0]), 1.0, 16),
        CircleBarrier(np.array([1.0, 5.0]), 1.0, 0),
    ]
    compiled, general = run(points, field, rest, passes), run(points, Hidden(field), rest, passes)
    assert (compiled.settled, compiled.passes) == (general.settled, general.passes)
    np.testing.assert_allclose(compiled.points, general.points, rtol=0.0, atol=1e-6)


def test_what_the_kernel_does_not_know_it_leaves_alone() -> None:
    field = hall(np.random.default_rng(1))
    gains, limits = (LINK, 0.02, 0.15, 0.4, 0.9), (6e-4, 6e-3, 0.3, 1.5)
    flat, spatial = np.zeros((3, 2)), np.zeros((3, 3))
    margins = np.ones(1)
    assert adjust_in_plane(spatial, np.zeros(3), [], gains, limits, (5, 9)) is None
    assert (
        adjust_in_plane(flat, TARGET, [BoundaryBarrier(Hidden(field), margins)], gains, limits, (5, 9))
        is None
    )
    late = [CircleBarrier(TARGET, 1.0, 3), BoundaryBarrier(field, margins)]
    assert adjust_in_plane(flat, TARGET, late, gains, limits, (5, 9)) is None
    assert adjust_in_plane(flat, TARGET, [], gains, limits, (5, 9)) is not None
