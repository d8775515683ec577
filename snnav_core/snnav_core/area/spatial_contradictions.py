"""Points that cameras measured where nothing should be: in space that was seen free, and is remembered."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from snnav_core.types import FloatArray

__all__ = ["mark_contradictions"]


@njit(cache=True, nogil=True)
def mark_contradictions(
    marked: NDArray[np.uint8],
    clearance: NDArray[np.float32],
    depth: float,
    origin: FloatArray,
    spacing: float,
    measured: FloatArray,
    rays: FloatArray,
    position: FloatArray,
    ways: NDArray[np.float32],
    spheres: FloatArray,
    pad: float,
) -> int:  # pragma: no cover - compiled
    """Mark the cells in which measured points lie deeper than `depth` in free space, in place; return their number.

    Parameters
    ----------
    marked : ndarray of uint8, shape (nx, ny, nz)
    clearance : ndarray of float32, shape (nx, ny, nz)
        What is taken for free [m].
    depth : float
        [m]
    origin, spacing : ndarray (3,), float
        Of the cells [m, map].
    measured : ndarray, shape (rows, columns)
        Ranges, NaN where there is none [m].
    rays : ndarray, shape (rows, columns, 3)
        Unit vectors [map].
    position : ndarray, shape (3,)
        Of the camera [m, map].
    ways : ndarray of float32, shape (rows, columns)
        Points as far as this are on walls that are known [m].
    spheres : ndarray, shape (K, 4)
        Centres and radii of the robots [m, map]; points in them, grown by `pad`, are theirs.
    pad : float
        [m]

    Returns
    -------
    int
    """
    shape = clearance.shape
    count = 0
    for row in range(measured.shape[0]):
        for column in range(measured.shape[1]):
            way = measured[row, column]
            if not way < ways[row, column]:  # also for NaN
                continue
            x = position[0] + way * rays[row, column, 0]
            y = position[1] + way * rays[row, column, 1]
            z = position[2] + way * rays[row, column, 2]
            i = int(np.floor((x - origin[0]) / spacing))
            j = int(np.floor((y - origin[1]) / spacing))
            k = int(np.floor((z - origin[2]) / spacing))
            if not (0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= k < shape[2]):
                continue
            if not clearance[i, j, k] > depth:
                continue
            is_robot = False
            for number in range(len(spheres)):
                dx, dy, dz = x - spheres[number, 0], y - spheres[number, 1], z - spheres[number, 2]
                reach = spheres[number, 3] + pad
                if dx * dx + dy * dy + dz * dz <= reach * reach:
                    is_robot = True
                    break
            if not is_robot:
                marked[i, j, k] = 1
                count += 1
    return count
