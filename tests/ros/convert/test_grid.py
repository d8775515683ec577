"""The grid never shows more free space than there is."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.errors import InvalidInput
from snnav_ros.convert import area_to_grid
from snnav_ros.convert.grid import BOUNDARY, FREE, UNKNOWN, rasterize

NUMBER = st.floats(-8.0, 8.0)
DISK = st.tuples(NUMBER, NUMBER, st.floats(0.3, 5.0))
BOX = st.tuples(st.integers(-20, 20), st.integers(-20, 20), st.integers(1, 20), st.integers(1, 20))


@st.composite
def regions(draw: st.DrawFn) -> shapely.MultiPolygon:
    disks = [
        shapely.Point(x, y).buffer(r, quad_segs=3) for x, y, r in draw(st.lists(DISK, min_size=1, max_size=4))
    ]
    # corners and edges that fall on cell borders
    boxes = [
        shapely.box(x / 4, y / 4, (x + w) / 4, (y + h) / 4) for x, y, w, h in draw(st.lists(BOX, max_size=3))
    ]
    holes = [shapely.Point(x, y).buffer(r / 4, quad_segs=2) for x, y, r in draw(st.lists(DISK, max_size=3))]
    return as_multipolygon(shapely.union_all(disks + boxes).difference(shapely.union_all(holes)))


@given(regions(), st.sampled_from([0.25, 0.5, 0.3]))
def test_free_cells_are_exactly_those_wholly_inside(region: shapely.MultiPolygon, resolution: float) -> None:
    area = UnoccupiedArea(0.0, region)
    if area.is_empty:
        return
    cells, column, row = rasterize(area.rings, resolution)
    rows, columns = np.indices(cells.shape)
    x, y = (columns + column) * resolution, (rows + row) * resolution
    boxes = shapely.box(x, y, x + resolution, y + resolution)
    shapely.prepare(region)
    free = cells == FREE
    assert shapely.covers(region, boxes[free]).all()
    # none is given away either: a cell well inside is free
    inner = shapely.covers(
        region, shapely.box(x - 1e-6, y - 1e-6, x + resolution + 1e-6, y + resolution + 1e-6)
    )
    assert free[inner].all()
    # unknown cells have nothing of the inside of the area
    outside = cells == UNKNOWN
    assert (shapely.area(shapely.intersection(boxes[outside], region)) < 1e-9).all()


@given(regions())
def test_free_cells_are_closed_in_by_the_boundary(region: shapely.MultiPolygon) -> None:
    area = UnoccupiedArea(0.0, region)
    if area.is_empty:
        return
    cells, _, _ = rasterize(area.rings, 0.25)
    for axis in (0, 1):
        first, second = (np.moveaxis(cells, axis, 0)[part] for part in (slice(None, -1), slice(1, None)))
        assert not ((first == FREE) & (second == UNKNOWN)).any()
        assert not ((first == UNKNOWN) & (second == FREE)).any()


def test_message_says_where_the_cells_are() -> None:
    area = UnoccupiedArea(1.5, shapely.MultiPolygon([shapely.box(1.05, 2.05, 3.95, 3.95)]))
    grid = area_to_grid(area, 0.5)
    cells = np.array(grid.data).reshape(grid.info.height, grid.info.width)
    free = np.argwhere(cells == FREE) * 0.5
    origin = np.array([grid.info.origin.position.y, grid.info.origin.position.x])
    assert (free.min(axis=0) + origin).tolist() == [2.5, 1.5]
    assert (free.max(axis=0) + origin).tolist() == [3.0, 3.0]
    assert set(np.unique(cells)) == {FREE, BOUNDARY, UNKNOWN}
    assert (grid.header.frame_id, grid.header.stamp.sec, grid.header.stamp.nanosec) == ("map", 1, 500_000_000)
    assert grid.info.resolution == pytest.approx(0.5)


def test_empty_area_gives_no_cells_and_bad_resolutions_are_refused() -> None:
    assert len(area_to_grid(UnoccupiedArea(0.0, shapely.MultiPolygon()), 0.1).data) == 0
    large = UnoccupiedArea(0.0, shapely.MultiPolygon([shapely.box(0, 0, 1000, 1000)]))
    with pytest.raises(InvalidInput, match="use a coarser one"):
        area_to_grid(large, 0.1)
    with pytest.raises(InvalidInput, match="must be positive"):
        area_to_grid(large, 0.0)
