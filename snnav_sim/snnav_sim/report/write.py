"""The run directory: scene, metrics, trajectories, paths and figures of one run (docs/scene-format.md)."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

from snnav_core.errors import InvalidInput
from snnav_sim.report.flight_metrics import compute_flight_metrics
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.report.record import Decision, RunRecord
from snnav_sim.report.separation import separations
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene import AnyScene, Scene, SpaceScene, dump_scene

__all__ = ["check_run_directory", "paths_digest", "write_run_directory", "write_tables"]

TRAJECTORY_COLUMNS = ("time", "robot", "x", "y", "z", "heading", "pitch", "speed", "turn_rate")
PATH_COLUMNS = ("time", "robot", "index", "x", "y", "z", "digest")
TRACKING_COLUMNS = ("time", "robot", "distance_error", "angle_error")
_MARKS = ("scene.yaml", "metrics.json")  # what makes a directory a run directory


def check_run_directory(directory: Path | str) -> Path:
    """Return the path if a run may be written there: it does not exist, is empty, or holds an earlier run.

    Raises
    ------
    InvalidInput
        If something else stands there.
    """
    path = Path(directory)
    if path.exists() and not path.is_dir():
        raise InvalidInput(f"{path}: is a file: give another directory for the run")
    if path.is_dir() and any(path.iterdir()) and not all((path / mark).is_file() for mark in _MARKS):
        raise InvalidInput(
            f"{path}: holds files of something else than a run: give another or an empty directory"
        )
    return path


def write_run_directory(
    directory: Path | str,
    scene: AnyScene,
    record: RunRecord,
    attachments: Mapping[str, Path] | None = None,
    figures: bool = True,
) -> dict[str, Any]:
    """Write everything about a run; nothing is left half-written.

    Parameters
    ----------
    directory : path
        Made with its parents; an earlier run in it is replaced.
    scene : Scene or SpaceScene
    record : RunRecord
        A FlightRecord for a scene in space.
    attachments : mapping, optional
        Name in the run directory -> file or directory that is moved there, such as the recorded bag.
    figures : bool
        Whether to draw.

    Returns
    -------
    dict
        The metrics as written.

    Raises
    ------
    InvalidInput
        If the directory holds something else, or cannot be written.
    """
    path = check_run_directory(directory)
    metrics, draw = _evaluate(scene, record)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise InvalidInput(f"{path}: cannot be written ({error.strerror}): give another directory") from None
    try:
        draft.chmod(0o755)
        _fill(draft, scene, record, metrics)
        if figures:
            draw(draft / "figures")
        for name, source in (attachments or {}).items():
            shutil.move(source, draft / name)
        _replace(path, draft)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return metrics


def _evaluate(scene: AnyScene, record: RunRecord) -> tuple[dict[str, Any], Callable[[Path], None]]:
    """Return the metrics, and what draws into a directory."""
    if isinstance(scene, SpaceScene):
        assert isinstance(record, FlightRecord), "a run in space has a record of its own"
        return compute_flight_metrics(scene, record), lambda directory: _draw_flight(directory, scene, record)
    truth = GroundTruth(scene)
    return compute_metrics(scene, record, truth), lambda directory: _draw(directory, scene, record, truth)


def _fill(draft: Path, scene: AnyScene, record: RunRecord, metrics: dict[str, Any]) -> None:
    (draft / "scene.yaml").write_text(dump_scene(replace(scene, seed=record.seed)), encoding="utf-8")
    text = json.dumps(metrics, indent=2, allow_nan=False, ensure_ascii=False)
    (draft / "metrics.json").write_text(text + "\n", encoding="utf-8")
    write_tables(draft, record)
    if isinstance(record, FlightRecord):
        _table(draft / "tracking.csv", TRACKING_COLUMNS, _tracking_rows(record))
    (draft / "figures").mkdir()


def _draw_flight(directory: Path, scene: SpaceScene, record: FlightRecord) -> None:
    from snnav_sim.report.flight_figures import draw_flight  # takes a second to import

    draw_flight(scene, record, directory)


def _draw(directory: Path, scene: Scene, record: RunRecord, truth: GroundTruth) -> None:
    # drawing needs matplotlib, which takes a second to import
    from snnav_sim.report.animation import draw_animation
    from snnav_sim.report.clearance_figure import draw_clearance
    from snnav_sim.report.decisions_figure import draw_decisions
    from snnav_sim.report.figures import draw_scene
    from snnav_sim.report.moment import Moments
    from snnav_sim.report.plan_figures import draw_candidates, draw_spacetime
    from snnav_sim.report.separation_figure import draw_separation
    from snnav_sim.report.snapshots import draw_snapshots

    draw_scene(scene, record, truth, directory / "scene.png")
    if not any(record.samples.values()):
        return
    draw_clearance(scene, record, truth, directory / "clearance.png")
    draw_decisions(scene, record, directory / "decisions.png")
    if len(scene.robots) > 1:
        draw_separation(scene, separations(scene, record), directory / "separation.png")
    if record.plans:
        draw_candidates(scene, record, truth, directory / "candidates.png")
        draw_spacetime(scene, record, directory / "spacetime.png")
    moments = Moments(scene, record, truth)
    draw_snapshots(scene, truth, moments, directory / "snapshots.png")
    draw_animation(scene, truth, moments, directory / "animation.gif")


def _replace(path: Path, draft: Path) -> None:
    """Put the draft where the directory is; an earlier run goes only after the new one stands."""
    if not path.exists():
        draft.rename(path)
        return
    old = Path(tempfile.mkdtemp(prefix=f".{path.name}.old.", dir=path.parent))
    path.rename(old / "run")
    draft.rename(path)
    shutil.rmtree(old)


def write_tables(directory: Path, record: RunRecord) -> None:
    """Write trajectories.csv and paths.csv into a directory that is there."""
    _table(directory / "trajectories.csv", TRAJECTORY_COLUMNS, _trajectory_rows(record))
    _table(directory / "paths.csv", PATH_COLUMNS, _path_rows(record.decisions))


def _table(path: Path, columns: tuple[str, ...], rows: Iterable[tuple[Any, ...]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        _write_table(file, columns, rows)


def _write_table(file: TextIO, columns: tuple[str, ...], rows: Iterable[tuple[Any, ...]]) -> None:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)


def paths_digest(record: RunRecord) -> str:
    """Return the SHA-1 of the file paths.csv that a run directory of this record holds."""
    file = io.StringIO(newline="")
    _write_table(file, PATH_COLUMNS, _path_rows(record.decisions))
    return hashlib.sha1(file.getvalue().encode("utf-8"), usedforsecurity=False).hexdigest()


def _trajectory_rows(record: RunRecord) -> list[tuple[Any, ...]]:
    rows = [
        (row[0], robot, *(row[1:] if isinstance(record, FlightRecord) else _in_space(*row[1:])))
        for robot, samples in record.samples.items()
        for row in samples
    ]
    return sorted(rows, key=lambda row: (float(row[0]), str(row[1])))


def _in_space(x: float, y: float, heading: float, speed: float, turn_rate: float) -> tuple[float, ...]:
    """Return the columns of a robot on the ground."""
    return x, y, 0.0, heading, 0.0, speed, turn_rate


def _tracking_rows(record: FlightRecord) -> list[tuple[Any, ...]]:
    rows = [(row[0], robot, *row[1:]) for robot, errors in record.errors.items() for row in errors]
    return sorted(rows, key=lambda row: (float(row[0]), str(row[1])))


def _path_rows(decisions: Iterable[Decision]) -> Iterable[tuple[Any, ...]]:
    for decision in decisions:
        if decision.path is None:
            yield decision.time, decision.robot, -1, "", "", "", decision.reason
            continue
        digest = decision.path.digest()
        for index, point in enumerate(decision.path.points.tolist()):
            x, y, z = [*point, 0.0][:3]
            yield decision.time, decision.robot, index, x, y, z, digest
