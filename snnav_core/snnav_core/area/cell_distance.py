"""How far every cell of a grid is from the nearest solid cell, exactly, and which one that is."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["distance_to_cells"]

_NONE = -1


def distance_to_cells(
    solid: NDArray[np.uint8], spacing: float, reach: float
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Distance from every cell's centre to the nearest solid cell, as a cube, up to a reach.

    Parameters
    ----------
    solid : ndarray of uint8, shape (nx, ny, nz)
        Nonzero where the cell is solid.
    spacing : float
        Edge of a cell [m].
    reach : float
        Distances beyond it are not worked out [m].

    Returns
    -------
    distance : ndarray of float32, shape (nx, ny, nz)
        [m]; 0 in solid cells, `reach` where there is none within it.
    nearest : ndarray of int32, shape (nx, ny, nz)
        Flat index of that cell, -1 where there is none within reach.

    Notes
    -----
    The distance to a cube along an axis is (|n| - 1/2) cells, n > 0, so half a diagonal need not be taken off
    (C4-22). Three passes along the axes; each looks outwards and ends when it can find nothing nearer.
    """
    cells = max(1, math.ceil(reach / spacing + 0.5))
    first = _along_z(solid, cells)
    squared, row = _along_y(first, cells)
    return _along_x(first, squared, row, cells, np.float32(spacing), np.float32(reach))


@njit(cache=True, nogil=True)
def _along_z(solid: NDArray[np.uint8], cells: int) -> NDArray[np.int16]:  # pragma: no cover - compiled
    """Return the signed number of cells to the nearest solid one in the same column, 32767 if none is near."""
    nx, ny, nz = solid.shape
    offset = np.empty((nx, ny, nz), dtype=np.int16)
    for i in range(nx):
        for j in range(ny):
            last = -32768
            for k in range(nz):
                if solid[i, j, k]:
                    last = k
                offset[i, j, k] = last - k if last >= 0 and k - last <= cells else 32767
            last = -1
            for k in range(nz - 1, -1, -1):
                if solid[i, j, k]:
                    last = k
                if last >= 0 and last - k <= cells:
                    behind = offset[i, j, k]
                    if behind == 32767 or last - k < -behind:
                        offset[i, j, k] = last - k
    return offset


@njit(cache=True, nogil=True)
def _along_y(
    first: NDArray[np.int16], cells: int
) -> tuple[NDArray[np.float32], NDArray[np.int16]]:  # pragma: no cover - compiled
    """Return squared distances [cells] within planes of equal x, and the column they go to."""
    nx, ny, nz = first.shape
    squared = np.full((nx, ny, nz), np.float32(1e9), dtype=np.float32)
    row = np.full((nx, ny, nz), np.int16(-1), dtype=np.int16)
    height = np.empty((ny, nz), dtype=np.float32)
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                n = first[i, j, k]
                if n == 32767:
                    height[j, k] = np.float32(1e9)
                elif n == 0:
                    height[j, k] = np.float32(0.0)
                else:
                    d = abs(n) - np.float32(0.5)
                    height[j, k] = d * d
        for j in range(ny):
            best, source = squared[i, j], row[i, j]
            for n in range(cells + 1):
                d = np.float32(n - 0.5) if n > 0 else np.float32(0.0)
                dd = d * d
                for side in range(2):
                    other = j - n if side == 0 else j + n
                    if (side == 1 and n == 0) or other < 0 or other >= ny:
                        continue
                    for k in range(nz):
                        value = height[other, k] + dd
                        if value < best[k]:
                            best[k] = value
                            source[k] = other
    return squared, row


@njit(cache=True, nogil=True)
def _along_x(
    first: NDArray[np.int16],
    squared: NDArray[np.float32],
    row: NDArray[np.int16],
    cells: int,
    spacing: np.float32,
    reach: np.float32,
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:  # pragma: no cover - compiled
    """Return distances [m] in space and the flat index of the cell they go to."""
    nx, ny, nz = first.shape
    distance = np.empty((nx, ny, nz), dtype=np.float32)
    nearest = np.full((nx, ny, nz), np.int32(-1), dtype=np.int32)
    best = np.empty(nz, dtype=np.float32)
    source = np.empty(nz, dtype=np.int32)
    for i in range(nx):
        for j in range(ny):
            best[:] = np.float32(1e9)
            source[:] = -1
            for n in range(cells + 1):
                d = np.float32(n - 0.5) if n > 0 else np.float32(0.0)
                dd = d * d
                for side in range(2):
                    other = i - n if side == 0 else i + n
                    if (side == 1 and n == 0) or other < 0 or other >= nx:
                        continue
                    for k in range(nz):
                        value = squared[other, j, k] + dd
                        if value < best[k]:
                            best[k] = value
                            source[k] = other
            for k in range(nz):
                metres = np.sqrt(best[k]) * spacing
                if source[k] < 0 or metres >= reach:
                    distance[i, j, k] = reach
                    continue
                distance[i, j, k] = metres
                x = source[k]
                y = row[x, j, k]
                nearest[i, j, k] = (x * ny + y) * nz + k + first[x, y, k]
    return distance, nearest
