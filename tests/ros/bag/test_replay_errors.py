"""What `snnav replay` refuses: one line with the value and the remedy, exit status 2, nothing written."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from snnav_core.types import Pose2D
from snnav_ros.bag.messages import laser_scan, pose_stamped
from snnav_ros.bag.sensors_file import read_sensors
from snnav_ros.bag.writer import BagWriter
from snnav_ros.cli import main

ENTRY = {"topic": "/scan", "x": 1.0, "y": 2.0, "yaw": 0.5}
GOOD = {"frame": "map", "sensors": {"laser": ENTRY}}
ROBOT = ("--robot", "1,2,0", "--goal", "2,2")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a directory with bags and a good sensors file; tests only read it."""
    place = tmp_path_factory.mktemp("errors")
    ranges = np.full(181, 4.0)
    with BagWriter(place / "good") as bag:
        for k in range(40):
            stamp = 1_000_000_000 + 100_000_000 * k
            bag.write("scan", laser_scan(stamp, "laser", ranges + 0.001 * k, -1.57, 0.0174, 10.0), stamp)
            bag.write("pose", pose_stamped(stamp, "map", Pose2D(0.0, 0.0, 0.0)), stamp)
    (place / "sensors.json").write_text(json.dumps(GOOD))
    return place


def refused(capsys: pytest.CaptureFixture[str], tmp_path: Path, *arguments: object) -> str:
    """Run the command, which must refuse and write nothing; return the line."""
    out = tmp_path / "out"
    before = sorted(tmp_path.rglob("*"))
    words = ["replay", *map(str, arguments), "--out", str(out), "--no-figures"]
    try:
        status = main(words)
    except SystemExit as leaving:  # argparse
        status = leaving.code
    told = capsys.readouterr()
    assert status == 2, told
    assert told.out == ""
    assert told.err.count("\n") == 1, told.err
    assert "Traceback" not in told.err
    assert sorted(tmp_path.rglob("*")) == before
    return told.err


def changed(change: Callable[[dict[str, Any]], None]) -> str:
    content = copy.deepcopy(GOOD)
    change(content)
    return json.dumps(content)


def sensor(**values: object) -> str:
    """Return a good file whose sensor has these values; None takes a key away."""
    entry = {key: value for key, value in {**ENTRY, **values}.items() if value is not None}
    return json.dumps({**GOOD, "sensors": {"laser": entry}})


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "the file is empty"),
        ("sensors: [", "not valid YAML"),
        ("- a\n- b\n", "the file is no mapping"),
        ("frame: map\n", "key sensors is missing"),
        ("sensors: {}\n", "names no sensor"),
        ("sensors: [laser]\n", "a list of 1 names no sensor"),
        (json.dumps({**GOOD, "frame": "odom"}), "odom is not known here: write one of map"),
        (json.dumps({**GOOD, "units": "metres, degrees"}), "give metres and radians"),
        (json.dumps({**GOOD, "sensor": {}}), "sensor: unknown key: did you mean sensors?"),
        (sensor(x=None), "sensors.laser: key x is missing: add x: ..."),
        (sensor(yaw=None), "sensors.laser: key yaw is missing: add yaw: ..."),
        (sensor(topic=None), "sensors.laser: key topic is missing"),
        (sensor(yaw_deg=3.0), "sensors.laser.yaw_deg: unknown key"),
        (sensor(x="1 m"), "sensors.laser.x: 1 m is no number"),
        (sensor(x=math.nan), "sensors.laser.x:"),
        (sensor(yaw=90), "sensors.laser.yaw: 90 is more than a turn: give the angle in radians"),
        (sensor(roll=1.57), "sensors.laser.roll: 1.57 tilts the scanner out of the plane"),
        (sensor(pitch=0.3), "sensors.laser.pitch: 0.3 tilts the scanner out of the plane"),
        (sensor(pitch=math.pi), "sensors.laser.pitch:"),
        (sensor(topic=""), "sensors.laser.topic: the text is empty"),
        (sensor(inf_is_free="yes"), "sensors.laser.inf_is_free: yes is neither true nor false"),
        (sensor(range_cut=0.0), "sensors.laser.range_cut: 0.0 is out of range"),
        (sensor(range_accuracy=-1), "sensors.laser.range_accuracy: -1 is out of range"),
        (sensor(expected_beams=1), "sensors.laser.expected_beams: 1 is out of range"),
        (sensor(error_codes=16.4), "sensors.laser.error_codes: 16.4 is no list"),
        (sensor(no_return=["a"]), "sensors.laser.no_return[0]: a is no number"),
        (sensor(sees_robots=True), "sensors.laser.sees_robots: unknown key"),
        (
            "sensors:\n  a: {topic: s, x: 0, y: 0, yaw: 0}\n  a: {topic: t, x: 0, y: 0, yaw: 0}\n",
            "given twice",
        ),
        (
            "sensors:\n  a: {topic: /s, x: 0, y: 0, yaw: 0}\n  b: {topic: s, x: 0, y: 0, yaw: 0}\n",
            "also that of a",
        ),
    ],
)
def test_a_sensors_file_that_cannot_be_used(
    text: str, told: str, place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "sensors.yaml"
    file.write_text(text, encoding="utf-8")
    line = refused(capsys, tmp_path, place / "good", "--sensors", file, *ROBOT)
    assert told in line
    assert str(file) in line


def test_a_missing_or_binary_sensors_file(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing, binary = tmp_path / "missing.yaml", tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00sensors")
    for file in (missing, binary, tmp_path):
        assert "cannot be read" in refused(capsys, tmp_path, place / "good", "--sensors", file, *ROBOT)


def test_a_topic_that_the_bag_does_not_have(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "sensors.json"
    file.write_text(sensor(topic="/front"))
    line = refused(capsys, tmp_path, place / "good", "--sensors", file, *ROBOT)
    assert "no topic '/front'; the bag has /pose, /scan" in line


def test_a_topic_of_another_type(place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "sensors.json"
    file.write_text(sensor(topic="/pose"))
    line = refused(capsys, tmp_path, place / "good", "--sensors", file, *ROBOT)
    assert "is a geometry_msgs/msg/PoseStamped, expected sensor_msgs/msg/LaserScan" in line


def test_a_type_that_nobody_knows(place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The same bag, with a name of the same length in place of LaserScan's."""
    bag = tmp_path / "unknown.mcap"
    (source,) = (place / "good").glob("*.mcap")
    content = source.read_bytes()
    assert b"sensor_msgs/msg/LaserScan" in content
    bag.write_bytes(content.replace(b"sensor_msgs/msg/LaserScan", b"sensor_msgs/msg/LazerScan"))
    line = refused(capsys, tmp_path, bag, "--sensors", place / "sensors.json", *ROBOT)
    assert str(bag) in line


def test_truncated_bags(
    place: Path, tmp_path: Path, convert_bag: Callable[[Path, Path], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    ros1 = convert_bag(place / "good", tmp_path / "whole.bag")
    (mcap,) = (place / "good").glob("*.mcap")
    (sqlite,) = convert_bag(place / "good", tmp_path / "sqlite").glob("*.db3")
    for whole in (ros1, mcap, sqlite):
        content = whole.read_bytes()
        for share in (0.0, 0.3, 0.9):
            cut = tmp_path / f"cut{whole.suffix}"
            cut.write_bytes(content[: int(share * len(content))])
            line = refused(capsys, tmp_path, cut, "--sensors", place / "sensors.json", *ROBOT)
            assert str(cut) in line
            cut.unlink()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((*ROBOT, "--start", "99"), "no usable scan on '/scan' from 99 s on; correct --start"),
        ((*ROBOT, "--start", "1.02", "--duration", "0.01"), "from 1.02 to 1.03 s"),
        (
            (*ROBOT, "--speed", "1.0"),
            "boundary_speed 1.2 m/s must be below the speed 1.0 m/s of robot robot_1",
        ),
        ((*ROBOT, "--margin", "0.1"), "safety_margin 0.1 m is below the radius 0.2 m"),
        (
            (*ROBOT, "--interval", "0.12"),
            "sampling interval 0.12 s is no multiple of the control period 0.05 s",
        ),
        ((*ROBOT, "--window", "0"), "'0' is no whole number of at least 1"),
        ((*ROBOT, "--radius", "nan"), "nan must be above 0"),
        (("--robot", "1,2,0", "--robot", "3,2,0", "--goal", "2,2"), "robot 'robot_2' has no goal"),
        ((*ROBOT, "--goal", "3,3"), "2 goals for 1 robots; give every goal a --robot"),
        (("--robot", "a=1,2,0", "--goal", "b=2,2"), "robot 'a' has no goal; add --goal a=X,Y"),
        (("--robot", "a=1,2,0", "--robot", "a=1,2,0", "--goal", "a=2,2"), "--robot: 'a' is given twice"),
        (("--robot", "1,2", "--goal", "2,2"), "'1,2' is not X,Y,HEADING_DEG"),
        (("--robot", "1,2,north", "--goal", "2,2"), "'1,2,north' is not X,Y,HEADING_DEG"),
        (("--robot", "1,2,0", "--goal", "2,inf"), "'2,inf' is not X,Y"),
        (("--robot", "=1,2,0", "--goal", "2,2"), "'=1,2,0' is not X,Y,HEADING_DEG"),
        (("--goal", "2,2"), "required: --robot"),
    ],
)
def test_options_that_cannot_be_used(
    arguments: tuple[str, ...], told: str, place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told in refused(capsys, tmp_path, place / "good", "--sensors", place / "sensors.json", *arguments)


def test_a_directory_with_other_files_is_left_alone(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("text")
    line = refused(capsys, tmp_path, place / "good", "--sensors", place / "sensors.json", *ROBOT)
    assert "holds other files" in line


def test_a_place_that_cannot_be_written_is_told_before_the_replay(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delattr("snnav_ros.bag.run_replay.LiveReplay")
    nowhere = Path("/proc/self/fdinfo")  # where not even root can make a file
    line = refused(capsys, nowhere, place / "good", "--sensors", place / "sensors.json", *ROBOT)
    assert line.startswith(f"snnav: {nowhere / 'out'}: cannot be written (")


def test_what_a_file_may_hold(tmp_path: Path) -> None:
    file = tmp_path / "sensors.yaml"
    file.write_text(
        """
        frame: map
        units: metres, radians
        note: measured twice
        sensors:
          front:   # a comment
            {topic: /front_scan, x: 0.2, y: -1.0e-1, z: 0.3, yaw: 3.141592, pitch: 0.0, roll: -3.141592,
             inf_is_free: true, range_accuracy: 0.03, range_cut: 4, expected_beams: 726, error_codes: [16.375],
             jump_ratio: 4, jump_distance: 0.05, never_repeats: true, no_return: [0, 65.535], note: upside down}
          rear: {topic: rear_scan, x: 0, y: 0, yaw: 0}
        """
    )
    front, rear = read_sensors(file)
    assert (front.sensor.id, front.topic, front.mirrored) == ("front", "/front_scan", True)
    assert front.sensor.pose == Pose2D(0.2, -0.1, 3.141592)
    settings = front.sensor.settings
    assert (settings.inf_is_free, settings.never_repeats) == (True, True)
    assert (settings.range_cut, settings.range_accuracy, settings.expected_beams) == (4.0, 0.03, 726)
    assert (settings.error_codes, front.no_return) == ((16.375,), (0.0, 65.535))
    assert (settings.jump_ratio, settings.jump_distance) == (4.0, 0.05)
    assert not rear.mirrored
    assert not rear.sensor.settings.inf_is_free
