"""Runs of every kind, end to end; and what becomes of one that raises, or takes its process with it."""

from __future__ import annotations

import hashlib
import multiprocessing
import os
import signal
from pathlib import Path
from typing import Any

import pytest

from snnav_core.types import StopReason
from snnav_sim.campaign import run as run_module
from snnav_sim.campaign.generate import campaign_scene
from snnav_sim.campaign.ledger import Campaign, open_ledger
from snnav_sim.campaign.pool import finish
from snnav_sim.campaign.run import campaign_run
from snnav_sim.campaign.totals import is_clean, robots_of, totals
from snnav_sim.report.write import write_run_directory
from snnav_sim.scene import load_scene
from snnav_sim.simulation import simulate

TYPED = {reason.value for reason in StopReason}
FEWEST = [seed for seed in range(200) if len(campaign_scene("multi", seed).robots) <= 4]


def check(records: list[dict[str, Any]]) -> None:
    summary = totals(records)
    assert is_clean(summary), summary
    for robot in robots_of(records):
        assert robot["reason"] in TYPED, robot
        assert robot["message"], robot
        assert robot["reached"] == (robot["reason"] == StopReason.ARRIVED.value), robot


@pytest.mark.parametrize("kind", ["static", "dynamic", "faults"])
def test_robots_keep_their_margin_and_end_for_a_typed_reason(kind: str) -> None:
    records = [campaign_run(kind, seed) for seed in range(8)]
    check(records)
    robots = robots_of(records)
    assert sum(robot["reached"] for robot in robots) >= sum(robot["feasible"] for robot in robots) - 1


def test_several_robots_keep_their_margin() -> None:
    check([campaign_run("multi", seed) for seed in FEWEST[:6]])


@pytest.mark.parametrize("seed", [1000067, pytest.param(1000244, marks=pytest.mark.nightly)])
def test_a_robot_in_a_hurry_still_makes_room(seed: int) -> None:
    """Somebody comes into a passage that the robot has begun, or up to where it turns: it was walked into."""
    record = campaign_run("dynamic", seed)
    check([record])
    assert record["robots"]["robot_1"]["walked_into"] == 0


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [1000123, 1000195, 1000268, 1000277])
def test_a_robot_that_gets_nowhere_says_so_before_the_time_limit(seed: int) -> None:
    """By turns it turned, drove a little and waited at a place hardly wider than the margin."""
    record = campaign_run("dynamic", seed)
    check([record])
    assert record["duration"] < 300.0


@pytest.mark.parametrize("kind", ["static", "dynamic", "multi", "faults"])
def test_the_scene_that_was_written_gives_the_same_paths(kind: str, tmp_path: Path) -> None:
    seed = FEWEST[0] if kind == "multi" else 3
    record = campaign_run(kind, seed, tmp_path)
    scene = load_scene(tmp_path / "scenes" / f"{kind}_{seed}.yaml")
    write_run_directory(tmp_path / "again", scene, simulate(scene), figures=False)
    content = (tmp_path / "again" / "paths.csv").read_bytes()
    assert hashlib.sha1(content, usedforsecurity=False).hexdigest() == record["paths_sha1"]


def test_a_run_that_did_not_arrive_has_a_picture(tmp_path: Path) -> None:
    seed = next(
        seed for seed in range(100) if not campaign_run("static", seed)["robots"]["robot_1"]["feasible"]
    )
    record = campaign_run("static", seed, tmp_path)
    assert not record["robots"]["robot_1"]["reached"]
    assert (tmp_path / "pictures" / f"static_{seed}.png").read_bytes().startswith(b"\x89PNG")


def test_an_exception_is_a_failed_run_with_its_traceback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: Any) -> None:
        raise ZeroDivisionError("nothing\nto divide by")

    monkeypatch.setattr(run_module, "simulate", broken)
    record = campaign_run("static", 1, tmp_path)
    assert record["error"] == "ZeroDivisionError: nothing to divide by"
    assert (record["kind"], record["seed"], record["robots"], record["reason"]) == ("static", 1, {}, "failed")
    assert "in broken" in (tmp_path / "failures" / "static_1.txt").read_text()
    summary = totals([record])
    assert summary["failed_runs"] == 1
    assert not is_clean(summary)


def test_a_process_that_dies_loses_its_run_only(tmp_path: Path) -> None:
    """The first process is killed while it works; its run is told as failed, the others are made."""
    killed = []

    def kill_one(_: dict[str, Any]) -> None:
        if not killed:
            (process,) = multiprocessing.active_children()
            os.kill(process.pid or 0, signal.SIGKILL)
            killed.append(process.pid)

    with open_ledger(Campaign("static", 3, 5), tmp_path) as ledger:
        finish(ledger, 1, kill_one)
        errors = [record["error"] for record in ledger.records]
    assert errors == ["", "the process of the run died with exit code -9", ""]
    assert "exit code -9" in (tmp_path / "failures" / "static_5000001.txt").read_text()
