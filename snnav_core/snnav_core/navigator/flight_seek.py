"""New ways for a flying robot: through a roadmap, and from cell to cell where that finds none (Ch. 4, A1-A7)."""

from __future__ import annotations

import numpy as np

from snnav_core.navigator.flight_task import FlightTask
from snnav_core.planning.adjustment import resample
from snnav_core.planning.flight_edges import NOBODY, Spheres
from snnav_core.planning.grid_search import GridSearch
from snnav_core.planning.roadmap import RoadmapSettings, build_roadmap, rough_path
from snnav_core.types import FloatArray, PathSource, PlannedPath, TimedPath

__all__ = ["can_be_reached", "in_company", "seek"]

_COMPANY = 2.5  # [m]
_PATIENCE = 8  # searches in vain after which others near by are no reason any more not to go leg by leg
_ROUNDS = 4  # kinds of questions, in turn


def seek(task: FlightTask, seed: tuple[int, int, int], failures: int) -> PlannedPath | None:
    """Look for a new path: through a roadmap, then from cell to cell.

    Parameters
    ----------
    task : FlightTask
    seed : tuple of int
        Of the samples.
    failures : int
        How often it was looked in vain just before: then for others the way is asked that goes round other robots, and
        roadmaps get denser, half of their samples where the region is narrow.
    """
    rng = np.random.default_rng(seed)
    turn = failures % _ROUNDS
    spheres = _crowd(task) if turn % 2 else NOBODY
    settings = task.settings.roadmap
    samples = settings.samples << min(failures // _ROUNDS, settings.attempts - 1)
    denser = RoadmapSettings(samples, settings.neighbours, 1, narrow=failures > 0)
    way = _through_roadmap(task, denser, task.reserves[turn // 2], spheres, rng)
    if way is not None:
        passes = task.settings.adjustment.cold_passes
        found = task.adjusted(way, PathSource.ROADMAP, passes, task.reserves[turn // 2])
        if found is not None or failures == 0:
            return found
    return _by_cells(task, spheres, failures >= _PATIENCE)


def can_be_reached(task: FlightTask) -> bool:
    """Whether any way keeps the margin, as far as cells tell, other robots left aside; looked up once in a step."""
    if task.reachable is None:
        distance = task.settings.safety_margin + task.settings.tracking_tolerance
        task.reachable = _cells(task, distance, task.state.position, NOBODY).is_connected()
    return task.reachable


def _crowd(task: FlightTask) -> Spheres:
    """All others as spheres that stay where they are."""
    if not task.others:
        return NOBODY
    places = np.array([one.path.positions_at(np.array([task.time]))[0] for one in task.others])
    radii = np.array([one.radius for one in task.others]) + task.distances.planned(task.reserves[0])
    return np.column_stack((places, radii))


def _through_roadmap(
    task: FlightTask, settings: RoadmapSettings, reserve: float, spheres: Spheres, rng: np.random.Generator
) -> FloatArray | None:
    """Points a link apart on the shortest way through a roadmap, (N, 3) [m, map]."""
    distances = task.distances
    distance = distances.planned(reserve) - 0.5 * reserve
    at_goal = float(task.area.clearance_at(task.goal[None], task.growth)[0])
    if at_goal < task.settings.safety_margin:
        task.faults.append("target")
        return None
    roadmap = build_roadmap(task.area, min(distance, at_goal), task.growth, settings, rng, spheres)
    start, prefix = task.departure()
    way = rough_path(task.area, roadmap, start, task.goal, distances.growth_per_metre, settings, spheres)
    if way is None:
        task.faults.append("no way through the roadmap")
        return None
    return resample(np.vstack((prefix, way)), distances.link)


def _by_cells(task: FlightTask, spheres: Spheres, insists: bool) -> PlannedPath | None:
    """A way from cell to cell, adjusted; where that fails, for a robot that hovers alone or insists, straight on.

    Straight on to the target, else to the first bend, to hover and turn there: for ways that no path of the speed
    holds.
    """
    distance = task.distances.planned(task.reserves[-1])
    start, prefix = task.departure()
    way = _cells(task, distance, start, spheres).way()
    if way is None:
        task.faults.append("no way from cell to cell")
        return None
    points = resample(np.vstack((prefix, way)), task.distances.link)
    found = task.adjusted(points, PathSource.SHORTEST_PATH, task.settings.adjustment.cold_passes)
    if found is not None or task.state.speed > 0.0 or (in_company(task) and not insists):
        return found
    return _straight(task, task.goal) or _straight(task, way[1])


def in_company(task: FlightTask) -> bool:
    """Whether others are near: who stops at every bend before a hole is in their way."""
    gaps = [
        float(np.linalg.norm(one.path.positions_at(np.array([task.time]))[0] - task.state.position))
        for one in task.others
    ]
    return min(gaps, default=np.inf) < _COMPANY


def _straight(task: FlightTask, end: FloatArray) -> PlannedPath | None:
    """Straight to a point, in whole links; at least one, however short."""
    link, begin = task.distances.link, task.state.position
    length = float(np.linalg.norm(end - begin))
    links = int(length / link + 1e-9)
    points = np.vstack((begin, end))
    if links > 0:
        points = begin + np.arange(links + 1)[:, None] * (link / length) * (end - begin)
    path = TimedPath(task.time, task.distances.step, points)
    return task.certified(path, PathSource.STRAIGHT_LEG, task.distances.planned(task.reserves[-1]))


def _cells(task: FlightTask, distance: float, start: FloatArray, spheres: Spheres) -> GridSearch:
    kept = min(distance, float(task.area.clearance_at(task.goal[None], task.growth)[0]))
    per_metre = task.distances.growth_per_metre
    return GridSearch(task.area, start, task.goal, kept, task.growth, per_metre, spheres)
