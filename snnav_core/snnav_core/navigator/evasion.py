"""Out of the way of what comes nearer, while there is no safe way to the target (beyond the thesis)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import shapely

from snnav_core.errors import PlanningError
from snnav_core.navigator.attempt import Attempt
from snnav_core.navigator.context import Disks
from snnav_core.navigator.plans import best_profile, better, turn_and_leg
from snnav_core.navigator.search import find_route, route_candidates
from snnav_core.types import FloatArray, PathSource, PlannedPath

__all__ = ["closes", "evade", "may_stand", "towards"]

_MOVES = 0.25  # share of what a boundary can move in an interval that counts as coming nearer ...
_NOISE = 0.03  # ... and at least this [m]: noise of the scanners moves it as well
_DEEPER = (1.0, 1.5)  # refuges are sought where so many times the demanded distance is kept
_REFUGES = 4
_CANDIDATES = 2  # for each refuge


def may_stand(attempt: Attempt) -> bool:
    """Whether the robot keeps the margin for the whole window where it stands, whatever the boundary does."""
    if attempt.settings.boundary_speed == 0.0:
        return True
    return attempt.context.clearance(attempt.pose.position) >= _demanded(attempt)


def closes(attempt: Attempt, plan: PlannedPath) -> bool:
    """Whether the boundary has come nearer to a path within its window since the step before."""
    settings = attempt.settings
    if attempt.previous is None or settings.boundary_speed == 0.0:
        return False
    points = np.asarray(plan.path.points)[: attempt.distances.window_points + 1]
    lost = attempt.previous.area.clearance(points) - attempt.context.area.clearance(points)
    reach = settings.boundary_speed * settings.sampling_interval
    return bool(lost.max() > max(_NOISE, _MOVES * reach))


def evade(attempt: Attempt, disks: Disks) -> PlannedPath | None:
    """A certified path to a place where the robot may stand for a whole window; None without any.

    Parameters
    ----------
    attempt : Attempt
    disks : Disks
        Of standing robots.

    Notes
    -----
    Ch. 3 promises nothing beyond the window. A robot that stops where something may come nearer loses its margin; here
    it makes room in time.
    """
    best: PlannedPath | None = None
    for refuge in _refuges(attempt, disks):
        plan = towards(attempt, refuge, disks)
        best = better(best, plan)
        if plan is not None and attempt.is_whole(plan):
            return plan
    return best


def _demanded(attempt: Attempt) -> float:
    return float(attempt.distances.demanded()[-1])


def _refuges(attempt: Attempt, disks: Disks) -> list[FloatArray]:
    """Points near the robot that keep the distance demanded at the end of the window, nearest first."""
    here = shapely.points(attempt.pose.position)
    found: list[tuple[float, FloatArray]] = []
    for factor in _DEEPER:
        for part in shapely.get_parts(attempt.context.region(factor * _demanded(attempt), disks)):
            line = shapely.shortest_line(part, here)
            found.append((float(shapely.length(line)), np.asarray(shapely.get_coordinates(line)[0])))
    return [point for _, point in sorted(found, key=lambda entry: entry[0])[:_REFUGES]]


def towards(attempt: Attempt, refuge: FloatArray, disks: Disks) -> PlannedPath | None:
    """The best certified path to a place, or a turn towards it; None without any."""
    try:
        route = find_route(
            attempt.context,
            attempt.robot,
            attempt.pose,
            refuge,
            attempt.distances,
            attempt.settings,
            disks,
        )
    except PlanningError:
        return None
    attempt = replace(attempt, target=route.target, planning_distance=route.distance)
    best: PlannedPath | None = None
    candidates = route_candidates(attempt.context, route, attempt.pose, attempt.distances, attempt.settings)
    for candidate in candidates[:_CANDIDATES]:
        plan = best_profile(attempt, candidate.polyline, candidate.rotation, PathSource.EVASION)
        best = better(best, plan)
        if attempt.is_whole(plan):
            return plan
    if attempt.robot.can_turn_in_place:
        best = better(best, turn_and_leg(attempt, route))
    return best
