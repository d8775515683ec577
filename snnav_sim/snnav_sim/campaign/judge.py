"""One run judged against ground truth: could the target be reached, was it, and was anything hit on the way."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from snnav_core.types import FloatArray
from snnav_sim.campaign.reference import connected, planned_distance, seen_area
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.report.optimum import reduced
from snnav_sim.report.record import Decision, RunRecord
from snnav_sim.report.separation import Separations, separations
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import RobotScene, Scene

__all__ = ["judge", "since"]

Flags = NDArray[np.bool_]

_TIME = 1e-6  # [s]
_KEPT = (
    "reached",
    "reason",
    "message",
    "arrival_time",
    "travelled_length",
    "optimum_length",
    "optimum_ratio",
    "planning_distance",
    "optimum_length_planned",
    "optimum_ratio_planned",
    "remaining_distance",
    "least_clearance",
    "least_separation",
)


def judge(scene: Scene, record: RunRecord) -> dict[str, Any]:
    """Return the judgement of a run; docs/campaigns.md explains every key.

    Notes
    -----
    A robot is *promised* its margin while it drives, and while it stands within the window of its last certificate.
    Nothing is promised to one that stands longer. A body that walks up to it then is counted apart (`walked_into`),
    until it has its margin back. Margins between robots are always promised.
    """
    truth, seen = GroundTruth(scene), seen_area(scene)
    metrics = compute_metrics(scene, record, truth, area=False)
    apart = separations(scene, record)
    robots = {
        robot.id: {
            **_feasibility(scene, robot, truth, seen),
            "safety_margin": scene.safety_margin,
            **{key: metrics["robots"][robot.id][key] for key in _KEPT},
            **_violations(scene, index, record, truth, apart),
        }
        for index, robot in enumerate(scene.robots)
    }
    return {
        "reason": metrics["reason"],
        "duration": metrics["duration"],
        "robots": robots,
        "planner_ms": metrics["planner"]["step_ms"],
        "fusion_ms": metrics["fusion"]["step_ms"],
        "refused_scans": sum(count for count, _ in record.rejected.values()),
    }


def _feasibility(scene: Scene, robot: RobotScene, truth: GroundTruth, seen: BaseGeometry) -> dict[str, bool]:
    """Whether start and target lie in one component of the area reduced by the planning distance.

    Of what noise-free scans show, and of what is truly visible.
    """
    distance = planned_distance(scene, robot)
    return {
        "feasible": connected(reduced(seen, distance), robot.start, robot.target),
        "feasible_by_sight": connected(truth.reduced_area(distance), robot.start, robot.target),
    }


def _violations(
    scene: Scene, index: int, record: RunRecord, truth: GroundTruth, apart: Separations
) -> dict[str, int]:
    """Count the samples with a collision, or with less than the margin to a body, a wall or another robot's disk."""
    robot = scene.robots[index]
    rows = record.trajectory(robot.id)
    if len(rows) == 0:
        return {"collisions": 0, "margin_violations": 0, "hit_standing": 0, "walked_into": 0}
    times = rows[:, 0]
    clearance, separation = truth.clearance(rows[:, 1:3], times), apart.at(index, times)
    driving = rows[:, 4] > 0.0
    near, hit = clearance < scene.safety_margin, clearance < robot.radius
    too_near = since(near, driving | _within_windows(scene, robot, record, times))
    struck = hit & (too_near | since(hit, driving))
    return {
        "collisions": int(np.sum(struck | (separation < robot.radius))),
        "margin_violations": int(np.sum(too_near | (separation < scene.safety_margin))),
        "hit_standing": int(np.sum(hit & ~struck)),
        "walked_into": int(np.sum(near & ~too_near)),
    }


def since(episodes: Flags, cause: Flags) -> Flags:
    """The rows of all episodes (runs of true values) whose first row has a cause, shape (N,)."""
    first = episodes & ~np.concatenate(([False], episodes[:-1]))
    begins = np.append(np.flatnonzero(first), 0)
    caused: Flags = episodes & cause[begins[np.maximum(np.cumsum(first) - 1, 0)]]
    return caused


def _within_windows(scene: Scene, robot: RobotScene, record: RunRecord, times: FloatArray) -> Flags:
    """Whether the margin is promised by a certificate at each time [s], shape (N,).

    A robot that turns in place after it has lost its margin, or is about to, gets certificates that promise no more
    than that it is as safe as standing: they count for as long as the margin holds whatever the boundary does.
    """
    decisions = record.decisions_of(robot.id)
    if not decisions:
        return np.zeros(len(times), dtype=np.bool_)
    begins = np.array([decision.time for decision in decisions])
    ends = np.array([_promised_until(decision, scene) for decision in decisions])
    index = np.searchsorted(begins, times + _TIME, side="right") - 1
    held: Flags = (index >= 0) & (times <= ends[np.maximum(index, 0)] + _TIME)
    return held


def _promised_until(decision: Decision, scene: Scene) -> float:
    if decision.path is None or decision.valid_until is None:
        return -math.inf
    if decision.path.turn_to is None or decision.least_clearance is None or scene.boundary_speed == 0.0:
        return decision.valid_until
    lasting = (decision.least_clearance - scene.safety_margin) / scene.boundary_speed
    return min(decision.valid_until, decision.time + lasting)
