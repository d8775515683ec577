"""The unoccupied region of space at one time, as lower bounds of the clearance at the cells of a grid (Ch. 4, A)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from snnav_core.area.grid import Grid
from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray

__all__ = ["SpatialArea"]


@dataclass(frozen=True)
class SpatialArea:
    """What is proved free at a time.

    Parameters
    ----------
    stamp : float
        [s]
    grid : Grid
    moving : ndarray of float32, shape (nx, ny, nz)
        At every cell's centre a lower bound of the distance to all that may be solid and may move, unseen space
        included [m]; 0 or less where nothing is proved. It shrinks with time, by V_max.
    static : ndarray of float32, shape (nx, ny, nz)
        The same for what is known never to move; it does not shrink (C4-2).

    Raises
    ------
    InvalidInput
        If the fields have not the shape of the grid.

    Notes
    -----
    A ball around every centre is free. A point has at least the clearance of a centre less its distance from it; the
    best of the eight centres around is taken. That costs up to half a cell's diagonal and is never too much (C4-22).
    """

    stamp: float
    grid: Grid
    moving: NDArray[np.float32]
    static: NDArray[np.float32]

    def __post_init__(self) -> None:
        for name in ("moving", "static"):
            field = getattr(self, name)
            if field.shape != self.grid.shape:
                raise InvalidInput(
                    f"area: field {name!r} has shape {field.shape}, the grid {self.grid.shape}"
                )
            field.setflags(write=False)

    def clearance_at(self, points: FloatArray, growth: FloatArray | float = 0.0) -> FloatArray:
        """Return a lower bound of the clearance of points.

        Parameters
        ----------
        points : ndarray, shape (N, 3)
            [m, map]
        growth : float or ndarray, shape (N,)
            How far what may move can have come nearer since `stamp` [m]: V_max times the time.

        Returns
        -------
        ndarray, shape (N,)
            [m]; negative or zero where nothing is proved, and outside the grid.
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        grown = np.broadcast_to(np.asarray(growth, dtype=np.float64), len(points)).copy()
        return np.asarray(
            _bound(points, grown, self.moving, self.static, self.grid.origin, self.grid.spacing)
        )

    def smooth_at(
        self, points: FloatArray, growth: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Interpolated clearance (N,) [m] and its gradient (N, 3), for planning; `clearance_at` is what is proved.

        Parameters are those of `clearance_at`.
        """
        points = np.ascontiguousarray(points, dtype=np.float64)
        grown = np.broadcast_to(np.asarray(growth, dtype=np.float64), len(points)).copy()
        value, gradient = _interpolate(
            points, grown, self.moving, self.static, self.grid.origin, self.grid.spacing
        )
        return value, gradient

    def reduced(self, distance: float, growth: float = 0.0) -> NDArray[np.bool_]:
        """Cells whose centres keep a distance [m] to all boundaries: R[A, d], shape (nx, ny, nz)."""
        kept: NDArray[np.bool_] = np.minimum(self.moving - np.float32(growth), self.static) >= distance
        return kept

    def components(self, distance: float, growth: float = 0.0) -> tuple[NDArray[np.int32], int]:
        """Label the connected parts of R[A, d]: labels (nx, ny, nz) from 1 on, 0 outside, and their number."""
        labels, number = ndimage.label(self.reduced(distance, growth))
        return labels.astype(np.int32), int(number)


@njit(cache=True, nogil=True)
def _bound(
    points: FloatArray,
    growth: FloatArray,
    moving: NDArray[np.float32],
    static: NDArray[np.float32],
    origin: FloatArray,
    spacing: float,
) -> FloatArray:  # pragma: no cover - compiled
    """Best of the eight centres around each point, less the way to it; per field, then the smaller of both."""
    nx, ny, nz = moving.shape
    bound = np.empty(len(points))
    for n in range(len(points)):
        x = (points[n, 0] - origin[0]) / spacing
        y = (points[n, 1] - origin[1]) / spacing
        z = (points[n, 2] - origin[2]) / spacing
        if not (0.0 <= x <= nx and 0.0 <= y <= ny and 0.0 <= z <= nz):
            bound[n] = -np.inf
            continue
        i0, j0, k0 = int(np.floor(x - 0.5)), int(np.floor(y - 0.5)), int(np.floor(z - 0.5))
        best_moving, best_static = -np.inf, -np.inf
        for i in range(max(i0, 0), min(i0 + 2, nx)):
            for j in range(max(j0, 0), min(j0 + 2, ny)):
                for k in range(max(k0, 0), min(k0 + 2, nz)):
                    dx, dy, dz = x - i - 0.5, y - j - 0.5, z - k - 0.5
                    way = np.sqrt(dx * dx + dy * dy + dz * dz) * spacing
                    best_moving = max(best_moving, moving[i, j, k] - way)
                    best_static = max(best_static, static[i, j, k] - way)
        bound[n] = min(best_moving - growth[n], best_static)
    return bound


@njit(cache=True, nogil=True)
def _interpolate(
    points: FloatArray,
    growth: FloatArray,
    moving: NDArray[np.float32],
    static: NDArray[np.float32],
    origin: FloatArray,
    spacing: float,
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Trilinear interpolation of min(moving - growth, static), clamped to the grid, and its gradient."""
    nx, ny, nz = moving.shape
    value = np.empty(len(points))
    gradient = np.zeros((len(points), 3))
    weight = np.empty((3, 2))
    low = np.empty(3, dtype=np.int64)
    size = (nx, ny, nz)
    for n in range(len(points)):
        for axis in range(3):
            at = (points[n, axis] - origin[axis]) / spacing - 0.5
            at = min(max(at, 0.0), size[axis] - 1.0)
            low[axis] = min(int(at), max(size[axis] - 2, 0))
            weight[axis, 1] = at - low[axis]
            weight[axis, 0] = 1.0 - weight[axis, 1]
        total = 0.0
        for a in range(2):
            for b in range(2):
                for c in range(2):
                    i = min(low[0] + a, nx - 1)
                    j = min(low[1] + b, ny - 1)
                    k = min(low[2] + c, nz - 1)
                    one = min(moving[i, j, k] - growth[n], static[i, j, k])
                    total += weight[0, a] * weight[1, b] * weight[2, c] * one
                    gradient[n, 0] += (2 * a - 1) * weight[1, b] * weight[2, c] * one / spacing
                    gradient[n, 1] += (2 * b - 1) * weight[0, a] * weight[2, c] * one / spacing
                    gradient[n, 2] += (2 * c - 1) * weight[0, a] * weight[1, b] * one / spacing
        value[n] = total
    return value, gradient
