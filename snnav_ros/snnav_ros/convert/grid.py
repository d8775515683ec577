"""The unoccupied area as a nav_msgs/OccupancyGrid for RViz, Foxglove and Nav2, on the safe side."""

from __future__ import annotations

import array
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray
from snnav_ros.available import new_message
from snnav_ros.convert.frames import MAP_FRAME, header
from snnav_ros.convert.stamps import nanoseconds

__all__ = ["BOUNDARY", "FREE", "UNKNOWN", "area_to_grid", "rasterize"]

FREE, BOUNDARY, UNKNOWN = 0, 100, -1
_MOST_CELLS = 4_000_000
_ROUNDING = 1e-9  # share of a cell


def area_to_grid(area: UnoccupiedArea, resolution: float) -> Any:
    """Return the grid that covers an area.

    Parameters
    ----------
    area : UnoccupiedArea
    resolution : float
        Side of a cell [m].

    Returns
    -------
    nav_msgs/OccupancyGrid
        A cell is free (0) only when it lies wholly inside the area; occupied (100) when the boundary passes through
        it, so that free cells are closed in all round; unknown (-1) otherwise. Corners are multiples of the
        resolution: grids of successive areas fit on each other. An empty area gives a grid without cells.

    Raises
    ------
    InvalidInput
        If the resolution is not positive, or so fine that the grid would have more than 4 million cells.
    """
    if not (math.isfinite(resolution) and resolution > 0.0):
        raise InvalidInput(f"resolution of the grid is {resolution} m, must be positive")
    message = new_message("nav_msgs/OccupancyGrid", header=header(nanoseconds(area.stamp), MAP_FRAME))
    message.info.map_load_time = message.header.stamp
    message.info.resolution = resolution
    message.info.origin.orientation.w = 1.0
    if area.is_empty:
        return message
    cells, column, row = rasterize(area.rings, resolution)
    message.info.height, message.info.width = cells.shape
    message.info.origin.position.x, message.info.origin.position.y = column * resolution, row * resolution
    message.data = array.array("b", cells.tobytes())
    return message


def rasterize(rings: Sequence[FloatArray], resolution: float) -> tuple[NDArray[np.int8], int, int]:
    """Return the cells (rows along y) and the column and row of the first one, counted from the map's origin."""
    starts = np.concatenate(rings) / resolution
    ends = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings]) / resolution
    low = np.floor(starts.min(axis=0)).astype(np.int64) - 1
    columns, rows = (np.floor(starts.max(axis=0)).astype(np.int64) + 2 - low).tolist()
    if columns * rows > _MOST_CELLS:
        raise InvalidInput(
            f"resolution {resolution} m makes a grid of {columns} x {rows} cells, more than {_MOST_CELLS}; "
            "use a coarser one"
        )
    starts, ends = starts - low, ends - low
    cells = np.where(_inside(starts, ends, rows, columns), np.int8(FREE), np.int8(UNKNOWN))
    cells[_touched(starts, ends, rows, columns)] = BOUNDARY
    return cells, int(low[0]), int(low[1])


def _inside(starts: FloatArray, ends: FloatArray, rows: int, columns: int) -> NDArray[np.bool_]:
    """Whether the centre of a cell lies inside, by the parity of the edges left of it; shape (rows, columns)."""
    edge, row = _edge_rows(starts[:, 1] - 0.5, ends[:, 1] - 0.5)
    height = row + 0.5
    share = (height - starts[edge, 1]) / (ends[edge, 1] - starts[edge, 1])
    crossing = starts[edge, 0] + share * (ends[edge, 0] - starts[edge, 0])
    first = np.clip(np.ceil(crossing - 0.5).astype(np.int64), 0, columns)
    toggles = np.zeros((rows, columns + 1), dtype=np.int64)
    np.add.at(toggles, (row, first), 1)
    inside: NDArray[np.bool_] = np.cumsum(toggles, axis=1)[:, :columns] % 2 == 1
    return inside


def _edge_rows(first: FloatArray, second: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs of edge and whole number r with min <= r < max of its two heights."""
    begin = np.ceil(np.minimum(first, second)).astype(np.int64)
    count = np.ceil(np.maximum(first, second)).astype(np.int64) - begin
    edge = np.repeat(np.arange(len(first)), count)
    offset = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    return edge, begin[edge] + offset


def _touched(starts: FloatArray, ends: FloatArray, rows: int, columns: int) -> NDArray[np.bool_]:
    """Whether an edge touches a closed cell; shape (rows, columns)."""
    low, high = np.minimum(starts[:, 1], ends[:, 1]), np.maximum(starts[:, 1], ends[:, 1])
    begin = np.floor(low - _ROUNDING).astype(np.int64)
    count = np.floor(high + _ROUNDING).astype(np.int64) - begin + 1
    edge = np.repeat(np.arange(len(starts)), count)
    row = begin[edge] + np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    ahead = ends[edge] - starts[edge]
    level = np.abs(ahead[:, 1]) < 1e-12
    rise = np.where(level, 1.0, ahead[:, 1])
    shares = np.stack([np.clip((row + side - starts[edge, 1]) / rise, 0.0, 1.0) for side in (0, 1)])
    shares = np.where(level, np.array([[0.0], [1.0]]), shares)
    reach = starts[edge, 0] + shares * ahead[:, 0]
    first = np.floor(reach.min(axis=0) - _ROUNDING).astype(np.int64)
    last = np.floor(reach.max(axis=0) + _ROUNDING).astype(np.int64)
    keep = (row >= 0) & (row < rows)
    marks = np.zeros((rows, columns + 1), dtype=np.int64)
    np.add.at(marks, (row[keep], np.clip(first[keep], 0, columns)), 1)
    np.add.at(marks, (row[keep], np.clip(last[keep] + 1, 0, columns)), -1)
    touched: NDArray[np.bool_] = np.cumsum(marks, axis=1)[:, :columns] > 0
    return touched
