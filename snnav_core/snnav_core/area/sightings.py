"""What beams measured lately: a hit far in front of that has arrived, one that beams now pass by has left."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from snnav_core.area.returns import FusedReturns
from snnav_core.types import FloatArray

__all__ = ["Sightings"]

_SIDE_BEAMS = 2  # on either side that must agree: single ones flicker at edges
_Reach = dict[
    int, FloatArray
]  # sensor -> how far it looked along every beam at least, inf without a return [m]


class Sightings:
    """Ranges of all sensors within a window of time, beam by beam.

    Parameters
    ----------
    window : float
        [s]
    depth : float
        Less than this in front of what was measured before, a hit may be noise [m].

    Notes
    -----
    A beam without return counts as one that looked far: this tells motion, never free space.
    """

    def __init__(self, window: float, depth: float) -> None:
        self._window, self._depth = window, depth
        self._past: deque[tuple[float, _Reach]] = deque()
        self._single: deque[tuple[float, _Reach]] = deque()
        self._now: _Reach = {}

    def take(self, time: float, returns: FusedReturns) -> NDArray[np.bool_]:
        """Add a measurement [s] and return whether each hit has arrived within the window, shape (K,)."""
        while self._past and time - self._past[0][0] > self._window:
            self._past.popleft()
            self._single.popleft()
        single: _Reach = {}
        ranges = returns.ranges
        arrived = np.zeros(len(returns), dtype=np.bool_)
        self._now = {}
        for sensor in np.unique(returns.sensors).tolist():
            own = returns.sensors == sensor
            beams = returns.beams[own]
            arrived[own] = self._is_before(sensor, beams, ranges[own])
            reach = np.full(int(beams.max()) + 1, np.inf)
            reach[beams] = ranges[own]
            single[sensor] = reach
            size = 2 * _SIDE_BEAMS + 1
            self._now[sensor] = minimum_filter1d(reach, size, mode="constant", cval=np.inf)
        self._past.append((time, self._now))
        self._single.append((time, single))
        return arrived

    def left(self, sensors: NDArray[np.int64], beams: NDArray[np.int64], ranges: FloatArray) -> int:
        """How many former hits, by sensor, beam and range [m], the latest measurement looks through; shapes (n,)."""
        count = 0
        for sensor in np.unique(sensors).tolist():
            if sensor in self._now:
                own = sensors == sensor
                reach = _at(self._now[sensor], beams[own])
                count += int((reach > ranges[own] + self._depth).sum())
        return count

    def steady(
        self,
        sensors: NDArray[np.int64],
        beams: NDArray[np.int64],
        ranges: FloatArray,
        since: float = math.inf,
    ) -> NDArray[np.bool_]:
        """Whether what single beams met stands, shape (n,): seen there at two times within the window, never farther.

        The first of these times is not after `since` [s].
        """
        times, farther = np.zeros(len(sensors), dtype=np.int64), np.zeros(len(sensors), dtype=np.bool_)
        first = np.full(len(sensors), np.inf)
        for sensor in np.unique(sensors).tolist():
            own = np.flatnonzero(sensors == sensor)
            for time, reach in self._single:
                if sensor in reach:
                    beyond = _at(reach[sensor], beams[own]) - ranges[own]
                    farther[own] |= beyond > self._depth
                    there = np.abs(beyond) <= self._depth
                    times[own] += there
                    first[own] = np.minimum(first[own], np.where(there, time, np.inf))
        return (times >= 2) & (first <= since) & ~farther

    def _is_before(self, sensor: int, beams: NDArray[np.int64], ranges: FloatArray) -> NDArray[np.bool_]:
        farthest = np.zeros(len(beams))
        for _, reach in self._past:
            if sensor in reach:
                farthest = np.maximum(farthest, _at(reach[sensor], beams))
        return np.asarray(farthest > ranges + self._depth)


def _at(reach: FloatArray, beams: NDArray[np.int64]) -> FloatArray:
    inside = beams < len(reach)
    return np.where(inside, reach[np.where(inside, beams, 0)], np.inf)
