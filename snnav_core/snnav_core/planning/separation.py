"""The distance that a path keeps to other robots, for the certificate: exact in time, also should they stop."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from snnav_core.types import FloatArray, TimedPath

__all__ = ["OtherRobot", "separation", "stops_within"]


@dataclass(frozen=True)
class OtherRobot:
    """Where another robot will be: it follows `path` and stays at its end; `parked` when it has no way to go."""

    id: str
    radius: float
    path: TimedPath
    parked: bool = False


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
    """
    until, least, fault = math.inf, math.inf, ""
    soon = min(end, path.start_time + interval)
    for other in others:
        times, distances = _approach(path, other.path, end)
        least = min(least, float(distances.min()) - other.radius)
        present = float(np.linalg.norm(_positions(other.path, path.start_time)[0] - path.points[0, :2]))
        # Robots that stand too near already may only part.
        limit = min(safety_margin, present - other.radius)
        ways = [(times, distances)]
        ways += [
            _approach(path, stopped, soon) for stopped in stops_within(other.path, path.start_time, soon)
        ]
        for begins, gaps in ways:
            failing = np.flatnonzero(gaps - other.radius < limit - 1e-9)
            if len(failing) and begins[failing[0]] < until:
                until = float(begins[failing[0]])
                fault = (
                    f"comes within {gaps[failing[0]] - other.radius:.3f} m of robot {other.id} after "
                    f"{until - path.start_time:.2f} s, margin {limit:.3f} m"
                )
    return until, least, fault


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


def _approach(first: TimedPath, second: TimedPath, end: float) -> tuple[FloatArray, FloatArray]:
    """Least distance of two moving points in every interval on which both move uniformly.

    Returns the start times of the intervals [s] and the least distances [m] in them, exact for linear motion.
    """
    start = first.start_time
    knots = np.concatenate(
        (
            np.array([start, end]),
            first.start_time + np.arange(len(first)) * first.step,
            second.start_time + np.arange(len(second)) * second.step,
        )
    )
    knots = np.unique(knots[(knots >= start) & (knots <= end)])
    relative = first.positions_at(knots)[:, :2] - second.positions_at(knots)[:, :2]
    begin, change = relative[:-1], np.diff(relative, axis=0)
    squared = np.einsum("ij,ij->i", change, change)
    share = np.clip(-np.einsum("ij,ij->i", begin, change) / np.maximum(squared, 1e-300), 0.0, 1.0)
    return knots[:-1], np.linalg.norm(begin + share[:, None] * change, axis=1)
