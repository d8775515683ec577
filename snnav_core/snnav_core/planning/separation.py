"""The distance that a path keeps to other robots, for the certificate: exact in time, also should they stop."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, overload

import numpy as np

from snnav_core.planning.separation_kernel import outlook, separate
from snnav_core.types import FloatArray, TimedPath

__all__ = ["OtherRobot", "Traffic", "separation", "stops_within"]


@dataclass(frozen=True)
class OtherRobot:
    """Where another robot will be: it follows `path` and stays at its end; `parked` when it has no way to go."""

    id: str
    radius: float
    path: TimedPath
    parked: bool = False

    @cached_property
    def row(self) -> tuple[FloatArray, int, float, float, float, float]:
        """Points (N, 2) [m, map] and their number, start time, step [s], radius [m], and end of the motion [s]."""
        path = self.path
        end = -math.inf if path.turn_to is not None else path.end_time
        return path.points[:, :2], len(path), path.start_time, path.step, self.radius, end


class Traffic(Sequence[OtherRobot]):
    """The other robots that one robot is planned around, laid out for the compiled comparison.

    Parameters
    ----------
    others : sequence of OtherRobot
    """

    def __init__(self, others: Sequence[OtherRobot]) -> None:
        self._others = tuple(others)
        self._seen: tuple[float, float, FloatArray, FloatArray] | None = None

    @classmethod
    def of(cls, others: Sequence[OtherRobot]) -> Traffic:
        """The others as they are when they are laid out already."""
        return others if isinstance(others, Traffic) else cls(others)

    @overload
    def __getitem__(self, index: int) -> OtherRobot: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[OtherRobot]: ...
    def __getitem__(self, index: int | slice) -> OtherRobot | Sequence[OtherRobot]:
        return self._others[index]

    def __len__(self) -> int:
        return len(self._others)

    @cached_property
    def ways(self) -> tuple[Any, ...]:
        """Points of all paths (M, 2) [m, map], where those of each begin (O + 1,), start times and steps [s]."""
        return self._columns[:4]

    @property
    def radii(self) -> FloatArray:
        """Radii of the disks [m], shape (O,)."""
        radii: FloatArray = self._columns[4]
        return radii

    @property
    def ends(self) -> FloatArray:
        """When each is at the end of its path [s], shape (O,); -inf for one that turns in place."""
        ends: FloatArray = self._columns[5]
        return ends

    @cached_property
    def _columns(self) -> tuple[Any, ...]:
        rows = [other.row for other in self._others]
        points, counts, *numbers = zip(*rows, strict=True) if rows else ((), (), (), (), (), ())
        offsets = np.zeros(len(rows) + 1, dtype=np.int64)
        np.cumsum(np.array(counts, dtype=np.int64), out=offsets[1:])
        together = np.concatenate((np.zeros((0, 2)), *points))
        return together, offsets, *(np.array(values, dtype=np.float64) for values in numbers)

    def outlook(self, begin: float, end: float) -> tuple[FloatArray, FloatArray]:
        """Where the others are at one time [s], and how far from there they come up to another.

        Returns
        -------
        positions : ndarray, shape (O, 2)
            [m, map]
        reach : ndarray, shape (O,)
            [m]; 0 for those that stand.
        """
        if self._seen is None or self._seen[:2] != (begin, end):
            points, offsets, starts, steps = self.ways
            self._seen = (begin, end, *outlook(points, offsets, starts, steps, begin, end))
        return self._seen[2:]


def separation(
    path: TimedPath, others: Sequence[OtherRobot], end: float, safety_margin: float, interval: float
) -> tuple[float, float, str]:
    """Compare a path with the ways of other robots.

    Up to the next decision another robot may also stop anywhere on its way: it was stopped after this path was
    decided, its own window has ended, or its base fails.

    Parameters
    ----------
    path : TimedPath
    others : sequence of OtherRobot
        Kept as `Traffic` when many paths are compared with the same ones.
    end : float
        Time up to which to look [s].
    safety_margin : float
        From the robot centre to the disks of the others [m].
    interval : float
        Time to the next decision [s].

    Returns
    -------
    until : float
        Time up to which the margin holds [s]; inf when it holds throughout.
    least : float
        Least distance to the disk of a robot that follows its path [m]; inf without others.
    fault : str
        What fails after `until`; empty when nothing does.

    Notes
    -----
    All three are those of comparing with everybody: a robot is left out only when the distance now minus what both
    move at most shows that it fails nothing and comes no nearer than the nearest.
    """
    traffic = Traffic.of(others)
    if not traffic:
        return math.inf, math.inf, ""
    soon = min(end, path.start_time + interval)
    points, offsets, starts, steps = traffic.ways
    until, least, index, gap, limit = separate(
        np.ascontiguousarray(path.points[:, :2]),
        path.start_time,
        path.step,
        points,
        offsets,
        starts,
        steps,
        traffic.ends > path.start_time,
        traffic.radii,
        end,
        soon,
        safety_margin,
    )
    if index < 0:
        return math.inf, float(least), ""
    fault = (
        f"comes within {gap:.3f} m of robot {traffic[int(index)].id} after "
        f"{until - path.start_time:.2f} s, margin {limit:.3f} m"
    )
    return float(until), float(least), fault


def stops_within(path: TimedPath, start: float, end: float) -> Iterator[TimedPath]:
    """The ways of a robot that stops on its path at once, or at one of its points before `end` [s]."""
    if start >= path.end_time or path.turn_to is not None:
        return
    yield TimedPath(start, path.step, _positions(path, start))
    first = math.floor((start - path.start_time) / path.step + 1e-9) + 1
    last = math.ceil((end - path.start_time) / path.step - 1e-9)
    for count in range(max(first, 1) + 1, min(last, len(path) - 1) + 1):
        yield TimedPath(path.start_time, path.step, path.points[:count])


def _positions(path: TimedPath, time: float) -> FloatArray:
    return path.positions_at(np.array([time]))[:, :2]
