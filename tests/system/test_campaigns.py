"""`snnav campaign` as a person uses it; and every night the campaigns of the acceptance in full."""

from __future__ import annotations

import csv
import hashlib
import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from snnav_ros.cli import main
from snnav_sim.campaign.generate import campaign_scene
from snnav_sim.campaign.run import run_seed
from snnav_sim.campaign.summary import CSV_COLUMNS, TIME_COLUMNS
from snnav_sim.scene import load_scene
from support.waiting import until

PROGRAM = [sys.executable, "-m", "snnav_ros.cli"]
PATIENCE = 240.0  # [s]


def campaign(directory: Path, *options: str, kind: str = "static", runs: int = 5, seed: int = 3) -> list[str]:
    numbers = ["--runs", str(runs), "--seed", str(seed)]
    return ["campaign", "--kind", kind, *numbers, "--out", str(directory), *options]


def small(kind: str) -> int:
    """Return the seed of a campaign whose first scene has few robots and people."""

    def size(seed: int) -> int:
        scene = campaign_scene(kind, run_seed(seed, 0))
        return len(scene.robots) + len(scene.movers)

    return min(range(30), key=size)


def rows(directory: Path) -> list[dict[str, str]]:
    """The table without what depends on the machine."""
    with (directory / "runs.csv").open(encoding="utf-8", newline="") as file:
        found = list(csv.DictReader(file))
    assert found
    assert tuple(found[0]) == CSV_COLUMNS
    return [{key: value for key, value in row.items() if key not in TIME_COLUMNS} for row in found]


def finished(directory: Path) -> int:
    path = directory / "runs.jsonl"
    return path.read_bytes().count(b"\n") if path.exists() else 0


def wait_for(runs: int, directory: Path, process: subprocess.Popen[Any]) -> None:
    """Wait until so many runs have ended; a process that ends before is found by what the test asserts."""
    until(lambda: finished(directory) >= runs or process.poll() is not None, f"{runs} runs", longest=PATIENCE)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small campaign that nobody disturbed."""
    directory = tmp_path_factory.mktemp("whole") / "campaign"
    assert main(campaign(directory, "--jobs", "2")) == 0
    return directory


def test_everything_that_the_docs_name_is_there(whole: Path) -> None:
    assert {"campaign.json", "runs.jsonl", "runs.csv", "summary.json", "index.html", "scenes"} <= {
        path.name for path in whole.iterdir()
    }
    summary = json.loads((whole / "summary.json").read_text(encoding="utf-8"))
    assert (summary["kind"], summary["seed"], summary["runs"]) == ("static", 3, 5)
    assert summary["collisions"] == summary["margin_violations"] == summary["failed_runs"] == 0
    page = (whole / "index.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 3
    links = re.findall(r'(?:href|src)="([^":]+)"', page)
    assert all((whole / link).is_file() for link in links)
    for path in (whole / "scenes").iterdir():
        assert load_scene(path).name == path.stem


@pytest.mark.parametrize("kind", ["static", "dynamic", "multi", "faults"])
def test_a_run_is_repeated_by_its_scene(kind: str, whole: Path, tmp_path: Path) -> None:
    if kind != "static":
        main(campaign(tmp_path / "one", "--jobs", "1", kind=kind, runs=1, seed=small(kind)))
    directory = whole if kind == "static" else tmp_path / "one"
    row = rows(directory)[0]
    scene = directory / "scenes" / f"{kind}_{row['seed']}.yaml"
    assert main(["run", str(scene), "--core", "--no-figures", "--out", str(tmp_path / "again")]) == 0
    content = (tmp_path / "again" / "paths.csv").read_bytes()
    assert hashlib.sha1(content, usedforsecurity=False).hexdigest() == row["paths_sha1"]


def test_a_campaign_that_was_killed_goes_on_to_the_same_table(whole: Path, tmp_path: Path) -> None:
    directory = tmp_path / "killed"
    process = subprocess.Popen([*PROGRAM, *campaign(directory, "--jobs", "1")], stdout=subprocess.DEVNULL)
    wait_for(2, directory, process)
    process.kill()
    assert process.wait() == -signal.SIGKILL
    before = finished(directory)
    assert 2 <= before < 5
    with (directory / "runs.jsonl").open("ab") as file:
        file.write(b'{"kind": "static", "seed": 30')
    kept = (directory / "runs.jsonl").read_bytes().split(b"\n")[:before]
    assert main(campaign(directory, "--jobs", "1")) == 0
    assert (directory / "runs.jsonl").read_bytes().split(b"\n")[:before] == kept
    assert rows(directory) == rows(whole)


def test_a_campaign_that_was_interrupted_says_how_to_go_on(tmp_path: Path) -> None:
    directory = tmp_path / "interrupted"
    process = subprocess.Popen(
        [*PROGRAM, *campaign(directory, "--jobs", "2", runs=100)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    wait_for(1, directory, process)
    process.send_signal(signal.SIGINT)
    told, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert re.search(r"\d+ of 100 runs are kept: the same command goes on", told)
    assert "Traceback" not in errors


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--kind", "swarm"], "invalid choice: 'swarm'"),
        (["--runs", "0"], "'0' is no whole number from 1 to 1000000"),
        (["--seed", "-1"], "'-1' is no whole number from 0"),
        (["--jobs", "many"], "'many' is no whole number from 1 to 1000"),
    ],
)
def test_a_mistake_is_told_in_one_line(
    options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main([*campaign(tmp_path / "new"), *options])
    assert left.value.code == 2
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1
    assert not (tmp_path / "new").exists()


def test_a_wrong_directory_is_told_in_one_line(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("mine")
    for directory, kind, message in (
        (tmp_path, "static", "holds files of something else than a campaign"),
        (tmp_path / "file", "static", "is a file"),
        (whole, "multi", "holds a campaign of --kind static --seed 3"),
    ):
        assert main(campaign(directory, kind=kind)) == 2
        told = capsys.readouterr().err
        assert message in told
        assert told.count("\n") == 1


SHARES = {"static": (300, 0.99), "dynamic": (300, 0.97), "multi": (200, 0.95), "faults": (200, None)}


@pytest.mark.nightly
@pytest.mark.parametrize("kind", SHARES)
def test_campaign(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs, share = SHARES[kind]
    status = main(
        ["campaign", "--kind", kind, "--runs", str(runs), "--seed", "1", "--out", str(tmp_path / kind)]
    )
    summary: dict[str, Any] = json.loads((tmp_path / kind / "summary.json").read_text(encoding="utf-8"))
    with capsys.disabled():
        print(json.dumps(summary, indent=2))
    assert status == 0
    assert summary["runs"] == runs
    assert summary["failed_runs"] == summary["collisions"] == summary["margin_violations"] == 0
    assert summary["without_typed_reason"] == 0
    if kind != "dynamic":
        assert summary["walked_into"] == summary["hit_standing"] == 0
    if share is not None:
        assert summary["feasible_reached_share"] >= share
    if kind == "static":
        assert summary["ratio_planned"]["median"] <= 1.03
        assert summary["ratio_planned"]["p95"] <= 1.10
