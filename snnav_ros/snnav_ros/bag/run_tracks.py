"""What ``snnav tracks`` does."""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, fields
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from rich import box
from rich.table import Table

from snnav_ros.bag.files import check_directory, make_directory
from snnav_ros.bag.recorded_scans import Recording, read_recording
from snnav_ros.bag.replay_judge import Returns, measured_returns
from snnav_ros.bag.sensors_file import TopicSensor, read_sensors
from snnav_ros.bag.settings import TracksSettings
from snnav_ros.bag.tracking import BodyTrack, TrackedRow, TracksRecord, track_recording
from snnav_ros.run_display import make_console
from snnav_sim.report.metrics import library_versions, step_times

__all__ = ["run"]

_MARK = "tracks.json"  # the file by which a directory of results is known
_LEAST_DURATION = 1.0  # [s]; shorter tracks stand in the files, not in the table and the figure
_BESIDE = 0.1  # [m] from the outline of a body to a return that counts as on it


def run(arguments: argparse.Namespace) -> int:
    """Run ``snnav tracks``."""
    settings = TracksSettings(
        **{field.name: getattr(arguments, field.name) for field in fields(TracksSettings)}
    )
    directory = check_directory(arguments.out or Path("runs") / f"{arguments.bag.stem}-tracks", _MARK)
    sensors = read_sensors(arguments.sensors)
    recording = read_recording(arguments.bag, sensors, arguments.start, arguments.duration)
    for warning in recording.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    record = track_recording(recording, sensors, settings)
    for name, lines in record.refused.items():
        print(f"warning: {len(lines)} scans of {name} refused: {lines[0]}", file=sys.stderr)
    returns = measured_returns(recording, sensors)
    metrics = _metrics(recording, record, returns)
    how = {
        "bag": str(recording.path),
        "start": arguments.start,
        "duration": arguments.duration,
        "settings": asdict(settings),
    }

    def fill(draft: Path) -> None:
        _write_json(draft / _MARK, how)
        _write_json(draft / "metrics.json", metrics)
        _write_rows(draft / "tracks.csv", record.rows)
        if not arguments.no_figures:
            _draw(draft / "figures", recording, sensors, record, returns)

    make_directory(directory, _MARK, fill)
    console = make_console()
    console.print(_table(metrics))
    console.print(f"results: {directory}", soft_wrap=True, highlight=False)
    return 0


def _metrics(recording: Recording, record: TracksRecord, returns: Sequence[Returns]) -> dict[str, Any]:
    """Return the content of ``metrics.json``; docs/real-logs.md explains its keys."""
    on_bodies, by_people = _explained(record, returns)
    return {
        "recording": recording.path.stem,
        "begin": round(record.times[0], 3),
        "end": round(record.times[-1], 3),
        "updates": len(record.times),
        "scans": dict(Counter(scan.sensor_id for scan in recording.scans)),
        "refused_scans": {name: len(lines) for name, lines in record.refused.items()},
        "bodies": {body.id: _body(body) for body in record.bodies},
        "returns_of_people": by_people,
        "returns_of_people_on_moving_bodies": on_bodies,
        "tracker": step_times(record.seconds),
        "versions": library_versions(),
    }


def _body(body: BodyTrack) -> dict[str, Any]:
    places = np.array([(row.x, row.y) for row in body.rows])
    return {
        "begin": round(body.rows[0].time, 3),
        "end": round(body.rows[-1].time, 3),
        "updates": len(body.rows),
        "travelled_length": round(float(np.hypot(*np.diff(places, axis=0).T).sum()), 3),
        "speed": {
            name: round(float(np.percentile(body.speeds, share)), 4)
            for name, share in (("p5", 5), ("p50", 50), ("p95", 95), ("max", 100))
        },
        "deviation": round(float(np.median([row.deviation for row in body.rows])), 4),
    }


def _explained(record: TracksRecord, returns: Sequence[Returns]) -> tuple[int, int]:
    """Count the returns of people that lie on a body which moves, at the next measurement; and all of them."""
    on_bodies = total = 0
    times = np.array(record.times)
    for scan in returns:
        people = scan.points[scan.is_person]
        update = int(np.searchsorted(times, scan.stamp - 1e-9))
        if len(people) == 0 or update == len(times):
            continue
        total += len(people)
        _, bodies = record.outlines[update]
        for point in shapely.points(people):
            on_bodies += any(
                shapely.Polygon(body.outline_at(scan.stamp)).distance(point) <= body.radius + _BESIDE
                for body in bodies
            )
    return on_bodies, total


def _table(metrics: Mapping[str, Any]) -> Table:
    """Return one row per body that was followed for a while."""
    steps = metrics["tracker"]["step_ms"]
    table = Table(
        title=metrics["recording"],
        caption=f"{metrics['updates']} measurements, update {steps['p50']:.1f} ms (p99 {steps['p99']:.1f})",
        title_justify="left",
        caption_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
    )
    table.add_column("body")
    for name in ("from\ns", "to\ns", "way\nm", "speed\nm/s", "p95\nm/s", "deviation\nm/s"):
        table.add_column(name, justify="right")
    for name, body in metrics["bodies"].items():
        if body["end"] - body["begin"] >= _LEAST_DURATION:
            table.add_row(
                name,
                f"{body['begin']:.1f}",
                f"{body['end']:.1f}",
                f"{body['travelled_length']:.1f}",
                f"{body['speed']['p50']:.2f}",
                f"{body['speed']['p95']:.2f}",
                f"{body['deviation']:.2f}",
            )
    return table


def _draw(
    directory: Path,
    recording: Recording,
    sensors: Sequence[TopicSensor],
    record: TracksRecord,
    returns: Sequence[Returns],
) -> None:
    from snnav_sim.report.tracks_figure import TrackCurve, draw_tracks  # matplotlib takes a second to import

    directory.mkdir()
    curves = []
    for body in record.bodies:
        table = np.array([astuple(row)[:1] + astuple(row)[2:] for row in body.rows], dtype=np.float64)
        if table[-1, 0] - table[0, 0] >= _LEAST_DURATION:
            curves.append(TrackCurve(body.id, table[:, 0], table[:, 1:3], table[:, 3:5], table[:, 5]))
    points = np.concatenate([np.zeros((0, 2)), *(scan.points[~scan.is_person] for scan in returns)])
    people = np.concatenate([np.zeros((0, 2)), *(scan.points[scan.is_person] for scan in returns)])
    places = np.array([entry.sensor.pose.position for entry in sensors])
    span = (record.times[0], record.times[-1])
    draw_tracks(recording.path.stem, places, points, people, curves, span, directory / "tracks.png")


def _write_rows(path: Path, rows: Sequence[TrackedRow]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([field.name for field in fields(TrackedRow)])
        for row in rows:
            writer.writerow([f"{value:.4f}" if isinstance(value, float) else value for value in astuple(row)])


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
