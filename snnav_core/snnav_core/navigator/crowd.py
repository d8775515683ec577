"""The other robots as one robot sees them in one step: who stands, who may come near, what to keep away from."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from snnav_core.navigator.prediction import up_to
from snnav_core.navigator.settings import NavigatorSettings, RobotDistances
from snnav_core.planning.fields import DiskBarrier
from snnav_core.planning.separation import OtherRobot, Traffic, stops_within
from snnav_core.planning.separation_kernel import are_near, sample
from snnav_core.types import TIME_TOLERANCE, FloatArray, HeardPath, Pose2D, RobotSpec, RobotState, TimedPath

__all__ = ["Cast", "Crowd", "Turns", "believed", "possible_paths"]

_LONGEST_WAIT = 6  # steps that a robot waits at most for its turn to seek a way
_SLACK = 1.0  # [m]; farther than this an adjustment does not move a path


class Crowd(Traffic):
    """The other robots around one robot; everything is computed once, when it is first needed.

    Parameters
    ----------
    others : sequence of OtherRobot
    pose : Pose2D
        Of the robot that is planned for [map].
    time : float
        Of the decision [s].
    distances : RobotDistances
    settings : NavigatorSettings
    """

    def __init__(
        self,
        others: Sequence[OtherRobot],
        pose: Pose2D,
        time: float,
        distances: RobotDistances,
        settings: NavigatorSettings,
    ) -> None:
        super().__init__(others)
        self.pose, self.time = pose, time
        self._distances, self._settings = distances, settings

    @cached_property
    def gaps(self) -> FloatArray:
        """Present distances between the centres [m], shape (O,)."""
        positions, _ = self.outlook(self.time, math.inf)
        gaps: FloatArray = np.linalg.norm(positions - self.pose.position, axis=1)
        return gaps

    @cached_property
    def stands(self) -> NDArray[np.bool_]:
        """Which of them stand and have no way to go on, shape (O,)."""
        return np.asarray(self.outlook(self.time, math.inf)[1] == 0.0)

    def barriers(self, chain: FloatArray) -> list[DiskBarrier]:
        """What the points of a path keep away from when a chain (N, 2) [m, map] is adjusted.

        Robots under way that can be met within the window, for so long; robots that stand near the chain; and for
        the first interval the stops of those so near that they matter then.

        Where robots under way will be beyond the window nobody knows. As obstacles there, they tore most ways through
        a crowd apart; in a large one, so did those that stand for a while.
        """
        if len(self) == 0:
            return []
        centres, demanded = self._disks
        link = 1.02 * self._distances.link
        ends, chain = np.ascontiguousarray(centres[:, -1]), np.require(chain, np.float64, ["C", "W"])
        ahead = are_near(ends, demanded[:, -1] + _SLACK, chain, link)
        stand = [DiskBarrier(centres[index], demanded[index]) for index in np.flatnonzero(self._stay & ahead)]
        return stand + self._moving + self._stops

    @property
    def is_large(self) -> bool:
        """Whether there are so many that the robot looks only as far as its window at those who will go on."""
        return len(self) >= self._settings.crowd

    @cached_property
    def _stay(self) -> NDArray[np.bool_]:
        """Which of them stand, in a large crowd for good, shape (O,)."""
        if not self.is_large:
            return self.stands
        return np.asarray(self.stands & [other.parked for other in self])

    @cached_property
    def _moving(self) -> list[DiskBarrier]:
        """Robots that will go on and can be met within the window."""
        centres, demanded = self._disks
        met = self.gaps - self.own_reach - self._reach <= demanded.max(axis=1)
        return _ending(centres[met & ~self._stay], demanded[met & ~self._stay])

    @cached_property
    def own_reach(self) -> float:
        """How far the robot comes within the window [m]."""
        distances = self._distances
        return distances.certificate.stretch * distances.link * distances.window_points

    @cached_property
    def _reach(self) -> FloatArray:
        window = self._settings.time_window * self._settings.sampling_interval
        return self.outlook(self.time, self.time + window)[1]

    @cached_property
    def _disks(self) -> tuple[FloatArray, FloatArray]:
        """Where the others are at the times of p_1, p_2, ... (O, K, 2), and what they demand then (O, K) [m]."""
        points, offsets, starts, steps = self.ways
        times = self.time + self._distances.step * np.arange(1, self._distances.window_points + 1)
        centres = sample(points, offsets, starts, steps, times)
        return centres, self._demanded(centres, self.radii, self.gaps)

    def _demanded(self, centres: FloatArray, radii: FloatArray, gaps: FloatArray) -> FloatArray:
        """Distances that keep the margin also between the points, for centres (O, K, 2) -> (O, K) [m]."""
        link, count = self._distances.link, centres.shape[1]
        clearance = self._settings.safety_margin + 2.0 * self._distances.tolerance + self._distances.reserve
        longest = np.linalg.norm(np.diff(centres, axis=1), axis=2).max(axis=1, initial=0.0)
        distance = np.hypot(radii + clearance, 0.5 * link + 0.5 * longest)
        # Robots that stand nearer part at half the speed; they are not torn apart.
        parting = gaps[:, None] + 0.5 * link * np.arange(1, count + 1)
        demanded: FloatArray = np.minimum(distance[:, None], parting)
        return demanded

    @cached_property
    def _stops(self) -> list[DiskBarrier]:
        """Robots near this one that stop on their way: only the points up to the next decision keep away."""
        distances, settings = self._distances, self._settings
        times = self.time + distances.step * np.arange(1, distances.parts + 1, dtype=np.float64)
        near = self.gaps < self.radii + settings.safety_margin + 3.0 * distances.stride
        who, centres = [], []
        for index in np.flatnonzero(near & ~self.stands):
            path = self[int(index)].path
            for stopped in stops_within(path, self.time, self.time + settings.sampling_interval):
                who.append(index)
                centres.append(stopped.positions_at(times)[:, :2])
        if not who:
            return []
        together = np.array(centres)
        return _ending(together, self._demanded(together, self.radii[who], self.gaps[who]))


def _ending(centres: FloatArray, demanded: FloatArray) -> list[DiskBarrier]:
    """Disks at places (O, K, 2) [m, map] that keep only p_1 .. p_K away, by distances (O, K) [m]."""
    centres = np.concatenate((centres, centres[:, -1:]), axis=1)
    demanded = np.concatenate((demanded, np.full((len(demanded), 1), -math.inf)), axis=1)
    return [DiskBarrier(places, distances) for places, distances in zip(centres, demanded, strict=True)]


class Turns:
    """Whose turn it is to seek new ways in a step: all at once, a hundred robots would take seconds.

    Parameters
    ----------
    most : int
        So many take turns first come, first served, in the order of decisions.
    waiting : mapping
        Of a large crowd: robots that were put off -> for how many steps. For those that have waited longer than the one
        that asks turns are kept, until they are decided: else most would wait as long as they can, and then seek all in
        one step.

    Notes
    -----
    It counts searches, not time: the outcome does not depend on the machine.
    """

    def __init__(self, most: int, waiting: Mapping[str, int] = MappingProxyType({})) -> None:
        self._left, self._waiting = most, dict(waiting)

    def take(self, name: str, waited: int) -> bool:
        """Whether a robot may seek now that was put off for so many steps; after six it may in any case."""
        self.skip(name)
        kept = sum(longer > waited for longer in self._waiting.values())
        granted = self._left > kept or waited >= _LONGEST_WAIT
        self._left -= granted
        return granted

    def pay(self) -> None:
        """Take one turn more: for a search that found nothing, which takes about twice as long as others."""
        self._left -= 1

    def skip(self, name: str) -> None:
        """Keep no turn for a robot: it was decided."""
        self._waiting.pop(name, None)


class Cast:
    """Where all robots will be for all that is known in one step, worked out once for each and size of its disk."""

    def __init__(self) -> None:
        self._ways: dict[float, dict[str, list[OtherRobot]]] = {}

    def others(
        self,
        name: str,
        robots: Mapping[str, RobotSpec],
        ways: Callable[[str, float], list[OtherRobot]],
    ) -> list[OtherRobot]:
        """All robots but one, as disks that are as large as its own at least.

        Parameters
        ----------
        name : str
        robots : mapping
        ways : callable
            Works out where a robot may be, as a disk of a given radius [m].
        """
        others: list[OtherRobot] = []
        least = robots[name].radius
        known = self._ways.setdefault(least, {})
        for other, robot in robots.items():
            if other == name:
                continue
            if other not in known:
                known[other] = ways(other, max(robot.radius, least))
            others += known[other]
        return others

    def forget(self, name: str) -> None:
        """Note that something was decided for a robot: it may be elsewhere than was known up to now."""
        for known in self._ways.values():
            known.pop(name, None)


def believed(
    promise: HeardPath, last: HeardPath | None, state: RobotState | None, time: float, interval: float
) -> HeardPath:
    """What another navigator promises at a time [s]; of a robot that was stopped unseen its last path counts.

    Nobody knows where on it the robot stands until it is measured again; nor, if it was not measured for an interval
    [s] even before, whether it heard that it shall.
    """
    if promise.path is not None or last is None:
        return promise
    measured = -math.inf if state is None else state.stamp
    until = last.valid_until if time - measured > interval + TIME_TOLERANCE else min(last.valid_until, time)
    return (
        promise if measured >= until - TIME_TOLERANCE else replace(promise, path=last.path, valid_until=until)
    )


def possible_paths(
    state: RobotState | None, promise: HeardPath, distances: RobotDistances, time: float
) -> list[TimedPath]:
    """Where a robot may be from `time` [s] on: on what it was promised, or standing somewhere on the rest of that.

    Parameters
    ----------
    state : RobotState or None
        The last that is known of it; None for nothing.
    promise : HeardPath
    distances : RobotDistances
        Of the robot.
    time : float
    """
    step = distances.step
    if promise.path is not None and time < promise.valid_until:
        way = up_to(promise.path, promise.valid_until)
        return [way, *_stops_before(state, way, distances, time)]
    if state is None:
        return []
    paths = [TimedPath(time, step, state.pose.position[None])]
    if promise.path is not None and state.stamp < time - TIME_TOLERANCE:
        # Not heard of since: it stands somewhere on what was left of its way.
        left = np.arange(state.stamp, promise.valid_until + 0.5 * step, step)
        paths += [TimedPath(time, step, point[None]) for point in promise.path.positions_at(left)]
    return paths


def _stops_before(
    state: RobotState | None, way: TimedPath, distances: RobotDistances, time: float
) -> list[TimedPath]:
    """Where a robot may have stopped before `time` [s] that was not heard of since its way was decided.

    It was told to stop then, but nobody knows whether it hears that.
    """
    since = way.start_time if state is None else max(way.start_time, state.stamp)
    if time - since <= distances.parts * distances.step + TIME_TOLERANCE:
        return []
    passed = way.positions_at(np.arange(since, time, distances.step))
    return [TimedPath(time, distances.step, point[None]) for point in passed]
