"""The exact visibility region against dense scans and known shapes."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from snnav_sim.raycast import cast
from snnav_sim.visibility import ring_segments, visible_region

ROOM = shapely.box(0.0, 0.0, 20.0, 12.0)
BLOCKS = shapely.union_all(
    [shapely.box(4, 4, 6, 9), shapely.Polygon([(12, 2), (15, 3), (13, 5)]), shapely.box(16, 8, 20, 12)]
)
FREE = ROOM.difference(BLOCKS)


def test_an_empty_room_is_seen_whole() -> None:
    seen = visible_region((3.0, 2.0), 1.0, math.tau, 100.0, ring_segments(ROOM))
    assert seen.symmetric_difference(ROOM).area < 1e-9


def test_the_shadow_of_a_block() -> None:
    """From (0, 6) the block hides the wedge behind its front corners (4, 4) and (4, 9)."""
    seen = visible_region(
        (1.0, 6.0), 0.0, math.tau, 100.0, ring_segments(ROOM.difference(shapely.box(4, 4, 6, 9)))
    )
    assert not seen.contains(shapely.Point(10.0, 6.0))
    # the shadow begins where the lines through the corners leave the block behind
    assert seen.area == pytest.approx(ROOM.area - 10.0 - shadow_area(), rel=1e-9)


def shadow_area() -> float:
    wedge = shapely.Polygon([(1, 6), (61, 6 - 60 * 2 / 3), (61, 66)])
    return float(
        wedge.intersection(ROOM).difference(shapely.box(0, 0, 4, 12)).difference(shapely.box(4, 4, 6, 9)).area
    )


def test_a_sector_and_the_range_limit() -> None:
    seen = visible_region((10.0, 0.0), 0.0, math.pi, 5.0, ring_segments(ROOM))
    assert seen.area == pytest.approx(math.pi * 25.0 / 2.0, rel=1e-5)
    assert seen.area < math.pi * 25.0 / 2.0
    quarter = visible_region((10.0, 6.0), 0.0, math.pi / 2, 2.0, ring_segments(ROOM))
    assert quarter.bounds == pytest.approx((10.0, 6.0, 12.0, 8.0))


@given(
    st.floats(0.0, 20.0),
    st.floats(0.0, 12.0),
    st.floats(-7.0, 7.0),
    st.floats(0.3, math.tau),
    st.floats(1.0, 40.0),
)
def test_dense_scans_end_on_the_boundary(x: float, y: float, first: float, view: float, reach: float) -> None:
    if FREE.distance(shapely.Point(x, y)) > 0.0 or FREE.boundary.distance(shapely.Point(x, y)) < 1e-3:
        return
    segments = ring_segments(FREE)
    seen = visible_region((x, y), first, view, reach, segments)
    beams = 400
    step = view / (beams - 1)
    ranges = np.minimum(cast((x, y), first, 0.0, step, beams, segments, np.zeros((0, 3)), reach), reach)
    angles = first + step * np.arange(beams)
    ends = np.stack((x + ranges * np.cos(angles), y + ranges * np.sin(angles)), axis=-1)
    assert shapely.distance(shapely.points(ends), seen.boundary).max() < 1e-6 + reach * 5e-6
    assert seen.is_valid
    assert FREE.buffer(1e-9).covers(seen)


@given(st.floats(0.5, 19.5), st.floats(0.5, 11.5), st.floats(0.5, 19.5), st.floats(0.5, 11.5))
def test_seen_means_a_free_line_of_sight(x: float, y: float, u: float, v: float) -> None:
    if not FREE.contains(shapely.Point(x, y)):
        return
    seen = visible_region((x, y), 0.0, math.tau, 100.0, ring_segments(FREE))
    sight = shapely.LineString([(x, y), (u, v)])
    if seen.boundary.distance(shapely.Point(u, v)) > 1e-6:
        assert seen.contains(shapely.Point(u, v)) == FREE.buffer(1e-9).covers(sight)


def test_a_device_on_a_wall() -> None:
    seen = visible_region((0.0, 6.0), 0.0, math.tau, 100.0, ring_segments(ROOM))
    assert seen.symmetric_difference(ROOM).area < 1e-9


def test_a_device_outside_sees_nothing_inside() -> None:
    seen = visible_region((30.0, 6.0), 0.0, math.tau, 5.0, ring_segments(ROOM))
    assert seen.intersection(ROOM).area == 0.0
