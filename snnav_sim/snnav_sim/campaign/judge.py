"""One run judged against ground truth: could the target be reached, was it, and was anything hit on the way."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from snnav_core.types import FloatArray
from snnav_sim.campaign.reference import connected, planned_distance
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.report.record import RunRecord
from snnav_sim.report.separation import Separations, separations
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import RobotScene, Scene

__all__ = ["judge"]

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
    Nothing is promised to one that stands longer: who walks up to it then is counted apart (`walked_into`).
    """
    truth = GroundTruth(scene)
    metrics = compute_metrics(scene, record, truth, area=False)
    apart = separations(scene, record)
    robots = {
        robot.id: {
            "feasible": _is_feasible(scene, robot, truth),
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


def _is_feasible(scene: Scene, robot: RobotScene, truth: GroundTruth) -> bool:
    """Whether start and target lie in one component of the true area reduced by the planning distance."""
    return connected(truth.reduced_area(planned_distance(scene, robot)), robot.start, robot.target)


def _violations(
    scene: Scene, index: int, record: RunRecord, truth: GroundTruth, apart: Separations
) -> dict[str, int]:
    """Count the samples with a collision, or with less than the margin to a body, a wall or another robot's disk."""
    robot = scene.robots[index]
    rows = record.trajectory(robot.id)
    if len(rows) == 0:
        return {"collisions": 0, "margin_violations": 0, "walked_into": 0, "hit_standing": 0}
    gap = np.minimum(truth.clearance(rows[:, 1:3], rows[:, 0]), apart.at(index, rows[:, 0]))
    promised = (rows[:, 4] > 0.0) | _within_windows(robot, record, rows[:, 0])
    near, hit = gap < scene.safety_margin, gap < robot.radius
    return {
        "collisions": int(np.sum(hit & promised)),
        "margin_violations": int(np.sum(near & promised)),
        "hit_standing": int(np.sum(hit & ~promised)),
        "walked_into": int(np.sum(near & ~promised)),
    }


def _within_windows(robot: RobotScene, record: RunRecord, times: FloatArray) -> NDArray[np.bool_]:
    """Whether a certificate holds at each time [s], shape (N,)."""
    decisions = record.decisions_of(robot.id)
    if not decisions:
        return np.zeros(len(times), dtype=np.bool_)
    begins = np.array([decision.time for decision in decisions])
    ends = np.array([-math.inf if d.valid_until is None else d.valid_until for d in decisions])
    index = np.searchsorted(begins, times + _TIME, side="right") - 1
    held: NDArray[np.bool_] = (index >= 0) & (times <= ends[np.maximum(index, 0)] + _TIME)
    return held
