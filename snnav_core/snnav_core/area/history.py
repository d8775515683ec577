"""Which sensor saw a point free last, and when."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from snnav_core.sensing.scan import DetectedArea
from snnav_core.types import FloatArray

__all__ = ["SeenHistory"]

_SCANS = 20


class SeenHistory:
    """The last 20 different scans of every sensor.

    Parameters
    ----------
    sensor_ids : sequence of str
    """

    def __init__(self, sensor_ids: Sequence[str]) -> None:
        self._sensor_ids = sorted(sensor_ids)
        self._seen: dict[str, deque[tuple[float, DetectedArea]]] = {
            sensor_id: deque(maxlen=_SCANS) for sensor_id in self._sensor_ids
        }

    def clear(self) -> None:
        """Forget everything."""
        for scans in self._seen.values():
            scans.clear()

    def add(self, stamp: float, part: DetectedArea) -> None:
        """Take what a sensor saw at `stamp` [s]; the same part again only gets the new stamp."""
        scans = self._seen[part.sensor_id]
        if scans and scans[-1][1] is part:
            scans.pop()
        scans.append((stamp, part))

    def last_seen(self, points: FloatArray, time: float) -> tuple[NDArray[np.int64], FloatArray]:
        """Which sensor saw points free last.

        Parameters
        ----------
        points : ndarray, shape (N, 2)
            Positions [m, map].
        time : float
            Scans after it do not count [s].

        Returns
        -------
        sensor : ndarray of int, shape (N,)
            Index into the sorted ids of the sensors; -1 where no scan of the history saw the point free.
        stamp : ndarray, shape (N,)
            Of the newest scan that did [s]; NaN where there is none. Of scans with the same stamp the first sensor's.
        """
        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        sensor = np.full(len(points), -1, dtype=np.int64)
        stamps = np.full(len(points), np.nan)
        scans = [
            (stamp, index, part)
            for index, sensor_id in enumerate(self._sensor_ids)
            for stamp, part in self._seen[sensor_id]
            if stamp <= time
        ]
        open_ = np.flatnonzero(np.isfinite(points).all(axis=1))
        for stamp, index, part in sorted(scans, key=lambda scan: (-scan[0], scan[1])):
            if open_.size == 0:
                break
            polygon = part.polygon
            shapely.prepare(polygon)
            inside = np.asarray(shapely.intersects_xy(polygon, points[open_, 0], points[open_, 1]))
            sensor[open_[inside]], stamps[open_[inside]] = index, stamp
            open_ = open_[~inside]
        return sensor, stamps
