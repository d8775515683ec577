"""Candidates that the search is given beside its own: an earlier plan, a route, a way over a lattice."""

from __future__ import annotations

import math

import numpy as np

from snnav_core.planning.homotopy_search import Found
from snnav_core.planning.lattice import lattice_way
from snnav_core.planning.prolonging import Chain
from snnav_core.planning.spacetime_problem import SpacetimeProblem, TravelBound
from snnav_core.planning.spacetime_world import Layout
from snnav_core.types import FloatArray, TimedPath

__all__ = ["lattice_chain", "rest_of_path", "route_chain"]

_MOST_NODES = 30_000
_SPARE = 40  # points that a chain may grow by


def rest_of_path(path: TimedPath, problem: SpacetimeProblem, layout: Layout) -> Found | None:
    """What is left of an earlier path as a candidate; None if it leads elsewhere or nothing is left.

    Parameters
    ----------
    path : TimedPath
    problem : SpacetimeProblem
        Starts at any time of the path.
    layout : Layout
        Of the problem.
    """
    left = path.end_time - problem.start_time
    goes_there = math.dist(path.points[-1, :2], problem.target) <= layout.link
    if left < layout.step or not goes_there or left / layout.step + _SPARE > layout.most_points:
        return None
    times: FloatArray = problem.start_time + layout.step * np.arange(1.0, int(left / layout.step) + 1)
    points = np.vstack((problem.start.position, path.positions_at(times)[:, :2]))
    return Found(Chain.along(points, layout.link, _SPARE))


def route_chain(bound: TravelBound, problem: SpacetimeProblem, layout: Layout) -> Found | None:
    """The route of a lower bound as a candidate; None if there is none, or it is longer than any candidate.

    Parameters
    ----------
    bound : TravelBound
        For the planning distance.
    problem : SpacetimeProblem
    layout : Layout
        Of the problem.
    """
    if not math.isfinite(bound.time) or bound.time / layout.step + _SPARE > layout.most_points:
        return None
    count = max(int(bound.time / layout.step), 1)
    times: FloatArray = problem.start_time + layout.step * np.arange(count + 1.0)
    points = np.column_stack([np.interp(times, bound.route[:, 2], bound.route[:, axis]) for axis in range(2)])
    points[0] = problem.start.position
    return Found(Chain.along(points, layout.link, _SPARE))


def lattice_chain(layout: Layout, cell: float) -> Found | None:
    """A way found by a coarse search over places and times as a candidate; None if none is found.

    Parameters
    ----------
    layout : Layout
    cell : float
        See `lattice_way`.
    """
    way = lattice_way(layout.world, layout.link, cell, layout.most_points, _MOST_NODES)
    return None if way is None else Found(Chain.along(way, layout.link, _SPARE))
