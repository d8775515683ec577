"""Metrics of runs made by hand, where every number is known."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from snnav_core.types import Pose2D, TimedPath, VelocityCommand
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.report.record import Decision, RunRecord
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene import Circle, Mover, RobotScene, Scene

ROBOT_KEYS = {
    "reached",
    "arrival_time",
    "travelled_length",
    "optimum_length",
    "least_clearance",
    "least_separation",
    "reason",
}


def drive(
    record: RunRecord, robot: str, y: float, first: float = 2.0, speed: float = 1.0, count: int = 121
) -> None:
    """Add a straight drive in the direction of x, then rest."""
    for tick in range(count):
        moving = speed if tick < count - 1 else 0.0
        record.add_sample(
            robot, 0.05 * tick, Pose2D(first + speed * 0.05 * tick, y, 0.0), VelocityCommand(moving, 0.0)
        )


def straight_run(scene: Scene) -> RunRecord:
    """From (2, 2) to (8, 2) in six seconds."""
    record = RunRecord(scene.seed, reason="all robots arrived")
    drive(record, "r", 2.0)
    path = TimedPath(0.0, 0.5, np.stack((np.linspace(2.0, 8.0, 13), np.full(13, 2.0)), axis=-1))
    record.decisions.append(Decision(0.0, "r", path, planning_distance=0.6))
    record.decisions.append(Decision(6.0, "r", None, "arrived", "robot r is 0.00 m from its target"))
    record.planner_seconds += [9.0, 0.001, 0.002, 0.003]
    record.fusion_seconds += [9.0, 0.004]
    return record


def test_a_straight_run(room: Scene) -> None:
    metrics = compute_metrics(room, straight_run(room))
    robot = metrics["robots"]["r"]
    assert robot.keys() >= ROBOT_KEYS
    assert (robot["reached"], robot["arrival_time"], robot["reason"]) == (True, 6.0, "arrived")
    assert robot["travelled_length"] == pytest.approx(6.0)
    assert robot["optimum_length"] == pytest.approx(6.0)
    assert robot["optimum_ratio"] == pytest.approx(1.0)
    assert robot["optimum_length_planned"] == pytest.approx(6.0)
    assert robot["least_clearance"] == pytest.approx(1.0)  # below the block at y = 3
    assert robot["least_area_clearance"] == pytest.approx(2.0 / 3.0, abs=2e-4)  # a triangle there is unseen
    assert robot["least_separation"] is None
    assert (robot["margin_violations"], robot["area_margin_violations"]) == (0, 0)
    assert robot["remaining_distance"] == 0.0
    assert metrics["planner"]["step_ms"] == {"p50": 2.0, "p99": pytest.approx(2.98), "max": 3.0}
    assert metrics["planner"]["first_step_ms"] == 9000.0
    assert metrics["fusion"]["step_ms"]["max"] == 4.0
    assert (metrics["scene"], metrics["seed"]) == ("room", 0)
    assert {"snnav_sim", "python", "numpy"} <= metrics["versions"].keys()
    json.dumps(metrics, allow_nan=False)


def test_a_run_of_one_step_has_step_times(room: Scene) -> None:
    record = straight_run(room)
    record.planner_seconds[:] = [0.002]
    record.fusion_seconds[:] = [0.003]
    metrics = compute_metrics(room, record)
    assert metrics["planner"]["step_ms"] == {"p50": 2.0, "p99": 2.0, "max": 2.0}
    assert metrics["fusion"]["step_ms"]["max"] == metrics["fusion"]["first_step_ms"] == 3.0


def test_the_margin_is_measured_at_every_sample(room: Scene) -> None:
    record = RunRecord(0, reason="time limit")
    drive(record, "r", 2.6)  # 0.4 m below the block from x = 4 to x = 6
    robot = compute_metrics(room, record)["robots"]["r"]
    assert robot["least_clearance"] == pytest.approx(0.4, abs=2e-4)
    rows = record.trajectory("r")
    inside = np.hypot(np.maximum(0.0, np.abs(rows[:, 1] - 5.0) - 1.0), 0.4) < 0.5
    assert robot["margin_violations"] == inside.sum() > 40
    assert (robot["reached"], robot["arrival_time"]) == (False, None)
    assert robot["reason"] == "no_decision"
    assert robot["optimum_ratio"] is None


def test_a_stop_gives_its_reason_and_a_path_the_reason_of_the_run(room: Scene) -> None:
    record = straight_run(room)
    record.decisions[-1] = Decision(6.0, "r", None, "goal_blocked", "the target is in a wall")
    assert compute_metrics(room, record)["robots"]["r"]["reason"] == "goal_blocked"
    record.decisions.pop()
    record.reason = "time limit of 6 s"
    robot = compute_metrics(room, record)["robots"]["r"]
    assert (robot["reason"], robot["message"]) == ("under_way", "time limit of 6 s")


def test_making_room_after_a_stop_is_not_being_under_way(room: Scene) -> None:
    record = straight_run(room)
    away = replace(record.decisions[-2], source="evasion")
    record.decisions[-2:] = [Decision(5.0, "r", None, "no_progress", "gets nowhere"), away, away]
    robot = compute_metrics(room, record)["robots"]["r"]
    assert (robot["reason"], robot["message"], robot["reached"]) == ("no_progress", "gets nowhere", False)
    record.decisions.append(replace(away, source="warm_start"))
    assert compute_metrics(room, record)["robots"]["r"]["reason"] == "under_way"


def test_arrived_somewhere_else_is_not_reached(room: Scene) -> None:
    scene = replace(room, robots=(replace(room.robots[0], target=(8.0, 6.0)),))
    assert not compute_metrics(scene, straight_run(scene))["robots"]["r"]["reached"]


def test_separation_from_centre_to_the_other_disk(room: Scene) -> None:
    other = RobotScene("q", (8.0, 1.0), math.pi, (2.0, 1.0), 1.0, 1.0, 0.35)
    scene = replace(room, robots=(*room.robots, other))
    record = straight_run(scene)
    drive(record, "q", 1.0, first=8.0, speed=-1.0)
    robots = compute_metrics(scene, record)["robots"]
    assert robots["r"]["least_separation"] == pytest.approx(1.0 - 0.35)  # they meet at x = 5
    assert robots["q"]["least_separation"] == pytest.approx(1.0 - 0.2)


def test_clearance_to_moving_bodies_at_their_time(room: Scene) -> None:
    walker = Mover("w", Circle(0.0, 0.0, 0.25), ((2.0, 1.0), (8.0, 1.0)), speed=1.0)
    scene = replace(room, movers=(walker,), boundary_speed=1.0)
    robot = compute_metrics(scene, straight_run(scene))["robots"]["r"]
    assert robot["least_clearance"] == pytest.approx(0.75)  # side by side all the way
    assert 0.0 < robot["least_area_clearance"] <= 0.75, (
        "what is known to be free ends at the body or before it"
    )
    assert robot["optimum_length"] == pytest.approx(6.0), "the optimum knows no moving bodies"


def test_recorded_networks_measure_to_fused_area_and_returns(recorded: Scene) -> None:
    truth = GroundTruth(recorded)
    points = np.array([[2.0, 1.0], [3.9, 0.1], [2.0, 2.0], [9.0, 9.0]])
    times = np.zeros(4)
    clearance = truth.clearance(points, times)
    area = truth.area_clearance(points, times)[0]
    returns = np.min(np.hypot(*(points[:, None] - truth.returns).T), axis=0)
    assert len(truth.returns) == 5
    assert clearance == pytest.approx(np.minimum(area, returns))
    assert clearance[3] < 0.0
    assert not recorded.robots
    assert compute_metrics(recorded, RunRecord(0, reason="no robots in the scene"))["robots"] == {}
