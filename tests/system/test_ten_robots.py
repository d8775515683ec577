"""Ten robots of which some join, leave or are sent elsewhere: the same paths without ROS, with it, and as processes."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from snnav_ros.bringup import run_scene
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.report.record import RunRecord
from snnav_sim.report.write import write_tables
from snnav_sim.scene import Scene, find_scene, load_scene
from snnav_sim.simulation import simulate


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(find_scene("ten_robots"))


@pytest.fixture(scope="module")
def alone(scene: Scene) -> RunRecord:
    return simulate(scene)


def digest(record: RunRecord, folder: Path) -> str:
    write_tables(folder, record)
    return hashlib.sha1((folder / "paths.csv").read_bytes()).hexdigest()


def check_safety(scene: Scene, record: RunRecord) -> None:
    robots = compute_metrics(scene, record)["robots"]
    gone = {robot.id for robot in scene.robots if robot.leaves_at < scene.time_limit}
    assert record.reason == "all robots arrived or left"
    assert all(robot["reached"] for name, robot in robots.items() if name not in gone)
    assert all(robot["margin_violations"] == 0 for robot in robots.values())
    assert all(robot["least_separation"] >= scene.safety_margin for robot in robots.values())


@pytest.mark.slow
@pytest.mark.parametrize("processes", [False, True])
def test_the_paths_are_the_same_through_ros(
    scene: Scene, alone: RunRecord, processes: bool, tmp_path: Path
) -> None:
    assert len(scene.robots) == 10
    assert sum(robot.joins_at > 0.0 for robot in scene.robots) == 2
    assert sum(robot.leaves_at < scene.time_limit for robot in scene.robots) == 2
    assert sum(bool(robot.retargets) for robot in scene.robots) == 2
    check_safety(scene, alone)
    assert digest(run_scene(scene, processes=processes), tmp_path) == digest(alone, tmp_path)


@pytest.mark.slow
def test_two_planner_processes_serve_it_with_the_same_safety(scene: Scene) -> None:
    check_safety(scene, run_scene(scene, processes=True, planners=2))
