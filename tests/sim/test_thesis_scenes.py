"""The scenes and experiments of ch. 3 are driven as the thesis says, measured against ground truth."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from snnav_sim.report.metrics import compute_metrics
from snnav_sim.report.record import RunRecord
from snnav_sim.scene import Scene, find_scene, load_scene
from snnav_sim.simulation import simulate
from snnav_sim.world import World

STATIC = ("thesis_ch3_scene1", "thesis_ch3_scene2")
MOVING = ("thesis_ch3_scene3", "thesis_ch3_scene4")
EXPERIMENTS = ("thesis_ch3_experiment1", "thesis_ch3_experiment2", "thesis_ch3_experiment3")
ALL = (*STATIC, *MOVING, *EXPERIMENTS)

# speed, u_M, R_s, d_s, V_max, T as in the tables of ch. 3 (T is irrelevant and the default where V_max is 0, C3-35)
TABLE = {
    "thesis_ch3_scene1": (1.0, 0.5, 15.0, 1.0, 0.5, 4),
    "thesis_ch3_scene2": (1.0, 0.5, 15.0, 1.0, 0.5, 4),
    "thesis_ch3_scene3": (1.0, 0.5, 50.0, 3.0, 0.5, 7),
    "thesis_ch3_scene4": (1.0, 0.5, 50.0, 3.0, 0.5, 7),
    "thesis_ch3_experiment1": (0.3, 1.2, 8.0, 0.5, 0.0, 4),
    "thesis_ch3_experiment2": (0.3, 1.2, 8.0, 0.6, 0.0, 4),
    "thesis_ch3_experiment3": (0.5, 2.0, 8.0, 0.5, 0.4, 2),
}
# when the robot arrives in the figures of the thesis [s], where they tell
ARRIVALS = {
    "thesis_ch3_scene3": 78.0,
    "thesis_ch3_scene4": 89.0,
    "thesis_ch3_experiment1": 66.0,
    "thesis_ch3_experiment2": 42.0,
    "thesis_ch3_experiment3": 54.0,
}


def scene_of(name: str, noise: bool = False) -> Scene:
    scene = load_scene(find_scene(name))
    if not noise:
        return scene
    return replace(scene, sensors=tuple(replace(sensor, noise="lms200") for sensor in scene.sensors))


@cache
def driven(name: str, noise: bool) -> tuple[RunRecord, dict[str, Any]]:
    """Run a scene once for all tests."""
    scene = scene_of(name, noise)
    record = simulate(scene)
    return record, compute_metrics(scene, record)["robots"]["robot_1"]


@pytest.mark.parametrize("name", ALL)
def test_parameters_of_the_table(name: str) -> None:
    scene = scene_of(name)
    (robot,) = scene.robots
    (reach,) = {sensor.range_max for sensor in scene.sensors}
    found = (
        robot.speed,
        robot.max_turn_rate,
        reach,
        scene.safety_margin,
        scene.boundary_speed,
        scene.time_window,
    )
    assert found == TABLE[name]
    assert (scene.sampling_interval, robot.radius) == (1.0, 0.3)
    assert {sensor.noise for sensor in scene.sensors} == {"none"}


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_three_scanners_of_180_degrees_on_the_floor(name: str) -> None:
    scene = scene_of(name)
    assert len(scene.sensors) == 3
    assert all(sensor.sees_robots and sensor.beams == 361 for sensor in scene.sensors)
    assert (scene.robots[0].start, scene.robots[0].heading) == ((0.0, 0.0), 0.0)


def test_as_many_bodies_as_the_thesis_has() -> None:
    bodies = {name: len(scene_of(name).movers) for name in (*MOVING, *EXPERIMENTS)}
    assert bodies == dict(zip((*MOVING, *EXPERIMENTS), (4, 3, 0, 0, 2), strict=True))
    assert len(scene_of("thesis_ch3_scene3").sensors) == 4


@pytest.mark.parametrize("noise", [False, True], ids=["exact", "noisy"])
@pytest.mark.parametrize("name", ALL)
def test_the_target_is_reached_at_the_margin(name: str, noise: bool) -> None:
    scene, (_, robot) = scene_of(name, noise), driven(name, noise)
    assert robot["reached"]
    assert robot["least_clearance"] >= scene.safety_margin
    assert robot["margin_violations"] == 0
    assert robot["largest_turn_rate"] <= scene.robots[0].max_turn_rate
    if not noise:
        assert robot["least_area_clearance"] >= scene.safety_margin
        assert robot["area_margin_violations"] == 0


@pytest.mark.parametrize("noise", [False, True], ids=["exact", "noisy"])
@pytest.mark.parametrize("name", [*STATIC, *EXPERIMENTS[:2]])
def test_among_things_at_rest_the_way_is_short(name: str, noise: bool) -> None:
    assert driven(name, noise)[1]["optimum_ratio_planned"] <= 1.05


@pytest.mark.parametrize("name", ARRIVALS)
def test_it_takes_about_as_long_as_in_the_thesis(name: str) -> None:
    assert driven(name, False)[1]["arrival_time"] == pytest.approx(ARRIVALS[name], rel=0.2)


@pytest.mark.parametrize("name", [*MOVING, EXPERIMENTS[2]])
def test_bodies_bend_the_way(name: str) -> None:
    """The straight way, or the way round what stands, would have been too near to a body at some time."""
    scene, (record, robot) = scene_of(name), driven(name, False)
    assert robot["travelled_length"] > 1.005 * robot["optimum_length"]
    entry = scene.robots[0]
    times = np.arange(0.0, math.dist(entry.start, entry.target) / entry.speed, 0.1)
    share = (times * entry.speed / math.dist(entry.start, entry.target))[:, None]
    straight = np.array(entry.start) + share * (np.array(entry.target) - np.array(entry.start))
    assert World(scene).obstacle_clearance(straight, times).min() < scene.safety_margin
    assert len(record.decisions) > 10


def test_the_second_scene_is_the_first_with_fewer_sensors() -> None:
    first, second = (scene_of(name) for name in STATIC)
    assert (first.obstacles, first.robots, first.border) == (second.obstacles, second.robots, second.border)
    assert len(second.sensors) < len(first.sensors)


def test_the_third_scene_is_seen_and_the_fourth_is_not() -> None:
    """The part of the free space that no sensor sees, over time (C3-34: a matter of where the sensors stand)."""
    unseen = {}
    for name in MOVING:
        world = World(scene_of(name))
        shares = [
            1.0 - world.true_unoccupied_area(time).area / world.free_region(time).area
            for time in np.linspace(0.0, 80.0, 9).tolist()
        ]
        unseen[name] = max(shares)
    assert unseen[MOVING[0]] < 0.01
    assert unseen[MOVING[1]] > 0.1
