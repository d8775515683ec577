"""Simulated robots among real people, in recordings that are no part of the project: skipped where they are absent."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from snnav_ros.cli import main

DATA = Path(__file__).parents[4] / "shared" / "data"
TWO = DATA / "two_fixed_lasers_people"
ONE = DATA / "static_laser_people"
ROUND = DATA / "static_rplidar_a3"

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"no recordings in {DATA}")

SMALL = ("--radius", "0.15", "--margin", "0.2")
NEARBY = (*SMALL, "--window", "2")

# One scanner each, its own frame is the map. That "nothing came back" (inf, or 0 in the positive_ files) means "free
# up to 4 or 7 m" is our reading of devices whose model is not stated.
SENSORS: dict[str, Any] = {
    "demo": {"topic": "/scan", "x": 0, "y": 0, "yaw": 0, "inf_is_free": True, "range_cut": 4.0},
    "right": {
        "topic": "right_scan",
        "x": 0,
        "y": 0,
        "yaw": 0,
        "no_return": [0.0],
        "inf_is_free": True,
        "range_cut": 7.0,
    },
    "round": {"topic": "/hog/scan0", "x": 0, "y": 0, "yaw": 0},
}
SENSORS["rear"] = {**SENSORS["right"], "topic": "/rear_scan"}


def sensors_file(name: str, place: Path) -> Path:
    if name == "two":
        return TWO / "sensors.json"
    file = place / f"{name}.json"
    file.write_text(json.dumps({"frame": "map", "sensors": {"laser": SENSORS[name]}}))
    return file


def replayed(bag: Path, sensors: Path, out: Path, robot: str, goal: str, *options: str) -> dict[str, Any]:
    """Run the command; return the metrics of the robot."""
    arguments = ("replay", bag, "--sensors", sensors, "--robot", robot, "--goal", goal, *options)
    assert main([str(word) for word in (*arguments, "--no-figures", "--out", out)]) == 0
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["refused_scans"] == {}
    found: dict[str, Any] = metrics["robots"]["robot_1"]
    return found


@pytest.mark.parametrize(
    ("bag", "sensors", "robot", "goal", "options"),
    [
        (
            TWO / "scans_demo.bag",
            "two",
            "1.6,-2.3,180",
            "-0.6,-1.4",
            (*SMALL, "--duration", "15", "--to-and-fro"),
        ),
        (
            ONE / "demo_stationary_simple_environment.bag",
            "demo",
            "0.8,-3,90",
            "0.8,3",
            ("--duration", "15", "--to-and-fro"),
        ),
        (ONE / "positive_1.bag", "right", "0.2,2.3,-90", "0.2,0.9", (*NEARBY, "--start", "41")),
        (ONE / "positive_4.bag", "right", "-0.15,1.1,90", "-0.5,2.6", (*NEARBY, "--start", "5")),
        (ONE / "positive_6.bag", "rear", "4,3.5,180", "0.6,1.8", ()),
        (ROUND / "2019-07-31-10-32-43.bag", "round", "-3.8,-2,0", "-0.9,-4", ()),
    ],
    ids=["two_lasers", "demo", "positive_1", "positive_4", "positive_6", "rplidar"],
)
def test_nobody_is_met(
    bag: Path, sensors: str, robot: str, goal: str, options: tuple[str, ...], tmp_path: Path
) -> None:
    found = replayed(bag, sensors_file(sensors, tmp_path), tmp_path / "out", robot, goal, *options)
    assert found["returns_in_disk_moving"] == 0
    assert found["returns_in_disk_standing"] == 0
    assert found["least_distance_to_latest_scans"] > 0.0
    assert found["reached"], found["shares"]


@pytest.mark.parametrize(
    ("folder", "name", "sensors", "robot", "goal"),
    [
        (TWO, "scans_demo", "two", "1.6,-2.3,180", "-0.6,-1.4"),
        (ONE, "demo_stationary_simple_environment", "demo", "0.8,-3,90", "0.8,3"),
        (ONE, "positive_4", "right", "-0.15,1.1,90", "-0.5,2.6"),
    ],
)
def test_every_kind_of_bag_gives_the_same_paths(
    folder: Path,
    name: str,
    sensors: str,
    robot: str,
    goal: str,
    tmp_path: Path,
    convert_bag: Callable[[Path, Path], Path],
) -> None:
    file, paths = sensors_file(sensors, tmp_path), []
    sqlite = convert_bag(folder / f"{name}_ros2", tmp_path / "sqlite")
    assert list(sqlite.glob("*.db3"))
    for number, bag in enumerate((folder / f"{name}.bag", folder / f"{name}_ros2", sqlite)):
        out = tmp_path / str(number)
        replayed(bag, file, out, robot, goal, *SMALL, "--start", "5", "--duration", "2")
        paths.append((out / "paths.csv").read_bytes())
    assert paths[0] == paths[1] == paths[2]
    assert paths[0].count(b"\n") > 15


def test_a_recording_cut_short_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut.bag"
    cut.write_bytes((TWO / "scans_demo.bag").read_bytes()[:1_500_000])
    arguments = [
        "replay",
        str(cut),
        "--sensors",
        str(TWO / "sensors.json"),
        "--robot",
        "0,-2,0",
        "--goal",
        "1,-2",
    ]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "damaged or cut short" in told
    assert not (tmp_path / "out").exists()
