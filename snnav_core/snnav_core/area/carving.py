"""Which cells of a grid a depth camera saw to be free (Ch. 4, N_i)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from snnav_core.area.grid import Grid
from snnav_core.sensing.depth import DepthCamera
from snnav_core.types import FloatArray

__all__ = ["Carver"]


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
    table_columns = model.columns * (2 if model.around else 1)
    cells, corner, size, far = _project(
        (grid.origin - camera.position) @ camera.rotation,
        np.ascontiguousarray(grid.spacing * camera.rotation),
        grid.shape,
        model.kind == "equal_angle",
        (model.columns, model.rows, table_columns),
        (model.column_step, model.row_step, model.column_centre, model.row_centre),
        (model.range_max, grid.half_diagonal),
    )
    return _Windows(cells, corner, size, np.nextafter(far, np.float32(np.inf)))


@njit(cache=True, nogil=True)
def _project(
    origin: FloatArray,
    axes: FloatArray,
    shape: tuple[int, int, int],
    angles: bool,
    pixels: tuple[int, int, int],
    optics: tuple[float, float, float, float],
    reach: tuple[float, float],
) -> tuple[
    NDArray[np.int32], NDArray[np.int32], NDArray[np.int16], NDArray[np.float32]
]:  # pragma: no cover - compiled
    """Return the windows of cells: index, first pixel, size, farthest corner.

    Parameters
    ----------
    origin, axes : ndarray, shapes (3,) and (3, 3)
        Lowest corner of the grid, and the edges of a cell as rows, in the camera frame [m].
    shape : tuple of int
        Of the grid.
    angles : bool
        Whether pixels are equal steps of angle, else of the tangent.
    pixels : tuple of int
        Columns and rows of the image, columns of the table (twice as many when the image closes round).
    optics : tuple of float
        Steps and centres, of columns and rows.
    reach : tuple of float
        Greatest range, half the diagonal of a cell [m].
    """
    range_max, half = reach
    found = 0
    count = shape[0] * shape[1] * shape[2]
    cells = np.empty(count, dtype=np.int32)
    corner = np.empty(count, dtype=np.int32)
    size = np.empty((count, 2), dtype=np.int16)
    far = np.empty(count, dtype=np.float32)
    layers = np.empty((2, shape[1] + 1, shape[2] + 1, 3))  # of corners, two in turn: left, up, distance
    _look_at(layers[0], origin, axes, angles, half)
    for index in range(count):
        i, j, k = index // (shape[1] * shape[2]), index // shape[2] % shape[1], index % shape[2]
        if j == 0 and k == 0:
            _look_at(layers[(i + 1) % 2], origin + (i + 1) * axes[0], axes, angles, half)
        ends = _ends(layers[i % 2], layers[(i + 1) % 2], j, k, angles)
        left_low, left_high, up_low, up_high, nearest, farthest = ends
        if nearest < 0.0 or farthest > range_max:
            continue
        bulge = 0.0
        if angles:
            # An edge seen across bulges beyond its corners in elevation, by less than its own angle squared.
            wide = 2.0 * half / nearest
            bulge = 0.5 * wide * wide * max(abs(up_low), abs(up_high)) / optics[1]
        first_column = int(np.rint(optics[2] - left_high / optics[0])) - 1
        last_column = int(np.rint(optics[2] - left_low / optics[0])) + 1
        first_row = int(np.rint(optics[3] - up_high / optics[1] - bulge)) - 1
        last_row = int(np.rint(optics[3] - up_low / optics[1] + bulge)) + 1
        if pixels[2] > pixels[0]:
            shift = first_column // pixels[0] * pixels[0]
            first_column, last_column = first_column - shift, last_column - shift
            if last_column - first_column >= pixels[0] - 1:
                continue
        if first_column < 0 or last_column >= pixels[2] or first_row < 0 or last_row >= pixels[1]:
            continue
        cells[found] = index
        corner[found] = first_row * pixels[2] + first_column
        size[found, 0], size[found, 1] = last_row - first_row + 1, last_column - first_column + 1
        far[found] = farthest
        found += 1
    return cells[:found].copy(), corner[:found].copy(), size[:found].copy(), far[:found].copy()


@njit(cache=True, nogil=True)
def _ends(
    one: FloatArray, other: FloatArray, j: int, k: int, angles: bool
) -> tuple[float, float, float, float, float, float]:  # pragma: no cover - compiled
    """Between which coordinates, and at which distances, the eight corners of a cell lie in two layers of corners."""
    left_low, left_high, up_low, up_high = np.inf, -np.inf, np.inf, -np.inf
    nearest, farthest = np.inf, 0.0
    first = one[j, k, 0]
    for number in range(8):
        layer = one if number & 1 == 0 else other
        corner = layer[j + (number >> 1 & 1), k + (number >> 2)]
        left = corner[0]
        if angles:
            left -= 2.0 * np.pi * np.floor((left - first) / (2.0 * np.pi) + 0.5)
        left_low, left_high = min(left_low, left), max(left_high, left)
        up_low, up_high = min(up_low, corner[1]), max(up_high, corner[1])
        nearest, farthest = min(nearest, corner[2]), max(farthest, corner[2])
    return left_low, left_high, up_low, up_high, nearest, farthest


@njit(cache=True, nogil=True)
def _look_at(
    layer: FloatArray, origin: FloatArray, axes: FloatArray, angles: bool, half: float
) -> None:  # pragma: no cover - compiled
    """Fill (ny + 1, nz + 1, 3): to the left, up, distance of corners; a distance below 0 where these mean nothing."""
    for j in range(layer.shape[0]):
        for k in range(layer.shape[1]):
            x = origin[0] + j * axes[1, 0] + k * axes[2, 0]
            y = origin[1] + j * axes[1, 1] + k * axes[2, 1]
            z = origin[2] + j * axes[1, 2] + k * axes[2, 2]
            level = np.sqrt(x * x + y * y)
            one = layer[j, k]
            if angles:
                one[0], one[1] = np.arctan2(y, x), np.arctan2(z, level)
                sound = level > half  # the azimuth of a cell above or below the camera means nothing
            else:
                sound = x > 0.1 * half
                one[0], one[1] = y / max(x, 1e-9), z / max(x, 1e-9)
            one[2] = np.sqrt(level * level + z * z) if sound else -1.0


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
