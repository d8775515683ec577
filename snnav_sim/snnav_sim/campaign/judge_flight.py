"""One flight judged against ground truth: could the target be reached, was it, and was anything hit on the way."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from snnav_core.types import FloatArray
from snnav_sim.campaign.judge import since
from snnav_sim.report.coverage import measure_coverage
from snnav_sim.report.flight_metrics import (
    compute_flight_metrics,
    flight_clearances,
    flight_separations,
)
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.space_types import FlyerScene, SpaceScene

__all__ = ["judge_flight"]

_TIME = 1e-6  # [s]
_KEPT = (
    "reached",
    "reason",
    "message",
    "arrival_time",
    "travelled_length",
    "optimum_length",
    "remaining_distance",
    "least_clearance",
    "least_separation",
)
_UNKNOWN = ("optimum_ratio", "planning_distance", "optimum_length_planned", "optimum_ratio_planned")


def judge_flight(scene: SpaceScene, record: FlightRecord) -> dict[str, Any]:
    """Return the judgement of a run; docs/campaigns.md explains every key.

    Notes
    -----
    A target is feasible when start and target lie in one component of what all cameras show at first, without noise and
    robots, reduced by the margin and by what may move in the window. The margin is promised as in the plane: while a
    robot flies and within the window of its last certificate; margins between robots always.
    """
    metrics = compute_flight_metrics(scene, record)
    feasible = measure_coverage(scene).robots
    clearances, separations = flight_clearances(scene, record), flight_separations(scene, record)
    robots = {
        robot.id: {
            "feasible": feasible[robot.id] == "reachable",
            "feasible_by_sight": feasible[robot.id] == "reachable",
            "safety_margin": scene.safety_margin,
            **{key: metrics["robots"][robot.id][key] for key in _KEPT},
            **dict.fromkeys(_UNKNOWN),
            **_violations(scene, robot, record, clearances[robot.id], separations[robot.id]),
        }
        for robot in scene.robots
    }
    return {
        "reason": metrics["reason"],
        "duration": metrics["duration"],
        "robots": robots,
        "planner_ms": metrics["planner"]["step_ms"],
        "fusion_ms": metrics["fusion"]["step_ms"],
        "refused_scans": sum(count for count, _ in record.rejected.values()),
    }


def _violations(
    scene: SpaceScene,
    robot: FlyerScene,
    record: FlightRecord,
    clearance: FloatArray,
    separation: FloatArray,
) -> dict[str, int]:
    """Count the samples with a collision, or with less than the margin to a body or another robot's sphere."""
    rows = record.trajectory(robot.id)
    promised = (rows[:, 6] > 0.0) | _within_windows(robot, record, rows[:, 0])
    near, hit = clearance < scene.safety_margin, clearance < robot.radius
    too_near = since(near, promised)
    struck = hit & too_near
    return {
        "collisions": int(np.sum(struck | (separation < robot.radius))),
        "margin_violations": int(np.sum(too_near | (separation < scene.safety_margin))),
        "hit_standing": int(np.sum(hit & ~struck)),
        "walked_into": int(np.sum(near & ~too_near)),
    }


def _within_windows(robot: FlyerScene, record: FlightRecord, times: FloatArray) -> NDArray[np.bool_]:
    """Whether the margin is promised by a certificate at each time [s], shape (N,)."""
    decisions = record.decisions_of(robot.id)
    if not decisions:
        return np.zeros(len(times), dtype=np.bool_)
    begins = np.array([decision.time for decision in decisions])
    ends = np.array([-math.inf if d.valid_until is None else d.valid_until for d in decisions])
    index = np.searchsorted(begins, times + _TIME, side="right") - 1
    held: NDArray[np.bool_] = (index >= 0) & (times <= ends[np.maximum(index, 0)] + _TIME)
    return held
