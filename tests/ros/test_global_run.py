"""Scenes with the global planner through the nodes: the same paths without ROS, in one process and in several."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from snnav_core.errors import InvalidInput
from snnav_ros.bag.reader import BagReader
from snnav_ros.bringup import run_scene
from snnav_ros.convert import obstacles_from_message
from snnav_sim.report.record import RunRecord
from snnav_sim.scene import parse_scene
from snnav_sim.simulation import simulate

SCENE = parse_scene(
    """
name: passer_by
description: A body crosses the way of one robot; another one is on its own
sampling_interval: 0.3
boundary_speed: 0.3
safety_margin: 0.6
seed: 1
planner: global
time_limit: 20.0
workspace: {polygon: [[0, 0], [12, 0], [12, 9], [0, 9]]}
movers:
  - {id: walker, circle: [0, 0, 0.3], start: [5.0, 6.6], velocity: [0.0, -0.2]}
sensors:
  - {id: west, device: lms200, position: [0.1, 4.5], heading_deg: 0, field_of_view_deg: 180, resolution_deg: 0.5,
     range_max: 20.0, noise: lms200, sees_robots: true}
  - {id: east, device: lms200, position: [11.9, 4.5], heading_deg: 180, field_of_view_deg: 180, resolution_deg: 0.5,
     range_max: 20.0, noise: lms200, sees_robots: true}
robots:
  - {id: robot_1, start: [2.5, 4.0], heading_deg: 0, target: [7.0, 4.0], speed: 0.5, max_turn_rate: 2.0, radius: 0.3}
  - {id: robot_2, start: [10.0, 6.5], heading_deg: 180, target: [8.0, 6.5], speed: 0.5, max_turn_rate: 2.0, radius: 0.3}
""",
    "passer_by",
)


@pytest.fixture(scope="module")
def alone() -> RunRecord:
    return simulate(SCENE)


@pytest.mark.parametrize("processes", [False, True], ids=["one process", "processes"])
def test_same_paths_with_and_without_ros(alone: RunRecord, processes: bool, tmp_path: Path) -> None:
    assert sum(decision.path is not None for decision in alone.decisions) > 10
    record = run_scene(SCENE, processes=processes, bag=tmp_path / "bag")
    assert record.reason == alone.reason
    assert record.digests() == alone.digests()
    for name in alone.samples:
        np.testing.assert_array_equal(record.trajectory(name), alone.trajectory(name))
    assert [time for time, _ in record.plans] == [time for time, _ in alone.plans]
    for (_, ours), (_, theirs) in zip(record.plans, alone.plans, strict=True):
        assert ours.path.digest() == theirs.path.digest()
        assert ours.certificate == theirs.certificate
        assert [one.turns for one in ours.candidates] == [one.turns for one in theirs.candidates]
        assert ours.gap == theirs.gap
    with BagReader(tmp_path / "bag") as bag:
        messages = [(entry.stamp_ns, entry.message) for entry in bag.messages(["/obstacles"])]
    samples = len(record.fusion_seconds)
    assert [stamp for stamp, _ in messages] == [300_000_000 * k for k in range(samples)]
    moving = [body for _, message in messages for body in obstacles_from_message(message) if body.speed > 0.0]
    assert moving
    assert np.median([body.speed for body in moving]) == pytest.approx(0.2, rel=0.1)


def test_one_global_planner_serves_all() -> None:
    with pytest.raises(InvalidInput, match="one global planner serves all; give 1"):
        run_scene(SCENE, planners=2)
