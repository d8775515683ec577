"""How far every cell of a grid is from the nearest solid cell, exactly, and which one that is."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["distance_to_cells"]

_MANY = 300_000  # cells from which on two threads are worth their while


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
    (C4-22). Three passes along the axes, each outwards from every cell. Large grids are shared by two threads, which
    changes nothing of what comes out.
    """
    cells = max(1, math.ceil(reach / spacing + 0.5))
    shape = solid.shape
    first = np.empty(shape, dtype=np.int16)
    squared, row = np.empty(shape, dtype=np.float32), np.empty(shape, dtype=np.int16)
    distance, nearest = np.empty(shape, dtype=np.float32), np.empty(shape, dtype=np.int32)

    def within_planes(begin: int, end: int) -> None:
        _along_z(solid, cells, begin, end, first)
        _along_y(first, cells, begin, end, squared, row)

    def across_planes(begin: int, end: int) -> None:
        lengths = np.float32(spacing), np.float32(reach)
        _along_x(first, squared, row, cells, lengths, begin, end, distance, nearest)

    if solid.size < _MANY:
        within_planes(0, shape[0])
        across_planes(0, shape[0])
        return distance, nearest
    begins, ends = (0, shape[0] // 2), (shape[0] // 2, shape[0])
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(within_planes, begins, ends))
        list(pool.map(across_planes, begins, ends))
    return distance, nearest


@njit(cache=True, nogil=True)
def _along_z(
    solid: NDArray[np.uint8], cells: int, begin: int, end: int, offset: NDArray[np.int16]
) -> None:  # pragma: no cover - compiled
    """Fill planes with the signed number of cells to the nearest solid one of the column, 32767 if none is near."""
    _, ny, nz = solid.shape
    for i in range(begin, end):
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


@njit(cache=True, nogil=True)
def _along_y(
    first: NDArray[np.int16],
    cells: int,
    begin: int,
    end: int,
    squared: NDArray[np.float32],
    row: NDArray[np.int16],
) -> None:  # pragma: no cover - compiled
    """Fill planes of equal x with squared distances [cells] within them, and the column they go to."""
    _, ny, nz = first.shape
    height = np.empty((ny, nz), dtype=np.float32)
    for i in range(begin, end):
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
            best[:] = np.float32(1e9)
            source[:] = -1
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


@njit(cache=True, nogil=True)
def _along_x(
    first: NDArray[np.int16],
    squared: NDArray[np.float32],
    row: NDArray[np.int16],
    cells: int,
    lengths: tuple[np.float32, np.float32],
    begin: int,
    end: int,
    distance: NDArray[np.float32],
    nearest: NDArray[np.int32],
) -> None:  # pragma: no cover - compiled
    """Fill planes with distances [m] in space and the flat index of the cell they go to; lengths: spacing, reach."""
    nx, ny, nz = first.shape
    spacing, reach = lengths
    best = np.empty(nz, dtype=np.float32)
    source = np.empty(nz, dtype=np.int32)
    for i in range(begin, end):
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
                    nearest[i, j, k] = -1
                    continue
                distance[i, j, k] = metres
                x = source[k]
                y = row[x, j, k]
                nearest[i, j, k] = (x * ny + y) * nz + k + first[x, y, k]
