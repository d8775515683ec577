"""Which cells of a grid a depth camera saw to be free (Ch. 4, N_i)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from snnav_core.area.grid import Grid
from snnav_core.sensing.depth import CameraModel, DepthCamera
from snnav_core.types import FloatArray

__all__ = ["Carver"]

_CHUNK = 65536  # cells that are projected at once


@dataclass(frozen=True)
class _Windows:
    """For every cell that a camera can see whole: its pixels, and how far they must have seen."""

    cells: NDArray[np.int32]  # (K,) flat index into the grid
    corner: NDArray[np.int32]  # (K,) flat index of the first pixel
    size: NDArray[np.int16]  # (K, 2) rows and columns of the window
    far: NDArray[np.float32]  # (K,) distance of the farthest corner of the cell [m]


class Carver:
    """Carves what one fixed camera sees out of a grid.

    Parameters
    ----------
    camera : DepthCamera
    grid : Grid

    Notes
    -----
    A cell is free when every pixel whose cone meets it, and every pixel next to those, saw farther than its farthest
    corner; a cell that leaves the image is never free. The pixels next to it see bodies that end between two
    rays. What is thinner than a pixel can stay unseen (C4-20): a claim is made for bodies above that size. Which
    pixels belong to which cell is worked out once, for the camera does not move.
    """

    def __init__(self, camera: DepthCamera, grid: Grid) -> None:
        self.camera = camera
        self.grid = grid
        self._windows = _windows(camera, grid)
        side = min(camera.model.rows, camera.model.columns)
        self._levels = int(np.log2(side)) + 1
        self._columns = camera.model.columns * (2 if camera.model.around else 1)
        self._least = np.empty((self._levels, camera.model.rows, self._columns), dtype=np.float32)

    @property
    def cells(self) -> int:
        """Number of cells that the camera can see whole."""
        return len(self._windows.cells)

    def carve(self, free_up_to: NDArray[np.float32], free: NDArray[np.uint8]) -> None:
        """Mark the cells that an image shows free.

        Parameters
        ----------
        free_up_to : ndarray of float32, shape (rows, columns)
            Up to where every pixel saw nothing [m]; 0 where it says nothing (`DepthImage.free_up_to`).
        free : ndarray of uint8, shape (nx, ny, nz)
            Set to 1 where the cell is free, left alone elsewhere.
        """
        columns = self.camera.model.columns
        self._least[0, :, :columns] = free_up_to
        if self._columns > columns:
            self._least[0, :, columns:] = free_up_to
        _least_of_squares(self._least)
        windows = self._windows
        _carve(self._least, windows.cells, windows.corner, windows.size, windows.far, free.reshape(-1))


def _windows(camera: DepthCamera, grid: Grid) -> _Windows:
    """Project the corners of all cells; keep those that lie in the image whole."""
    model = camera.model
    corners = grid.spacing * (np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3, indexing="ij"), -1).reshape(8, 3))
    centres = ((grid.centres() - camera.position) @ camera.rotation).reshape(-1, 3)
    turned = corners @ camera.rotation
    near = np.einsum("ij,ij->i", centres, centres) <= (model.range_max + grid.half_diagonal) ** 2
    candidates = np.flatnonzero(near)
    parts = [
        _project(model, centres[part], turned, part, grid.half_diagonal)
        for part in np.array_split(candidates, max(1, len(candidates) // _CHUNK))
    ]
    return _Windows(*(np.ascontiguousarray(np.concatenate(column)) for column in zip(*parts, strict=True)))


def _project(
    model: CameraModel, centres: FloatArray, corners: FloatArray, cells: NDArray[np.intp], half: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int16], NDArray[np.float32]]:
    """Return the windows of cells: index, first pixel, size, farthest corner."""
    points = centres[:, None, :] + corners  # (K, 8, 3)
    far = np.linalg.norm(points, axis=-1).max(axis=1)
    distance = np.linalg.norm(centres, axis=-1)
    whole = (distance > 2.0 * half) & (far <= model.range_max)
    if model.kind == "equal_angle":
        level = np.hypot(centres[:, 0], centres[:, 1])
        whole &= level > 1.5 * half  # the azimuth of a cell above or below the camera means nothing
        azimuth = np.arctan2(centres[:, 1], centres[:, 0])
        turned = np.arctan2(points[..., 1], points[..., 0]) - azimuth[:, None]
        left = azimuth[:, None] + np.remainder(turned + np.pi, 2.0 * np.pi) - np.pi
        up = np.arctan2(points[..., 2], np.hypot(points[..., 0], points[..., 1]))
        # An edge seen across bulges beyond its corners in elevation, by less than its own angle squared.
        bulge = 0.5 * (2.0 * half / np.maximum(distance - half, half)) ** 2 * np.abs(up).max(axis=1)
    else:
        whole &= points[..., 0].min(axis=1) > 0.1 * half
        depth = np.maximum(points[..., 0], 1e-9)
        left, up = points[..., 1] / depth, points[..., 2] / depth
        bulge = np.zeros(len(centres))
    column = model.column_centre - left / model.column_step
    row = model.row_centre - up / model.row_step
    first_column = np.rint(column.min(axis=1)).astype(np.int64) - 1
    last_column = np.rint(column.max(axis=1)).astype(np.int64) + 1
    first_row = np.rint(row.min(axis=1) - bulge / model.row_step).astype(np.int64) - 1
    last_row = np.rint(row.max(axis=1) + bulge / model.row_step).astype(np.int64) + 1
    table_columns = model.columns
    if model.around:
        table_columns = 2 * model.columns
        shift = np.floor_divide(first_column, model.columns) * model.columns
        first_column, last_column = first_column - shift, last_column - shift
        whole &= last_column - first_column < model.columns - 1
    whole &= (first_column >= 0) & (last_column < table_columns)
    whole &= (first_row >= 0) & (last_row < model.rows)
    size = np.column_stack((last_row - first_row + 1, last_column - first_column + 1))
    corner = first_row * table_columns + first_column
    return (
        cells[whole].astype(np.int32),
        corner[whole].astype(np.int32),
        size[whole].astype(np.int16),
        np.nextafter(far[whole].astype(np.float32), np.float32(np.inf)),
    )


@njit(cache=True, nogil=True)
def _least_of_squares(least: NDArray[np.float32]) -> None:  # pragma: no cover - compiled
    """Fill least[k, r, c] with the least of the 2^k x 2^k pixels from (r, c) on, where they lie in the image."""
    levels, rows, columns = least.shape
    for level in range(1, levels):
        half = 1 << (level - 1)
        for row in range(rows - 2 * half + 1):
            for column in range(columns - 2 * half + 1):
                above = min(least[level - 1, row, column], least[level - 1, row, column + half])
                below = min(least[level - 1, row + half, column], least[level - 1, row + half, column + half])
                least[level, row, column] = min(above, below)


@njit(cache=True, nogil=True)
def _carve(
    least: NDArray[np.float32],
    cells: NDArray[np.int32],
    corner: NDArray[np.int32],
    size: NDArray[np.int16],
    far: NDArray[np.float32],
    free: NDArray[np.uint8],
) -> None:  # pragma: no cover - compiled
    """Mark the cells whose windows saw far enough; cells that are free already are passed over."""
    columns = least.shape[2]
    for index in range(len(cells)):
        cell = cells[index]
        if free[cell]:
            continue
        row, column = corner[index] // columns, corner[index] % columns
        needed = far[index]
        if least[0, row, column] < needed:
            continue
        height, width = size[index, 0], size[index, 1]
        side = min(height, width)
        level = 0
        while (2 << level) <= side:
            level += 1
        step = 1 << level
        clear = True
        down = 0
        while clear and down < height:
            at_row = row + min(down, height - step)
            right = 0
            while right < width:
                if least[level, at_row, column + min(right, width - step)] < needed:
                    clear = False
                    break
                right += step
            down += step
        if clear:
            free[cell] = 1
