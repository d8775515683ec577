"""How far a robot is from where its timed path has it, and the same path timed anew from where it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from snnav_core.types import FloatArray, TimedPath

__all__ = ["Offset", "offset", "remainder", "retimed"]

_SAME = 1e-6  # [m], and share of a step
_AHEAD = 0.5  # [s] of driving before and after the place of the timed path, in which a robot is sought
_SHORTEST = 1e-3  # [m]; a shorter last link is none
_PIECES = 16  # of a link, where the nearest place is sought


@dataclass(frozen=True, slots=True)
class Offset:
    """Where a robot is, compared with its timed path.

    Parameters
    ----------
    distance : float
        From where the path has it now [m].
    across : float
        From the nearest place of the path within half a second of driving [m].
    ahead : float
        Length of path by which that place lies before the one of now [m]; negative when the robot is late.
    """

    distance: float
    across: float
    ahead: float


def offset(path: TimedPath, speed: float, position: FloatArray, time: float) -> Offset:
    """Compare a position (2,) [m, map] at a time [s] with the timed path of a robot of that speed [m/s]."""
    curve = _Curve(path, speed)
    station = curve.station(time)
    distance = float(np.linalg.norm(curve.at(np.array([station]))[0] - position))
    reach = _AHEAD * speed
    spread = np.linspace(-reach, reach, 2 * math.ceil(_PIECES * reach / curve.link) + 1)
    stations = np.unique(np.clip(station + spread, 0.0, curve.length))
    away = np.linalg.norm(curve.at(stations) - position, axis=1)
    nearest = int(np.argmin(away))
    return Offset(distance, float(away[nearest]), float(stations[nearest] - station))


def remainder(path: TimedPath, speed: float, time: float) -> TimedPath:
    """The part of a path that is left at a time [s]: its first point is where the robot has to be then."""
    passed = (time - path.start_time) / path.step
    if passed <= _SAME:
        return path
    whole = round(passed)
    if abs(passed - whole) <= _SAME:
        return TimedPath(time, path.step, path.points[min(whole, len(path) - 1) :])
    return retimed(path, speed, time, 0.0)


def retimed(path: TimedPath, speed: float, time: float, ahead: float) -> TimedPath:
    """What is left of a path for a robot that is `ahead` [m] of it (negative: late) at a time [s]."""
    curve = _Curve(path, speed)
    return curve.onwards(min(max(curve.station(time) + ahead, 0.0), curve.length), time)


class _Curve:
    """A path as a curve by length: through the points, so that points in between cut no corner."""

    def __init__(self, path: TimedPath, speed: float) -> None:
        points = np.asarray(path.points[:, :2])
        links = np.linalg.norm(np.diff(points, axis=0), axis=1)
        kept = links > _SAME
        self._points = points[np.concatenate(([True], kept))]
        self._marks = np.concatenate(([0.0], np.cumsum(links[kept])))
        self._spline = CubicSpline(self._marks, self._points) if len(self._marks) > 2 else None
        self.length, self.link = float(self._marks[-1]), speed * path.step
        # every link takes a step, a shorter last one less
        steps = np.ones(len(self._marks) - 1)
        if len(steps):
            steps[-1] = min(1.0, float(links[kept][-1]) / self.link)
        self._times = path.start_time + path.step * np.concatenate(([0.0], np.cumsum(steps)))
        self._step = path.step

    def station(self, time: float) -> float:
        """Length of path that is to be driven at a time [s]."""
        return float(np.interp(time, self._times, self._marks))

    def at(self, stations: FloatArray) -> FloatArray:
        """Points (N, 2) [m, map] at lengths (N,) [m]."""
        if self._spline is not None:
            return np.asarray(self._spline(stations))
        columns = [np.interp(stations, self._marks, self._points[:, axis]) for axis in range(2)]
        return np.stack(columns, axis=-1)

    def onwards(self, begin: float, time: float) -> TimedPath:
        """The path from a length [m] on, which is driven at a time [s]."""
        count = math.floor((self.length - begin) / self.link + _SAME)
        stations = begin + self.link * np.arange(count + 1)
        if self.length - float(stations[-1]) > _SHORTEST:
            stations = np.append(stations, self.length)
        points = self.at(np.asarray(stations, dtype=np.float64))
        points[-1] = self._points[-1]
        return TimedPath(time, self._step, points)
