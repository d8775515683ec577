"""The velocity of a body from hits on it at several times: every pair of times is laid over each other at once."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snnav_core.area.body_sample import BodySample
from snnav_core.area.faces import face_information
from snnav_core.area.laying import densest, lay_over
from snnav_core.area.silhouette import PassingBeams, narrow_velocity, velocity_limits
from snnav_core.types import FloatArray

__all__ = ["Drift", "fit_drift", "overlap"]

_GATES = (0.3, 0.15, 0.08, 0.08, 0.08)  # [m]; hits farther apart show different places of the body
_NEAR_GATES = _GATES[1:4]  # the same where the velocity is nearly known
_ROUNDS = 3  # of silhouettes and surfaces in turn
_ROBUST = 4.0  # in deviations of a range: residuals beyond count little
_RIGID = 0.6  # share of hits that lie over others in a body that does not change its shape
_SEARCHED_POINTS = 12  # of one sample that take part in a search for where to start
_LEAST_KNOWN = 0.25  # share of the hits that at least has to lie over others, where normals are rare
_LEANING = 3.0  # times the noise of normals is not taken for a shape
_LAGGING = 0.5  # share of the speed of its middle: what is slower is the leg on which somebody stands
_ANY_SPEED = 1.0  # [m/s]; deviation of a velocity of which nothing is known
_SHAPE_CHANGE = 0.05  # share of its extent by which the middle of what is seen of a body may wander


@dataclass(frozen=True)
class Drift:
    """Velocity (2,) [m/s], its covariance (2, 2), and the share of hits that lie over others when it is undone."""

    velocity: FloatArray
    covariance: FloatArray
    agreement: float

    @property
    def rigid(self) -> bool:
        """Whether the body keeps its shape, as far as it was seen."""
        return self.agreement >= _RIGID

    @property
    def deviation(self) -> float:
        """Standard deviation in the direction in which least is known [m/s]."""
        return math.sqrt(max(0.0, float(np.linalg.eigvalsh(self.covariance)[-1])))

    @property
    def significance(self) -> float:
        """Speed in standard deviations of its own direction."""
        return math.sqrt(max(0.0, float(self.velocity @ np.linalg.solve(self.covariance, self.velocity))))


def fit_drift(samples: Sequence[BodySample], range_noise: float, guess: FloatArray | None = None) -> Drift:
    """Fit a constant velocity to hits on one body.

    Hits of different times that show the same place of the body lie on one line along its surface once the motion is
    undone (symmetric point-to-line matching; no outline has to be assumed). Along a surface the hits say nothing: there
    decides where its silhouettes end (`narrow_velocity`), if it keeps its shape; else, or where no beam was seen to
    pass it, the wandering of their middle, sensor by sensor, with the doubt that belongs to it.

    Parameters
    ----------
    samples : sequence of BodySample
        Two or more, at different times.
    range_noise : float
        Standard deviation of a range [m].
    guess : ndarray, shape (2,), optional
        Where to start from [m/s].

    Returns
    -------
    Drift
    """
    hits = _hits_of(samples)
    known, pull = _middle_information(samples)
    middle: FloatArray = np.asarray(np.linalg.solve(known, pull))
    start = middle if guess is None else guess
    outlined = _fit_outline(samples, hits, range_noise, known, start)
    if outlined is None:  # what was hidden at first has its middle elsewhere
        outlined = _fit_outline(samples, hits, range_noise, 1e-6 * np.eye(2), _search(hits, start))
    if outlined is not None:
        return outlined
    best = _follow(hits, known, pull, start, range_noise)
    if guess is not None and best.agreement < _RIGID:
        best = max(best, _follow(hits, known, pull, middle, range_noise), key=lambda found: found.agreement)
    lags = float(np.hypot(*best.velocity)) < _LAGGING * float(np.hypot(*middle))
    trust = 0.0 if lags and best.agreement < _RIGID else min(1.0, best.agreement / _RIGID) ** 2
    information = known + trust * best.information
    covariance: FloatArray = np.asarray(np.linalg.inv(information))
    velocity = covariance @ (pull + trust * best.pull)
    if best.agreement < _RIGID:  # the surfaces and their middle tell different motions: either may be right
        covariance = covariance + np.outer(velocity - middle, velocity - middle)
    return Drift(velocity, covariance, best.agreement)


def overlap(samples: Sequence[BodySample], velocity: FloatArray, range_noise: float) -> float:
    """Share of the hits on a body that lie over others when a velocity (2,) [m/s] is undone."""
    hits = _hits_of(samples)
    weight = hits.lay_over(velocity, _GATES[-1], range_noise)[6]
    return min(1.0, float(weight) / hits.pairs)


def _fit_outline(
    samples: Sequence[BodySample], hits: _Hits, range_noise: float, known: FloatArray, start: FloatArray
) -> Drift | None:
    """Velocity of a body that keeps its shape: its surfaces, and where its silhouettes end; None for another one."""
    points = np.concatenate([sample.points for sample in samples])
    times = np.concatenate([sample.times for sample in samples])
    beams = np.concatenate([sample.beam_ways for sample in samples])
    passing = [sample.passing.past(sample.points) for sample in samples]
    passed = functools.reduce(PassingBeams.joined, passing)
    limits = velocity_limits(passed, points, times, beams, range_noise)
    weak = np.eye(2) / _ANY_SPEED**2
    match = _follow(hits, known, known @ start, start, range_noise, leaning_share=_LEANING)
    information, pull = match.information, match.pull
    for left in reversed(range(_ROUNDS)):
        covariance: FloatArray = np.asarray(np.linalg.inv(information + weak))
        found = narrow_velocity(limits, covariance @ pull, covariance)
        if found is None:
            return None
        velocity, spread = found
        known = np.asarray(np.linalg.inv(spread))
        match = _follow(hits, known, known @ velocity, velocity, range_noise, _NEAR_GATES, _LEANING)
        information, pull = match.information, match.pull
        if left > 0:
            doubt = math.sqrt(float(np.linalg.eigvalsh(spread)[-1]))
            by_faces = face_information(
                hits.points, hits.normals, hits.beams, hits.times, velocity, range_noise, doubt
            )
            if _least(by_faces[0]) > _least(information):
                information, pull = by_faces
    if match.agreement < _RIGID:
        return None
    return Drift(velocity, spread, match.agreement)


def _least(information: FloatArray) -> float:
    """What is known in the direction in which least is."""
    return float(np.linalg.eigvalsh(information)[0])


@dataclass(frozen=True)
class _Hits:
    """Hits of all samples one after the other, where those of each sample begin, and how many may lie over others."""

    points: FloatArray
    normals: FloatArray
    baselines: FloatArray
    beams: FloatArray
    times: FloatArray
    offsets: NDArray[np.int64]
    pairs: float

    def lay_over(self, velocity: FloatArray, gate: float, range_noise: float) -> tuple[float, ...]:
        """The normal equations of `lay_over`, from a velocity (2,) [m/s] on."""
        equations: tuple[float, ...] = lay_over(
            self.points,
            self.normals,
            self.baselines,
            self.times,
            self.offsets,
            velocity,
            gate,
            _ROBUST * range_noise,
        )
        return equations


def _hits_of(samples: Sequence[BodySample]) -> _Hits:
    thin = [sample.thinned() for sample in samples]
    return _Hits(
        np.concatenate([sample.points for sample in thin]),
        np.concatenate([sample.normals for sample in thin]),
        np.concatenate([sample.baselines for sample in thin]),
        np.concatenate([sample.beam_ways for sample in thin]),
        np.concatenate([sample.times for sample in thin]),
        np.concatenate(([0], np.cumsum([len(sample.points) for sample in thin]))),
        _pairs(thin),
    )


def _pairs(samples: Sequence[BodySample]) -> float:
    """Number of pairs of hits with normals that would lie over each other if every sensor had seen the same each time.

    What a sensor saw of a body at one time but not at another is no sign of another shape.
    """
    sensors = 1 + max(int(sample.sensors.max()) for sample in samples)
    every, useful = (
        np.stack([np.bincount(part, minlength=sensors) for part in parts])
        for parts in (
            [sample.sensors for sample in samples],
            [sample.sensors[sample.normals.any(axis=1)] for sample in samples],
        )
    )
    common, known = (float(np.minimum(n[:, None], n[None]).sum() - n.sum()) for n in (every, useful))
    return max(1.0, 0.5 * known, 0.5 * _LEAST_KNOWN * common)


def _search(hits: _Hits, around: FloatArray) -> FloatArray:
    """Velocity (2,) [m/s] at which most hits lie over others, among many."""
    kept = [
        np.unique(np.linspace(low, high - 1, _SEARCHED_POINTS).astype(np.int64))
        for low, high in itertools.pairwise(hits.offsets.tolist())
        if high > low
    ]
    chosen = np.concatenate(kept)
    offsets = np.concatenate(([0], np.cumsum([len(part) for part in kept])))
    return np.asarray(densest(hits.points[chosen], hits.normals[chosen], hits.times[chosen], offsets, around))


@dataclass(frozen=True)
class _Match:
    """Where laying samples over each other came to rest: its information on the velocity, without the middles."""

    velocity: FloatArray
    information: FloatArray
    pull: FloatArray
    agreement: float


def _follow(
    hits: _Hits,
    known: FloatArray,
    pull: FloatArray,
    velocity: FloatArray,
    range_noise: float,
    gates: Sequence[float] = _GATES,
    leaning_share: float = 0.0,
) -> _Match:
    """Lay samples over each other, starting from a velocity."""
    samples = len(hits.offsets) - 1
    for gate in gates:
        equations = hits.lay_over(velocity, gate, range_noise)
        xx, xy, yy, bx, by, squares, weight, leaning = equations
        variance = max(range_noise**2, 0.5 * squares / weight if weight > 0.0 else 0.0)
        scale = 1.0 / (variance * samples)  # each hit takes part in a pair with every other sample
        seen, vector = _without_leaning(
            np.array([[xx, xy], [xy, yy]]), np.array([bx, by]), leaning_share * leaning * range_noise**2
        )
        information, vector = scale * seen, scale * vector
        velocity = np.asarray(np.linalg.solve(known + information, pull + vector))
    return _Match(velocity, information, vector, min(1.0, weight / hits.pairs))


def _without_leaning(
    information: FloatArray, pull: FloatArray, leaning: float
) -> tuple[FloatArray, FloatArray]:
    """Leave out what normals seem to tell along a flat face only because noise makes them lean."""
    values, axes = np.linalg.eigh(information)
    told = axes.T @ pull / np.maximum(values, 1e-12)
    kept = np.maximum(values - leaning, 0.0)
    return axes @ np.diag(kept) @ axes.T, axes @ (kept * told)


def _middle_information(samples: Sequence[BodySample]) -> tuple[FloatArray, FloatArray]:
    """What the middles of the hits of each sensor tell of the velocity: information (2, 2) and vector (2,)."""
    information, vector = 1e-6 * np.eye(2), np.zeros(2)
    for sensor in np.unique(np.concatenate([sample.sensors for sample in samples])):
        rows = []
        extents, spacing = [], 0.0
        for sample in samples:
            own = sample.sensors == sensor
            if own.any():
                points = sample.points[own]
                rows.append((*(0.5 * (points.min(axis=0) + points.max(axis=0))), sample.times[own].mean()))
                extents.append(float(np.hypot(*np.ptp(points, axis=0))))
                spacing = max(spacing, float(sample.spacing[own].mean()))
        table = np.array(rows)
        table -= table.mean(axis=0)
        places, times = table[:, :2], table[:, 2]
        spread = float(times @ times)
        if spread <= 0.0:
            continue
        slope = times @ places / spread
        misfit = float(np.sum((places - np.outer(times, slope)) ** 2)) / max(1, 2 * (len(times) - 2))
        uncertain = max(0.5 * spacing, _SHAPE_CHANGE * max(extents), 0.5 * float(np.std(extents)))
        variance = max(uncertain**2, misfit)
        information += np.eye(2) * spread / variance
        vector += spread * slope / variance
    return information, vector
