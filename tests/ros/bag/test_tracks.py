"""`snnav tracks`: bodies that move in recorded scans."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from snnav_ros.bag.messages import laser_scan
from snnav_ros.bag.writer import BagWriter
from snnav_ros.cli import main
from snnav_sim.raycast import cast
from snnav_sim.visibility import ring_segments

DATA = Path(__file__).parents[4] / "shared" / "data"
TWO = DATA / "two_fixed_lasers_people"
SPEED, RADIUS = 0.6, 0.4
PLACES = {"left": (0.5, 0.5, 0.8), "right": (7.5, 0.5, 2.3)}


def ranges(place: tuple[float, float, float], time: float) -> np.ndarray:
    """Ranges of a scanner in a room of 8 m x 6 m in which a disk goes along x."""
    walls = ring_segments(shapely.box(0.0, 0.0, 8.0, 6.0))
    disk = np.array([[2.0 + SPEED * time, 3.5, RADIUS]])
    x, y, heading = place
    exact = cast((x, y), heading, -math.pi / 2, math.radians(0.5), 361, walls, disk, 20.0)
    return exact + np.random.default_rng(round(1000 * time)).normal(0.0, 0.005, 361)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a directory with a bag of two scanners that measure alternately, and its file of sensors."""
    place = tmp_path_factory.mktemp("tracks")
    with BagWriter(place / "room") as bag:
        for k in range(60):
            name = ("left", "right")[k % 2]
            time = 0.05 * k
            stamp = 1_000_000_000 + round(1e9 * time)
            message = laser_scan(
                stamp, name, ranges(PLACES[name], time), -math.pi / 2, math.radians(0.5), 20.0
            )
            bag.write(f"{name}/scan", message, stamp)
    sensors = {
        name: {"topic": f"{name}/scan", "x": x, "y": y, "yaw": yaw} for name, (x, y, yaw) in PLACES.items()
    }
    (place / "sensors.json").write_text(json.dumps({"frame": "map", "sensors": sensors}))
    return place


def tracked(out: Path, *words: object) -> tuple[dict[str, Any], list[dict[str, str]]]:
    """Run the command; return metrics and rows."""
    assert main([str(word) for word in ("tracks", *words, "--out", out)]) == 0
    with (out / "tracks.csv").open(encoding="utf-8") as file:
        return json.loads((out / "metrics.json").read_text()), list(csv.DictReader(file))


def test_one_body_is_followed(place: Path, tmp_path: Path) -> None:
    metrics, rows = tracked(tmp_path / "out", place / "room", "--sensors", place / "sensors.json")
    assert list(rows[0]) == ["time", "id", "x", "y", "vx", "vy", "deviation", "radius"]
    assert len({row["id"] for row in rows}) == 1
    assert len(metrics["bodies"]) == 1
    for row in rows[-3:]:
        vx, vy, deviation = (float(row[key]) for key in ("vx", "vy", "deviation"))
        assert math.hypot(vx - SPEED, vy) < max(0.05 * SPEED, 3.0 * deviation)
        centre = (2.0 + SPEED * float(row["time"]), 3.5)
        assert math.dist((float(row["x"]), float(row["y"])), centre) < RADIUS
        assert float(row["radius"]) >= 0.9 * RADIUS
    assert (tmp_path / "out" / "figures" / "tracks.png").stat().st_size > 10_000


def test_the_same_recording_gives_the_same_rows(place: Path, tmp_path: Path) -> None:
    words = (place / "room", "--sensors", place / "sensors.json", "--no-figures")
    assert tracked(tmp_path / "first", *words)[1] == tracked(tmp_path / "second", *words)[1]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("nothing.bag", "--sensors", "sensors.json"), "nothing.bag"),
        (("room", "--sensors", "nothing.json"), "cannot be read"),
        (("room", "--sensors", "sensors.json", "--start", "100"), "no usable scan"),
        (("room", "--sensors", "sensors.json", "--interval", "5"), "shorter than --interval 5"),
        (("room", "--sensors", "sensors.json", "--interval", "0"), "--interval"),
    ],
)
def test_what_cannot_be_tracked(
    words: tuple[str, ...], told: str, place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [str(place / word) if "." in word or word == "room" else word for word in words]
    try:
        status = main(["tracks", *arguments, "--out", str(tmp_path / "out")])
    except SystemExit as stop:  # argparse
        status = int(stop.code or 0)
    assert status == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert told in lines[-1]
    assert not (tmp_path / "out").exists()


def test_other_files_are_left_alone(place: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep")
    words = ["tracks", str(place / "room"), "--sensors", str(place / "sensors.json"), "--out", str(tmp_path)]
    assert main(words) == 2
    assert [file.name for file in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.skipif(not TWO.is_dir(), reason=f"no recordings in {DATA}")
def test_somebody_walks_at_a_walking_pace(tmp_path: Path) -> None:
    words = (TWO / "scans_demo.bag", "--sensors", TWO / "sensors.json", "--no-figures")
    metrics, rows = tracked(tmp_path / "out", *words)
    assert metrics["refused_scans"] == {}
    longest = next(iter(metrics["bodies"].values()))
    assert longest["end"] - longest["begin"] > 10.0
    assert 0.3 < longest["speed"]["p50"] < 1.2
    assert all(math.hypot(float(row["vx"]), float(row["vy"])) <= 2.0 for row in rows)
    assert metrics["returns_of_people_on_moving_bodies"] > 0.5 * metrics["returns_of_people"]
