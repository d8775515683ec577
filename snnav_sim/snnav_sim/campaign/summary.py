"""The outcome of a campaign as files: every robot as a row, the totals, and a page to look at."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from snnav_sim.campaign.ledger import Campaign
from snnav_sim.campaign.page import page
from snnav_sim.campaign.run import write_whole
from snnav_sim.campaign.totals import Record, totals

__all__ = ["CSV_COLUMNS", "TIME_COLUMNS", "write_summary"]

_RUN = ("kind", "seed")
_ROBOT = (
    "feasible",
    "feasible_by_sight",
    "reached",
    "reason",
    "arrival_time",
    "travelled_length",
    "optimum_length_planned",
    "optimum_ratio_planned",
    "planning_distance",
    "optimum_length",
    "optimum_ratio",
    "safety_margin",
    "least_clearance",
    "least_separation",
    "collisions",
    "margin_violations",
    "hit_standing",
    "walked_into",
    "remaining_distance",
    "message",
)
_WHOLE = ("duration", "refused_scans", "paths_sha1", "error")
TIME_COLUMNS = (
    "planner_p50_ms",
    "planner_p99_ms",
    "planner_max_ms",
    "fusion_p50_ms",
    "fusion_p99_ms",
    "seconds",
)
"""Columns that depend on the machine."""
CSV_COLUMNS = (*_RUN, "robot", *_ROBOT, "run_reason", *_WHOLE, *TIME_COLUMNS)
"""Columns of ``runs.csv``."""


def write_summary(directory: Path, campaign: Campaign, records: Sequence[Record]) -> dict[str, Any]:
    """Write ``runs.csv``, ``summary.json`` and ``index.html``, each whole, and return the totals."""
    file = io.StringIO(newline="")
    writer = csv.DictWriter(file, CSV_COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(row for record in records for row in _rows(record))
    write_whole(directory / "runs.csv", file.getvalue().encode("utf-8"))
    summary = {"kind": campaign.kind, "seed": campaign.seed, **totals(records)}
    text = json.dumps(summary, indent=2, allow_nan=False, ensure_ascii=False)
    write_whole(directory / "summary.json", (text + "\n").encode("utf-8"))
    write_whole(directory / "index.html", page(directory, summary, records).encode("utf-8"))
    return summary


def _rows(record: Record) -> Iterator[dict[str, Any]]:
    """One row for every robot; one without a robot for a run that failed."""
    steps = {
        f"{name}_{share}_ms": record[f"{name}_ms"].get(share)
        for name, share in (
            ("planner", "p50"),
            ("planner", "p99"),
            ("planner", "max"),
            ("fusion", "p50"),
            ("fusion", "p99"),
        )
    }
    whole = {
        **{key: record[key] for key in (*_RUN, *_WHOLE, "seconds")},
        "run_reason": record["reason"],
        **steps,
    }
    for name, robot in record["robots"].items():
        yield {**whole, "robot": name, **{key: robot[key] for key in _ROBOT}}
    if not record["robots"]:
        yield whole
