"""The run directory: complete, readable by standard tools, whole or not there at all."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from snnav_core.errors import InvalidInput, SnnavError
from snnav_core.types import TimedPath
from snnav_sim.report import write
from snnav_sim.report.record import RunRecord
from snnav_sim.report.write import check_run_directory, write_run_directory
from snnav_sim.scene import Scene, load_scene
from snnav_sim.simulation import Simulation


@pytest.fixture
def record(room: Scene) -> RunRecord:
    """Two sampling intervals of a real run."""
    simulation = Simulation(room, seed=7)
    for _ in range(2):
        simulation.decide()
        for _ in range(room.ticks_per_sample):
            simulation.move()
    simulation.decide()
    simulation.record.decisions.append(
        simulation.record.decisions[-1].__class__(1.5, "r", None, "no_path", "nothing verified")
    )
    return simulation.record


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_contents(tmp_path: Path, room: Scene, record: RunRecord) -> None:
    target = tmp_path / "deep" / "run"
    metrics = write_run_directory(target, room, record)
    names = {str(path.relative_to(target)) for path in target.rglob("*") if path.is_file()}
    assert names == {
        "scene.yaml", "metrics.json", "trajectories.csv", "paths.csv", "figures/scene.png", "figures/clearance.png",
        "figures/decisions.png", "figures/snapshots.png", "figures/animation.gif",
    }  # fmt: skip
    assert json.loads((target / "metrics.json").read_text()) == metrics
    scene = load_scene(target / "scene.yaml")
    assert scene.seed == 7, "as run"
    assert scene.robots == room.robots
    assert [path.name for path in target.parent.iterdir()] == ["run"], "nothing left beside it"


def test_trajectories(tmp_path: Path, room: Scene, record: RunRecord) -> None:
    write_run_directory(tmp_path / "run", room, record, figures=False)
    rows = rows_of(tmp_path / "run" / "trajectories.csv")
    assert list(rows[0]) == ["time", "robot", "x", "y", "z", "heading", "pitch", "speed", "turn_rate"]
    assert len(rows) == 2 * room.ticks_per_sample
    times = [float(row["time"]) for row in rows]
    assert times == pytest.approx(np.arange(len(rows)) * room.control_period)
    read = np.array(
        [[float(row[key]) for key in ("time", "x", "y", "heading", "speed", "turn_rate")] for row in rows]
    )
    assert np.array_equal(read, record.trajectory("r")), "every digit is kept"
    assert {row["z"] for row in rows} == {row["pitch"] for row in rows} == {"0.0"}


def test_paths_give_their_digests_back(tmp_path: Path, room: Scene, record: RunRecord) -> None:
    write_run_directory(tmp_path / "run", room, record, figures=False)
    rows = rows_of(tmp_path / "run" / "paths.csv")
    assert list(rows[0]) == ["time", "robot", "index", "x", "y", "z", "digest"]
    first = [row for row in rows if row["time"] == "0.0"]
    points = np.array([[float(row["x"]), float(row["y"])] for row in first])
    path = record.decisions[0].path
    assert path is not None
    assert [int(row["index"]) for row in first] == list(range(len(first)))
    assert TimedPath(0.0, path.step, points).digest() == first[0]["digest"] == path.digest()
    assert rows[-1] == {
        "time": "1.5",
        "robot": "r",
        "index": "-1",
        "x": "",
        "y": "",
        "z": "",
        "digest": "no_path",
    }


def test_figures_show_something(tmp_path: Path, room: Scene, record: RunRecord) -> None:
    from matplotlib.image import imread

    write_run_directory(tmp_path / "run", room, record)
    for name in ("scene.png", "clearance.png", "snapshots.png"):
        image = imread(tmp_path / "run" / "figures" / name)
        assert image.shape[1] > 1000
        assert len(np.unique(np.round(image[::4, ::4, :3].reshape(-1, 3), 1), axis=0)) > 5


def test_an_earlier_run_is_replaced_and_attachments_move_in(
    tmp_path: Path, room: Scene, record: RunRecord
) -> None:
    target = tmp_path / "run"
    write_run_directory(target, room, record, figures=False)
    (target / "old.txt").write_text("of the earlier run")
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "data.mcap").write_text("data")
    write_run_directory(target, room, record, attachments={"bag": bag}, figures=False)
    assert (target / "bag" / "data.mcap").read_text() == "data"
    assert not (target / "old.txt").exists()
    assert not bag.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_what_is_no_run_is_left_alone(tmp_path: Path, room: Scene, record: RunRecord) -> None:
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "mum.txt").write_text("dear")
    (tmp_path / "file").write_text("text")
    for name in ("letters", "file"):
        with pytest.raises(InvalidInput, match=name):
            write_run_directory(tmp_path / name, room, record)
    with pytest.raises(InvalidInput, match="cannot be written"):
        write_run_directory(tmp_path / "file" / "run", room, record)
    assert (tmp_path / "letters" / "mum.txt").read_text() == "dear"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "letters"]
    (tmp_path / "empty").mkdir()
    assert check_run_directory(tmp_path / "empty") == tmp_path / "empty"


def test_a_failure_leaves_the_earlier_run(
    tmp_path: Path, room: Scene, record: RunRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "run"
    write_run_directory(target, room, record, figures=False)
    before = (target / "metrics.json").read_text()

    def fail(*_: object) -> None:
        raise SnnavError("no space left")

    monkeypatch.setattr(write, "_table", fail)
    with pytest.raises(SnnavError, match="no space"):
        write_run_directory(target, room, record, figures=False)
    assert (target / "metrics.json").read_text() == before
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
