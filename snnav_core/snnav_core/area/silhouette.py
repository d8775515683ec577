"""Motion of a body from where its silhouettes end: between the last beam that met it and the first that passed it."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numba
import numpy as np
from numpy.typing import NDArray

from snnav_core.area.returns import FusedReturns
from snnav_core.types import FloatArray

__all__ = ["Limits", "PassingBeams", "narrow_velocity", "passing_beams", "velocity_limits"]

_BEHIND = 0.1  # [m] that a beam reaches farther than the last hit on the body, if it passed the body
_NEXT = 8  # beams on each side of which the nearest one that met what stands tells where a body ends
_INSIDE = 0.02  # [m] by which hits of the same measurement may lie beyond a beam that passed
_NOISE = 2.5  # deviations of a range by which a hit may lie outside of the body
_SLACKS = (0.0, 0.004, 0.01, 0.02)  # [m] by which hits and passing beams may contradict each other
_LEAST_DOUBT = 0.001  # [m] to which places of hits and beams can be compared at best
_SPREAD = 4.0  # deviations around the expected velocity that are looked at
_GRID = (25, 17)  # velocities along the longer and the shorter side
_LEAST_PASSED = 1e-3  # [s]


@dataclass(frozen=True)
class PassingBeams:
    """The first beams that passed a body, on both sides of what was hit of it, in one measurement.

    Parameters
    ----------
    origins : ndarray, shape (E, 2)
        Where their sensors are [m, map].
    outward : ndarray, shape (E, 2)
        Unit vectors square to them, away from the body: no point of it lies on that side.
    times : ndarray, shape (E,)
        [s]
    ends : ndarray of int, shape (E,)
        Which end they pass: twice the number of the sensor, one more at the end of the higher beams.
    beams : ndarray of int, shape (E,)
        Their numbers.
    ranges : ndarray, shape (E,)
        How far they reached [m].
    surfaces : ndarray of int, shape (E,)
        What they met, by numbers that hold for one measurement.
    bodies : ndarray of int, shape (E,)
        Number of the tracked body that they met, -1 for none.
    """

    origins: FloatArray
    outward: FloatArray
    times: FloatArray
    ends: NDArray[np.int64]
    beams: NDArray[np.int64]
    ranges: FloatArray
    surfaces: NDArray[np.int64]
    bodies: NDArray[np.int64]

    def part(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> PassingBeams:
        """Some of them."""
        return PassingBeams(*(getattr(self, field.name)[chosen] for field in fields(self)))

    def joined(self, other: PassingBeams) -> PassingBeams:
        """These and others."""
        return PassingBeams(
            *(
                np.concatenate((getattr(self, field.name), getattr(other, field.name)))
                for field in fields(self)
            )
        )

    def past(self, points: FloatArray) -> PassingBeams:
        """Those that pass all of these points (n, 2) [m, map], one at every end: not those between parts of a body."""
        beyond = np.einsum("enk,ek->en", points[None] - self.origins[:, None], self.outward)
        outside = np.flatnonzero((beyond <= _INSIDE).all(axis=1))
        outside = outside[np.argsort(-beyond[outside].mean(axis=1), kind="stable")]
        _, nearest = np.unique(self.ends[outside], return_index=True)
        return self.part(outside[nearest])


def passing_beams(
    returns: FusedReturns, own: NDArray[np.bool_], single: NDArray[np.bool_], bodies: NDArray[np.int64]
) -> PassingBeams:
    """Find the beams that just passed a body.

    Parameters
    ----------
    returns : FusedReturns
    own : ndarray of bool, shape (K,)
        The hits on the body.
    single : ndarray of bool, shape (K,)
        Hits that belong to nothing: on a face that a beam grazes they may be far from the next one, and on the body.
    bodies : ndarray of int, shape (K,)
        Number of the tracked body that each hit belongs to, -1 for none.

    Notes
    -----
    Where the next return is nearer than the body, something hides its end; where it is hardly farther, it may show the
    body itself: neither tells where the body ends. A beam without return tells nothing: a robot may have been left out.
    """
    hits, others = np.flatnonzero(own), np.flatnonzero(~own & ~single)
    if len(hits) == 0 or len(others) == 0:
        none = np.zeros(0, dtype=np.int64)
        return PassingBeams(
            np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0), none, none, np.zeros(0), none, none
        )
    starts = np.flatnonzero(np.diff(returns.sensors[hits], prepend=-1) != 0)
    first, last = hits[starts], hits[np.append(starts[1:], len(hits)) - 1]
    inner = np.repeat(np.concatenate((first, last)), _NEXT)
    ends = 2 * returns.sensors[inner] + np.repeat([0, 1], _NEXT * len(first))
    steps = np.arange(_NEXT)
    before = np.searchsorted(others, first)[:, None] - 1 - steps
    after = np.searchsorted(others, last)[:, None] + steps
    next_one = np.concatenate((before, after)).ravel()
    there = (next_one >= 0) & (next_one < len(others))
    inner, ends, outer = inner[there], ends[there], others[next_one[there]]
    same = returns.sensors[inner] == returns.sensors[outer]
    passed = same & (returns.ranges[outer] > returns.ranges[inner] + _BEHIND)
    inner, outer, ends = inner[passed], outer[passed], ends[passed]
    origins = returns.origins[returns.sensors[outer]]
    beams = (returns.points[outer] - origins) / returns.ranges[outer, None]
    outward = np.column_stack((-beams[:, 1], beams[:, 0]))
    inside = np.sum(outward * (returns.points[inner] - origins), axis=1) > 0.0
    outward[inside] *= -1.0
    return PassingBeams(
        origins,
        outward,
        returns.times[outer],
        ends,
        returns.beams[outer],
        returns.ranges[outer],
        returns.surfaces[outer],
        bodies[outer],
    )


@dataclass(frozen=True)
class Limits:
    """Half-planes of velocities a vx + b vy <= c: rows (N, 3), c in metres; and the end that each is about, (N,)."""

    rows: FloatArray
    ends: NDArray[np.int64]


def velocity_limits(
    passing: PassingBeams, points: FloatArray, times: FloatArray, beams: FloatArray, range_noise: float
) -> Limits:
    """Velocities at which no hit, moved on, lies beyond a beam that passed the body at another time.

    Parameters
    ----------
    passing : PassingBeams
        Of all measurements.
    points, beams : ndarray, shape (n, 2)
        All hits [m, map], and the unit vectors of the beams that met them.
    times : ndarray, shape (n,)
        [s]
    range_noise : float
        Standard deviation of a range [m].
    """
    moments, number = np.unique(times.round(4), return_inverse=True)
    beyond = np.einsum("enk,ek->en", points[None] - passing.origins[:, None], passing.outward)
    beyond -= _NOISE * range_noise * np.abs(beams @ passing.outward.T).T
    farthest = np.empty((len(passing.times), len(moments)))
    for moment in range(len(moments)):
        farthest[:, moment] = beyond[:, number == moment].max(axis=1)
    passed = passing.times[:, None] - moments[None]
    edge, moment_of = np.nonzero(np.abs(passed) > _LEAST_PASSED)
    slopes = passing.outward[edge] * passed[edge, moment_of, None]
    return Limits(np.column_stack((slopes, -farthest[edge, moment_of])), passing.ends[edge])


def narrow_velocity(
    limits: Limits, expected: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Narrow a velocity by where a rigid body was hit and passed at several times.

    Within the limits the likelihood of a velocity is the length over which the end of the body, wherever it is, agrees
    with all hits and all passing beams.

    Parameters
    ----------
    limits : Limits
    expected, covariance : ndarray, shapes (2,), (2, 2)
        What is known of the velocity besides [m/s].

    Returns
    -------
    velocity, covariance : ndarray, or None
        None where nothing was passed, or hits and passing beams contradict each other.
    """
    if len(limits.rows) == 0:
        return None
    spread, axes = np.linalg.eigh(covariance)  # the shorter axis first
    half = _SPREAD * np.sqrt(np.maximum(spread, 1e-12))
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * half
    start = expected + corners @ axes.T
    for slack in _SLACKS:
        rows = limits.rows.copy()
        rows[:, 2] += slack
        region = _clip(start, rows)
        if len(region):
            weighed = _weigh(region, rows, limits.ends, expected, covariance, axes)
            doubt = (slack + _LEAST_DOUBT) / float(np.hypot(*rows[:, :2].T).max())
            return None if weighed is None else (weighed[0], weighed[1] + doubt**2 * np.eye(2))
    return None


@numba.njit(cache=True, nogil=True)
def _clip(region, limits):  # type: ignore[no-untyped-def]
    """The part of a convex polygon (N, 2) within all half-planes; (0, 2) where there is none."""
    for k in range(limits.shape[0]):
        rest = limits[k, 2] - limits[k, 0] * region[:, 0] - limits[k, 1] * region[:, 1]
        if rest.min() >= 0.0:
            continue
        kept, count = np.empty((region.shape[0] + 1, 2)), 0
        for here in range(region.shape[0]):
            before = here - 1 if here > 0 else region.shape[0] - 1
            if (rest[here] >= 0.0) != (rest[before] >= 0.0):
                share = rest[before] / (rest[before] - rest[here])
                kept[count] = region[before] + share * (region[here] - region[before])
                count += 1
            if rest[here] >= 0.0:
                kept[count] = region[here]
                count += 1
        region = kept[:count].copy()
        if count == 0:
            break
    return region


def _weigh(
    region: FloatArray,
    rows: FloatArray,
    ends: NDArray[np.int64],
    expected: FloatArray,
    covariance: FloatArray,
    axes: FloatArray,
) -> tuple[FloatArray, FloatArray] | None:
    """Mean and covariance of the velocities in a region."""
    inside = (region - expected) @ axes
    low, high = inside.min(axis=0), inside.max(axis=0)
    steps = [
        low[k] + (np.arange(count) + 0.5) / count * (high[k] - low[k]) for k, count in enumerate(_GRID[::-1])
    ]
    grid = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 2) @ axes.T + expected
    _, group = np.unique(ends, return_inverse=True)
    lengths = _agreeing(grid, rows, group.astype(np.int64), int(group.max()) + 1)
    off = grid - expected
    weights = lengths * np.exp(-0.5 * np.sum(off @ np.linalg.inv(covariance) * off, axis=1))
    total = float(weights.sum())
    if not total > 0.0:
        return None
    velocity = weights @ grid / total
    off = grid - velocity
    cell = (high - low) / np.array(_GRID[::-1])
    found = (off * weights[:, None]).T @ off / total + axes @ np.diag(cell**2 / 12.0) @ axes.T
    return velocity, found


@numba.njit(cache=True, nogil=True)
def _agreeing(grid, limits, group, groups):  # type: ignore[no-untyped-def]
    """Product over all ends of the length over which they agree, for every velocity of the grid."""
    result = np.ones(grid.shape[0])
    least = np.empty(groups)
    for g in range(grid.shape[0]):
        least[:] = np.inf
        for k in range(limits.shape[0]):
            rest = limits[k, 2] - limits[k, 0] * grid[g, 0] - limits[k, 1] * grid[g, 1]
            if rest < least[group[k]]:
                least[group[k]] = rest
        for k in range(groups):
            result[g] *= max(least[k], 0.0)
    return result
