"""The boundary curves C_0, C_1, ... of a reduced area, and what can be seen along straight lines in it."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property

import numba
import numpy as np
import shapely
from shapely.geometry import Polygon

from snnav_core.area.bins import SegmentBins
from snnav_core.types import FloatArray

__all__ = ["AreaCurves"]

_TURN = 1e-12
_BIN_SIZE = 0.5  # [m]
_MANY_CORNERS = 400  # so many are worth a second thread ...
_FIRST_HALF = 1.0 - math.sqrt(0.5)  # ... that takes this share of them: half of the pairs


@numba.njit(cache=True, nogil=True)
def _crossing(px, py, dx, dy, e, starts, ends, following):  # type: ignore[no-untyped-def]
    """Share of the segment p -> p + d at which it crosses the boundary on edge e or at the end of e; inf for none.

    Touching is no crossing. Through vertices the boundary crosses when it comes from one side, perhaps runs along the
    segment, and leaves to the other side: coming from the left it has the free side, which is on its left, behind these
    vertices, coming from the right before them.
    """
    ax, ay = starts[e, 0] - px, starts[e, 1] - py
    bx, by = ends[e, 0] - px, ends[e, 1] - py
    ca = dx * ay - dy * ax
    cb = dx * by - dy * bx
    square = dx * dx + dy * dy
    eps = 1e-9 * max(math.sqrt(square), 1.0)
    if abs(ca) <= eps:
        return math.inf
    if abs(cb) > eps:
        if ca * cb > 0.0:
            return math.inf
        ex, ey = bx - ax, by - ay
        share = (ax * ey - ay * ex) / (dx * ey - dy * ex)
        return share if 1e-9 < share < 1.0 - 1e-9 else math.inf
    first = low = high = (bx * dx + by * dy) / square
    after = following[e]
    for _ in range(starts.shape[0]):
        bx, by = ends[after, 0] - px, ends[after, 1] - py
        cb = dx * by - dy * bx
        if abs(cb) > eps:
            break
        share = (bx * dx + by * dy) / square
        low, high = min(low, share), max(high, share)
        after = following[after]
    if ca * cb >= 0.0:
        return math.inf
    blocked = 1e-9 < low <= 1.0 + 1e-9 if ca > 0.0 else -1e-9 <= high < 1.0 - 1e-9
    return max(first, 0.0) if blocked else math.inf


@numba.njit(cache=True, nogil=True)
def _first_crossing(px, py, dx, dy, starts, ends, following, offsets, members, origin, size, columns, rows):  # type: ignore[no-untyped-def]
    """Smallest share of the segment p -> p + d at which it crosses the boundary, and the edge there; inf, -1 for none.

    Walks the bins column by column in the direction of the segment.
    """
    best, edge = math.inf, -1
    begin = int(math.floor((px - origin[0]) / size - 1e-9))
    end = int(math.floor((px + dx - origin[0]) / size + 1e-9))
    step = 1 if dx >= 0.0 else -1
    if step < 0:
        begin, end = (
            int(math.floor((px - origin[0]) / size + 1e-9)),
            int(math.floor((px + dx - origin[0]) / size - 1e-9)),
        )
    for column in range(begin, end + step, step):
        if column < 0 or column >= columns:
            continue
        left, right = origin[0] + column * size, origin[0] + (column + 1) * size
        first, last = 0.0, 1.0
        if dx != 0.0:
            at_left, at_right = (left - px) / dx, (right - px) / dx
            first, last = max(min(at_left, at_right), 0.0), min(max(at_left, at_right), 1.0)
        if best < first:
            break
        low, high = py + first * dy, py + last * dy
        if low > high:
            low, high = high, low
        row_from = max(int(math.floor((low - origin[1]) / size - 1e-9)), 0)
        row_to = min(int(math.floor((high - origin[1]) / size + 1e-9)), rows - 1)
        for row in range(row_from, row_to + 1):
            b = column * rows + row
            for m in range(offsets[b], offsets[b + 1]):
                t = _crossing(px, py, dx, dy, members[m], starts, ends, following)
                if t < best:
                    best, edge = t, members[m]
    return best, edge


@numba.njit(cache=True, nogil=True)
def _first_hits(sources, targets, starts, ends, following, offsets, members, origin, size, columns, rows):  # type: ignore[no-untyped-def]
    """For each segment source -> target the smallest share at which it crosses the boundary, and the edge there."""
    share = np.full(sources.shape[0], np.inf)
    edge = np.full(sources.shape[0], -1, dtype=np.int64)
    for i in range(sources.shape[0]):
        px, py = sources[i, 0], sources[i, 1]
        share[i], edge[i] = _first_crossing(
            px,
            py,
            targets[i, 0] - px,
            targets[i, 1] - py,
            starts,
            ends,
            following,
            offsets,
            members,
            origin,
            size,
            columns,
            rows,
        )
    return share, edge


@numba.njit(cache=True, nogil=True)
def _tangent_graph(  # type: ignore[no-untyped-def]
    corners, begin, end, before, starts, ends, following, offsets, members, origin, size, columns, rows
):
    """Pairs of corners whose connection touches both from outside and crosses no edge; the first is one of a range."""
    found_from = []
    found_to = []
    lengths = []
    for i in range(begin, end):
        first = corners[i]
        px, py = starts[first, 0], starts[first, 1]
        for j in range(i + 1, corners.shape[0]):
            second = corners[j]
            dx, dy = starts[second, 0] - px, starts[second, 1] - py
            length = math.sqrt(dx * dx + dy * dy)
            if length < 1e-9:
                continue
            eps = 1e-9 * max(length, 1.0)
            if not _touches(starts[first], before[first], ends[first], dx, dy, eps):
                continue
            if not _touches(starts[second], before[second], ends[second], dx, dy, eps):
                continue
            share, _ = _first_crossing(
                px, py, dx, dy, starts, ends, following, offsets, members, origin, size, columns, rows
            )
            if share == math.inf:
                found_from.append(i)
                found_to.append(j)
                lengths.append(length)
    return np.array(found_from), np.array(found_to), np.array(lengths)


@numba.njit(cache=True, nogil=True)
def _touches(corner, previous, following, dx, dy, eps):  # type: ignore[no-untyped-def]
    """Whether both neighbours of a corner lie on one side of the line through it."""
    ca = dx * (previous[1] - corner[1]) - dy * (previous[0] - corner[0])
    cb = dx * (following[1] - corner[1]) - dy * (following[0] - corner[0])
    return (ca > -eps and cb > -eps) or (ca < eps and cb < eps)


class AreaCurves:
    """One component of a reduced area as closed curves.

    Parameters
    ----------
    polygon : shapely.Polygon
        Component of R[A, d] [m, map]. Curve 0 is its exterior (C_0), the others are its holes.

    Notes
    -----
    Rings are open and have the free side on the left: the exterior runs counter-clockwise, holes clockwise.
    """

    def __init__(self, polygon: Polygon) -> None:
        self.polygon = shapely.orient_polygons(polygon)
        exterior = shapely.get_coordinates(self.polygon.exterior)[:-1]
        holes = [shapely.get_coordinates(hole)[:-1] for hole in self.polygon.interiors]
        self.rings: list[FloatArray] = [exterior, *holes]
        sizes = [len(ring) for ring in self.rings]
        self.offsets = np.concatenate(([0], np.cumsum(sizes)))
        self.starts: FloatArray = np.concatenate(self.rings)
        self.ends: FloatArray = np.concatenate([np.roll(ring, -1, axis=0) for ring in self.rings])
        self.before: FloatArray = np.concatenate([np.roll(ring, 1, axis=0) for ring in self.rings])
        edges = np.split(np.arange(len(self.starts)), self.offsets[1:-1])
        self._following = np.concatenate([np.roll(edge, -1) for edge in edges])
        bins = SegmentBins.of(self.starts, self.ends, _BIN_SIZE)
        self._bins = (bins.offsets, bins.members, bins.origin, bins.size, bins.columns, bins.rows)
        shapely.prepare(self.polygon)

    def covers(self, point: FloatArray) -> bool:
        """Whether the point (2,) [m, map] lies in the component."""
        return bool(shapely.intersects_xy(self.polygon, point[0], point[1]))

    def nearest(self, point: FloatArray) -> FloatArray:
        """The point of the component nearest to the given one, (2,) [m, map]."""
        line = shapely.shortest_line(self.polygon, shapely.points(point))
        return np.asarray(shapely.get_coordinates(line)[0])

    def locate(self, edge: int) -> tuple[int, int]:
        """Curve and index within it of an edge."""
        curve = int(np.searchsorted(self.offsets, edge, side="right")) - 1
        return curve, edge - int(self.offsets[curve])

    @cached_property
    def corners(self) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Indices of vertices around which a shortest path can bend: the free side turns by more than a half."""
        incoming, outgoing = self.starts - self.before, self.ends - self.starts
        turn = incoming[:, 0] * outgoing[:, 1] - incoming[:, 1] * outgoing[:, 0]
        return np.flatnonzero(turn < -_TURN)

    @cached_property
    def tangents(self) -> tuple[np.ndarray, np.ndarray, FloatArray]:
        """Bitangent connections between `corners`: indices into it, and lengths [m]."""
        chosen = self.corners
        if len(chosen) < 2:
            empty = np.empty(0, dtype=np.int64)
            return empty, empty, np.empty(0)
        arrays = (self.before, self.starts, self.ends, self._following, *self._bins)
        if len(chosen) < _MANY_CORNERS:
            rows, columns, lengths = _tangent_graph(chosen, 0, len(chosen), *arrays)
            return rows, columns, lengths
        middle = round(_FIRST_HALF * len(chosen))
        with ThreadPoolExecutor(1) as pool:
            first = pool.submit(_tangent_graph, chosen, 0, middle, *arrays)
            second = _tangent_graph(chosen, middle, len(chosen), *arrays)
            rows, columns, lengths = (
                np.concatenate(both) for both in zip(first.result(), second, strict=True)
            )
        return rows, columns, lengths

    @cached_property
    def neighbours(self) -> tuple[np.ndarray, np.ndarray, FloatArray]:
        """The `tangents` by corner: where those of each begin (C + 1,), corners at their other ends, lengths [m]."""
        rows, columns, lengths = self.tangents
        ends = np.concatenate((rows, columns)).astype(np.int64)
        order = np.argsort(ends, kind="stable")
        offsets = np.zeros(len(self.corners) + 1, dtype=np.int64)
        np.cumsum(np.bincount(ends, minlength=len(self.corners)), out=offsets[1:])
        others = np.concatenate((columns, rows)).astype(np.int64)[order]
        return offsets, others, np.concatenate((lengths, lengths))[order]

    def first_hits(self, sources: FloatArray, targets: FloatArray) -> tuple[FloatArray, np.ndarray]:
        """First crossing of each segment with a curve; touching one is no crossing.

        Parameters
        ----------
        sources, targets : ndarray, shape (N, 2)
            Ends of the segments [m, map].

        Returns
        -------
        share : ndarray, shape (N,)
            Where the segment first crosses a curve, as a share of its length; inf when it crosses none.
        edge : ndarray, shape (N,)
            Index of that edge, -1 for none.
        """
        share, edge = _first_hits(
            np.require(sources, np.float64, ["C", "W"]),
            np.require(targets, np.float64, ["C", "W"]),
            self.starts,
            self.ends,
            self._following,
            *self._bins,
        )
        return share, edge

    def touches_corner(self, points: FloatArray) -> np.ndarray:
        """For each source point (N, 2) and corner (M): whether the line between them is tangent at the corner."""
        corner = self.starts[self.corners]
        line = corner[None, :, :] - points[:, None, :]
        back, ahead = self.before[self.corners] - corner, self.ends[self.corners] - corner
        ca = line[..., 0] * back[None, :, 1] - line[..., 1] * back[None, :, 0]
        cb = line[..., 0] * ahead[None, :, 1] - line[..., 1] * ahead[None, :, 0]
        eps = 1e-9 * np.maximum(np.linalg.norm(line, axis=2), 1.0)
        return np.asarray(((ca > -eps) & (cb > -eps)) | ((ca < eps) & (cb < eps)))
