"""What a replay came to: its numbers, its directory, its table."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from snnav_ros.bag.files import make_directory
from snnav_ros.bag.live_replay import ReplayRecord, ReplayRobot
from snnav_ros.bag.recorded_scans import Recording
from snnav_ros.bag.replay_judge import Encounter, Outrun, Verdict
from snnav_ros.bag.settings import ReplaySettings
from snnav_sim.report.metrics import library_versions, step_times
from snnav_sim.report.write import write_tables

__all__ = ["MARK", "replay_metrics", "replay_table", "write_replay"]

MARK = "replay.json"
"""The file by which the directory of a replay is known."""


def replay_metrics(
    recording: Recording,
    robots: Sequence[ReplayRobot],
    record: ReplayRecord,
    verdicts: Mapping[str, Verdict],
    outrun: Outrun,
    settings: ReplaySettings,
) -> dict[str, Any]:
    """Return the content of ``metrics.json``; docs/real-logs.md explains its keys."""
    scans = Counter(scan.sensor_id for scan in recording.scans)
    return {
        "scene": recording.path.stem,
        "reason": record.run.reason,
        "duration": max(float(verdict.times[-1]) for verdict in verdicts.values()),
        "robots": {
            robot.spec.id: _robot(robot, robots, record, verdicts[robot.spec.id], settings)
            for robot in robots
        },
        "scans": dict(scans),
        "refused_scans": {name: len(lines) for name, lines in record.refused.items()},
        "outrun": {"returns": outrun.count, "share": outrun.share, "deepest": _rounded(outrun.deepest)},
        "planner": step_times(record.run.planner_seconds),
        "fusion": step_times(record.run.fusion_seconds),
        "versions": library_versions(),
    }


def write_replay(
    directory: Path,
    sensors_file: Path,
    metrics: Mapping[str, Any],
    record: ReplayRecord,
    how: Mapping[str, Any],
    draw: Any = None,
) -> None:
    """Write the directory of a replay, whole or not at all; an earlier replay there is replaced.

    Parameters
    ----------
    directory, sensors_file : Path
    metrics : mapping
        From `replay_metrics`.
    record : ReplayRecord
    how : mapping
        Bag, robots and settings, for ``replay.json``.
    draw : callable, optional
        Draws into the directory that it is given.
    """

    def fill(draft: Path) -> None:
        _dump(draft / MARK, how)
        _dump(draft / "metrics.json", metrics)
        write_tables(draft, record.run)
        (draft / f"sensors{sensors_file.suffix or '.yaml'}").write_bytes(sensors_file.read_bytes())
        (draft / "figures").mkdir()
        if draw is not None:
            draw(draft / "figures")

    make_directory(directory, MARK, fill)


def replay_table(metrics: Mapping[str, Any], settings: ReplaySettings) -> RenderableType:
    """Return a renderable for `rich`: one row per robot, and below what matters of the recording."""
    table = Table(title=metrics["scene"], title_justify="left", title_style="bold", box=box.SIMPLE_HEAD)
    table.add_column("robot")
    for name in ("arrivals", "first\ns", "driven\nm", "nearest\nreturn m", "nearest\nperson m", "met"):
        table.add_column(name, justify="right")
    for name in ("under way, waits", "at last"):
        table.add_column(name)
    for name, values in metrics["robots"].items():
        met = values["returns_in_disk_moving"] + values["returns_in_disk_standing"]
        table.add_row(
            name,
            Text(str(values["arrivals"]), style="green" if values["reached"] else "red"),
            _number(values["arrival_time"], 1),
            f"{values['travelled_length']:.1f}",
            _number(_distance(values["nearest_return"]), 2),
            _number(_distance(values["nearest_person"]), 2),
            Text(str(met), style="bold red" if met else ""),
            _shares(values["shares"]),
            values["reason"].replace("_", " "),
        )
    return Group(table, Text(_footer(metrics, settings), style="dim"))


def _robot(
    robot: ReplayRobot,
    robots: Sequence[ReplayRobot],
    record: ReplayRecord,
    verdict: Verdict,
    settings: ReplaySettings,
) -> dict[str, Any]:
    name = robot.spec.id
    rows, decisions, arrivals = (
        record.run.trajectory(name),
        record.run.decisions_of(name),
        record.arrivals[name],
    )
    goal = record.trips[name][-1][1]
    last = decisions[-1]
    shares = Counter(decision.reason or "under_way" for decision in decisions)
    return {
        "reached": bool(arrivals),
        "arrivals": len(arrivals),
        "arrival_time": arrivals[0] if arrivals else None,
        "travelled_length": _rounded(float(np.sum(rows[:-1, 4] * np.diff(rows[:, 0])))),
        "least_clearance": None
        if verdict.nearest is None
        else _rounded(verdict.nearest.distance + robot.spec.radius),
        "least_separation": _separation(robot, robots, record),
        "nearest_return": _encounter(verdict.nearest),
        "nearest_return_moving": _encounter(verdict.nearest_moving),
        "nearest_person": _encounter(verdict.nearest_person),
        "least_distance_to_latest_scans": _rounded(float(verdict.distances.min())),
        "returns_in_disk_moving": verdict.met_moving,
        "returns_in_disk_standing": verdict.met_standing,
        "reason": last.reason or "under_way",
        "message": last.message or record.run.reason,
        "remaining_distance": _rounded(float(np.hypot(*(rows[-1, 1:3] - np.array(goal))))),
        "shares": {reason: round(count / len(decisions), 4) for reason, count in shares.most_common()},
    }


def _separation(robot: ReplayRobot, robots: Sequence[ReplayRobot], record: ReplayRecord) -> float | None:
    """Return the least distance from the robot's centre to the disk of another one at equal times [m]."""
    rows = record.run.trajectory(robot.spec.id)[:, 1:3]
    others = [other for other in robots if other is not robot]
    gaps = [
        float(np.hypot(*(rows - record.run.trajectory(other.spec.id)[:, 1:3]).T).min()) - other.spec.radius
        for other in others
    ]
    return _rounded(min(gaps)) if gaps else None


def _encounter(encounter: Encounter | None) -> dict[str, Any] | None:
    if encounter is None:
        return None
    return {
        name: _rounded(value) if isinstance(value, float) else value
        for name, value in asdict(encounter).items()
    }


def _rounded(value: float) -> float | None:
    return round(value, 4) if np.isfinite(value) else None


def _dump(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(
        json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n", encoding="utf-8"
    )


def _distance(encounter: Mapping[str, Any] | None) -> float | None:
    return None if encounter is None else float(encounter["distance"])


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _shares(shares: Mapping[str, float]) -> str:
    """Return how the decisions are shared out, such as ``86 %, no path 12 %``."""
    driving = f"{100 * shares.get('under_way', 0.0):.0f} %"
    waits = [
        f"{reason.replace('_', ' ')} {100 * share:.0f} %"
        for reason, share in shares.items()
        if reason not in ("under_way", "arrived") and share >= 0.005
    ]
    return ", ".join([driving, *waits])


def _footer(metrics: Mapping[str, Any], settings: ReplaySettings) -> str:
    planner, fusion, outrun = metrics["planner"]["step_ms"], metrics["fusion"]["step_ms"], metrics["outrun"]
    lines = [
        f"{metrics['reason']} at {metrics['duration']:.1f} s; radius {settings.radius:g} m, margin "
        f"{settings.safety_margin:g} m, speed {settings.speed:g} m/s, people up to {settings.boundary_speed:g} m/s",
        f"planner step {planner['p50']:.1f} ms (p99 {planner['p99']:.1f}), "
        f"fusion step {fusion['p50']:.1f} ms (p99 {fusion['p99']:.1f})",
    ]
    if outrun["returns"]:
        lines.append(
            f"{100 * outrun['share']:.2g} % of the returns lie where nothing that slow could be, up to "
            f"{outrun['deepest']:.2f} m deep: faster, or not seen before"
        )
    return "\n".join(lines)
