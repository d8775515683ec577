"""Distances of path segments to the boundary of an area, by shapely, for the certificate check."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry import MultiPolygon

from snnav_core.types import FloatArray

__all__ = ["BoundaryIndex"]

_STRETCH = 8  # successive segments of a chain that are first compared as one
_HAIR = 1e-9  # [m] for rounding


class BoundaryIndex:
    """Distances from segments to the boundary of an area, and whether points lie inside, by shapely."""

    def __init__(self, region: MultiPolygon) -> None:
        self._region = region
        self._outline = shapely.boundary(region)
        shapely.prepare([self._region, self._outline])
        links = []
        for ring in shapely.get_rings(shapely.get_parts(region)):
            points = shapely.get_coordinates(ring)
            links.append(np.stack((points[:-1], points[1:]), axis=1))
        self._pieces = shapely.linestrings(np.concatenate(links)) if links else np.empty(0, dtype=object)
        self._tree = shapely.STRtree(self._pieces)

    def distances(self, segments: FloatArray) -> FloatArray:
        """Distance of segments (N, 2, 2) [m, map] to the boundary [m]; 0 where a segment is not inside the area."""
        if len(self._pieces) == 0 or len(segments) == 0:
            return np.zeros(len(segments))
        (rows, _), distances = self._tree.query_nearest(
            _lines(segments), all_matches=False, return_distance=True
        )
        result = np.zeros(len(segments))
        result[rows] = distances
        result[~shapely.contains_xy(self._region, segments[:, 0, 0], segments[:, 0, 1])] = 0.0
        return result

    def distances_below(self, segments: FloatArray, enough: FloatArray) -> FloatArray:
        """Distances of the segments (N, 2, 2) of a chain, infinite where they are more than `enough` (N,) [m].

        Many times as fast as `distances` where most are: those are not worked out.
        """
        if len(self._pieces) == 0 or len(segments) == 0:
            return np.zeros(len(segments))
        if np.all(segments == segments[0, 0]):
            distance = self.distances(segments[:1])[0]
            return np.where((distance <= enough) | (distance == 0.0), distance, math.inf)
        maybe = self._maybe_near(segments, enough)
        near = maybe[
            np.unique(
                self._tree.query(_lines(segments[maybe]), predicate="dwithin", distance=enough[maybe])[0]
            )
        ]
        result = np.full(len(segments), math.inf)
        result[near] = self.distances(segments[near])
        # What lies far from the boundary is on the side of its neighbours, except where the chain crosses.
        crosses = bool((result[near] == 0.0).any())
        asked = segments[:, 0] if crosses else segments[:1, 0]
        inside = shapely.contains_xy(self._region, asked[:, 0], asked[:, 1])
        return np.where(inside, result, 0.0)

    def _maybe_near(self, segments: FloatArray, enough: FloatArray) -> NDArray[np.int64]:
        """Indices of the segments in stretches of the chain that come as near as the largest of their `enough`."""
        firsts = np.arange(0, len(segments), _STRETCH)
        lasts = np.minimum(firsts + _STRETCH, len(segments)) - 1
        # All starts, and after each stretch its end, which is the start of the next one.
        points = np.insert(segments[:, 0], lasts + 1, segments[lasts, 1], axis=0)
        stretch = np.repeat(np.arange(len(firsts)), lasts - firsts + 2)
        lines = shapely.linestrings(points, indices=stretch)
        most = np.maximum.reduceat(enough, firsts) + _HAIR
        near = shapely.length(lines) == 0.0  # such a line is none
        near[self._tree.query(lines, predicate="dwithin", distance=most)[0]] = True
        return np.flatnonzero(near[np.arange(len(segments)) // _STRETCH])

    def least_distance(self, chain: FloatArray) -> float:
        """Distance of a chain of points (N, 2) [m, map], N >= 2, that lies inside the area to its boundary [m]."""
        if np.all(chain == chain[0]):
            return float(self.distances(chain[None, [0, 0]])[0])
        return float(shapely.distance(self._outline, shapely.linestrings(chain)))


def _lines(segments: FloatArray) -> NDArray[np.object_]:
    """Segments (N, 2, 2) as geometries; a point has no line string: it gets some length, far below any tolerance."""
    degenerate = np.all(segments[:, 0] == segments[:, 1], axis=1)
    if degenerate.any():
        segments = segments.copy()
        segments[degenerate, 1, 0] += 1e-9
    lines: NDArray[np.object_] = shapely.linestrings(segments)
    return lines
