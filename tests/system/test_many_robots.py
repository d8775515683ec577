"""Robots that want past each other: all arrive, none comes too near to another or to a wall, whoever waits says why."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from snnav_core.types import StopReason
from snnav_sim.campaign.judge import judge
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.report.record import RunRecord
from snnav_sim.report.separation import separations
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene import Scene, find_scene, load_scene
from snnav_sim.simulation import simulate

NARROW = ("corridor_swap", "doorway", "crossing")
SCENES = (*NARROW, "swap20")
# makespan over the time of straight lines through everything, at most
SLOWEST = {"corridor_swap": 3.0, "doorway": 3.5, "crossing": 3.5, "swap20": 3.0}
ABOUT_OTHERS = (StopReason.YIELDS.value, StopReason.BLOCKED_BY_ROBOT.value)
PIECES = 20


@cache
def driven(name: str) -> tuple[Scene, RunRecord, dict[str, Any]]:
    """Run a scene once for all tests."""
    scene = load_scene(find_scene(name))
    record = simulate(scene)
    return scene, record, compute_metrics(scene, record)["robots"]


def straight_time(scene: Scene) -> float:
    return max(math.dist(robot.start, robot.target) / robot.speed for robot in scene.robots)


@pytest.mark.parametrize("name", SCENES)
def test_all_arrive(name: str) -> None:
    scene, record, robots = driven(name)
    assert record.reason == "all robots arrived"
    assert all(robot["reached"] for robot in robots.values())
    makespan = max(robot["arrival_time"] for robot in robots.values())
    assert straight_time(scene) - scene.sampling_interval <= makespan <= SLOWEST[name] * straight_time(scene)


@pytest.mark.parametrize("name", SCENES)
def test_no_two_come_too_near(name: str) -> None:
    scene, record, _ = driven(name)
    assert separations(scene, record).least.min() >= scene.safety_margin


@pytest.mark.parametrize("name", SCENES)
def test_none_comes_too_near_to_a_wall_between_samples_either(name: str) -> None:
    scene, record, _ = driven(name)
    truth = GroundTruth(scene)
    for robot in scene.robots:
        rows = record.trajectory(robot.id)
        times = np.linspace(0.0, rows[-1, 0], PIECES * (len(rows) - 1) + 1)
        points = np.stack([np.interp(times, rows[:, 0], rows[:, axis]) for axis in (1, 2)], axis=-1)
        # a point of the way is at most half a piece, and the bulge of an arc, from one that was looked at
        reach = robot.speed * scene.control_period / PIECES / 2.0
        bulge = robot.speed * robot.max_turn_rate * scene.control_period**2 / 8.0
        assert truth.clearance(points, times).min() - reach - bulge >= scene.safety_margin


@pytest.mark.parametrize("name", SCENES)
def test_whoever_waits_says_for_whom(name: str) -> None:
    scene, record, _ = driven(name)
    names = {robot.id for robot in scene.robots}
    typed = {reason.value for reason in StopReason}
    stops = [decision for decision in record.decisions if decision.path is None]
    assert {stop.reason for stop in stops} <= typed
    waits = [stop for stop in stops if stop.reason in ABOUT_OTHERS]
    assert waits
    for wait in waits:
        assert (names - {wait.robot}) & set(re.findall(r"\w+", wait.message)), wait.message


def test_twenty_robots_start_opposite_their_targets_on_a_circle() -> None:
    scene = load_scene(find_scene("swap20"))
    starts = np.array([robot.start for robot in scene.robots])
    assert starts.shape == (20, 2)
    assert np.hypot(*starts.T) == pytest.approx(15.0, abs=1e-3)
    assert np.array([robot.target for robot in scene.robots]) == pytest.approx(-starts)
    assert {sensor.noise for sensor in scene.sensors} == {"lms200"}


def test_a_corridor_through_ros_gives_the_same_paths(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "snnav_ros.cli", "run", "corridor_swap", "--no-figures", "--out", "ros"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=180)
    assert ended.returncode == 0, ended.stderr
    command = [*command[:-1], "core", "--core"]
    subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=180)
    for name in ("scene.yaml", "trajectories.csv", "paths.csv"):
        assert (tmp_path / "ros" / name).read_bytes() == (tmp_path / "core" / name).read_bytes()


@pytest.mark.nightly
def test_a_hundred_robots() -> None:
    scene = load_scene(find_scene("hundred"))
    assert (len(scene.robots), len(scene.sensors)) == (100, 40)
    record = simulate(scene)
    verdict = judge(scene, record)
    robots = verdict["robots"]
    assert sum(robot["collisions"] + robot["margin_violations"] for robot in robots.values()) == 0
    assert sum(robot["reached"] for robot in robots.values()) >= 95
    assert {robot["reason"] for robot in robots.values()} <= {reason.value for reason in StopReason}
    step = np.array(record.planner_seconds[1:]) + np.array(record.fusion_seconds[1:])
    assert np.percentile(step, 99) < scene.sampling_interval
