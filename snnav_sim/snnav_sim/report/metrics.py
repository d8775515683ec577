"""The numbers of a run: reached or not, lengths against the optimum, clearance and separation against ground truth."""

from __future__ import annotations

import math
import platform
from collections import Counter
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import shapely

import snnav_core
import snnav_sim
from snnav_core.errors import PlanningError
from snnav_core.planning.spacetime_problem import SpacetimePlan
from snnav_core.types import PathSource, StopReason
from snnav_sim.report.optimum import shortest_path
from snnav_sim.report.record import Decision, RunRecord
from snnav_sim.report.separation import separations
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import RobotScene, Scene

__all__ = ["compute_metrics", "floored", "library_versions", "rounded", "step_times"]

_LIBRARIES = ("numpy", "scipy", "shapely", "numba")
_HAIR = 1e-6  # [m]


def compute_metrics(
    scene: Scene, record: RunRecord, truth: GroundTruth | None = None, area: bool = True
) -> dict[str, Any]:
    """Return the content of ``metrics.json``; its keys are explained in docs/scene-format.md.

    Parameters
    ----------
    scene : Scene
    record : RunRecord
    truth : GroundTruth, optional
        Of the same scene, when it is at hand.
    area : bool
        Whether to measure the distance to the boundary of the true unoccupied area, which takes long among movers.
        Never with the global planner: it heeds bodies.
    """
    truth = truth or GroundTruth(scene)
    area = area and not scene.plans_globally
    apart = separations(scene, record).least.min(axis=1, initial=math.inf)
    return {
        "scene": scene.name,
        "seed": record.seed,
        "reason": record.reason,
        "duration": _duration(record),
        "robots": {
            robot.id: _robot(robot, scene, record, truth, area, least)
            for robot, least in zip(scene.robots, apart.tolist(), strict=True)
        },
        "planner": {**step_times(record.planner_seconds), **_planning(scene, record)},
        "fusion": step_times(record.fusion_seconds),
        "versions": {**library_versions(), **record.versions},
    }


def _planning(scene: Scene, record: RunRecord) -> dict[str, Any]:
    """Return how long the steps took in which the global planner made plans, and how many it made."""
    if not scene.plans_globally:
        return {}
    seconds = record.planner_seconds
    steps = {round(time / scene.sampling_interval) for time, _ in record.plans}
    took = [1e3 * seconds[step] for step in sorted(steps) if step < len(seconds)]
    return {"plans": len(record.plans), "planning_ms": [rounded(each) for each in took]}


def _plans(scene: Scene, record: RunRecord, robot: str) -> dict[str, Any]:
    """Return what is to be said of the plans of one robot, in order."""
    if not scene.plans_globally:
        return {}
    return {"plans": [_plan(time, plan) for time, plan in record.plans_of(robot)]}


def _plan(time: float, plan: SpacetimePlan) -> dict[str, Any]:
    bound = None if plan.bound is None or not math.isfinite(plan.bound.time) else plan.bound.time
    outcomes = Counter(candidate.outcome.value for candidate in plan.candidates)
    return {
        "time": time,
        "travel_time": rounded(plan.travel_time),
        "candidates": dict(sorted(outcomes.items())),
        "bound": rounded(bound),
        "gap": None if bound is None else round(plan.gap, 5),
    }


def _duration(record: RunRecord) -> float | None:
    ends = [rows[-1][0] for rows in record.samples.values() if rows]
    return max(ends) if ends else None


def step_times(seconds: Sequence[float]) -> dict[str, Any]:
    """Return percentiles of the steps without the first one, which loads compiled code, unless it is the only one."""
    milliseconds = 1e3 * np.asarray(seconds[1:] or seconds, dtype=np.float64)
    names = {"p50": 50, "p99": 99, "max": 100}
    steps = {
        name: rounded(float(np.percentile(milliseconds, share))) if len(milliseconds) else None
        for name, share in names.items()
    }
    return {
        "step_ms": steps,
        "first_step_ms": rounded(1e3 * seconds[0]) if seconds else None,
        "steps": len(seconds),
    }


def library_versions() -> dict[str, str]:
    """Return the versions of snnav, Python and the numerical libraries."""
    versions = {
        "snnav_core": snnav_core.__version__,
        "snnav_sim": snnav_sim.__version__,
        "python": platform.python_version(),
    }
    for library in _LIBRARIES:
        try:
            versions[library] = version(library)
        except PackageNotFoundError:  # a system package may come without metadata
            continue
    return versions


def _robot(
    robot: RobotScene,
    scene: Scene,
    record: RunRecord,
    truth: GroundTruth,
    area: bool,
    separation: float,
) -> dict[str, Any]:
    rows = record.trajectory(robot.id)
    decisions = record.decisions_of(robot.id)
    reason, message = _reason(robot, scene, record, decisions)
    target = robot.target_at(decisions[-1].time if decisions else 0.0)
    arrivals = [d.time for d in decisions if d.reason == StopReason.ARRIVED.value]
    arrival = next((time for time in arrivals if robot.target_at(time) == target), None)
    if len(rows) == 0:
        rows = np.array([[0.0, *robot.start, robot.heading, 0.0, 0.0]])
    points, times = rows[:, 1:3], rows[:, 0]
    clearance = truth.clearance(points, times)
    area_clearance = truth.area_clearance(points, times)[0] if area else None
    remaining = math.dist(points[-1], target)
    reached = reason == StopReason.ARRIVED.value and remaining <= robot.speed * scene.sampling_interval
    travelled = float(np.sum(rows[:-1, 4] * np.diff(times)))
    return {
        "reached": reached,
        "arrival_time": arrival if reached else None,
        "travelled_length": rounded(travelled),
        **_optima(robot, scene, decisions, truth, travelled + remaining if reached else None),
        "least_clearance": floored(float(clearance.min())),
        "least_separation": floored(separation) if math.isfinite(separation) else None,
        "reason": reason,
        "message": message,
        "remaining_distance": rounded(remaining),
        "least_area_clearance": None if area_clearance is None else floored(float(area_clearance.min())),
        "margin_violations": int(np.sum(clearance < scene.safety_margin)),
        "area_margin_violations": None
        if area_clearance is None
        else int(np.sum(area_clearance < scene.safety_margin)),
        "largest_turn_rate": float(np.abs(rows[:, 5]).max()),
        **_plans(scene, record, robot.id),
    }


def _reason(
    robot: RobotScene, scene: Scene, record: RunRecord, decisions: Sequence[Decision]
) -> tuple[str, str]:
    """Return the reason of the last stop and its message; for a robot still under way why it or the run ended."""
    end = _duration(record) or 0.0
    if not decisions and scene.instant(robot.joins_at) > end:
        return "not_joined", f"the run ended before {robot.joins_at:g} s: {record.reason}"
    if not decisions:
        return "no_decision", "nothing was ever published for this robot"
    last = next((d for d in reversed(decisions) if d.source != PathSource.EVASION.value), decisions[-1])
    if last.path is None:  # one that has only made room since is not under way
        return last.reason, last.message
    if not scene.is_present(robot, end + scene.control_period):
        return "left", f"left the workspace at {scene.instant(robot.leaves_at):g} s"
    return "under_way", record.reason


def _optima(
    robot: RobotScene, scene: Scene, decisions: Sequence[Decision], truth: GroundTruth, length: float | None
) -> dict[str, Any]:
    """Return shortest paths at the safety margin and at the least distance that a path was planned for.

    Where start or target is nearer to the boundary than a path was planned for, the second is taken at their distance.
    """
    distances = [d.planning_distance for d in decisions if d.planning_distance is not None]
    planned = min(distances) if distances else None
    several = bool(robot.retargets)  # then there is no one shortest path
    optimum = None if several else _optimum(robot, truth, scene.safety_margin)
    ends = shapely.points([robot.start, robot.target])
    nearest = float(shapely.distance(ends, shapely.boundary(truth.area)).min()) - _HAIR
    optimum_planned = None if planned is None or several else _optimum(robot, truth, min(planned, nearest))

    def ratio(best: float | None) -> float | None:
        return None if not best or length is None else round(length / best, 5)

    return {
        "optimum_length": rounded(optimum),
        "optimum_ratio": ratio(optimum),
        "planning_distance": rounded(planned),
        "optimum_length_planned": rounded(optimum_planned),
        "optimum_ratio_planned": ratio(optimum_planned),
    }


def _optimum(robot: RobotScene, truth: GroundTruth, distance: float) -> float | None:
    try:
        return shortest_path(truth.reduced_area(distance), robot.start, robot.target)[0]
    except PlanningError:
        return None


def rounded(value: float | None) -> float | None:
    """Round to a tenth of a millimetre, or of whatever it is."""
    return None if value is None else round(value, 4)


def floored(value: float) -> float:
    """Round down to a tenth of a millimetre: no margin is kept by rounding."""
    return math.floor(value * 1e4) / 1e4
