"""The numbers of a flight through recorded free space, where nobody knows the truth but what was measured."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from snnav_core.area.spatial import SpatialArea
from snnav_core.types import FloatArray, StopReason
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.metrics import floored, library_versions, rounded, step_times
from snnav_sim.space_types import SpaceScene

__all__ = ["recorded_clearances", "recorded_flight_metrics"]

_FEW = 20_000
_PARTS = 8  # pieces of the way from row to row; half of one is taken off


def recorded_clearances(
    rows: FloatArray, area: SpatialArea, hits: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return how near a flight comes to what is not known to be free, and to the nearest hit.

    Parameters
    ----------
    rows : ndarray, shape (N, >= 4)
        Of a trajectory: time, x, y, z, ... [s; m, map].
    area : SpatialArea
    hits : ndarray, shape (M, 3)
        [m, map]

    Returns
    -------
    to_region, to_hits : ndarray, shape (N,)
        [m]; lower bounds along the way to the next row, not only at the row.
    """
    rows = np.vstack((rows, rows[-1:]))  # nothing is flown after the last one
    shares = np.arange(_PARTS + 1) / _PARTS
    places = rows[:-1, None, 1:4] + shares[:, None] * np.diff(rows[:, 1:4], axis=0)[:, None]
    step = np.linalg.norm(places[:, 1] - places[:, 0], axis=1)
    found = []
    for measure in (area.clearance_at, lambda points: _to_hits(points, hits)):
        least = np.asarray(measure(places.reshape(-1, 3))).reshape(-1, _PARTS + 1).min(axis=1)
        found.append(least - 0.5 * step)
    return found[0], found[1]


def _to_hits(places: FloatArray, hits: FloatArray) -> FloatArray:
    """Return the distance from places (N, 3) to the nearest of many hits (M, 3), exactly."""
    if len(hits) == 0:
        return np.full(len(places), np.inf)
    some = hits[:: max(1, len(hits) // _FEW)]
    enough = float(cKDTree(some).query(places)[0].max())  # none of the nearest hits is farther
    low, high = places.min(axis=0) - enough, places.max(axis=0) + enough
    near = hits[((hits >= low) & (hits <= high)).all(axis=1)]
    distance: FloatArray = cKDTree(near).query(places)[0]
    return distance


def recorded_flight_metrics(
    scene: SpaceScene, record: FlightRecord, area: SpatialArea, hits: FloatArray
) -> dict[str, Any]:
    """Return the numbers of the first robot of a scene; docs/real-depth.md explains the keys."""
    robot = scene.robots[0]
    rows = record.trajectory(robot.id)
    to_region, to_hits = recorded_clearances(rows, area, hits)
    last = record.decisions_of(robot.id)[-1]
    flown = [decision for decision in record.decisions_of(robot.id) if decision.path is not None]
    certified = [one.least_clearance for one in flown if one.least_clearance is not None]
    errors = np.array(record.errors.get(robot.id, [])).reshape(-1, 3)
    moving = rows[:, 6] > 0.0
    return {
        "start": list(robot.start),
        "target": list(robot.target),
        "reached": last.reason == StopReason.ARRIVED.value,
        "reason": last.message or record.reason,
        "duration": record.end,
        "straight_length": rounded(math.dist(robot.start, robot.target)),
        "travelled_length": rounded(float(np.sum(rows[:-1, 6] * np.diff(rows[:, 0])))),
        "paths": len(flown),
        "least_certified_clearance": floored(min(certified)) if certified else None,
        "least_clearance": floored(float(to_region[moving].min())) if moving.any() else None,
        "nearest_hit": floored(float(to_hits[moving].min())) if moving.any() else None,
        "margin_violations": int(np.sum(np.minimum(to_region, to_hits)[moving] < scene.safety_margin)),
        "tracking_error": rounded(float(errors[:, 1].max(initial=0.0))),
        "planner": step_times(record.planner_seconds),
        "versions": library_versions(),
    }
