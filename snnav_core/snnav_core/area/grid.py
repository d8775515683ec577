"""A box of cubic cells in space."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray

__all__ = ["Grid"]

_MOST_CELLS = 50_000_000


@dataclass(frozen=True)
class Grid:
    """Cubic cells; cell (i, j, k) reaches from origin + spacing (i, j, k) to origin + spacing (i + 1, j + 1, k + 1).

    Parameters
    ----------
    origin : array_like, shape (3,)
        Lowest corner [m, map].
    spacing : float
        Edge of a cell [m].
    shape : tuple of int
        Number of cells along x, y, z.

    Raises
    ------
    InvalidInput
        If the origin is not finite, the spacing not positive, or there are no cells or over 50 million.
    """

    origin: FloatArray
    spacing: float
    shape: tuple[int, int, int]

    def __post_init__(self) -> None:
        origin = np.array(self.origin, dtype=np.float64)
        if origin.shape != (3,) or not np.isfinite(origin).all():
            raise InvalidInput(f"grid: origin is {origin.tolist()}, expected three finite numbers")
        if not (math.isfinite(self.spacing) and self.spacing > 0.0):
            raise InvalidInput(f"grid: spacing is {self.spacing} m, must be a positive number")
        cells = math.prod(self.shape)
        if min(self.shape) < 1 or cells > _MOST_CELLS:
            raise InvalidInput(
                f"grid: {self.shape} are {cells} cells, must be 1 to {_MOST_CELLS}; choose another spacing"
            )
        origin.setflags(write=False)
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "shape", tuple(int(size) for size in self.shape))

    @classmethod
    def covering(cls, low: FloatArray, high: FloatArray, spacing: float) -> Grid:
        """Return the grid inside the box from `low` to `high` (3,) [m, map]: rest that fills no cell is left out."""
        size = np.asarray(high, dtype=np.float64) - np.asarray(low, dtype=np.float64)
        if not (np.isfinite(size).all() and (size >= spacing).all()):
            raise InvalidInput(f"grid: the box {list(low)} to {list(high)} holds no cell of {spacing} m")
        nx, ny, nz = np.floor(size / spacing + 1e-6).astype(int).tolist()
        return cls(np.asarray(low, dtype=np.float64), spacing, (nx, ny, nz))

    @property
    def half_diagonal(self) -> float:
        """Distance from the centre of a cell to its corners [m]."""
        return 0.5 * math.sqrt(3.0) * self.spacing

    @property
    def high(self) -> FloatArray:
        """Highest corner (3,) [m, map]."""
        corner: FloatArray = self.origin + self.spacing * np.array(self.shape)
        return corner

    def centres(self) -> FloatArray:
        """Centres of all cells, shape (nx, ny, nz, 3) [m, map]."""
        axes = [self.origin[axis] + self.spacing * (np.arange(self.shape[axis]) + 0.5) for axis in range(3)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
