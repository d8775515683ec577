"""The subcommands as a user meets them: what they print, write and refuse."""

from __future__ import annotations

import argparse
import csv
import gzip
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from snnav_core.errors import SnnavError
from snnav_ros.bag.commands import add_parser
from snnav_ros.bag.errors import LogError
from snnav_ros.bag.evaluation import evaluate, name_of
from snnav_ros.bag.settings import EvaluationSettings, NetworkSettings
from snnav_sim.scene import load_scene

WIDTH, HEIGHT = 24.0, 9.0
MANUAL = (Path(__file__).parents[3] / "docs" / "real-logs.md").read_text(encoding="utf-8")


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser(prog="snnav")
    add_parser(parser.add_subparsers(required=True))
    parsed = parser.parse_args([str(argument) for argument in arguments])
    return parsed.func(parsed)


def flaser(ranges: np.ndarray, x: float, y: float, heading: float, stamp: float) -> str:
    readings = " ".join(f"{r:g}" for r in ranges)
    return f"FLASER {len(ranges)} {readings} {x} {y} {heading} {x} {y} {heading} {stamp} host {stamp}\n"


def room_log(path: Path, count: int = 30) -> Path:
    """Write the log of a robot that drives to and fro in an empty room; some beams come back with nothing."""
    lines = []
    for k in range(count):
        x, y, heading = 2.0 + 20.0 * k / (count - 1), 4.5, 0.4 + math.pi * (k % 2)
        angles = heading - 0.5 * math.pi + math.radians(1.0) * np.arange(181)
        with np.errstate(divide="ignore"):
            across = np.where(np.cos(angles) > 0, (WIDTH - x) / np.cos(angles), -x / np.cos(angles))
            along = np.where(np.sin(angles) > 0, (HEIGHT - y) / np.sin(angles), -y / np.sin(angles))
        ranges = np.minimum(across, along).round(2)
        ranges[k % 7 :: 60] = 81.91
        lines.append(flaser(ranges, x, y, heading, 10.0 + k))
    path.write_bytes(gzip.compress("".join(lines).encode()))
    return path


def test_from_log_to_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = room_log(tmp_path / "room.log.gz")
    assert run("import-carmen", log, tmp_path / "room") == 0
    told = capsys.readouterr()
    assert "30 FLASER scans of 181 beams, no return = 81.91 m" in told.out
    assert "20.0 x 0.0 m, path 20.0 m, 29.0 s" in told.out
    assert told.err == ""
    out = tmp_path / "scenes" / "room.yaml"
    arguments = ("--nodes", "12", "--robots", "2", "--seed", "5", "--out", out)
    assert run("network", tmp_path / "room", *arguments) == 0
    told = capsys.readouterr().out
    assert "12 nodes see" in told
    assert "robot_2: (" in told
    scene = load_scene(out)
    assert (scene.name, scene.seed, len(scene.sensors), len(scene.robots)) == ("room", 5, 12, 2)
    assert [sensor.range_cut for sensor in scene.sensors] == [20.0] * 12
    first = out.read_bytes()
    assert run("network", tmp_path / "room", *arguments) == 0
    assert out.read_bytes() == first
    assert sorted(path.name for path in (tmp_path / "scenes").iterdir()) == ["room.yaml"]
    assert run("network", tmp_path / "room", "--every", "10", "--robots", "0", "--out", out) == 0
    assert (len(load_scene(out).sensors), load_scene(out).robots) == (3, ())


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("import-carmen", "missing.log", "bag"), "missing.log: cannot be read"),
        (("import-carmen", "room.log.gz", "there"), "there: exists already"),
        (("network", "missing", "--nodes", "3", "--out", "x.yaml"), "missing: does not exist"),
        (("network", "bag", "--nodes", "99", "--out", "x.yaml"), "99 nodes wanted of 30 posed scans"),
        (("network", "bag", "--nodes", "9", "--topic", "scans", "--out", "x.yaml"), "no topic 'scans'"),
        (("network", "bag", "--nodes", "9", "--out", "there"), "there: is a directory"),
        (
            ("network", "bag", "--nodes", "9", "--safety-margin", "9", "--out", "x.yaml"),
            "no place is 9 m from",
        ),
        (("network", "bag", "--nodes", "9", "--radius", "0.5", "--out", "x.yaml"), "below the radius 0.5"),
        (("network", "bag", "--nodes", "9", "--robots", "400", "--out", "x.yaml"), "no room for robot"),
        (("evaluate-logs", "room.log.gz", "room.log.gz"), "room: given 2 times"),
        (("evaluate-logs", "empty.log", "--jobs", "1"), "no usable scan"),
        (("evaluate-logs", "room.log.gz", "--out", "."), "holds other files"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], text: str
) -> None:
    monkeypatch.chdir(tmp_path)
    room_log(tmp_path / "room.log.gz")
    run("import-carmen", "room.log.gz", "bag")
    (tmp_path / "there").mkdir()
    (tmp_path / "empty.log").write_text("ODOM 1 2 3\n")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(SnnavError, match=text) as caught:
        run(*arguments)
    assert "\n" not in str(caught.value)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize(
    "arguments",
    [
        ("network", "bag", "--out", "x.yaml"),
        ("network", "bag", "--nodes", "3", "--every", "2", "--out", "x.yaml"),
        ("network", "bag", "--nodes", "0", "--out", "x.yaml"),
        ("network", "bag", "--nodes", "3", "--speed", "0", "--out", "x.yaml"),
        ("network", "bag", "--nodes", "3", "--speed", "nan", "--out", "x.yaml"),
        ("network", "bag", "--nodes", "3", "--seed", "-1", "--out", "x.yaml"),
        ("evaluate-logs",),
        ("evaluate-logs", "a.log", "--jobs", "two"),
    ],
)
def test_wrong_arguments_end_with_status_2(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        run(*arguments)
    assert caught.value.code == 2
    assert "error:" in capsys.readouterr().err


def test_evaluation_of_a_room(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, out = room_log(tmp_path / "room-corrected.log.gz"), tmp_path / "results"
    status = run("evaluate-logs", log, "--nodes", "12", "--pairs", "2", "--jobs", "1", "--out", out)
    told = capsys.readouterr().out
    assert status == 0
    assert "2 of 2 targets reached (100.0 %), 0 violations of the safety margin 0.4 m: accepted" in told
    content = json.loads((out / "evaluation.json").read_text())
    (building,) = content["buildings"]
    assert (content["accepted"], building["building"], building["reached"]) == (True, "room", 2)
    assert building["least_area_clearance"] >= 0.4
    assert building["least_return_clearance"] >= 0.4
    assert 0.99 <= building["median_ratio"] <= building["largest_ratio"] < 1.2
    with (out / "pairs.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["building"], row["pair"], row["reached"]) for row in rows] == [
        ("room", "1", "True"),
        ("room", "2", "True"),
    ]
    assert all(float(row["straight_distance"]) >= 10.0 for row in rows)
    assert (out / "figures" / "room.png").stat().st_size > 20_000
    assert not (out / "failed").exists()


def test_routes_that_fail_are_typed_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from snnav_core.types import StopReason

    monkeypatch.setattr("snnav_core.navigator.ground.GroundNavigator.step", _nothing_found)
    log, out = room_log(tmp_path / "room.log.gz"), tmp_path / "results"
    status = run("evaluate-logs", log, "--nodes", "12", "--pairs", "1", "--jobs", "1", "--out", out)
    assert status == 1
    (building,) = json.loads((out / "evaluation.json").read_text())["buildings"]
    assert building["failures"] == {StopReason.NO_PATH.value: 1}
    assert len(load_scene(out / "failed" / "room_route_1.yaml").robots) == 1
    again = run("evaluate-logs", log, "--nodes", "12", "--pairs", "1", "--jobs", "1", "--out", out)
    assert again == 1


def _nothing_found(self, time, area, states, goals):
    from snnav_core.types import StepResult, Stop, StopReason

    return StepResult(time, {name: Stop(name, StopReason.NO_PATH, "nothing found") for name in states})


def test_the_number_of_processes_changes_nothing(tmp_path: Path) -> None:
    logs = [room_log(tmp_path / "one.log"), room_log(tmp_path / "two.log.gz", count=24)]
    settings = EvaluationSettings(nodes=10, pairs=1, network=NetworkSettings(seed=3))
    alone, together = (evaluate(logs, settings, jobs) for jobs in (1, 2))
    for first, second in zip(alone, together, strict=True):
        assert first.building.name == second.building.name
        for one, other in zip(first.pairs, second.pairs, strict=True):
            np.testing.assert_array_equal(one.rows, other.rows)
            assert (one.reached, one.ratio, one.area_clearance) == (
                other.reached,
                other.ratio,
                other.area_clearance,
            )


def test_errors_of_processes_arrive_as_one_line(tmp_path: Path) -> None:
    (tmp_path / "empty.log").write_text("nothing\n")
    with pytest.raises(LogError, match="no usable scan"):
        evaluate([tmp_path / "empty.log"], EvaluationSettings(), jobs=2)


def test_names_of_buildings() -> None:
    names = [name_of(Path(name)) for name in ("a/intel-corrected.log.gz", "b.log", "c.clf.gz")]
    assert names == ["intel", "b", "c.clf"]


def test_the_commands_of_the_manual_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    room_log(tmp_path / "intel.log.gz", count=60)
    lines = [line.split()[1:] for line in MANUAL.splitlines() if line.startswith("    snnav ")]
    made, driven, evaluated = lines[:2], lines[2], lines[3]
    assert [run(*line) for line in made] == [0, 0]
    assert driven[0] == "run"
    assert len(load_scene(driven[1]).sensors) == 40
    assert evaluated[0] == "evaluate-logs"


def test_the_python_of_the_manual_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", MANUAL, flags=re.DOTALL)
    exec(compile(code, "docs/real-logs.md", "exec"), {})
    assert capsys.readouterr().out == "0 /scan [1. 2. 3.]\n"
