"""Where the rays of a camera meet walls that are known, and robots that are known."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from snnav_core.area.grid import Grid
from snnav_core.sensing.depth import DepthCamera
from snnav_core.types import FloatArray

__all__ = ["pass_through_robots", "ways_to_walls"]


def ways_to_walls(
    camera: DepthCamera, grid: Grid, walls: NDArray[np.uint8], walled_in: bool
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return how far every ray goes before it enters a cell that is known to be solid, and where it leaves such again.

    Parameters
    ----------
    camera : DepthCamera
        It may be mounted in such a cell, or outside the grid: what it leaves first does not count.
    grid : Grid
    walls : ndarray of uint8, shape (nx, ny, nz)
        Nonzero where a body that never moves reaches into the cell.
    walled_in : bool
        Whether the outside of the grid is such a body.

    Returns
    -------
    enter, leave : ndarray of float32, shape (rows, columns)
        [m]; inf where the ray meets none. Where it does not come out again, but for the outside of the grid, `leave`
        is inf.
    """
    rays = (camera.model.rays() @ camera.rotation.T).reshape(-1, 3)
    start = (camera.position - grid.origin) / grid.spacing
    ways = _march(start, rays, walls, walled_in) * grid.spacing
    enter, leave = ways.reshape(2, camera.model.rows, camera.model.columns).astype(np.float32)
    return enter, leave


@njit(cache=True, nogil=True)
def _march(
    start: FloatArray, rays: FloatArray, walls: NDArray[np.uint8], walled_in: bool
) -> FloatArray:  # pragma: no cover - compiled
    """Walk from cell to cell along every ray; lengths in cells to where it enters and leaves walls, (2, R)."""
    shape = walls.shape
    ways = np.full((2, len(rays)), np.inf)
    cell = np.empty(3, dtype=np.int64)
    step = np.empty(3, dtype=np.int64)
    following = np.empty(3)
    stride = np.empty(3)
    for n in range(len(rays)):
        # Enter the grid, if the camera stands outside of it.
        begin, end = 0.0, np.inf
        for axis in range(3):
            if rays[n, axis] == 0.0:
                if start[axis] < 0.0 or start[axis] > shape[axis]:
                    end = -1.0
                continue
            one = (0.0 - start[axis]) / rays[n, axis]
            other = (shape[axis] - start[axis]) / rays[n, axis]
            begin, end = max(begin, min(one, other)), min(end, max(one, other))
        if end <= begin:
            continue
        way = begin
        for axis in range(3):
            at = start[axis] + (begin + 1e-9) * rays[n, axis]
            cell[axis] = min(max(int(np.floor(at)), 0), shape[axis] - 1)
            step[axis] = 1 if rays[n, axis] > 0.0 else -1
            if rays[n, axis] == 0.0:
                following[axis], stride[axis] = np.inf, np.inf
            else:
                border = cell[axis] + (1 if step[axis] > 0 else 0)
                following[axis] = (border - start[axis]) / rays[n, axis]
                stride[axis] = abs(1.0 / rays[n, axis])
        left = False
        while True:
            solid = walls[cell[0], cell[1], cell[2]] != 0
            if solid and left and ways[0, n] == np.inf:
                ways[0, n] = way
            if not solid and ways[0, n] < np.inf:
                ways[1, n] = way
                break
            left = left or not solid
            axis = 0
            if following[1] < following[axis]:
                axis = 1
            if following[2] < following[axis]:
                axis = 2
            way = following[axis]
            following[axis] += stride[axis]
            cell[axis] += step[axis]
            if cell[axis] < 0 or cell[axis] >= shape[axis]:
                if walled_in and ways[0, n] == np.inf:
                    ways[0, n] = way
                break
    return ways


@njit(cache=True, nogil=True)
def pass_through_robots(
    free_up_to: NDArray[np.float32],
    measured: FloatArray,
    rays: FloatArray,
    position: FloatArray,
    spheres: FloatArray,
    pad: float,
) -> None:  # pragma: no cover - compiled
    """Let rays that end at a known robot go on to where they leave its padded sphere, in place (C3-6, C4-23).

    Parameters
    ----------
    free_up_to : ndarray of float32, shape (rows, columns)
        [m]
    measured : ndarray, shape (rows, columns)
        [m], NaN where there is none.
    rays : ndarray, shape (rows, columns, 3)
        Unit vectors [map].
    position : ndarray, shape (3,)
        Of the camera [m, map].
    spheres : ndarray, shape (K, 4)
        Centres [m, map] and radii [m] of the robots.
    pad : float
        By how much the sphere is grown [m]: nothing but the robot is expected in it, for robots keep their margin.
    """
    rows, columns = free_up_to.shape
    for k in range(len(spheres)):
        gap = spheres[k, :3] - position
        radius = spheres[k, 3] + pad
        squared = gap[0] * gap[0] + gap[1] * gap[1] + gap[2] * gap[2]
        for row in range(rows):
            for column in range(columns):
                ray = rays[row, column]
                along = gap[0] * ray[0] + gap[1] * ray[1] + gap[2] * ray[2]
                inside = radius * radius - squared + along * along
                if along <= 0.0 or inside <= 0.0:
                    continue
                half = np.sqrt(inside)
                seen = measured[row, column]
                if along - half <= seen <= along + half:
                    free_up_to[row, column] = max(free_up_to[row, column], np.float32(along + half))
