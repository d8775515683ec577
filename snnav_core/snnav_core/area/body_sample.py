"""What one measurement showed of one body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snnav_core.area.silhouette import PassingBeams
from snnav_core.types import FloatArray

__all__ = ["BodySample"]

_MOST_POINTS = 48  # of one sample that take part in a fit


@dataclass(frozen=True)
class BodySample:
    """Hits on one body in one measurement.

    Parameters
    ----------
    taken : float
        Time of the measurement [s].
    points, normals : ndarray, shape (n, 2)
        [m, map] and unit vectors, 0, 0 where none is known.
    times : ndarray, shape (n,)
        [s]
    spacing : ndarray, shape (n,)
        Distance between neighbouring beams there [m].
    sensors, beams : ndarray of int, shape (n,)
    ranges : ndarray, shape (n,)
        Distance from the sensor [m].
    origins : ndarray, shape (n, 2)
        Positions of the sensors [m, map].
    baselines : ndarray, shape (n,)
        What divides the noise of a range to give the deviation of a normal [m/rad]; 0 without a normal.
    passing : PassingBeams
        Beams that passed the body.
    """

    taken: float
    points: FloatArray
    normals: FloatArray
    times: FloatArray
    spacing: FloatArray
    sensors: NDArray[np.int64]
    beams: NDArray[np.int64]
    ranges: FloatArray
    origins: FloatArray
    baselines: FloatArray
    passing: PassingBeams

    @property
    def beam_ways(self) -> FloatArray:
        """Unit vectors of the beams (n, 2)."""
        ways: FloatArray = self.points - self.origins
        ways /= np.hypot(*ways.T)[:, None]
        return ways

    def thinned(self) -> BodySample:
        """So few hits, evenly chosen, that fits stay cheap."""
        if len(self.points) <= _MOST_POINTS:
            return self
        chosen = np.linspace(0, len(self.points) - 1, _MOST_POINTS).astype(np.int64)
        return self.part(chosen)

    def part(self, chosen: NDArray[np.int64] | NDArray[np.bool_]) -> BodySample:
        """Some of the hits."""
        return BodySample(
            self.taken,
            self.points[chosen],
            self.normals[chosen],
            self.times[chosen],
            self.spacing[chosen],
            self.sensors[chosen],
            self.beams[chosen],
            self.ranges[chosen],
            self.origins[chosen],
            self.baselines[chosen],
            self.passing,
        )

    def joined(self, other: BodySample) -> BodySample:
        """These hits and others of the same measurement."""
        return BodySample(
            self.taken,
            np.concatenate((self.points, other.points)),
            np.concatenate((self.normals, other.normals)),
            np.concatenate((self.times, other.times)),
            np.concatenate((self.spacing, other.spacing)),
            np.concatenate((self.sensors, other.sensors)),
            np.concatenate((self.beams, other.beams)),
            np.concatenate((self.ranges, other.ranges)),
            np.concatenate((self.origins, other.origins)),
            np.concatenate((self.baselines, other.baselines)),
            self.passing.joined(other.passing),
        )
