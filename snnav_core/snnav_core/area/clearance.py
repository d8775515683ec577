"""Exact signed distance to a set of boundary rings, for many points at once.

The boundary segments are sorted into square bins; a query walks the bins in growing squares around its point and
stops when no closer segment is possible. Independent of the number of segments for points near the boundary.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numba
import numpy as np

from snnav_core.area.bins import SegmentBins
from snnav_core.types import FloatArray

__all__ = ["NOWHERE", "ClearanceField", "nearby_boundary", "nearest_boundary", "nearest_of"]

_BIN_SIZE = 0.25  # [m]
_FARTHEST = 1e8  # [m]; a point with a larger coordinate is outside of every area

NOWHERE = (
    np.zeros((0, 2)),
    np.zeros((0, 2)),
    np.zeros((0, 2)),
    np.zeros((0, 2)),
    np.zeros(1, dtype=np.int64),
    np.zeros(0, dtype=np.int64),
    np.zeros(2),
    1.0,
    1,
    1,
)
"""`ClearanceField.arrays` where there is no boundary; kernels do not look up distances then."""


@numba.njit(cache=True, nogil=True)
def _query(points, limit, arrays):  # type: ignore[no-untyped-def]
    count = points.shape[0]
    distance = np.empty(count)
    gradient = np.empty((count, 2))
    for i in range(count):
        distance[i], gradient[i, 0], gradient[i, 1] = nearest_boundary(
            points[i, 0], points[i, 1], limit, *arrays
        )
    return distance, gradient


@numba.njit(cache=True, nogil=True)
def nearest_boundary(  # type: ignore[no-untyped-def]
    px, py, limit, starts, ends, normals_start, normals_end, offsets, members, origin, size, nx, ny
):
    """Signed distance of one point and its gradient, for other kernels; arguments as in `ClearanceField.arrays`."""
    if not (abs(px) < _FARTHEST and abs(py) < _FARTHEST):
        return -math.inf, 0.0, 0.0  # NaN too: nothing is known to be free there
    cx, cy, rim, ring, last = _rings(px, py, origin, size, nx, ny)
    best = limit * limit
    found = -1
    found_t = 0.0
    while ring <= last:
        if ring > 0:
            reach = (ring - 1) * size + rim
            if reach > 0.0 and reach * reach > best:
                break
        for ix in range(max(cx - ring, 0), min(cx + ring, nx - 1) + 1):
            for iy in _column(ix, cx, cy, ring, ny):
                b = ix * ny + iy
                for m in range(offsets[b], offsets[b + 1]):
                    s = members[m]
                    square, t = _square_to(px, py, s, starts, ends)
                    if square < best:
                        best, found, found_t = square, s, t
        ring += 1
    if found < 0:
        return limit, 0.0, 0.0
    return _signed(px, py, found_t, starts[found], ends[found], normals_start[found], normals_end[found])


@numba.njit(cache=True, nogil=True)
def nearby_boundary(px, py, slack, found, starts, ends, offsets, members, origin, size, nx, ny):  # type: ignore[no-untyped-def]
    """Segments that may be the nearest one to a point while it moves by no more than half the slack [m].

    Writes their numbers into `found` and returns how many there are; -1 when there are more than fit, or none.
    """
    if not (abs(px) < _FARTHEST and abs(py) < _FARTHEST):
        return -1
    cx, cy, rim, ring, last = _rings(px, py, origin, size, nx, ny)
    squares = np.empty(len(found))
    best, farthest, count = math.inf, math.inf, 0
    while ring <= last:
        if ring > 0:
            reach = (ring - 1) * size + rim
            if reach > 0.0 and reach * reach > farthest:
                break
        for ix in range(max(cx - ring, 0), min(cx + ring, nx - 1) + 1):
            for iy in _column(ix, cx, cy, ring, ny):
                b = ix * ny + iy
                for m in range(offsets[b], offsets[b + 1]):
                    s = members[m]
                    square, _ = _square_to(px, py, s, starts, ends)
                    if square > farthest:
                        continue
                    if square < best:
                        best = square
                        farthest = (math.sqrt(best) + slack) ** 2
                        count = _keep(found, squares, count, farthest)
                    if s in found[:count]:
                        continue
                    if count == len(found):
                        return -1
                    found[count], squares[count] = s, square
                    count += 1
        ring += 1
    return count if count > 0 else -1


@numba.njit(cache=True, nogil=True)
def _rings(px, py, origin, size, nx, ny):  # type: ignore[no-untyped-def]
    """Bin (cx, cy) of a point, its distance [m] from the rim of the bin, and the first and last ring of bins around it.

    Rings start where the grid does, for a point outside of it.
    """
    cx = int(math.floor((px - origin[0]) / size))
    cy = int(math.floor((py - origin[1]) / size))
    inside_x, inside_y = px - origin[0] - cx * size, py - origin[1] - cy * size
    rim = min(min(inside_x, size - inside_x), min(inside_y, size - inside_y))
    first = max(0, -cx, -cy, cx - nx + 1, cy - ny + 1)
    last = max(max(cx, nx - 1 - cx), max(cy, ny - 1 - cy))
    return cx, cy, rim, first, last


@numba.njit(cache=True, nogil=True)
def _column(ix, cx, cy, ring, ny):  # type: ignore[no-untyped-def]
    """Rows of the bins of a ring in column `ix` of the grid: all of them at its two ends, else top and bottom."""
    if ix == cx - ring or ix == cx + ring:
        return range(max(cy - ring, 0), min(cy + ring, ny - 1) + 1, 1)
    first = cy - ring if cy >= ring else cy + ring
    return range(first, min(cy + ring, ny - 1) + 1, 2 * ring)


@numba.njit(cache=True, nogil=True)
def _keep(found, squares, count, farthest):  # type: ignore[no-untyped-def]
    """Drop what is farther away than `farthest`, in place; returns how many are left."""
    kept = 0
    for i in range(count):
        if squares[i] <= farthest:
            found[kept], squares[kept] = found[i], squares[i]
            kept += 1
    return kept


@numba.njit(cache=True, nogil=True)
def nearest_of(px, py, found, count, starts, ends, normals_start, normals_end):  # type: ignore[no-untyped-def]
    """Signed distance of a point to the nearest of some segments, and its gradient."""
    best, nearest, share = math.inf, 0, 0.0
    for i in range(count):
        square, t = _square_to(px, py, found[i], starts, ends)
        if square < best:
            best, nearest, share = square, found[i], t
    return _signed(
        px, py, share, starts[nearest], ends[nearest], normals_start[nearest], normals_end[nearest]
    )


@numba.njit(cache=True, nogil=True)
def _square_to(px, py, s, starts, ends):  # type: ignore[no-untyped-def]
    """Squared distance of a point to segment s, and the share of the segment where it is nearest."""
    ax, ay = starts[s, 0], starts[s, 1]
    dx, dy = ends[s, 0] - ax, ends[s, 1] - ay
    t = ((px - ax) * dx + (py - ay) * dy) / (dx * dx + dy * dy)
    t = min(max(t, 0.0), 1.0)
    qx, qy = px - ax - t * dx, py - ay - t * dy
    return qx * qx + qy * qy, t


@numba.njit(cache=True, nogil=True)
def _signed(px, py, share, start, end, normal_start, normal_end):  # type: ignore[no-untyped-def]
    """Signed distance of a point to the nearest point of the boundary, at a share of a segment; its gradient."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    qx, qy = px - start[0] - share * dx, py - start[1] - share * dy
    nx, ny = -dy, dx
    if share == 0.0:
        nx, ny = normal_start[0], normal_start[1]
    elif share == 1.0:
        nx, ny = normal_end[0], normal_end[1]
    rho = math.sqrt(qx * qx + qy * qy)
    if rho > 1e-9:
        sign = 1.0 if qx * nx + qy * ny >= 0.0 else -1.0
        return sign * rho, sign * qx / rho, sign * qy / rho
    norm = math.sqrt(nx * nx + ny * ny)
    if norm > 1e-12:
        return rho, nx / norm, ny / norm
    return rho, 0.0, 0.0


class ClearanceField:
    """Signed distance to the boundary of an area and its gradient.

    Parameters
    ----------
    rings : sequence of ndarray, each (N, 2)
        Open rings [m, map], the free side on the left: exteriors counter-clockwise, holes clockwise.

    Notes
    -----
    The sign at a vertex comes from the sum of the two unit normals there, which is exact for simple rings. Where
    corners of several rings touch, as those of holes do at a scanner, it comes from all of their edges.
    """

    def __init__(self, rings: Sequence[FloatArray]) -> None:
        pieces = [_ring_segments(np.asarray(ring, dtype=np.float64)) for ring in rings]
        pieces = [piece for piece in pieces if len(piece[0])]
        self.is_empty = not pieces
        if self.is_empty:
            return
        self._starts = np.concatenate([piece[0] for piece in pieces])
        self._ends = np.concatenate([piece[1] for piece in pieces])
        self._normals_start = np.concatenate([piece[2] for piece in pieces])
        self._normals_end = np.concatenate([piece[3] for piece in pieces])
        _settle_touching(self._starts, self._ends, self._normals_start, self._normals_end)
        self._bins = SegmentBins.of(self._starts, self._ends, _BIN_SIZE)

    @property
    def segment_count(self) -> int:
        """Number of boundary segments."""
        return 0 if self.is_empty else len(self._starts)

    def query(self, points: FloatArray, limit: float = math.inf) -> tuple[FloatArray, FloatArray]:
        """Signed distance and its gradient.

        Parameters
        ----------
        points : ndarray, shape (N, 2)
            Positions [m, map].
        limit : float
            Distances beyond it need not be told apart: such points get `limit` and a zero gradient, whatever their
            side. Infinite by default.

        Returns
        -------
        distance : ndarray, shape (N,)
            Distance to the boundary [m], negative outside the area; -inf everywhere when the area is empty, and for
            points that are not finite or 1e8 m away.
        gradient : ndarray, shape (N, 2)
            Unit vector of growing distance.
        """
        # Writeable, so that there is one kind of array for the compiler.
        points = np.require(points, np.float64, ["C", "W"]).reshape(-1, 2)
        if self.is_empty:
            return np.full(len(points), -math.inf), np.zeros((len(points), 2))
        distance, gradient = _query(points, limit, self.arrays)
        return distance, gradient

    @property
    def arrays(self) -> tuple[Any, ...]:
        """What kernels need to look up distances by `nearest_boundary`; not for an empty area."""
        return (
            self._starts,
            self._ends,
            self._normals_start,
            self._normals_end,
            self._bins.offsets,
            self._bins.members,
            self._bins.origin,
            self._bins.size,
            self._bins.columns,
            self._bins.rows,
        )


def _ring_segments(ring: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    keep = np.any(ring != np.roll(ring, 1, axis=0), axis=1)
    ring = ring[keep]
    following = np.roll(ring, -1, axis=0)
    delta = following - ring
    length = np.linalg.norm(delta, axis=1, keepdims=True)
    if len(ring) < 2:
        empty = np.empty((0, 2))
        return empty, empty, empty, empty
    normal = np.column_stack((-delta[:, 1], delta[:, 0])) / length
    normal_start = normal + np.roll(normal, 1, axis=0)
    return ring, following, normal_start, np.roll(normal_start, -1, axis=0)


def _settle_touching(
    starts: FloatArray, ends: FloatArray, normals_start: FloatArray, normals_end: FloatArray
) -> None:
    """Give corners that share a vertex one normal, in place.

    A point nearest to the vertex lies opposite to all of its edges, so in one gap between them (if there is one of more
    than half a turn, else no point is). The normal points into this gap if it is free, else away from it.
    """
    vertices, number, count = np.unique(starts @ (1.0, 1.0j), return_inverse=True, return_counts=True)
    for vertex in np.flatnonzero(count > 1):
        leaving = np.flatnonzero(number == vertex)
        arriving = np.flatnonzero(ends @ (1.0, 1.0j) == vertices[vertex])
        away = np.concatenate((ends[leaving] - starts[leaving], starts[arriving] - ends[arriving]))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        gap = -away.sum(axis=0)
        turns = np.arctan2(gap[1], gap[0]) - np.arctan2(away[:, 1], away[:, 0])
        first_clockwise = int(np.argmin(turns % (2.0 * math.pi)))
        # The free side is on the left: behind an edge that leaves the vertex, before one that arrives there.
        normals_start[leaving] = normals_end[arriving] = gap if first_clockwise < len(leaving) else -gap
