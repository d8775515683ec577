"""The node of a depth camera: what it publishes is what the device measures; with the fusion, the run without ROS."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import SetBool

from snnav_core.area.spatial import SpatialArea
from snnav_core.flight_types import FlyerState
from snnav_ros.convert import (
    flight_to_message,
    image_from_message,
    is_no_cloud,
    nanoseconds_from_stamp,
    seconds_from_stamp,
    spatial_area_from_message,
    stamp_message,
)
from snnav_ros.nodes.clock import ClockNode
from snnav_ros.nodes.fusion import FusionNode
from snnav_ros.nodes.tof import TofNode
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import CLOUDS, LOCKSTEP, SENSOR, VOLUMES
from snnav_sim.devices import SensorFeed
from snnav_sim.devices.tof import DepthDevice
from snnav_sim.scene import Fault, SpaceScene, dump_scene, parse_any_scene
from snnav_sim.simulation_flight import FlightSimulation
from snnav_sim.space_world import SpaceWorld

ROOM = """
name: room
seed: 3
sampling_interval: 0.2
time_window: 4
boundary_speed: 0.2
safety_margin: 0.4
workspace: {box: [[0, 0, 0], [4, 3, 2]]}
obstacles:
  - {box: [[1.9, 0, 0], [2.1, 3, 2]], holes: [[[1.9, 0.8, 0.4], [2.1, 2.2, 1.6]]], known_static: true}
movers:
  - {id: cat, box: [[-0.2, -0.1, 0], [0.2, 0.1, 0.3]], waypoints: [[0.5, 0.5, 0], [1.5, 0.5, 0]], speed: 0.2,
     loop: true}
sensors:
  - {id: west, device: tof, position: [0.1, 0.1, 1.9], look_at: [1.2, 2, 0.8], columns: 48, rows: 48, noise: tof,
     drop_out: 0.02}
  - {id: east, device: spinning, position: [3, 2.9, 1], columns: 72, rows: 24, range_max: 2.5, no_return: free}
robots:
  - {id: bee, start: [0.6, 1.5, 1], curve: [[0.6, 1.5, 1], [2, 1.5, 1], [3.4, 1.8, 1.2]], heading_deg: 0, speed: 0.7,
     max_turn_rate: 2.0, radius: 0.15}
"""


def scene_of(**west: Any) -> SpaceScene:
    scene = parse_any_scene(ROOM, "room.yaml")
    assert isinstance(scene, SpaceScene)
    return replace(scene, sensors=(replace(scene.sensors[0], **west), *scene.sensors[1:]))


def written(scene: SpaceScene, folder: Path) -> str:
    file = folder / "room.yaml"
    file.write_text(dump_scene(scene), encoding="utf-8")
    return str(file)


def hover(stamp: int) -> Odometry:
    """The robot where the camera does not see it, at rest."""
    state = FlyerState("bee", np.array([2.6, 0.3, 0.3]), np.array([1.0, 0.0, 0.0]), stamp / 10**9)
    return flight_to_message(state, np.zeros(3), stamp)


class Lockstep:
    """A tof node and the ticks and odometry that it waits for."""

    def __init__(self, graph: Any, scene: SpaceScene, folder: Path, **parameters: Any) -> None:
        self.graph = graph
        self.heard = graph.hear(PointCloud2, "sensors/west/points", CLOUDS)
        self.done = graph.hear(Header, "lockstep/done", LOCKSTEP)
        file = written(scene, folder)
        given = {"scene": file, "sensor_id": "west", "lockstep": True, **parameters}
        graph.add(TofNode, "west", lean=False, **given)
        self.clock = graph.speak(Clock, "/clock", LOCKSTEP)
        self.odom = graph.speak(Odometry, "bee/odom", LOCKSTEP)

    def go(self, tick: int) -> None:
        """Let the robot say where it is, and wait for the end of a tick."""
        count = len(self.done)
        self.clock.publish(Clock(clock=stamp_message(tick)))
        self.odom.publish(hover(tick))
        self.graph.until(lambda: len(self.done) > count, "the end of the tick")


@pytest.mark.parametrize("seed", [5, 6])
def test_images_of_lockstep_are_those_of_the_device_and_its_seed(
    graph: Any, tmp_path: Path, seed: int
) -> None:
    scene = scene_of()
    steps = Lockstep(graph, scene, tmp_path, seed=seed)
    for number in range(4):
        steps.go(200_000_000 * number)
    graph.until(lambda: len(steps.heard) >= 4)
    device, other = (DepthDevice(scene.sensors[0], SpaceWorld(scene), one) for one in (seed, seed + 1))
    camera = scene.sensors[0].camera
    assert not np.array_equal(device.scan(0.0).ranges, other.scan(0.0).ranges)
    for number, message in enumerate(steps.heard):
        image = image_from_message(message, camera)
        ours = device.scan(0.2 * number)
        assert image.stamp == ours.stamp
        np.testing.assert_array_equal(image.measured(camera.model), ours.measured(camera.model))
        assert np.isnan(image.ranges).any()
        assert message.header.frame_id == "west"


@pytest.mark.parametrize("enabled", [True, False])
def test_a_tick_of_lockstep_ends_with_a_cloud_of_it_or_a_word(
    graph: Any, tmp_path: Path, enabled: bool
) -> None:
    faults = (Fault("delay", seconds=0.2, jitter=0.4, probability=0.5), Fault("duplicate", probability=0.3))
    scene = scene_of(scan_period=0.15, scan_offset=0.05, faults=faults)
    steps = Lockstep(graph, scene, tmp_path)
    if not enabled:
        graph.call(SetBool, "west/enable", SetBool.Request(data=False))
    feed = SensorFeed(DepthDevice(scene.sensors[0], SpaceWorld(scene), scene.seed), 0.15, scene.seed)
    expected: list[tuple[float, int]] = []
    for number in range(12):
        tick = round(0.2 * number, 9)
        steps.go(200_000_000 * number)
        brought = [(image.stamp, image.ranges.size) for image in feed.arrivals(tick)] if enabled else []
        expected += brought if brought and brought[-1][0] == tick else [*brought, (tick, 0)]
    assert any(size == 0 for _, size in expected)
    graph.until(lambda: len(steps.heard) >= len(expected))
    got = [(seconds_from_stamp(one.header.stamp), one.width * one.height) for one in steps.heard]
    assert got == expected
    assert all(is_no_cloud(one) == (size == 0) for one, (_, size) in zip(steps.heard, got, strict=True))


def test_it_waits_until_it_knows_where_the_robots_are_and_sees_them_there(graph: Any, tmp_path: Path) -> None:
    steps = Lockstep(graph, scene_of(noise="none", drop_out=0.0), tmp_path)
    camera = scene_of().sensors[0].camera
    ahead = camera.position + camera.rotation[:, 0]
    steps.go(0)
    state = FlyerState("bee", ahead, np.array([1.0, 0.0, 0.0]), 0.2)
    steps.clock.publish(Clock(clock=stamp_message(200_000_000)))
    graph.work(0.1)
    assert len(steps.done) == 1, "not before the odometry of this tick"
    steps.odom.publish(flight_to_message(state, np.zeros(3), 200_000_000))
    graph.until(lambda: len(steps.done) == 2)
    graph.until(lambda: len(steps.heard) == 2)
    without, with_robot = (image_from_message(one, camera).ranges[23, 23] for one in steps.heard)
    assert without > 1.5
    assert with_robot == pytest.approx(0.85, abs=0.01)


def test_free_running_images_are_stamped_with_simulated_time(graph: Any, tmp_path: Path) -> None:
    heard = graph.hear(PointCloud2, "sensors/west/points", SENSOR)
    file = written(scene_of(), tmp_path)
    graph.add(TofNode, scene=file, sensor_id="west", use_sim_time=True, scan_period=0.1)
    clock = graph.speak(Clock, "/clock", 1)
    for tick in range(1, 10):
        before = len(heard)
        clock.publish(Clock(clock=stamp_message(tick * 100_000_000)))
        graph.until(lambda before=before: len(heard) > before)
        assert heard[-1].header.stamp == stamp_message(tick * 100_000_000)


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({}, "scene: is not given"),
        ({"scene": "hello"}, "scene: names a scene in the plane; this node serves scenes in space"),
        ({"scene": "hello_flight"}, "sensor_id: value '' names no sensor of hello_flight"),
        ({"scene": "hello_flight", "sensor_id": "x"}, "sensor_id: value 'x' names no sensor"),
    ],
)
def test_mistakes_end_it_at_its_start(graph: Any, parameters: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        graph.add(TofNode, **parameters)


class Told:
    """A run without ROS: its areas, and what its robot said at every tick."""

    def __init__(self, scene: SpaceScene, samples: int) -> None:
        simulation = FlightSimulation(scene)
        fuse, add = simulation.fusion.area, simulation.fusion.add_state
        self.areas: list[SpatialArea] = []
        self.states: list[FlyerState] = [simulation._flyers["bee"].state(0.0)]

        def area(time: float) -> SpatialArea:
            self.areas.append(fuse(time))
            return self.areas[-1]

        def add_state(state: FlyerState) -> None:
            self.states.append(state)
            add(state)

        simulation.fusion.area, simulation.fusion.add_state = area, add_state  # type: ignore[method-assign]
        for _ in range(samples):
            simulation.decide()
            for _ in range(scene.ticks_per_sample):
                simulation.move()
        self.rejected = {name: count for name, (count, _) in simulation.record.rejected.items()}


FAULTS = (
    Fault("delay", seconds=0.25, probability=0.3),
    Fault("duplicate", probability=0.3),
    Fault("frozen", probability=0.15),
    Fault("clock_offset", seconds=0.3, probability=0.15),
    Fault("reorder", probability=0.2),
)


@pytest.mark.parametrize("faults", [(), FAULTS], ids=["healthy", "faulty"])
def test_the_area_of_the_nodes_is_that_of_the_run_without_ros_bit_by_bit(
    graph: Any, tmp_path: Path, faults: tuple[Fault, ...]
) -> None:
    samples = 12
    scene = scene_of(faults=faults, scan_period=0.07, scan_offset=0.03) if faults else scene_of()
    told = Told(scene, samples)
    heard = graph.hear(PointCloud2, "unoccupied_area", VOLUMES)
    diagnostics = graph.hear(DiagnosticArray, "/diagnostics", LOCKSTEP)
    done = graph.hear(Header, "lockstep/done", LOCKSTEP)
    file = written(scene, tmp_path)
    for sensor in scene.sensors:
        graph.add(TofNode, sensor.id, scene=file, sensor_id=sensor.id, lockstep=True)
    graph.add(FusionNode, scene=file, lockstep=True)
    graph.add(
        ClockNode, lockstep=True, control_period=0.05, sampling_interval=0.2,
        every_sample=["west", "east", "fusion_node"], every_tick=["robot"],
    )  # fmt: skip
    odom = graph.speak(Odometry, "bee/odom", LOCKSTEP, listeners=3)
    finished = graph.speak(Header, "lockstep/done", LOCKSTEP)
    for state in told.states[: 4 * samples - 3]:
        tick = round(state.stamp * 20) * 50_000_000
        odom.publish(flight_to_message(state, np.zeros(3), tick))
        finished.publish(Header(stamp=stamp_message(tick), frame_id="robot"))
        if tick % 200_000_000 == 0:
            graph.until(
                lambda tick=tick: any(
                    one.frame_id == "fusion_node" and nanoseconds_from_stamp(one.stamp) == tick
                    for one in done
                ),
                f"the fusion at {tick}",
            )
    graph.until(lambda: len(heard) >= samples)
    for ours, theirs in zip(told.areas, map(spatial_area_from_message, heard), strict=True):
        assert theirs.stamp == ours.stamp
        assert (theirs.moving > 0.0).any()
        assert theirs.moving.tobytes() == ours.moving.tobytes()
        assert theirs.static.tobytes() == ours.static.tobytes()
    last = {one.hardware_id: one for one in diagnostics[-1].status if one.name.startswith("sensor ")}
    rejected = {
        name: int(next(pair.value for pair in one.values if pair.key == "rejected"))
        for name, one in last.items()
    }
    assert {name: count for name, count in rejected.items() if count} == told.rejected
    assert bool(told.rejected) == bool(faults)
