"""The simulations of ch. 4 are flown as the thesis says, measured against ground truth every 0.05 s."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from snnav_sim.report.flight_metrics import (
    compute_flight_metrics,
    flight_clearances,
    flight_separations,
)
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.scene import SpaceScene, find_scene, load_any_scene
from snnav_sim.simulation_flight import FlightSimulation

# d_s, V_max, T, cameras, people, robots as in the thesis (T is irrelevant where V_max is 0, C3-35)
TABLE = {
    "thesis_ch4_static": (0.5, 0.0, 6, 12, 0, 1),
    "thesis_ch4_dynamic": (0.7, 0.26, 6, 6, 4, 1),
    "thesis_ch4_four_robots": (0.6, 0.0, 6, 3, 0, 4),
}
ALL = ("thesis_ch4_tracking", *TABLE)


def scene_of(name: str) -> SpaceScene:
    scene = load_any_scene(find_scene(name))
    assert isinstance(scene, SpaceScene)
    return scene


@cache
def fly(name: str, seed: int | None = None) -> FlightRecord:
    return FlightSimulation(scene_of(name), seed).run()


def metrics_of(name: str) -> dict[str, Any]:
    robots: dict[str, Any] = compute_flight_metrics(scene_of(name), fly(name))["robots"]
    return robots


@pytest.mark.parametrize("name", TABLE)
def test_the_scene_is_the_one_of_the_thesis(name: str) -> None:
    scene = scene_of(name)
    found = (scene.safety_margin, scene.boundary_speed, scene.time_window)
    counts = (len(scene.sensors), len(scene.movers), len(scene.robots))
    assert (*found, *counts) == TABLE[name]
    assert (scene.sampling_interval, scene.control_period) == (0.2, 0.05)
    assert all((robot.speed, robot.max_turn_rate) == (0.7, 2.0) for robot in scene.robots)
    for sensor in scene.sensors:
        assert (sensor.columns, sensor.rows, sensor.range_max) == (128, 128, 9.0)
        np.testing.assert_allclose(np.degrees([sensor.width, sensor.height]), 135.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_all_arrive_and_keep_the_margin(name: str) -> None:
    scene, record = scene_of(name), fly(name)
    for robot in scene.robots:
        rows = record.trajectory(robot.id)
        np.testing.assert_allclose(np.diff(rows[:, 0]), 0.05)
        assert np.linalg.norm(rows[-1, 1:4] - robot.target) <= 0.14
        assert flight_clearances(scene, record)[robot.id].min() >= scene.safety_margin
        assert flight_separations(scene, record)[robot.id].min() >= scene.safety_margin
        assert metrics_of(name)[robot.id]["reached"]
        assert rows[-1, 6] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_robots_stay_within_their_limits_and_on_their_paths(name: str) -> None:
    for robot in scene_of(name).robots:
        rows = fly(name).trajectory(robot.id)
        assert rows[:, 7].max() <= 2.0 + 1e-9
        speeds = rows[:, 6]
        assert speeds.max() <= 0.7 + 1e-9
        assert (
            (speeds > 0.0) & (speeds < 0.7 - 1e-9)
        ).sum() <= 1  # the last period ends at the end of the path
        assert metrics_of(name)[robot.id]["tracking_error_settled"] <= 0.05


def test_the_curve_is_reached_from_beside_it() -> None:
    errors = np.array(fly("thesis_ch4_tracking").errors["bee"])
    assert errors[0, 1] > 0.3
    assert errors[errors[:, 0] >= 3.0, 1].max() <= 0.05


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [2, 3, 4, 5])
@pytest.mark.parametrize("name", TABLE)
def test_other_samples_lead_there_as_well(name: str, seed: int) -> None:
    robots = compute_flight_metrics(scene_of(name), fly(name, seed))["robots"].values()
    assert all(robot["reached"] for robot in robots)
    assert not any(robot["margin_violations"] + robot["separation_violations"] for robot in robots)
