"""The numbers of a run in space: reached or not, clearance and separation against ground truth, tracking."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from snnav_core.types import FloatArray, StopReason
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.metrics import floored, library_versions, rounded, step_times
from snnav_sim.space_types import FlyerScene, SpaceScene
from snnav_sim.space_world import SpaceWorld

__all__ = ["compute_flight_metrics", "flight_clearances", "flight_separations"]

_SETTLED = 3.0  # [s]; tracking errors before this time since the start of the motion are those of the start


def compute_flight_metrics(scene: SpaceScene, record: FlightRecord) -> dict[str, Any]:
    """Return the content of ``metrics.json``; its keys are explained in docs/scenes-in-space.md."""
    clearances = flight_clearances(scene, record)
    separations = flight_separations(scene, record)
    return {
        "scene": scene.name,
        "seed": record.seed,
        "reason": record.reason,
        "duration": record.end,
        "robots": {
            robot.id: _robot(robot, scene, record, clearances[robot.id], separations[robot.id])
            for robot in scene.robots
        },
        "planner": step_times(record.planner_seconds),
        "fusion": step_times(record.fusion_seconds),
        "versions": {**library_versions(), **record.versions},
    }


def flight_clearances(scene: SpaceScene, record: FlightRecord) -> dict[str, FloatArray]:
    """Return the distance to the nearest true body at every row of every robot's trajectory [m]."""
    world = SpaceWorld(scene)
    rows = {robot.id: record.trajectory(robot.id) for robot in scene.robots}
    return {name: world.clearance(each[:, 1:4], each[:, 0]) for name, each in rows.items()}


def flight_separations(scene: SpaceScene, record: FlightRecord) -> dict[str, FloatArray]:
    """Return the distance from every robot's centre to the nearest sphere of another one, row by row [m].

    Between two rows both fly straight on but for 0.4 mm at usual turn rates: the nearest they come in between counts.
    """
    rows = {robot.id: record.trajectory(robot.id)[:, 1:4] for robot in scene.robots}
    least = {name: np.full(len(places), np.inf) for name, places in rows.items()}
    for one in scene.robots:
        for other in scene.robots:
            count = min(len(rows[one.id]), len(rows[other.id]))
            if one.id == other.id or count == 0:
                continue
            gap = rows[one.id][:count] - rows[other.id][:count]
            change = np.diff(gap, axis=0, append=gap[-1:])
            squared = np.maximum(np.einsum("ij,ij->i", change, change), 1e-300)
            share = np.clip(-np.einsum("ij,ij->i", gap, change) / squared, 0.0, 1.0)
            apart = np.linalg.norm(gap + share[:, None] * change, axis=1) - other.radius
            least[one.id][:count] = np.minimum(least[one.id][:count], apart)
    return least


def _robot(
    robot: FlyerScene,
    scene: SpaceScene,
    record: FlightRecord,
    clearance: FloatArray,
    separation: FloatArray,
) -> dict[str, Any]:
    rows, decisions = record.trajectory(robot.id), record.decisions_of(robot.id)
    last = decisions[-1] if decisions else None
    reason, message = "no_decision", "nothing was ever published for this robot"
    if last is not None:
        reason, message = (
            ("under_way", record.reason) if last.path is not None else (last.reason, last.message)
        )
    places = rows[:, 1:4] if len(rows) else np.array([robot.start])
    remaining = math.dist(places[-1], robot.target)
    arrival = next((d.time for d in decisions if d.reason == StopReason.ARRIVED.value), None)
    reached = reason == StopReason.ARRIVED.value and remaining <= robot.speed * scene.sampling_interval
    least_separation = float(separation.min(initial=math.inf))
    return {
        "reached": reached,
        "arrival_time": arrival if reached else None,
        "travelled_length": rounded(float(np.sum(rows[:-1, 6] * np.diff(rows[:, 0])))),
        "straight_length": rounded(math.dist(robot.start, robot.target)),
        "optimum_length": None,
        "least_clearance": floored(float(clearance.min())) if len(clearance) else None,
        "least_separation": floored(least_separation) if math.isfinite(least_separation) else None,
        "reason": reason,
        "message": message,
        "remaining_distance": rounded(remaining),
        "margin_violations": int(np.sum(clearance < scene.safety_margin)),
        "separation_violations": int(np.sum(separation < scene.safety_margin)),
        "largest_turn_rate": rounded(float(rows[:, 7].max(initial=0.0))),
        **_tracking(record, robot.id),
    }


def _tracking(record: FlightRecord, robot: str) -> dict[str, Any]:
    """Return the largest errors of the tracker: from the start, and once it has settled."""
    rows = np.array(record.errors.get(robot, [])).reshape(-1, 3)
    if len(rows) == 0:
        return {"tracking_error": None, "tracking_error_settled": None, "angle_error_settled": None}
    settled = rows[rows[:, 0] >= rows[0, 0] + _SETTLED]
    return {
        "tracking_error": rounded(float(rows[:, 1].max())),
        "tracking_error_settled": rounded(float(settled[:, 1].max())) if len(settled) else None,
        "angle_error_settled": rounded(float(np.abs(settled[:, 2]).max())) if len(settled) else None,
    }
