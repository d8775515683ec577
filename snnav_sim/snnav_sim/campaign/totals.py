"""What the runs of a campaign say together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from snnav_core.types import StopReason

__all__ = ["Record", "is_clean", "robots_of", "totals"]

Record = Mapping[str, Any]
"""One line of runs.jsonl."""

_STOPS = {reason.value for reason in StopReason}


def robots_of(records: Iterable[Record]) -> list[dict[str, Any]]:
    """Return every robot of every run."""
    return [robot for record in records for robot in record["robots"].values()]


def totals(records: Sequence[Record]) -> dict[str, Any]:
    """Return the content of ``summary.json`` but for the name of the campaign; docs/campaigns.md explains the keys."""
    robots = robots_of(records)
    feasible = [robot for robot in robots if robot["feasible"]]
    arrived = [robot for robot in feasible if robot["reached"]]
    others = [robot for robot in robots if not robot["reached"]]
    return {
        "runs": len(records),
        "failed_runs": sum(bool(record["error"]) for record in records),
        "robots": len(robots),
        "reached": sum(robot["reached"] for robot in robots),
        "feasible": len(feasible),
        "feasible_reached": len(arrived),
        "feasible_reached_share": len(arrived) / len(feasible) if feasible else None,
        "feasible_by_sight": sum(robot["feasible_by_sight"] for robot in robots),
        "feasible_by_sight_reached": sum(robot["feasible_by_sight"] and robot["reached"] for robot in robots),
        "not_reached_by_reason": dict(sorted(Counter(robot["reason"] for robot in others).items())),
        "without_typed_reason": sum(robot["reason"] not in _STOPS for robot in others),
        **{key: sum(robot[key] > 0 for robot in robots) for key in ("collisions", "margin_violations")},
        **{key: sum(robot[key] > 0 for robot in robots) for key in ("hit_standing", "walked_into")},
        "least_clearance_over_margin": _least(robots, "least_clearance"),
        "least_separation_over_margin": _least(robots, "least_separation"),
        "ratio_planned": _spread([r["optimum_ratio_planned"] for r in feasible], (50, 95, 100)),
        "ratio_safety_margin": _spread([r["optimum_ratio"] for r in feasible], (50, 95, 100)),
        "planner_p50_ms": _spread([r["planner_ms"].get("p50") for r in records], (50, 95, 100)),
        "planner_p99_ms": _spread([r["planner_ms"].get("p99") for r in records], (50, 95, 100)),
        "simulated_time": round(sum(record["duration"] or 0.0 for record in records), 1),
        "seconds": round(sum(record["seconds"] or 0.0 for record in records), 1),
    }


def is_clean(summary: Mapping[str, Any]) -> bool:
    """Whether no run failed, no robot collided, and the safety margin was kept wherever it is promised."""
    return not any(summary[key] for key in ("failed_runs", "collisions", "margin_violations"))


def _least(robots: Iterable[Mapping[str, Any]], key: str) -> float | None:
    """The least distance beyond the safety margin [m]."""
    values = [robot[key] - robot["safety_margin"] for robot in robots if robot[key] is not None]
    return round(min(values), 4) if values else None


def _spread(values: Iterable[float | None], shares: Sequence[int]) -> dict[str, float] | None:
    """Percentiles by name."""
    known = [value for value in values if value is not None]
    names = {50: "median", 100: "max"}
    if not known:
        return None
    return {names.get(s, f"p{s}"): round(float(np.percentile(known, s)), 4) for s in shares}
