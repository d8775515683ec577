"""The node of a range finder: what it publishes is what the device measures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_srvs.srv import SetBool

from snnav_ros.convert import scan_from_message, stamp_message
from snnav_ros.nodes.clock import ClockNode
from snnav_ros.nodes.lms200 import Lms200Node
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import LOCKSTEP, SENSOR
from snnav_sim.devices import make_device
from snnav_sim.scene import dump_scene, find_scene, load_scene, parse_scene
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


def test_switched_off_it_sees_nothing_in_lockstep(graph: Any) -> None:
    heard = graph.hear(LaserScan, TOPIC, LOCKSTEP)
    graph.add(Lms200Node, "lms_west", lean=False, scene="hello", sensor_id="lms_west", lockstep=True)
    graph.call(SetBool, "lms_west/enable", SetBool.Request(data=False))
    graph.add(ClockNode, lockstep=True, control_period=0.05, sampling_interval=0.5, every_sample=["lms_west"])
    graph.until(lambda: len(heard) >= 3)
    assert all(np.isnan(message.ranges).all() for message in heard)


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
