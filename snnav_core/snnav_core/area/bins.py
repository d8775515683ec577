"""Line segments sorted into square bins, for the kernels that look up what is near or in the way."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from snnav_core.types import FloatArray

__all__ = ["SegmentBins"]

_MAX_BINS = 250_000


@dataclass(frozen=True)
class SegmentBins:
    """Compressed lists of the segments that touch each bin.

    Parameters
    ----------
    origin : ndarray, shape (2,)
        Corner of the grid [m].
    size : float
        Side of a bin [m].
    columns, rows : int
        Bin (ix, iy) has the number ix * rows + iy.
    offsets, members : ndarray of int
        The segments of bin b are ``members[offsets[b]:offsets[b + 1]]``.
    """

    origin: FloatArray
    size: float
    columns: int
    rows: int
    offsets: NDArray[np.int64]
    members: NDArray[np.int64]

    @classmethod
    def of(cls, starts: FloatArray, ends: FloatArray, least_size: float) -> SegmentBins:
        """Sort segments (S, 2) -> (S, 2) [m], S >= 1, into bins of at least the given side [m]."""
        low = np.minimum(starts.min(axis=0), ends.min(axis=0)) - 1e-6
        extent = np.maximum(starts.max(axis=0), ends.max(axis=0)) + 1e-6 - low
        size = max(least_size, math.sqrt(float(extent[0] * extent[1]) / _MAX_BINS))
        columns, rows = int(extent[0] / size) + 1, int(extent[1] / size) + 1
        offsets, members = _bin_segments(starts, ends, low, size, columns, rows)
        return cls(low, size, columns, rows, offsets, members)


@numba.njit(cache=True)
def _bin_segments(starts, ends, origin, size, nx, ny):  # type: ignore[no-untyped-def]
    """Compressed lists: the segments whose bounding box touches each bin."""
    count = starts.shape[0]
    boxes = np.empty((count, 4), dtype=np.int64)
    offsets = np.zeros(nx * ny + 1, dtype=np.int64)
    for s in range(count):
        x0 = min(starts[s, 0], ends[s, 0])
        x1 = max(starts[s, 0], ends[s, 0])
        y0 = min(starts[s, 1], ends[s, 1])
        y1 = max(starts[s, 1], ends[s, 1])
        boxes[s, 0] = min(max(int((x0 - origin[0]) / size), 0), nx - 1)
        boxes[s, 1] = min(max(int((x1 - origin[0]) / size), 0), nx - 1)
        boxes[s, 2] = min(max(int((y0 - origin[1]) / size), 0), ny - 1)
        boxes[s, 3] = min(max(int((y1 - origin[1]) / size), 0), ny - 1)
        for ix in range(boxes[s, 0], boxes[s, 1] + 1):
            for iy in range(boxes[s, 2], boxes[s, 3] + 1):
                if _touches(starts, ends, s, origin[0] + ix * size, origin[1] + iy * size, size):
                    offsets[ix * ny + iy + 1] += 1
    for b in range(nx * ny):
        offsets[b + 1] += offsets[b]
    fill = offsets[:-1].copy()
    members = np.empty(offsets[-1], dtype=np.int64)
    for s in range(count):
        for ix in range(boxes[s, 0], boxes[s, 1] + 1):
            for iy in range(boxes[s, 2], boxes[s, 3] + 1):
                if _touches(starts, ends, s, origin[0] + ix * size, origin[1] + iy * size, size):
                    b = ix * ny + iy
                    members[fill[b]] = s
                    fill[b] += 1
    return offsets, members


@numba.njit(cache=True)
def _touches(starts, ends, s, x, y, size):  # type: ignore[no-untyped-def]
    """Whether the line of a segment meets the square at (x, y), widened by a rounding allowance."""
    dx = ends[s, 0] - starts[s, 0]
    dy = ends[s, 1] - starts[s, 1]
    offset = dx * (y + 0.5 * size - starts[s, 1]) - dy * (x + 0.5 * size - starts[s, 0])
    return abs(offset) <= 0.5001 * size * (abs(dx) + abs(dy)) + 1e-12
