"""The curve that a tracker follows: a path as fine segments with heading and curvature."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from snnav_core.types import FloatArray, wrap_angle

__all__ = [
    "PIECES_PER_LINK",
    "Track",
    "TrackPoint",
    "chain_track",
    "distances_along",
    "smooth_chain",
    "spline_track",
    "without_repetitions",
]

PIECES_PER_LINK = 16
_LEAST_LINK = 1e-3  # [m]; shorter links repeat a point
_LEAST_PIECE = 1e-9  # [m]; a shorter piece is a point
_SHORT_LAST_LINK = 0.3  # of the link before; a shorter last link is merged with it
_MAX_FIRST_BEND = math.pi / 3  # [rad] between the first link and the tangent at its start


@dataclass(frozen=True, slots=True)
class TrackPoint:
    """The point of a track that is closest to a robot."""

    distance: float  # along the track from its start [m]
    x: float  # [m, map]
    y: float  # [m, map]
    heading: float  # direction of travel [rad, map]


@dataclass(frozen=True)
class Track:
    """A curve in M - 1 straight pieces.

    Parameters
    ----------
    points : ndarray, shape (M, 2)
        Ends of the pieces [m, map].
    distances : ndarray, shape (M,)
        Length along the track up to every point [m].
    headings : ndarray, shape (M - 1, 2)
        Heading at the start and the end of every piece [rad, map], continuous inside a piece.
    curvatures : ndarray, shape (M - 1, 2)
        Curvature there [1/m], positive to the left.
    """

    points: FloatArray
    distances: FloatArray
    headings: FloatArray
    curvatures: FloatArray

    @property
    def length(self) -> float:
        """Length of the track [m]."""
        return float(self.distances[-1])

    def closest(self, x: float, y: float, begin: float, end: float) -> TrackPoint:
        """Return the closest point to (x, y) [m, map] among the pieces that touch [begin, end] [m]."""
        pieces = len(self.headings)
        first = min(max(int(np.searchsorted(self.distances, begin, side="right")) - 1, 0), pieces - 1)
        last = min(max(int(np.searchsorted(self.distances, end, side="left")), first + 1), pieces)
        starts = self.points[first:last]
        steps = self.points[first + 1 : last + 1] - starts
        offset = np.array((x, y)) - starts
        squared = np.maximum(np.einsum("ij,ij->i", steps, steps), _LEAST_PIECE**2)
        fraction = np.clip(np.einsum("ij,ij->i", offset, steps) / squared, 0.0, 1.0)
        feet = starts + fraction[:, None] * steps
        nearest = int(np.argmin((feet[:, 0] - x) ** 2 + (feet[:, 1] - y) ** 2))
        piece, part = first + nearest, float(fraction[nearest])
        start, stop = self.headings[piece].tolist()
        return TrackPoint(
            distance=float((1.0 - part) * self.distances[piece] + part * self.distances[piece + 1]),
            x=float(feet[nearest, 0]),
            y=float(feet[nearest, 1]),
            heading=wrap_angle((1.0 - part) * start + part * stop),
        )

    def curvature_at(self, distance: float) -> float:
        """Return the curvature [1/m] at a length along the track [m]; beyond the ends that of the ends."""
        pieces = len(self.curvatures)
        piece = min(max(int(np.searchsorted(self.distances, distance, side="right")) - 1, 0), pieces - 1)
        begin, end = self.distances[piece : piece + 2].tolist()
        part = min(max((distance - begin) / max(end - begin, _LEAST_PIECE), 0.0), 1.0)
        start, stop = self.curvatures[piece].tolist()
        return float((1.0 - part) * start + part * stop)


def chain_track(points: FloatArray) -> Track | None:
    """Return the polygonal chain itself as a track (Ch. 3, Section "Computer simulations").

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        Points of the path [m, map].

    Returns
    -------
    Track or None
        None if all points are the same: there is nothing to follow.
    """
    chain = without_repetitions(points[:, :2])
    if len(chain) < 2:
        return None
    steps = np.diff(chain, axis=0)
    heading = np.arctan2(steps[:, 1], steps[:, 0])
    headings = np.column_stack((heading, heading))
    return Track(chain, distances_along(chain), headings, np.zeros_like(headings))


def spline_track(points: FloatArray, initial_heading: float | None = None) -> Track | None:
    """Return a cubic spline through the points as a track.

    Parameters
    ----------
    points : ndarray, shape (N, 2)
        Points of the path [m, map]. Repetitions are dropped; a last link shorter than 0.3 of the one before is
        merged with it, so that rounding in its direction cannot bend the end of the curve.
    initial_heading : float, optional
        Heading of the robot at the first point [rad, map]: the tangent there, up to 60 degrees off the first link.

    Returns
    -------
    Track or None
        None if all points are the same: there is nothing to follow.

    Notes
    -----
    Deviation (C3-32): the thesis tracks the polygonal chain, whose heading jumps cost 26 to 35 cm.
    """
    chain = smooth_chain(points[:, :2])
    if len(chain) < 2:
        return None
    knots = distances_along(chain)
    spline = CubicSpline(knots, chain, bc_type=_end_conditions(chain, initial_heading))
    pieces = np.arange(PIECES_PER_LINK) / PIECES_PER_LINK
    parameter = np.append((knots[:-1, None] + np.diff(knots)[:, None] * pieces).ravel(), knots[-1])
    velocity, acceleration = spline(parameter, 1), spline(parameter, 2)
    speed = np.maximum(np.hypot(velocity[:, 0], velocity[:, 1]), 1e-3)
    curvature = (velocity[:, 0] * acceleration[:, 1] - velocity[:, 1] * acceleration[:, 0]) / speed**3
    heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    fine = spline(parameter)
    return Track(fine, distances_along(fine), _pairs(heading), _pairs(curvature))


def _end_conditions(chain: FloatArray, initial_heading: float | None) -> object:
    """Return the end conditions of the spline: the tangent of an arc over the first link, else not-a-knot."""
    if initial_heading is None:
        return "not-a-knot"
    first_heading = math.atan2(chain[1, 1] - chain[0, 1], chain[1, 0] - chain[0, 0])
    bend = wrap_angle(initial_heading - first_heading)
    bend = min(max(bend, -_MAX_FIRST_BEND), _MAX_FIRST_BEND)
    arc_over_chord = bend / math.sin(bend) if abs(bend) > 1e-9 else 1.0
    heading = first_heading + bend
    tangent = (1, arc_over_chord * np.array((math.cos(heading), math.sin(heading))))
    return (tangent, "not-a-knot" if len(chain) > 2 else (2, np.zeros(2)))


def without_repetitions(points: FloatArray) -> FloatArray:
    """Drop points (N, D) that repeat the one kept before; the last point always stays."""
    chain = np.asarray(points, dtype=np.float64)
    kept = [0]
    for index in range(1, len(chain)):
        if math.dist(chain[index], chain[kept[-1]]) >= _LEAST_LINK:
            kept.append(index)
    if kept[-1] != len(chain) - 1 and len(kept) > 1:
        kept[-1] = len(chain) - 1
    return chain[kept]


def smooth_chain(points: FloatArray) -> FloatArray:
    """Drop repetitions, and merge a last link too short for its direction to mean anything; (N, D) -> (M, D)."""
    chain = without_repetitions(points)
    links = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    if len(links) > 1 and links[-1] < _SHORT_LAST_LINK * links[-2]:
        chain = np.delete(chain, -2, axis=0)
    return chain


def distances_along(points: FloatArray) -> FloatArray:
    """Length along a chain (N, D) up to every point: shape (N,) [m]."""
    return np.concatenate(((0.0,), np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))


def _pairs(values: FloatArray) -> FloatArray:
    return np.column_stack((values[:-1], values[1:]))
