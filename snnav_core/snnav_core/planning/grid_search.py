"""Ways from cell to cell of the free region: finds one whenever the cells are connected, however narrow (Ch. 4)."""

from __future__ import annotations

import heapq

import numpy as np
from numba import njit
from numpy.typing import NDArray

from snnav_core.area.spatial import SpatialArea
from snnav_core.planning.flight_edges import NOBODY, Spheres, clear_edges
from snnav_core.types import FloatArray

__all__ = ["GridSearch"]

_AWAY = 10  # cells, along each axis, in which a robot that is not in the region may enter it
_BESIDE = 2  # and a target that is no centre of a cell
_EAGER = 1.3  # what is still ahead counts so much: the way is at most so much longer, and found in a third of the time


class GridSearch:
    """Looks for a way through R[A, d] from cell to cell, each to its 26 neighbours.

    Parameters
    ----------
    area : SpatialArea
    start, goal : ndarray, shape (3,)
        [m, map]
    distance : float
        Clearance that is kept [m]; the start may have less (C4-5).
    growth : float
        How far what may move may have come nearer [m].
    growth_per_metre : float
        V_max / v, for the way from the start to the first cell.
    spheres : ndarray, shape (K, 4)
        Places to stay out of.

    Notes
    -----
    Not in the thesis, whose roadmap may miss a passage: whether the target can be reached is decided here for cells
    of this size. Between two centres that keep d, a point keeps sqrt(d^2 - 3 h^2 / 4) at least, h being the spacing.
    """

    def __init__(
        self,
        area: SpatialArea,
        start: FloatArray,
        goal: FloatArray,
        distance: float,
        growth: float,
        growth_per_metre: float,
        spheres: Spheres = NOBODY,
    ) -> None:
        self.area, self.start, self.goal, self.spheres = area, start, goal, spheres
        self.distance, self.growth = distance, growth
        region = area.reduced(distance, growth)
        for x, y, z, radius in spheres.tolist():
            _cut_out(region, area, np.array((x, y, z)), radius)
        self._region = region
        self._entries = self._cells_near(start, _AWAY, growth_per_metre)
        self._exits = self._cells_near(goal, _BESIDE, None)

    def is_connected(self) -> bool:
        """Whether there is a way at all."""
        if len(self._entries) == 0 or len(self._exits) == 0:
            return False
        return bool(_is_connected(self._region, self._exits, self._entries))

    def way(self) -> FloatArray | None:
        """Return the vertices of a short way from start to goal, (M, 3) [m, map]; None when there is none."""
        if not self.is_connected():
            return None
        spacing = self.area.grid.spacing
        costs = np.linalg.norm(self._centres(self._entries) - self.start, axis=1) / spacing
        cells = _shortest(self._region, self._entries, costs, self._exits, self._cell(self.goal))
        return self._straightened(np.vstack((self.start, self._centres(cells), self.goal)))

    def _cell(self, point: FloatArray) -> NDArray[np.int64]:
        grid = self.area.grid
        cell = np.floor((point - grid.origin) / grid.spacing).astype(np.int64)
        return np.clip(cell, 0, np.array(grid.shape) - 1)

    def _centres(self, cells: NDArray[np.int64]) -> FloatArray:
        places = np.stack(np.unravel_index(cells, self._region.shape), axis=-1)
        centres: FloatArray = self.area.grid.origin + self.area.grid.spacing * (places + 0.5)
        return centres

    def _cells_near(self, point: FloatArray, away: int, growth_per_metre: float | None) -> NDArray[np.int64]:
        """Cells of the region around a point that a straight edge leads to, as flat indices."""
        cell = self._cell(point)
        low, high = np.maximum(cell - away, 0), np.minimum(cell + away + 1, self._region.shape)
        block = np.argwhere(self._region[low[0] : high[0], low[1] : high[1], low[2] : high[2]]) + low
        cells = np.ravel_multi_index(tuple(block.T), self._region.shape)
        ends = self._centres(cells)
        begins = np.broadcast_to(point, ends.shape)
        per_metre = None if growth_per_metre is None else np.full(len(ends), growth_per_metre)
        clear = clear_edges(self.area, begins, ends, self.distance, self.growth, self.spheres, per_metre)
        return np.asarray(cells[clear])

    def _straightened(self, way: FloatArray) -> FloatArray:
        """From every vertex kept, straight on to the last one that can be seen; the first step may start too near."""
        kept = [0, 1]
        while kept[-1] < len(way) - 1:
            at = kept[-1]
            ends = way[at + 1 :]
            begins = np.broadcast_to(way[at], ends.shape)
            clear = clear_edges(self.area, begins, ends, self._between, self.growth, self.spheres)
            kept.append(at + 1 + int(np.flatnonzero(clear).max(initial=0)))
        return way[kept]

    @property
    def _between(self) -> float:
        """What is kept between two centres [m]."""
        return float(np.sqrt(max(self.distance**2 - self.area.grid.half_diagonal**2, 0.0)))


def _cut_out(region: NDArray[np.bool_], area: SpatialArea, centre: FloatArray, radius: float) -> None:
    """Take the cells whose centres lie in a sphere out of a region, in place."""
    grid = area.grid
    low = np.maximum(np.floor((centre - radius - grid.origin) / grid.spacing).astype(int), 0)
    high = np.minimum(np.ceil((centre + radius - grid.origin) / grid.spacing).astype(int), grid.shape)
    if (high <= low).any():
        return
    axes = [
        grid.origin[axis] + grid.spacing * (np.arange(low[axis], high[axis]) + 0.5) - centre[axis]
        for axis in range(3)
    ]
    squared = axes[0][:, None, None] ** 2 + axes[1][:, None] ** 2 + axes[2] ** 2
    region[low[0] : high[0], low[1] : high[1], low[2] : high[2]] &= squared > radius * radius


@njit(cache=True, nogil=True)
def _is_connected(region, exits, entries):  # type: ignore[no-untyped-def]
    """Flood the region from the exits until an entry is wet."""
    nx, ny, nz = region.shape
    wanted = np.zeros(region.size, dtype=np.uint8)  # 1: an entry, 2: seen
    for cell in entries:
        wanted[cell] = 1
    queue = np.empty(region.size, dtype=np.int32)
    count = 0
    for cell in exits:
        if wanted[cell] == 1:
            return True
        wanted[cell] = 2
        queue[count] = cell
        count += 1
    done = 0
    while done < count:
        cell = queue[done]
        done += 1
        i, j, k = cell // (ny * nz), cell // nz % ny, cell % nz
        for a in range(max(i - 1, 0), min(i + 2, nx)):
            for b in range(max(j - 1, 0), min(j + 2, ny)):
                for c in range(max(k - 1, 0), min(k + 2, nz)):
                    other = (a * ny + b) * nz + c
                    if wanted[other] == 2 or not region[a, b, c]:
                        continue
                    if wanted[other] == 1:
                        return True
                    wanted[other] = 2
                    queue[count] = other
                    count += 1
    return False


@njit(cache=True, nogil=True)
def _ahead(i, j, k, goal):  # type: ignore[no-untyped-def]
    """Length of the shortest way to the cell `goal` from centre to centre, were nothing between [cells]."""
    a, b, c = abs(i - goal[0]), abs(j - goal[1]), abs(k - goal[2])
    most, least = max(a, b, c), min(a, b, c)
    middle = a + b + c - most - least
    return most - middle + np.sqrt(2.0) * (middle - least) + np.sqrt(3.0) * least


@njit(cache=True, nogil=True)
def _shortest(region, entries, costs, exits, goal):  # type: ignore[no-untyped-def]
    """A* from entries that cost something to reach, to the first exit: cells from entry to exit, empty if none."""
    nx, ny, nz = region.shape
    cost = np.full(region.size, np.float32(np.inf), dtype=np.float32)
    before = np.full(region.size, -1, dtype=np.int32)
    is_exit = np.zeros(region.size, dtype=np.bool_)
    is_exit[exits] = True
    done = np.zeros(region.size, dtype=np.bool_)
    heap = [(0.0, np.float32(0.0), np.int64(-1))]
    heapq.heappop(heap)
    for n in range(len(entries)):
        cell = entries[n]
        cost[cell] = costs[n]
        i, j, k = cell // (ny * nz), cell // nz % ny, cell % nz
        heapq.heappush(heap, (cost[cell] + _EAGER * _ahead(i, j, k, goal), cost[cell], np.int64(cell)))
    last = np.int64(-1)
    while len(heap) > 0:
        _, known, cell = heapq.heappop(heap)
        if done[cell]:
            continue
        done[cell] = True
        if is_exit[cell]:
            last = cell
            break
        i, j, k = cell // (ny * nz), cell // nz % ny, cell % nz
        for a in range(max(i - 1, 0), min(i + 2, nx)):
            for b in range(max(j - 1, 0), min(j + 2, ny)):
                for c in range(max(k - 1, 0), min(k + 2, nz)):
                    other = (a * ny + b) * nz + c
                    if done[other] or not region[a, b, c]:
                        continue
                    step = np.sqrt(float((a - i) ** 2 + (b - j) ** 2 + (c - k) ** 2))
                    total = np.float32(known + step)
                    if total < cost[other]:
                        cost[other] = total
                        before[other] = cell
                        heapq.heappush(heap, (total + _EAGER * _ahead(a, b, c, goal), total, np.int64(other)))
    count = 0
    cell = last
    while cell >= 0:
        count += 1
        cell = np.int64(before[cell])
    cells = np.empty(count, dtype=np.int64)
    cell = last
    for n in range(count):
        cells[count - 1 - n] = cell
        cell = np.int64(before[cell])
    return cells
