"""A simulated robot among people that were recorded: the small recording is made here, the walker is known."""

from __future__ import annotations

import csv
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from snnav_core.types import Pose2D, RobotSpec
from snnav_ros.bag.live_replay import LiveReplay, ReplayRobot
from snnav_ros.bag.messages import laser_scan, pose_stamped
from snnav_ros.bag.recorded_scans import Recording, read_recording
from snnav_ros.bag.sensors_file import read_sensors
from snnav_ros.bag.settings import ReplaySettings
from snnav_ros.bag.writer import BagWriter
from snnav_ros.cli import main
from snnav_sim.devices import make_device
from snnav_sim.report.record import RunRecord
from snnav_sim.scene import parse_scene
from snnav_sim.world import World

EPOCH = 1_600_000_000  # [s]
START, GOAL = "1.2,2.5,0", "6.8,2.5"
SLOW = ("--boundary-speed", "0.9", "--speed", "1.2", "--window", "8")

HALL = """
name: hall
description: a hall with a walker to and fro across the way
seed: 3
sampling_interval: 0.1
control_period: 0.05
time_window: 3
boundary_speed: 0.9
safety_margin: 0.25
time_limit: 20.0
workspace: {polygon: [[0, 0], [8, 0], [8, 5], [0, 5]]}
obstacles: []
movers:
  - {id: walker, circle: [0, 0, 0.2], waypoints: [[4, 0.8], [4, 4.2]], speed: 0.8, loop: true}
sensors:
  - {id: west, device: lms200, position: [0.1, 0.1], heading_deg: 45,
     field_of_view_deg: 100, resolution_deg: 1.0, range_max: 12.0, noise: none}
  - {id: east, device: lms200, position: [7.9, 4.9], heading_deg: 225,
     field_of_view_deg: 100, resolution_deg: 1.0, range_max: 12.0, noise: none}
robots: []
"""

PERIODS = {"west": (0.1, 0.0), "east": (0.13, 0.04)}  # [s] from scan to scan, and to the first one

Edit = Callable[[str, Any], Any]


def record_hall(
    directory: Path, duration: float = 9.0, edit: Edit = lambda _, message: message, lag: float = 0.03
) -> Path:
    """Record the hall as rosbag2 (MCAP); `edit` gets the sensor and each message and returns what is written."""
    scene = parse_scene(HALL, "hall")
    world = World(scene)
    found = []
    for sensor in scene.sensors:
        device = make_device(sensor, world, scene.seed)
        period, offset = PERIODS[sensor.id]
        for time in np.arange(offset, duration, period).tolist():
            scan = device.scan(time)
            stamp = round((EPOCH + time) * 1e6) * 1000
            message = laser_scan(
                stamp, sensor.id, scan.ranges, scan.angle_min, scan.angle_increment, scan.range_max, 0.02
            )
            found.append((stamp + round(lag * 1e9), f"{sensor.id}/scan", edit(sensor.id, message)))
    with BagWriter(directory) as bag:
        for stamp, topic, message in sorted(found, key=lambda one: one[:2]):
            bag.write(topic, message, stamp)
        bag.write("pose", pose_stamped(0, "map", Pose2D(0.0, 0.0, 0.0)), stamp)
    return directory


def hall_sensors() -> dict[str, Any]:
    """Return what the sensors file of the hall holds."""
    return {
        "frame": "map",
        "units": "metres, radians",
        "note": "as built",
        "sensors": {
            "west": {"topic": "/west/scan", "x": 0.1, "y": 0.1, "z": 0.3, "yaw": math.radians(45)},
            "east": {"topic": "east/scan", "x": 7.9, "y": 4.9, "yaw": math.radians(225), "roll": 0.0},
        },
    }


def write_sensors(path: Path, content: Any = None) -> Path:
    """Write a sensors file (JSON, which is YAML)."""
    path.write_text(json.dumps(hall_sensors() if content is None else content), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a directory with ``bag`` and ``sensors.json``; tests only read it."""
    place = tmp_path_factory.mktemp("hall")
    record_hall(place / "bag")
    write_sensors(place / "sensors.json")
    return place


def replayed(bag: Path, out: Path, *more: str, sensors: Path | None = None) -> int:
    """Run the command, with robot and goal unless others are given."""
    robots = () if "--robot" in more else ("--robot", START, "--goal", GOAL)
    sensors = sensors or bag.parent / "sensors.json"
    arguments = ("replay", bag, "--sensors", sensors, *robots, *SLOW, "--no-figures", "--out", out, *more)
    return main([str(argument) for argument in arguments])


def run_core(recording: Recording, sensors: Path, robot: str = START, **settings: Any) -> RunRecord:
    chosen = ReplaySettings(boundary_speed=0.9, speed=1.2, time_window=8, **settings)
    x, y, heading = map(float, robot.split(","))
    spec = RobotSpec("robot_1", chosen.radius, chosen.speed, chosen.max_turn_rate)
    goal_x, goal_y = map(float, GOAL.split(","))
    robots = [ReplayRobot(spec, Pose2D(x, y, heading), (goal_x, goal_y))]
    return LiveReplay(read_sensors(sensors), recording, robots, chosen).run().run


def test_it_crosses_the_way_of_a_walker(
    hall: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, bag = tmp_path / "out", record_hall(tmp_path / "bag", 14.0)  # it lets the walker pass more than once
    assert replayed(bag, out, sensors=hall / "sensors.json") == 0
    told = capsys.readouterr()
    assert "all robots arrived" in told.out
    assert f"run directory: {out}" in told.out
    assert told.err == ""
    metrics = json.loads((out / "metrics.json").read_text())
    robot = metrics["robots"]["robot_1"]
    assert robot["reached"]
    assert robot["returns_in_disk_moving"] == robot["returns_in_disk_standing"] == 0
    # At full speed straight ahead it would be at the walker's way when he is in the middle of it.
    assert 0.25 - 0.2 <= robot["nearest_person"]["distance"] < 2.0
    assert robot["least_clearance"] == pytest.approx(robot["nearest_return"]["distance"] + 0.2)
    assert metrics["refused_scans"] == {}
    assert metrics["outrun"]["returns"] == 0
    with (out / "trajectories.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert math.dist((float(rows[-1]["x"]), float(rows[-1]["y"])), (6.8, 2.5)) < 0.2
    assert_allclose(np.diff([float(row["time"]) for row in rows]), 0.05, atol=1e-6)
    with (out / "paths.csv").open() as file:
        assert {row["robot"] for row in csv.DictReader(file)} == {"robot_1"}
    assert json.loads((out / "sensors.json").read_text()) == hall_sensors()
    assert json.loads((out / "replay.json").read_text())["settings"]["boundary_speed"] == 0.9


def test_every_kind_of_bag_gives_the_same_run(
    hall: Path, tmp_path: Path, convert_bag: Callable[[Path, Path], Path]
) -> None:
    ros1 = convert_bag(hall / "bag", tmp_path / "hall.bag")
    sqlite = convert_bag(hall / "bag", tmp_path / "sqlite")
    (database,) = sqlite.glob("*.db3")
    (mcap,) = (hall / "bag").glob("*.mcap")
    runs = {}
    for number, bag in enumerate((hall / "bag", mcap, ros1, sqlite, database)):
        out = tmp_path / str(number)
        assert replayed(bag, out, "--duration", "3", sensors=hall / "sensors.json") == 0
        runs[bag] = (out / "paths.csv").read_bytes() + (out / "trajectories.csv").read_bytes()
    assert len(set(runs.values())) == 1


def test_figures_are_drawn_and_an_earlier_replay_is_replaced(hall: Path, tmp_path: Path) -> None:
    sensors, out = hall / "sensors.json", tmp_path / "out"
    arguments = ["replay", str(hall / "bag"), "--sensors", str(sensors), "--robot", START, "--goal", GOAL]
    arguments += [*SLOW, "--out", str(out)]
    assert main([*arguments, "--no-figures", "--duration", "1"]) == 0
    assert list((out / "figures").iterdir()) == []
    assert main(arguments) == 0
    for name in ("replay.png", "clearance.png"):
        assert (out / "figures" / name).stat().st_size > 20_000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]


def test_two_robots_go_to_and_fro(hall: Path, tmp_path: Path) -> None:
    robots = ("--robot", "near=1.0,1.2,0", "--goal", "far=6.5,4.0", "--robot", "far=6.5,1.5,90")
    out = tmp_path / "out"
    assert replayed(hall / "bag", out, *robots, "--goal", "near=2.5,1.2", "--to-and-fro") == 0
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["reason"] == "the recording is over"
    near, far = metrics["robots"]["near"], metrics["robots"]["far"]
    assert near["arrivals"] >= 2
    assert far["arrivals"] >= 2
    assert near["returns_in_disk_moving"] == far["returns_in_disk_moving"] == 0
    assert near["least_separation"] == pytest.approx(far["least_separation"])
    assert near["least_separation"] > 0.25


def test_a_robot_that_stays_is_judged_at_its_goal_to_the_end(hall: Path, tmp_path: Path) -> None:
    """The goal is where the walker comes by: whoever stands there is walked over, whoever is gone is not."""
    robots = ("--robot", "1.2,2.5,0", "--goal", "3.6,2.5", "--radius", "0.25")
    found = {}
    for name, more in (("gone", ()), ("stays", ("--stay",))):
        assert replayed(hall / "bag", tmp_path / name, *robots, *more) == 0
        found[name] = json.loads((tmp_path / name / "metrics.json").read_text())
    gone, stays = (found[name]["robots"]["robot_1"] for name in ("gone", "stays"))
    assert found["gone"]["reason"] == "all robots arrived"
    assert found["stays"]["reason"] == "the recording is over"
    assert found["stays"]["duration"] > 8.8 > found["gone"]["duration"]
    assert stays["arrivals"] == gone["arrivals"] == 1
    assert stays["arrival_time"] == gone["arrival_time"]
    assert stays["reason"] == "arrived"
    assert stays["returns_in_disk_moving"] == 0
    assert stays["returns_in_disk_standing"] > gone["returns_in_disk_standing"] == 0


def test_to_and_fro_and_staying_exclude_each_other(
    hall: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as error:
        replayed(hall / "bag", tmp_path / "out", "--to-and-fro", "--stay")
    assert error.value.code == 2
    assert "not allowed with" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_coordinates_may_be_negative(hall: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert replayed(hall / "bag", out, "--robot", "-1,-2,0", "--goal", "-1.5,2", "--duration", "1") == 0
    robot = json.loads((out / "metrics.json").read_text())["robots"]["robot_1"]
    assert (robot["reached"], robot["reason"]) == (False, "start_blocked")
    assert robot["shares"] == {"start_blocked": 1.0}


def test_a_decision_knows_nothing_of_what_comes_later(hall: Path) -> None:
    sensors = hall / "sensors.json"
    whole = run_core(read_recording(hall / "bag", read_sensors(sensors)), sensors)
    part = run_core(read_recording(hall / "bag", read_sensors(sensors), duration=2.0), sensors)
    until = part.decisions[-1].time
    assert 1.8 < until <= 2.01
    assert part.digests() == [line for line in whole.digests() if float(line.split()[0]) <= until]


def test_a_scan_takes_part_once_it_has_arrived(tmp_path: Path) -> None:
    """What is recorded half a second late is known half a second later; the stamps are the same."""
    sensors = write_sensors(tmp_path / "sensors.json")
    found = {}
    for name, lag in (("soon", 0.03), ("late", 0.53)):
        bag = record_hall(tmp_path / name, 2.0, lag=lag)
        recording = read_recording(bag, read_sensors(sensors))
        assert_allclose([scan.arrival - scan.scan.stamp for scan in recording.scans], lag, atol=1e-5)
        found[name] = run_core(recording, sensors)
    assert found["late"].decisions[0].time == pytest.approx(found["soon"].decisions[0].time + 0.5)


def test_a_recorder_with_another_clock_does_not_matter(hall: Path, tmp_path: Path) -> None:
    """Stamps count, then: a scan came at the end of its sweep."""
    sensors = read_sensors(hall / "sensors.json")
    plain = read_recording(hall / "bag", sensors)
    for name, lag in (("behind", -3.0), ("ahead", 1000.0)):
        recording = read_recording(record_hall(tmp_path / name, lag=lag), sensors)
        stamps = [scan.scan.stamp for scan in plain.scans]
        assert [scan.arrival for scan in recording.scans] == sorted(stamps)


def test_a_sweep_takes_its_time(tmp_path: Path) -> None:
    sensors = read_sensors(write_sensors(tmp_path / "sensors.json"))

    def slow(_: str, message: Any) -> Any:
        return replace(message, time_increment=0.0005)

    recording = read_recording(record_hall(tmp_path / "bag", 1.0, slow, lag=-0.2), sensors)
    for scan in recording.scans:
        assert scan.arrival == pytest.approx(scan.scan.stamp + 100 * 0.0005)
        assert scan.beam_times[-1] == pytest.approx(scan.arrival)


def test_a_scanner_upside_down_sees_the_same(hall: Path, tmp_path: Path) -> None:
    def upside_down(sensor: str, message: Any) -> Any:
        if sensor == "east":
            return message
        low, high = message.angle_min, message.angle_min + 100 * message.angle_increment
        return replace(message, ranges=message.ranges[::-1].copy(), angle_min=-high, angle_max=-low)

    content = hall_sensors()
    content["sensors"]["west"]["roll"] = math.pi
    sensors = write_sensors(tmp_path / "sensors.json", content)
    bag = record_hall(tmp_path / "bag", 3.0, upside_down)
    turned = LiveReplay(
        read_sensors(sensors), read_recording(bag, read_sensors(sensors)), [], ReplaySettings()
    )
    plain_sensors = read_sensors(hall / "sensors.json")
    recording = read_recording(hall / "bag", plain_sensors, duration=3.0)
    plain = LiveReplay(plain_sensors, recording, [], ReplaySettings())
    for first, second in zip(turned.run().areas, plain.run().areas, strict=False):
        assert first.region.symmetric_difference(second.region).area < 1e-4
        assert first.region.area > 20.0


def test_readings_that_mean_nothing_came_back(tmp_path: Path) -> None:
    """A device says 0 for it; told so, it sees free space up to the range that it is trusted for."""

    def short_sighted(_: str, message: Any) -> Any:
        return replace(message, ranges=np.where(message.ranges > 4.0, 0.0, message.ranges).astype(np.float32))

    bag = record_hall(tmp_path / "bag", 1.0, short_sighted)
    areas = {}
    for name, more in (
        ("unknown", {}),
        ("infinite", {"no_return": [0.0]}),
        ("free", {"no_return": [0.0], "inf_is_free": True, "range_cut": 3.5}),
    ):
        content = hall_sensors()
        for entry in content["sensors"].values():
            entry.update(more)
        sensors = read_sensors(write_sensors(tmp_path / f"{name}.json", content))
        replay = LiveReplay(sensors, read_recording(bag, sensors), [], ReplaySettings())
        areas[name] = replay.run().areas[-1].region
    assert areas["unknown"].area == pytest.approx(areas["infinite"].area)
    assert areas["free"].area > areas["unknown"].area + 3.0


def test_scans_that_cannot_be_used_are_left_out_with_a_warning(
    hall: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    count = 0

    def spoil(sensor: str, message: Any) -> Any:
        nonlocal count
        count += sensor == "west"
        if sensor == "west" and count == 5:
            return replace(message, angle_increment=math.nan)
        if sensor == "west" and count == 9:
            header = replace(message.header, stamp=replace(message.header.stamp, sec=EPOCH + 10**8))
            return replace(message, header=header)
        return message

    bag = record_hall(tmp_path / "bag", 2.0, spoil)
    assert replayed(bag, tmp_path / "out", sensors=hall / "sensors.json") == 0
    told = capsys.readouterr()
    assert told.err.count("\n") == 1
    assert "2 scans of west left out" in told.err
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["scans"] == {"west": 18, "east": 16}
    assert metrics["duration"] < 3.0


def test_scans_out_of_order_are_refused_and_counted(
    hall: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    count = 0

    def shuffle(sensor: str, message: Any) -> Any:
        nonlocal count
        count += sensor == "west"
        if sensor == "west" and count == 12:
            stamp = replace(message.header.stamp, sec=EPOCH, nanosec=500_000_000)
            return replace(message, header=replace(message.header, stamp=stamp))
        return message

    bag = record_hall(tmp_path / "bag", 2.0, shuffle)
    assert replayed(bag, tmp_path / "out", sensors=hall / "sensors.json") == 0
    assert "1 scans of west refused" in capsys.readouterr().err
    assert json.loads((tmp_path / "out" / "metrics.json").read_text())["refused_scans"] == {"west": 1}


def test_it_runs_where_ros_is_not_installed(hall: Path, tmp_path: Path) -> None:
    code = (
        "import sys\nfor name in ('rclpy', 'nav_msgs', 'sensor_msgs'): sys.modules[name] = None\n"
        "from snnav_ros.cli import main\nsys.exit(main(sys.argv[1:]))"
    )
    arguments = ["replay", hall / "bag", "--sensors", hall / "sensors.json", "--robot", START, "--goal", GOAL]
    arguments += [*SLOW, "--duration", "1", "--no-figures", "--out", tmp_path / "out"]
    command = [sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=120, env=dict(os.environ)
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "metrics.json").is_file()


def test_an_interrupt_leaves_nothing_behind(
    hall: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    decide, times = LiveReplay._decide, []

    def interrupted(self: LiveReplay) -> None:
        times.append(self.time)
        if len(times) == 5:
            raise KeyboardInterrupt
        decide(self)

    monkeypatch.setattr(LiveReplay, "_decide", interrupted)
    assert replayed(hall / "bag", tmp_path / "out") == 130
    assert capsys.readouterr().err == "snnav: interrupted\n"
    assert list(tmp_path.iterdir()) == []
