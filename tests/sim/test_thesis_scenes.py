"""The first two scenes of ch. 3 are driven as the thesis says, measured against ground truth."""

from __future__ import annotations

from dataclasses import replace

import pytest

from snnav_sim.report.metrics import compute_metrics
from snnav_sim.scene import Scene, find_scene, load_scene
from snnav_sim.simulation import simulate

SCENES = ("thesis_ch3_scene1", "thesis_ch3_scene2")


def with_noise(scene: Scene) -> Scene:
    return replace(scene, sensors=tuple(replace(sensor, noise="lms200") for sensor in scene.sensors))


@pytest.mark.parametrize("name", SCENES)
def test_parameters_of_the_table(name: str) -> None:
    scene = load_scene(find_scene(name))
    (robot,) = scene.robots
    assert (robot.speed, robot.max_turn_rate, scene.sampling_interval) == (1.0, 0.5, 1.0)
    assert (scene.safety_margin, scene.boundary_speed, scene.time_window) == (1.0, 0.5, 4)
    assert {sensor.range_max for sensor in scene.sensors} == {15.0}
    assert {sensor.noise for sensor in scene.sensors} == {"none"}


@pytest.mark.parametrize("noise", [False, True], ids=["exact", "noisy"])
@pytest.mark.parametrize("name", SCENES)
def test_the_target_is_reached_at_the_margin_by_a_short_way(name: str, noise: bool) -> None:
    scene = load_scene(find_scene(name))
    scene = with_noise(scene) if noise else scene
    robot = compute_metrics(scene, simulate(scene))["robots"]["robot_1"]
    assert robot["reached"]
    assert robot["least_clearance"] >= scene.safety_margin
    assert robot["largest_turn_rate"] <= scene.robots[0].max_turn_rate
    assert robot["optimum_ratio_planned"] <= 1.05
    if not noise:
        assert robot["least_area_clearance"] >= scene.safety_margin


def test_the_second_scene_is_the_first_with_fewer_sensors() -> None:
    first, second = (load_scene(find_scene(name)) for name in SCENES)
    assert (first.obstacles, first.robots, first.border) == (second.obstacles, second.robots, second.border)
    assert len(second.sensors) < len(first.sensors)
