"""Where robots will go beyond their windows: shortest ways in time, and where these meet without room to pass."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from snnav_core.errors import PlanningError
from snnav_core.navigator.context import AreaContext
from snnav_core.navigator.search import find_route
from snnav_core.navigator.settings import NavigatorSettings, RobotDistances
from snnav_core.types import FloatArray, PlannedPath, Pose2D, RobotSpec

__all__ = ["Meeting", "Party", "Way", "Ways"]

_TICK = 0.5  # [s] between samples of a way
_HORIZON = 120  # samples
_ROOM = 0.1  # [m] that robots side by side need beyond what they must keep
_FOLLOWS = 0.5  # cosine between two directions from which on one robot follows the other


@dataclass(frozen=True)
class Party:
    """One robot as others have to reckon with it.

    Parameters
    ----------
    robot : RobotSpec
    distances : RobotDistances
    pose : Pose2D
        [map]
    goal : ndarray, shape (2,), or None
        Where it is told to go [m, map].
    plan : PlannedPath or None
        The path that it follows.
    leads_to_goal : bool
        Whether that path leads to the goal.
    arrived : bool
    served : bool
        Whether it is decided for here.
    """

    robot: RobotSpec
    distances: RobotDistances
    pose: Pose2D
    goal: FloatArray | None
    plan: PlannedPath | None = None
    leads_to_goal: bool = False
    arrived: bool = False
    served: bool = True

    @property
    def position(self) -> FloatArray:
        """Position (2,) [m, map]."""
        return self.pose.position


@dataclass(frozen=True)
class Way:
    """Where a robot is at every tick from now on, at full speed.

    Parameters
    ----------
    points : ndarray, shape (K, 2)
        [m, map]; the last one is its target, or where the horizon ends.
    narrow : ndarray of bool, shape (K,)
        Where another robot has no room beside it.
    """

    points: FloatArray
    narrow: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def directions(self) -> FloatArray:
        """Unit vectors (K, 2); zero where it stands."""
        if len(self.points) < 2:
            return np.zeros((len(self.points), 2))
        change = np.diff(self.points, axis=0)
        change = np.vstack((change, change[-1:]))
        return np.asarray(change / np.maximum(np.linalg.norm(change, axis=1), 1e-12)[:, None])

    @cached_property
    def line(self) -> BaseGeometry:
        """All of it as a geometry [m, map]."""
        return shapely.linestrings(self.points) if len(self.points) > 1 else shapely.points(self.points[0])

    def stretch(self, tick: int) -> tuple[int, int]:
        """First and last tick of the narrow part around a tick; the tick itself where it is wide."""
        first = last = tick
        while first > 0 and self.narrow[first - 1]:
            first -= 1
        while last + 1 < len(self) and self.narrow[last + 1]:
            last += 1
        return first, last


@dataclass(frozen=True)
class Meeting:
    """Two robots will meet where there is no room for both: the ticks at which either is there."""

    first: int
    second: int

    @property
    def tick(self) -> int:
        """When both are there."""
        return max(self.first, self.second)


class Ways:
    """The ways of all robots in one step.

    Parameters
    ----------
    context : AreaContext
    settings : NavigatorSettings
    parties : mapping
        Robot id -> Party.
    """

    def __init__(
        self, context: AreaContext, settings: NavigatorSettings, parties: Mapping[str, Party]
    ) -> None:
        self.context = context
        self.settings = settings
        self.parties = parties
        self._ways: dict[tuple[str, bytes, bool], Way | None] = {}

    def need(self, first: str, second: str) -> float:
        """Distance of two robot centres that both can plan for [m]."""
        one, other = self.parties[first], self.parties[second]
        reserve = max(party.distances.reserve + 2.0 * party.distances.tolerance for party in (one, other))
        chord = 0.5 * max(one.distances.link, other.distances.link)
        return math.hypot(
            self.settings.safety_margin + max(one.robot.radius, other.robot.radius) + reserve, chord
        )

    def to_goal(self, name: str) -> Way | None:
        """The way that a robot follows now, else the shortest as if there were no others; None without any."""
        party = self.parties[name]
        if party.goal is None:
            return None
        if party.plan is not None and party.leads_to_goal and party.plan.path.turn_to is None:
            key = (name, b"plan", True)
            if key not in self._ways:
                self._ways[key] = self._timed(party, _ahead(party.plan.path.points[:, :2], party.position))
            return self._ways[key]
        return self.shortest(name, party.goal)

    def shortest(self, name: str, goal: FloatArray) -> Way | None:
        """The shortest way of a robot to (2,) [m, map], as if there were no others; None without any."""
        key = (name, np.asarray(goal, dtype=np.float64).tobytes(), False)
        if key not in self._ways:
            chain = self._chain(self.parties[name], goal)
            self._ways[key] = None if chain is None else self._timed(self.parties[name], chain)
        return self._ways[key]

    def _chain(self, party: Party, goal: FloatArray) -> FloatArray | None:
        try:
            route = find_route(
                self.context, party.robot, party.pose, goal, party.distances, self.settings, ()
            )
        except PlanningError:
            return None
        start = party.position
        entry = start if route.start_inside else route.curves.nearest(start)
        chain = self.context.goal_tree(route.curves, route.target).from_point(entry)
        return None if chain is None else np.vstack((start, chain))

    def _timed(self, party: Party, chain: FloatArray) -> Way:
        links = np.linalg.norm(np.diff(chain, axis=0), axis=1)
        along = np.concatenate(([0.0], np.cumsum(links)))
        stride = party.robot.speed * _TICK
        count = min(_HORIZON, math.ceil(along[-1] / stride - 1e-9))
        stations = np.minimum(np.arange(count + 1) * stride, along[-1])
        points = np.stack([np.interp(stations, along, chain[:, axis]) for axis in range(2)], axis=-1)
        return Way(points, self.narrow(points, party))

    def narrow(self, points: FloatArray, party: Party) -> NDArray[np.bool_]:
        """Where two robots do not fit side by side, for points (K, 2) [m, map]."""
        largest = max(other.robot.radius for other in self.parties.values())
        half = 0.5 * (self.settings.safety_margin + largest + _ROOM)
        wide = self.context.opened(party.distances.tightest, half)
        return ~np.asarray(shapely.contains_xy(wide, points[:, 0], points[:, 1]), dtype=bool)

    def meeting(
        self, first: tuple[str, Way], second: tuple[str, Way], slack: float, anywhere: bool = False
    ) -> Meeting | None:
        """Where two robots meet first when both go on.

        Parameters
        ----------
        first, second : tuple of str and Way
        slack : float
            Either may be so much later than its way says [s].
        anywhere : bool
            Count also where there is room for both.
        """
        (one, way), (other, against) = first, second
        need, shift = self.need(one, other), max(0, round(slack / _TICK))
        best: Meeting | None = None
        for late in sorted(range(-shift, shift + 1), key=abs):
            begin, start = max(0, -late), max(0, late)
            count = min(len(way) - begin, len(against) - start)
            if count <= 0:
                continue
            mine, theirs = slice(begin, begin + count), slice(start, start + count)
            found = np.linalg.norm(way.points[mine] - against.points[theirs], axis=1) < need
            along = np.einsum("ij,ij->i", way.directions[mine], against.directions[theirs])
            found &= along < _FOLLOWS
            if not anywhere:
                found &= way.narrow[mine] | against.narrow[theirs]
            if found.any():
                tick = int(np.argmax(found))
                meeting = Meeting(begin + tick, start + tick)
                if best is None or meeting.tick < best.tick:
                    best = meeting
        return best

    def meetings(self, ways: Mapping[str, Way], slack: float) -> list[tuple[str, str, Meeting]]:
        """All pairs of robots that meet where there is no room for both, in the order of `ways`."""
        names = list(ways)
        if len(names) < 2:
            return []
        longest = max(len(way) for way in ways.values())
        points = np.array(
            [np.pad(way.points, ((0, longest - len(way)), (0, 0)), mode="edge") for way in ways.values()]
        )
        narrow = np.array([way.narrow.any() for way in ways.values()])
        reach = slack * np.array([self.parties[name].robot.speed for name in names])
        largest = max(self.need(name, name) for name in names)
        found = []
        for index, first in enumerate(names[:-1]):
            rest = np.arange(index + 1, len(names))
            rest = rest[narrow[index] | narrow[index + 1 :]]
            near = np.linalg.norm(points[rest] - points[index], axis=2) < (
                largest + np.maximum(reach[index], reach[rest])[:, None]
            )
            for other in rest[near.any(axis=1)]:
                second = names[int(other)]
                meeting = self.meeting((first, ways[first]), (second, ways[second]), slack)
                if meeting is not None:
                    found.append((first, second, meeting))
        return found


def _ahead(points: FloatArray, position: FloatArray) -> FloatArray:
    """The part of a path from where the robot is on."""
    nearest = int(np.argmin(np.linalg.norm(points - position, axis=1)))
    return np.vstack((position, points[nearest + 1 :])) if nearest + 1 < len(points) else position[None]
