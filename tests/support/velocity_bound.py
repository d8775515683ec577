"""How well beams determine the velocity of a body, whoever estimates it: from the truth, not from an estimate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from snnav_core.area.returns import FusedReturns
from snnav_core.types import FloatArray

_ON_BODY = 0.03  # [m] between a range and the body: a hit on it
_BEHIND = 0.1  # [m] that a beam reaches farther than the body, if it shows that it passed
_DEVIATIONS = 3.0  # of the surfaces
_ANY_SPEED = 2.0  # [m/s]; deviation of a velocity of which nothing is known
_LEAST_TURN = 1e-9  # of numbers that are to be known besides


@dataclass(frozen=True)
class Sight:
    """One measurement: its time [s], all hits, and the true body at that time."""

    time: float
    returns: FusedReturns
    body: shapely.Polygon


@dataclass(frozen=True)
class _Hits:
    """True places on the body that beams met (n, 2) [m, map], and which beams (n,)."""

    points: FloatArray
    sensors: NDArray[np.int64]
    beams: NDArray[np.int64]
    ranges: FloatArray


def velocity_bound(
    sights: Sequence[Sight], velocity: FloatArray, is_disk: bool, range_noise: float = 0.005
) -> float:
    """Return by how much a velocity may be off and still agree with all that was measured [m/s].

    A velocity agrees if moving the body with it takes no place that was hit beyond a beam that passed the body at
    another time, and if it is within three deviations of what hits on the faces tell, the place and the angle of each
    (of a disk middle and radius) being unknown.
    """
    found = [_hits(sight) for sight in sights]
    covariance = _surfaces(sights, found, velocity, is_disk, range_noise)
    values, axes = np.linalg.eigh(covariance)
    turns = np.linspace(0.0, 2.0 * math.pi, 96, endpoint=False)
    circle = np.column_stack((np.cos(turns), np.sin(turns))) / math.cos(math.pi / 96)
    region = shapely.Polygon(_DEVIATIONS * (circle * np.sqrt(values)) @ axes.T)
    wide = 10.0 * _ANY_SPEED
    for outward, rest in _limits(sights, found, velocity):
        along = np.array([-outward[1], outward[0]])
        edge = outward * rest
        half = [edge + wide * along, edge - wide * along]
        region = region.intersection(
            shapely.Polygon([*half, *(corner - wide * outward for corner in half[::-1])])
        )
    return float(np.hypot(*shapely.get_coordinates(region).T).max(initial=0.0))


def _hits(sight: Sight) -> _Hits:
    returns = sight.returns
    origins = returns.origins[returns.sensors]
    ways = shapely.linestrings(np.stack((origins, origins + 1.5 * (returns.points - origins)), axis=1))
    reached = shapely.distance(shapely.points(origins), shapely.intersection(ways, sight.body))
    own = np.flatnonzero(np.abs(reached - returns.ranges) < _ON_BODY)
    share = (reached[own] / returns.ranges[own])[:, None]
    places = origins[own] + share * (returns.points[own] - origins[own])
    return _Hits(places, returns.sensors[own], returns.beams[own], returns.ranges[own])


def _surfaces(
    sights: Sequence[Sight], found: Sequence[_Hits], velocity: FloatArray, is_disk: bool, noise: float
) -> FloatArray:
    """Covariance (2, 2) of what hits square to the faces tell of the velocity."""
    times = np.concatenate([np.full(len(h.points), s.time) for s, h in zip(sights, found, strict=True)])
    middle = float(times.mean())
    places = np.concatenate([hits.points for hits in found]) - np.outer(times - middle, velocity)
    ring = shapely.get_coordinates(sights[0].body.exterior) - (sights[0].time - middle) * velocity
    if is_disk:
        square = places - ring[:-1].mean(axis=0)
        square /= np.hypot(*square.T)[:, None]
        besides = np.column_stack((square, np.ones(len(square))))
    else:
        edges = shapely.linestrings(np.stack((ring[:-1], ring[1:]), axis=1))
        face = shapely.distance(shapely.points(places)[:, None], edges).argmin(axis=1)
        along = np.diff(ring, axis=0)[face]
        along /= np.hypot(*along.T)[:, None]
        square = np.column_stack((along[:, 1], -along[:, 0]))
        on_face = (face[:, None] == np.arange(len(edges))).astype(np.float64)
        besides = np.column_stack((on_face, on_face * np.sum(along * (places - ring[face]), axis=1)[:, None]))
    rows = np.column_stack((square * (times - middle)[:, None], besides)) / noise
    least = np.concatenate((np.full(2, _ANY_SPEED**-2), np.full(besides.shape[1], _LEAST_TURN)))
    return np.asarray(np.linalg.inv(rows.T @ rows + np.diag(least))[:2, :2])


def _limits(
    sights: Sequence[Sight], found: Sequence[_Hits], velocity: FloatArray
) -> list[tuple[FloatArray, float]]:
    """Half-planes of errors of the velocity: unit vector, and how far errors may go that way [m/s]."""
    limits = []
    for sight, hits in zip(sights, found, strict=True):
        for origin, outward in _passing(sight, hits):
            for other, places in zip(sights, found, strict=True):
                passed = sight.time - other.time
                if passed == 0.0 or len(places.points) == 0:
                    continue
                moved = places.points + passed * velocity
                rest = -float(((moved - origin) @ outward).max()) / abs(passed)
                limits.append((outward * math.copysign(1.0, passed), rest))
    return limits


def _passing(sight: Sight, hits: _Hits) -> list[tuple[FloatArray, FloatArray]]:
    """Beams beside the outermost hits that passed the body: origin and the unit vector square to them, away from it."""
    returns, corners = sight.returns, shapely.get_coordinates(sight.body.exterior)
    beams = []
    for sensor in np.unique(hits.sensors).tolist():
        own = np.flatnonzero(hits.sensors == sensor)
        for hit, step in ((own[0], -1), (own[-1], 1)):
            beside = (returns.sensors == sensor) & (returns.beams == hits.beams[hit] + step)
            beside &= returns.ranges > hits.ranges[hit] + _BEHIND
            for index in np.flatnonzero(beside).tolist():
                origin = returns.origins[sensor]
                along = (returns.points[index] - origin) / returns.ranges[index]
                outward = np.array([-along[1], along[0]])
                outward *= -math.copysign(1.0, float(outward @ (hits.points[hit] - origin)))
                if float(((corners - origin) @ outward).max()) <= 0.0:
                    beams.append((origin, outward))
    return beams
