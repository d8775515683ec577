"""A recorded run comes out the same when fusion and planner get its messages again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("nav_msgs", reason="the message packages of ROS 2 are not installed")

from snnav_core.area.fusion import AreaFusion
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.types import PlannedPath
from snnav_ros.bag.errors import BagError
from snnav_ros.bag.replay import STOP, replay
from snnav_ros.bag.writer import BagWriter
from snnav_ros.convert import (
    area_from_message,
    area_to_message,
    nanoseconds,
    odometry_to_message,
    path_to_message,
    scan_from_message,
    scan_to_message,
    state_from_message,
    stop_to_path,
)
from snnav_sim.configure import fusion_settings, navigator_settings, planar_sensor
from snnav_sim.devices import make_device
from snnav_sim.scene import Scene, SceneError, dump_scene, find_scene, load_scene
from snnav_sim.simulation import Simulation
from snnav_sim.world import World


def short_scene() -> Scene:
    return replace(load_scene(find_scene("hello")), time_limit=3.0)


def record(directory: Path, scene: Scene, nudge: float = 0.0, leave_out: str = "") -> Path:
    """Drive the closed loop by messages, as the nodes do, and record them; `nudge` falsifies recorded odometry."""
    sim, world = Simulation(scene), World(scene)
    devices = [make_device(sensor, world, scene.seed) for sensor in scene.sensors]
    fusion = AreaFusion([planar_sensor(sensor) for sensor in scene.sensors], fusion_settings(scene))
    navigator = GroundNavigator([robot.spec for robot in scene.robots], navigator_settings(scene))
    goals = {robot.id: robot.target for robot in scene.robots}
    directory.mkdir()
    (directory / "scene.yaml").write_text(dump_scene(scene))
    with BagWriter(directory / "bag") as bag:

        def write(topic: str, message, stamp: int) -> None:
            if topic != leave_out:
                bag.write(topic, message, stamp)

        while sim.time < scene.time_limit:
            stamp = nanoseconds(sim.time)
            for device in devices:
                message = scan_to_message(device.scan(sim.time), device.sensor.id, stamp)
                write(f"sensors/{device.sensor.id}/scan", message, stamp)
                fusion.add_scan(device.sensor.id, scan_from_message(message))
            area: UnoccupiedArea = fusion.area(sim.time)
            write("unoccupied_area", area_to_message(area), stamp)
            states = {}
            for name, robot in sim._robots.items():
                pose, speed = robot.base.pose, robot.base.command.speed
                message = odometry_to_message(name, pose, speed, 0.0, stamp)
                states[name] = state_from_message(message, name)
                message.pose.pose.position.x += nudge
                write(f"{name}/odom", message, stamp)
            result = navigator.step(sim.time, area_from_message(area_to_message(area)), states, goals)
            for name, decision in result.decisions.items():
                planned = isinstance(decision, PlannedPath)
                path = path_to_message(decision.path) if planned else stop_to_path(stamp)
                write(f"{name}/path", path, stamp)
                sim._robots[name].follow(decision)
            for _ in range(scene.ticks_per_sample):
                sim.move()
    return directory / "bag"


def test_the_same_areas_and_paths_come_out(tmp_path: Path) -> None:
    result = replay(record(tmp_path / "run", short_scene()))
    assert result.differences == []
    assert len(result.steps) == 6
    assert result.path_count == 6
    assert len({step.recorded["robot_1"] for step in result.steps}) > 1


def test_two_robots_and_a_stop_come_out_the_same(tmp_path: Path) -> None:
    scene = short_scene()
    (robot,) = scene.robots
    second = replace(robot, id="robot_2", start=(8.0, 4.5), target=(5.0, 2.6))  # into the pillar
    result = replay(record(tmp_path / "run", replace(scene, robots=(robot, second))))
    assert result.differences == []
    assert {step.replayed["robot_2"] for step in result.steps} == {STOP}


def test_a_change_is_found_and_named(tmp_path: Path) -> None:
    moved = replay(record(tmp_path / "moved", short_scene(), nudge=0.01))
    assert any("path of robot_1 was" in line for line in moved.differences)
    assert all(step.same_area for step in moved.steps)
    scene = short_scene()
    bag = record(tmp_path / "run", scene)
    shifted = [replace(sensor, position=(sensor.position[0], 3.05)) for sensor in scene.sensors]
    other = replay(bag, replace(scene, sensors=tuple(shifted)))
    assert "0.000 s: the unoccupied area differs" in other.differences


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    bag = record(tmp_path / "run", short_scene(), leave_out="robot_1/odom")
    with pytest.raises(BagError, match="no topic 'robot_1/odom'; the bag has"):
        replay(bag)
    bag = record(tmp_path / "blind", short_scene(), leave_out="sensors/lms_east/scan")
    with pytest.raises(BagError, match="no topic 'sensors/lms_east/scan'"):
        replay(bag)
    (tmp_path / "blind" / "scene.yaml").unlink()
    with pytest.raises(SceneError, match=r"scene\.yaml"):
        replay(bag)
