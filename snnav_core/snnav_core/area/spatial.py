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

__all__ = ["SpatialArea", "bound", "interpolate"]


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
    A ball around every centre is free, so a point has at least the clearance of a centre less its distance from it:
    the best of the eight centres around. And with d the distance to any set of bodies, d(x)^2 - x^2 is concave: where p
    is the mean of these centres c by the weights w of linear interpolation,

        d(p)^2 >= sum w d(c)^2 - sum w (c - p)^2,

    also with lower bounds of d(c) in its place. The better of both is taken; it is never too much (C4-22), and 1 cm
    too little at 0.4 m in cells of 0.1 m, where half a cell's diagonal is 9 cm.
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
        points = np.array(points, dtype=np.float64, order="C")
        grown = np.broadcast_to(np.asarray(growth, dtype=np.float64), len(points)).copy()
        return np.asarray(
            _bounds(points, grown, self.moving, self.static, self.grid.origin, self.grid.spacing)
        )

    def smooth_at(
        self, points: FloatArray, growth: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Interpolated clearance (N,) [m] and its gradient (N, 3), for planning; `clearance_at` is what is proved.

        Parameters are those of `clearance_at`.
        """
        points = np.array(points, dtype=np.float64, order="C")
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
def _bounds(
    points: FloatArray,
    growth: FloatArray,
    moving: NDArray[np.float32],
    static: NDArray[np.float32],
    origin: FloatArray,
    spacing: float,
) -> FloatArray:  # pragma: no cover - compiled
    """Return `bound` at points."""
    found = np.empty(len(points))
    for n in range(len(points)):
        found[n] = bound(points[n], growth[n], moving, static, origin, spacing)
    return found


@njit(cache=True, nogil=True)
def bound(
    point: FloatArray,
    growth: float,
    moving: NDArray[np.float32],
    static: NDArray[np.float32],
    origin: FloatArray,
    spacing: float,
) -> float:  # pragma: no cover - compiled
    """Lower bound of the clearance of a point (3,): per field, by the eight centres around it; the smaller of both."""
    nx, ny, nz = moving.shape
    x = (point[0] - origin[0]) / spacing
    y = (point[1] - origin[1]) / spacing
    z = (point[2] - origin[2]) / spacing
    if not (0.0 <= x <= nx and 0.0 <= y <= ny and 0.0 <= z <= nz):
        return -np.inf
    i0, j0, k0 = int(np.floor(x - 0.5)), int(np.floor(y - 0.5)), int(np.floor(z - 0.5))
    u, v, w = x - 0.5 - i0, y - 0.5 - j0, z - 0.5 - k0
    best_moving, best_static = -np.inf, -np.inf  # a centre less the way to it
    mean_moving, mean_static, inside = 0.0, 0.0, 0  # of squares
    for a in range(2):
        for b in range(2):
            for c in range(2):
                i, j, k = i0 + a, j0 + b, k0 + c
                if not (0 <= i < nx and 0 <= j < ny and 0 <= k < nz):
                    continue
                inside += 1
                dx, dy, dz = a - u, b - v, c - w
                way = np.sqrt(dx * dx + dy * dy + dz * dz) * spacing
                one, other = moving[i, j, k] - growth, np.float64(static[i, j, k])
                best_moving = max(best_moving, one - way)
                best_static = max(best_static, other - way)
                weight = (1.0 - abs(dx)) * (1.0 - abs(dy)) * (1.0 - abs(dz))
                mean_moving += weight * max(one, 0.0) ** 2
                mean_static += weight * max(other, 0.0) ** 2
    if inside == 8:
        spread = spacing * spacing * (u * (1.0 - u) + v * (1.0 - v) + w * (1.0 - w))
        if mean_moving > spread:
            best_moving = max(best_moving, np.sqrt(mean_moving - spread))
        if mean_static > spread:
            best_static = max(best_static, np.sqrt(mean_static - spread))
    return min(best_moving, best_static)


@njit(cache=True, nogil=True)
def _interpolate(
    points: FloatArray,
    growth: FloatArray,
    moving: NDArray[np.float32],
    static: NDArray[np.float32],
    origin: FloatArray,
    spacing: float,
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Value and gradient of `interpolate` at points."""
    value, gradient = np.empty(len(points)), np.empty((len(points), 3))
    for n in range(len(points)):
        value[n] = interpolate(points[n], growth[n], moving, static, origin, spacing, gradient[n])
    return value, gradient


@njit(cache=True, nogil=True)
def interpolate(
    point: FloatArray,
    growth: float,
    moving: NDArray[np.float32],
    static: NDArray[np.float32],
    origin: FloatArray,
    spacing: float,
    gradient: FloatArray,
) -> float:  # pragma: no cover - compiled
    """Interpolate min(moving - growth, static) linearly at a point (3,), clamped to the grid; fill its gradient."""
    nx, ny, nz = moving.shape
    i, u = _between(point[0], origin[0], spacing, nx)
    j, v = _between(point[1], origin[1], spacing, ny)
    k, w = _between(point[2], origin[2], spacing, nz)
    total = 0.0
    gradient[:] = 0.0
    for a in range(2):
        wx, ia = (u if a else 1.0 - u), min(i + a, nx - 1)
        for b in range(2):
            wy, jb = (v if b else 1.0 - v), min(j + b, ny - 1)
            for c in range(2):
                wz, kc = (w if c else 1.0 - w), min(k + c, nz - 1)
                one = min(moving[ia, jb, kc] - growth, static[ia, jb, kc])
                total += wx * wy * wz * one
                gradient[0] += (2 * a - 1) * wy * wz * one / spacing
                gradient[1] += (2 * b - 1) * wx * wz * one / spacing
                gradient[2] += (2 * c - 1) * wx * wy * one / spacing
    return total


@njit(cache=True, nogil=True)
def _between(
    coordinate: float, origin: float, spacing: float, size: int
) -> tuple[int, float]:  # pragma: no cover - compiled
    """The centre at or below a coordinate along one axis, and the share of the way to the next one."""
    at = min(max((coordinate - origin) / spacing - 0.5, 0.0), size - 1.0)
    low = min(int(at), max(size - 2, 0))
    return low, at - low
