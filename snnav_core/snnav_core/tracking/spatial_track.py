"""The curve in space that a flying robot follows: a path as fine pieces with tangent and curvature vector."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from snnav_core.tracking.spline import PIECES_PER_LINK, distances_along, smooth_chain, without_repetitions
from snnav_core.types import FloatArray

__all__ = ["SpatialPoint", "SpatialTrack", "chain_in_space", "spline_in_space"]

_LEAST_PIECE = 1e-9  # [m]; a shorter piece is a point
_LARGEST_FIRST_BEND = math.pi / 3  # [rad] between the first link and the tangent at its start


@dataclass(frozen=True)
class SpatialPoint:
    """The point of a track that is closest to a robot."""

    distance: float  # along the track from its start [m]
    position: FloatArray  # (3,) [m, map]
    tangent: FloatArray  # (3,) unit vector of travel [map]


@dataclass(frozen=True)
class SpatialTrack:
    """A curve in M - 1 straight pieces.

    Parameters
    ----------
    points : ndarray, shape (M, 3)
        Ends of the pieces [m, map].
    distances : ndarray, shape (M,)
        Length along the track up to every point [m].
    tangents : ndarray, shape (M - 1, 2, 3)
        Unit tangents at start and end of every piece.
    curvatures : ndarray, shape (M - 1, 2, 3)
        Curvature vectors there [1/m], towards the centre of curvature.
    """

    points: FloatArray
    distances: FloatArray
    tangents: FloatArray
    curvatures: FloatArray

    @property
    def length(self) -> float:
        """Length of the track [m]."""
        return float(self.distances[-1])

    def closest(self, position: FloatArray, begin: float, end: float) -> SpatialPoint:
        """Return the closest point to a position (3,) [m, map] among the pieces that touch [begin, end] [m]."""
        pieces = len(self.tangents)
        first = min(max(int(np.searchsorted(self.distances, begin, side="right")) - 1, 0), pieces - 1)
        last = min(max(int(np.searchsorted(self.distances, end, side="left")), first + 1), pieces)
        starts = self.points[first:last]
        steps = self.points[first + 1 : last + 1] - starts
        squared = np.maximum(np.einsum("ij,ij->i", steps, steps), _LEAST_PIECE**2)
        fraction = np.clip(np.einsum("ij,ij->i", position - starts, steps) / squared, 0.0, 1.0)
        feet = starts + fraction[:, None] * steps
        gaps = feet - position
        nearest = int(np.argmin(np.einsum("ij,ij->i", gaps, gaps)))
        piece, part = first + nearest, float(fraction[nearest])
        start, stop = self.distances[piece : piece + 2].tolist()
        tangent = (1.0 - part) * self.tangents[piece, 0] + part * self.tangents[piece, 1]
        return SpatialPoint(
            (1.0 - part) * start + part * stop, feet[nearest], tangent / np.linalg.norm(tangent)
        )

    def curvature_at(self, distance: float) -> FloatArray:
        """Return the curvature vector (3,) [1/m] at a length along the track [m]; beyond the ends that of the ends."""
        pieces = len(self.curvatures)
        piece = min(max(int(np.searchsorted(self.distances, distance, side="right")) - 1, 0), pieces - 1)
        begin, end = self.distances[piece : piece + 2].tolist()
        part = min(max((distance - begin) / max(end - begin, _LEAST_PIECE), 0.0), 1.0)
        curvature: FloatArray = (1.0 - part) * self.curvatures[piece, 0] + part * self.curvatures[piece, 1]
        return curvature


def chain_in_space(points: FloatArray) -> SpatialTrack | None:
    """Return the polygonal chain (N, 3) [m, map] itself as a track; None if all points are the same."""
    chain = without_repetitions(points)
    if len(chain) < 2:
        return None
    steps = np.diff(chain, axis=0)
    tangent = steps / np.linalg.norm(steps, axis=1)[:, None]
    tangents = np.stack((tangent, tangent), axis=1)
    return SpatialTrack(chain, distances_along(chain), tangents, np.zeros_like(tangents))


def spline_in_space(points: FloatArray, initial_direction: FloatArray | None = None) -> SpatialTrack | None:
    """Return a cubic spline through the points as a track.

    Parameters
    ----------
    points : ndarray, shape (N, 3)
        Points of the path [m, map]; repetitions and a very short last link are dropped.
    initial_direction : ndarray, shape (3,), optional
        Unit vector of travel of the robot at the first point: the tangent there, up to 60 degrees off the first link.

    Returns
    -------
    SpatialTrack or None
        None if all points are the same: there is nothing to follow.
    """
    chain = smooth_chain(points)
    if len(chain) < 2:
        return None
    knots = distances_along(chain)
    spline = CubicSpline(knots, chain, bc_type=_end_conditions(chain, initial_direction))
    part = np.arange(PIECES_PER_LINK) / PIECES_PER_LINK
    parameter = np.append((knots[:-1, None] + np.diff(knots)[:, None] * part).ravel(), knots[-1])
    velocity, acceleration = spline(parameter, 1), spline(parameter, 2)
    speed = np.maximum(np.linalg.norm(velocity, axis=1), 1e-3)[:, None]
    tangent = velocity / speed
    along = np.einsum("ij,ij->i", acceleration, tangent)[:, None]
    curvature = (acceleration - along * tangent) / speed**2
    fine = spline(parameter)
    return SpatialTrack(fine, distances_along(fine), _pairs(tangent), _pairs(curvature))


def _end_conditions(chain: FloatArray, initial_direction: FloatArray | None) -> object:
    """Return the end conditions of the spline: the tangent of an arc over the first link, else not-a-knot."""
    if initial_direction is None:
        return "not-a-knot"
    link = chain[1] - chain[0]
    link = link / np.linalg.norm(link)
    along = float(np.clip(initial_direction @ link, -1.0, 1.0))
    across = initial_direction - along * link
    width = float(np.linalg.norm(across))
    bend = min(math.acos(along), _LARGEST_FIRST_BEND)
    if bend < _LEAST_PIECE or width < _LEAST_PIECE:
        tangent = link
    else:
        tangent = (bend / math.sin(bend)) * (math.cos(bend) * link + math.sin(bend) * across / width)
    return ((1, tangent), "not-a-knot" if len(chain) > 2 else (2, np.zeros(3)))


def _pairs(values: FloatArray) -> FloatArray:
    return np.stack((values[:-1], values[1:]), axis=1)
