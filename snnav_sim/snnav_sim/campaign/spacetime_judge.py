"""A plan of the global planner judged against ground truth: margin, length, and how much could be gained."""

from __future__ import annotations

import math
import time as clock
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.errors import PlanningError
from snnav_core.obstacles import MovingObstacle
from snnav_core.planning.spacetime import plan_in_spacetime
from snnav_core.planning.spacetime_problem import SpacetimePlan, SpacetimeProblem
from snnav_core.planning.travel_bound import travel_bound
from snnav_core.planning.workspace import workspace_region
from snnav_core.types import FloatArray, TimedPath
from snnav_sim.campaign.spacetime_cases import SpacetimeCase

__all__ = ["Judgement", "judge_case", "true_clearance"]

_STEP = 0.05  # [s]
_FINE = 1e-4  # [m]


@dataclass(frozen=True)
class Judgement:
    """What came of one problem.

    Parameters
    ----------
    feasible : bool
        Whether a point that waits and turns as it likes gets to the target with the margin.
    reason : str
        Why there is no plan; empty when there is one.
    gap : float
        Travel time above its lower bound, as a share of it; NaN without a plan. Of travel time and length over speed
        the larger one counts.
    too_fast : bool
        Whether the plan is faster than any that keeps the safety margin can be: there is no such plan.
    clearance : float
        Least distance from bodies and workspace at every 0.05 s [m]; infinite without a plan.
    clearance_between : float
        The same at all times: not more than it is, by 0.1 mm at most [m].
    candidates : int
        Number of candidates of the plan.
    seconds : float
        Processor time of the planner [s].
    """

    feasible: bool
    reason: str
    gap: float = math.nan
    too_fast: bool = False
    clearance: float = math.inf
    clearance_between: float = math.inf
    candidates: int = 0
    seconds: float = 0.0


def judge_case(case: SpacetimeCase, seed: int = 0) -> Judgement:
    """Plan, and judge the plan.

    Notes
    -----
    Without motion the bound is the shortest path of the visibility graph of the same margin, and the gap is the length
    of the path above it.
    """
    problem = case.problem
    bound = travel_bound(problem, case.margin)
    feasible = math.isfinite(bound.time)
    begin = clock.process_time()
    try:
        plan: SpacetimePlan = plan_in_spacetime(problem, case.settings, np.random.default_rng(seed))
    except PlanningError as error:
        spent = clock.process_time() - begin
        return Judgement(feasible, f"{type(error).__name__}: {error}", seconds=spent)
    spent = clock.process_time() - begin
    sampled, least = true_clearance(problem, plan.path)
    gap = max(plan.travel_time, plan.path.length / problem.robot.speed) / bound.time - 1.0
    # A robot that follows at its speed is behind by the tolerance at most, and keeps the safety margin.
    behind = case.settings.tracking_tolerance / problem.robot.speed
    too_fast = plan.travel_time < travel_bound(problem, case.settings.safety_margin).time - behind - 1e-6
    return Judgement(feasible, "", gap, too_fast, sampled, least, len(plan.candidates), spent)


def true_clearance(problem: SpacetimeProblem, path: TimedPath) -> tuple[float, float]:
    """Least distance of a path from bodies and workspace [m]: at every 0.05 s, and at all times.

    The latter by halving every stretch of time in which the distance, at the speed at which it can change, could be
    less than what was found already by more than 0.1 mm, which are taken off in the end.
    """
    count = max(2, math.ceil((path.end_time - path.start_time) / _STEP - 1e-9) + 1)
    times = np.linspace(path.start_time, path.end_time, count)
    links = np.linalg.norm(np.diff(path.points[:, :2], axis=0), axis=1)
    speed = float(links.max(initial=0.0)) / path.step
    sampled = least = math.inf
    shapes: list[tuple[BaseGeometry, MovingObstacle | None]] = [
        (_shape(body), body) for body in problem.obstacles
    ]
    if problem.workspace is not None:
        shapes.append((workspace_region(problem.workspace).boundary, None))
    for shape, body in shapes:
        closing = speed + (0.0 if body is None else body.speed)
        values = _distances(path, shape, body, times)
        sampled = min(sampled, float(values.min()))
        least = min(least, _lower(path, shape, body, times, values, closing))
    return sampled, least


def _shape(body: MovingObstacle) -> BaseGeometry:
    few = len(body.outline) < 3
    return shapely.MultiPoint(body.outline).convex_hull if few else shapely.Polygon(body.outline)


def _distances(
    path: TimedPath, shape: BaseGeometry, body: MovingObstacle | None, times: FloatArray
) -> FloatArray:
    places = path.positions_at(times)[:, :2]
    if body is not None:
        places = places - body.velocity * (times - body.stamp)[:, None]
    distances: FloatArray = shapely.distance(shapely.points(places), shape)
    return distances if body is None else distances - body.radius


def _lower(
    path: TimedPath,
    shape: BaseGeometry,
    body: MovingObstacle | None,
    times: FloatArray,
    values: FloatArray,
    closing: float,
) -> float:
    """Least distance at all times, not more than it is [m]."""
    begins, ends, first, last = times[:-1], times[1:], values[:-1], values[1:]
    best = float(values.min())
    while True:
        could = 0.5 * (first + last - closing * (ends - begins))
        open_ = could < best - _FINE
        if not open_.any():
            return best - _FINE
        begins, ends, first, last = begins[open_], ends[open_], first[open_], last[open_]
        middle = 0.5 * (begins + ends)
        between = _distances(path, shape, body, middle)
        best = min(best, float(between.min()))
        begins, ends = np.concatenate((begins, middle)), np.concatenate((middle, ends))
        first, last = np.concatenate((first, between)), np.concatenate((between, last))
