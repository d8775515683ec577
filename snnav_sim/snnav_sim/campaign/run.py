"""One run of a campaign: scene, closed loop, judgement, and what is left of it on disk."""

from __future__ import annotations

import os
import tempfile
import time as clock
import traceback
from pathlib import Path
from typing import Any

from snnav_sim.campaign.generate import campaign_scene
from snnav_sim.campaign.judge import judge
from snnav_sim.campaign.judge_flight import judge_flight
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.record import RunRecord
from snnav_sim.report.truth import GroundTruth
from snnav_sim.report.write import paths_digest
from snnav_sim.scene import AnyScene, SpaceScene, dump_scene
from snnav_sim.simulation import simulate

__all__ = [
    "FAILURES",
    "PICTURES",
    "SCENES",
    "SEED_STRIDE",
    "campaign_run",
    "failed_run",
    "run_name",
    "run_seed",
    "write_whole",
]

SCENES, PICTURES, FAILURES = "scenes", "pictures", "failures"
SEED_STRIDE = 1_000_000  # campaigns with different seeds share no run, up to so many runs


def run_seed(seed: int, number: int) -> int:
    """Return the seed of a run by the seed of the campaign and the number of the run from 0."""
    return seed * SEED_STRIDE + number


def run_name(kind: str, seed: int) -> str:
    """Return the name of a run by its own seed; its scene, picture and traceback are files of this name."""
    return f"{kind}_{seed}"


def campaign_run(kind: str, seed: int, directory: Path | None = None) -> dict[str, Any]:
    """Run the scene of a kind and seed and return its record.

    Parameters
    ----------
    kind : str
        See `snnav_sim.campaign.generate.campaign_scene`.
    seed : int
        Of the run.
    directory : path, optional
        Where the scene goes, the picture of a run whose robots did not all arrive, and the traceback of an exception.

    Returns
    -------
    dict
        One line of ``runs.jsonl``, see docs/campaigns.md.

    Notes
    -----
    Whatever a run raises becomes a record with an `error` and its last line; the traceback goes to a file.
    """
    begin = clock.perf_counter()
    try:
        scene = campaign_scene(kind, seed)
        if directory is not None:
            text = dump_scene(scene)
            write_whole(directory / SCENES / f"{run_name(kind, seed)}.yaml", text.encode("utf-8"))
        record = simulate(scene)
        outcome = {**_judge(scene, record), "paths_sha1": paths_digest(record), "error": ""}
        if directory is not None and not all(robot["reached"] for robot in outcome["robots"].values()):
            _draw(directory, kind, seed, scene, record)
    except Exception as error:  # a run that fails is a result of the campaign
        outcome = failed_run(
            kind, seed, directory, f"{type(error).__name__}: {error}", traceback.format_exc()
        )
    return {"kind": kind, "seed": seed, **outcome, "seconds": round(clock.perf_counter() - begin, 3)}


def _judge(scene: AnyScene, record: RunRecord) -> dict[str, Any]:
    if isinstance(scene, SpaceScene):
        assert isinstance(record, FlightRecord)
        return judge_flight(scene, record)
    return judge(scene, record)


def failed_run(kind: str, seed: int, directory: Path | None, error: str, details: str) -> dict[str, Any]:
    """Return what is known of a run that ended with an exception; its traceback goes to a file."""
    if directory is not None:
        write_whole(directory / FAILURES / f"{run_name(kind, seed)}.txt", details.encode("utf-8"))
    return {
        "kind": kind,
        "seed": seed,
        "reason": "failed",
        "duration": None,
        "robots": {},
        "planner_ms": {},
        "fusion_ms": {},
        "refused_scans": 0,
        "paths_sha1": "",
        "error": " ".join(error.split()),
        "seconds": None,
    }


def write_whole(path: Path, content: bytes) -> None:
    """Write a file whole or not at all; directories are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, draft = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        Path(draft).chmod(0o644)
        Path(draft).replace(path)
    except BaseException:
        Path(draft).unlink(missing_ok=True)
        raise


def _draw(directory: Path, kind: str, seed: int, scene: AnyScene, record: RunRecord) -> None:
    # drawing needs matplotlib, which takes a second to import
    from snnav_sim.report.figures import draw_scene
    from snnav_sim.report.flight_figures import draw_flight_scene

    path = directory / PICTURES / f"{run_name(kind, seed)}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(scene, SpaceScene):
        assert isinstance(record, FlightRecord)
        draw_flight_scene(scene, record, path)
    else:
        draw_scene(scene, record, GroundTruth(scene), path)
