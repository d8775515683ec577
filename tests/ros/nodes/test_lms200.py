"""The node of a range finder: what it publishes is what the device measures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from std_srvs.srv import SetBool

from snnav_core.types import Pose2D
from snnav_ros.convert import (
    is_nothing,
    odometry_to_message,
    scan_from_message,
    seconds_from_stamp,
    stamp_message,
)
from snnav_ros.nodes.clock import ClockNode
from snnav_ros.nodes.lms200 import Lms200Node
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import LOCKSTEP, SENSOR
from snnav_sim.devices import SensorFeed, make_device
from snnav_sim.scene import Fault, Scene, dump_scene, find_scene, load_scene, parse_scene
from snnav_sim.world import World

HELLO = load_scene(find_scene("hello"))
TOPIC = "sensors/lms_west/scan"


@pytest.mark.parametrize("seed", [5, 6])
def test_scans_of_lockstep_are_those_of_the_device_and_its_seed(graph: Any, seed: int) -> None:
    heard = graph.hear(LaserScan, TOPIC, LOCKSTEP)
    graph.add(Lms200Node, "lms_west", scene="hello", sensor_id="lms_west", lockstep=True, seed=seed)
    graph.add(ClockNode, lockstep=True, control_period=0.05, sampling_interval=0.5, every_sample=["lms_west"])
    graph.until(lambda: len(heard) >= 8)
    device, other = (make_device(HELLO.sensors[0], World(HELLO), one) for one in (seed, seed + 1))
    assert not np.array_equal(device.scan(0.0).ranges, other.scan(0.0).ranges)
    for number, message in enumerate(heard[:8]):
        ours, theirs = device.scan(0.5 * number), scan_from_message(message)
        np.testing.assert_array_equal(theirs.ranges, ours.ranges)
        assert theirs.stamp == 0.5 * number
        assert (theirs.angle_min, theirs.angle_increment) == (ours.angle_min, ours.angle_increment)
        assert message.header.frame_id == "lms_west"


def test_free_running_scans_are_stamped_with_simulated_time(graph: Any) -> None:
    heard = graph.hear(LaserScan, TOPIC, SENSOR)
    graph.add(Lms200Node, scene="hello", sensor_id="lms_west", use_sim_time=True, scan_period=0.1)
    clock = graph.speak(Clock, "/clock", 1)
    for tick in range(1, 20):
        before = len(heard)
        clock.publish(Clock(clock=stamp_message(tick * 100_000_000)))
        graph.until(lambda before=before: len(heard) > before)
        assert heard[-1].header.stamp == stamp_message(tick * 100_000_000)


def shaky(tmp_path: Path, **changes: Any) -> tuple[Scene, Path]:
    """The scene hello, whose first scanner is changed."""
    scene = replace(HELLO, sensors=(replace(HELLO.sensors[0], **changes), HELLO.sensors[1]))
    file = tmp_path / "shaky.yaml"
    file.write_text(dump_scene(scene), encoding="utf-8")
    return scene, file


@pytest.mark.parametrize("enabled", [True, False])
def test_a_tick_of_lockstep_ends_with_a_scan_of_it_or_a_word(
    graph: Any, tmp_path: Path, enabled: bool
) -> None:
    """Everything that the feed brings is published in order; who is switched off brings nothing but the word."""
    faults = (Fault("delay", seconds=0.3, jitter=0.9, probability=0.5), Fault("duplicate", probability=0.3))
    scene, file = shaky(tmp_path, scan_period=0.2, scan_offset=0.1, faults=faults)
    heard = graph.hear(LaserScan, TOPIC, LOCKSTEP)
    graph.add(Lms200Node, "lms_west", lean=False, scene=str(file), sensor_id="lms_west", lockstep=True)
    if not enabled:
        graph.call(SetBool, "lms_west/enable", SetBool.Request(data=False))
    graph.add(ClockNode, lockstep=True, control_period=0.05, sampling_interval=0.5, every_sample=["lms_west"])
    feed = SensorFeed(make_device(scene.sensors[0], World(scene), scene.seed), 0.2, scene.seed)
    expected: list[tuple[float, int]] = []
    for number in range(12):
        tick = 0.5 * number
        brought = [(scan.stamp, scan.ranges.size) for scan in feed.arrivals(tick)] if enabled else []
        expected += brought if brought and brought[-1][0] == tick else [*brought, (tick, 0)]
    assert any(size == 0 for _, size in expected)
    assert not enabled or any(size == 0 for _, size in expected[1:-1])
    graph.until(lambda: len(heard) >= len(expected))
    got = [(seconds_from_stamp(message.header.stamp), len(message.ranges)) for message in heard]
    assert got[: len(expected)] == expected
    assert all(is_nothing(message) == (size == 0) for message, (_, size) in zip(heard, got, strict=True))


def test_a_scanner_on_the_floor_waits_until_it_knows_where_the_robots_are(graph: Any, tmp_path: Path) -> None:
    """It scans between two ticks too, and sees the robot where it was then."""
    scene, file = shaky(tmp_path, sees_robots=True, scan_period=0.25, noise="none")
    heard = graph.hear(LaserScan, TOPIC, LOCKSTEP)
    done = graph.hear(Header, "lockstep/done", LOCKSTEP)
    graph.add(Lms200Node, "lms_west", scene=str(file), sensor_id="lms_west", lockstep=True)
    ticks, odometry = (
        graph.speak(Clock, "/clock", LOCKSTEP),
        graph.speak(Odometry, "robot_1/odom", LOCKSTEP),
    )
    for number in range(11):
        tick = 50_000_000 * number
        ticks.publish(Clock(clock=stamp_message(tick)))
        graph.work(0.02)
        assert len(done) == number, "not before the odometry of this tick"
        pose = Pose2D(2.0 + 0.1 * number, 3.0, 0.0)
        odometry.publish(odometry_to_message("robot_1", pose, 2.0, 0.0, tick))
        graph.until(lambda number=number: len(done) > number)
    graph.until(lambda: len(heard) >= 3)
    straight = [float(message.ranges[180]) for message in heard]
    assert [seconds_from_stamp(message.header.stamp) for message in heard] == [0.0, 0.25, 0.5]
    radius, start = scene.robots[0].radius, 2.0 - scene.sensors[0].position[0]
    assert straight == pytest.approx([start - radius, start + 0.5 - radius, start + 1.0 - radius], abs=1e-5)


def test_in_real_time_a_delayed_scan_keeps_its_stamp(graph: Any, tmp_path: Path) -> None:
    _, file = shaky(tmp_path, scan_period=0.1, scan_offset=0.02, faults=(Fault("delay", seconds=0.3),))
    heard = graph.hear(LaserScan, TOPIC, SENSOR)
    graph.add(Lms200Node, scene=str(file), sensor_id="lms_west", use_sim_time=True)
    clock = graph.speak(Clock, "/clock", 1)
    for tick in range(1, 21):
        clock.publish(Clock(clock=stamp_message(tick * 50_000_000)))
        if tick >= 8:  # at 0.4 s the scan of 0.02 s is there, and so on
            graph.until(lambda tick=tick: len(heard) >= (50 * tick - 320) // 100 + 1)
        graph.work(0.01)
    stamps = [seconds_from_stamp(message.header.stamp) for message in heard]
    assert stamps == pytest.approx([0.02 + 0.1 * number for number in range(len(stamps))])
    assert len(stamps) == 7, "what was measured at 0.62 s arrived at 0.92 s"


def test_switched_off_it_is_silent_in_real_time(graph: Any) -> None:
    silent = graph.hear(LaserScan, TOPIC, SENSOR)
    graph.add(Lms200Node, "lms_west", lean=False, scene="hello", sensor_id="lms_west", scan_period=0.02)
    graph.until(lambda: len(silent) >= 2)
    graph.call(SetBool, "lms_west/enable", SetBool.Request(data=False))
    count = len(silent)
    graph.work(0.2)
    assert len(silent) == count


def test_recorded_scan_is_repeated(graph: Any, tmp_path: Path) -> None:
    text = dump_scene(HELLO).split("obstacles:")[0] + (
        "robots: []\n"
        "sensors:\n  - {id: log_1, device: recorded, position: [1, 3], heading_deg: 0, resolution_deg: 1.0, "
        "range_max: 81.0, no_return: unknown, angle_min_deg: -1.0, ranges: [1.25, 2.5, 81.9]}\n"
    )
    file = tmp_path / "log.yaml"
    file.write_text(dump_scene(parse_scene(text, "log.yaml")), encoding="utf-8")
    heard = graph.hear(LaserScan, "sensors/log_1/scan", LOCKSTEP)
    graph.add(Lms200Node, "log_1", scene=str(file), lockstep=True)
    graph.add(ClockNode, lockstep=True, control_period=0.05, sampling_interval=0.5, every_sample=["log_1"])
    graph.until(lambda: len(heard) >= 3)
    assert [list(message.ranges[:2]) for message in heard[:3]] == [[1.25, 2.5]] * 3


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({}, "scene: is not given"),
        ({"scene": "hello"}, "sensor_id: value '' names no sensor of hello; it has lms_west, lms_east"),
        ({"scene": "hello", "sensor_id": "x"}, "sensor_id: value 'x' names no sensor"),
        ({"scene": "hello", "sensor_id": "lms_west", "seed": -1}, "seed: value -1 lies outside"),
        (
            {"scene": "hello", "sensor_id": "lms_west", "scan_period": 0.0},
            "scan_period: value 0.0 lies outside",
        ),
    ],
)
def test_mistakes_end_it_at_its_start(graph: Any, parameters: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        graph.add(Lms200Node, **parameters)
