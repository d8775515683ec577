"""Separation along the motion: against robots whose distance is known in closed form, and against many small steps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_core.motion.unicycle import step_unicycle
from snnav_core.types import Pose2D, VelocityCommand
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.report.record import RunRecord
from snnav_sim.report.separation import separations
from snnav_sim.scene_types import Polygon, RobotScene, Scene

PERIOD = 0.05


def with_robots(scene: Scene, *radii: float) -> Scene:
    robots = (
        RobotScene(f"r{index}", (1.0 + index, 1.0), 0.0, (8.0, 1.0), 1.0, 1.0, radius)
        for index, radius in enumerate(radii)
    )
    return replace(scene, robots=tuple(robots))


def drive(record: RunRecord, robot: str, pose: Pose2D, motions: list[tuple[float, float]]) -> None:
    for tick, (speed, turn_rate) in enumerate([*motions, (0.0, 0.0)]):
        motion = VelocityCommand(speed, turn_rate)
        record.add_sample(robot, tick * PERIOD, pose, motion)
        pose = step_unicycle(pose, motion.speed, motion.turn_rate, PERIOD)


def test_between_samples_too(room: Scene) -> None:
    """Two robots that pass head-on between two samples, 0.8 m apart."""
    scene, record = with_robots(room, 0.3, 0.2), RunRecord(0)
    drive(record, "r0", Pose2D(2.0, 2.0, 0.0), [(1.0, 0.0)] * 20)
    drive(record, "r1", Pose2D(2.95, 2.8, math.pi), [(1.0, 0.0)] * 20)
    apart = separations(scene, record)
    at_samples = min(math.hypot(0.95 - 2.0 * PERIOD * tick, 0.8) for tick in range(21))
    assert at_samples > 0.8004
    assert apart.least.min(axis=1) == pytest.approx([0.8 - 0.2, 0.8 - 0.3], abs=1e-9)
    assert np.all(apart.nearest == [[1], [0]])
    robots = compute_metrics(scene, record)["robots"]
    assert robots["r0"]["least_separation"] == pytest.approx(0.6, abs=1.1e-4)


@given(
    st.lists(st.tuples(st.floats(0.0, 1.5), st.floats(-2.0, 2.0)), min_size=1, max_size=12),
    st.lists(st.tuples(st.floats(0.0, 1.5), st.floats(-2.0, 2.0)), min_size=1, max_size=12),
    st.floats(-3.1, 3.1),
)
def test_never_more_than_it_was(
    first: list[tuple[float, float]], second: list[tuple[float, float]], heading: float
) -> None:
    """Against positions at every hundredth of a control period, on the exact arcs."""
    count, fine = max(len(first), len(second)), 100
    ways = []
    record = RunRecord(0)
    for name, pose, motions in (
        ("r0", Pose2D(0.0, 0.0, 0.0), first),
        ("r1", Pose2D(1.2, 0.3, heading), second),
    ):
        motions = [*motions, *[(0.0, 0.0)] * (count - len(motions))]
        drive(record, name, pose, motions)
        points = []
        for speed, turn_rate in motions:
            for _ in range(fine):
                points.append((pose.x, pose.y))
                pose = step_unicycle(pose, speed, turn_rate, PERIOD / fine)
        ways.append(np.array([*points, (pose.x, pose.y)]))
    true = float(np.hypot(*(ways[0] - ways[1]).T).min())
    scene = with_robots(_EMPTY, 0.2, 0.2)
    found = float(separations(scene, record).least.min()) + 0.2
    assert found <= true + 1e-9
    assert found >= true - 2e-3 * PERIOD - 2e-4


def test_far_robots_count_and_absent_ones_do_not(room: Scene) -> None:
    scene, record = with_robots(room, 0.3, 0.2, 0.1, 0.1), RunRecord(0)
    drive(record, "r0", Pose2D(9.0, 5.0, 0.0), [(0.0, 0.0)] * 9)
    drive(record, "r1", Pose2D(2.0, 5.0, 0.0), [(0.0, 0.0)] * 3)
    drive(record, "r2", Pose2D(2.0, 4.0, 0.0), [(0.0, 0.0)] * 9)
    del record.samples["r2"][:6]
    apart = separations(scene, record)
    assert apart.least[0, :4] == pytest.approx(7.0 - 0.2), "r1 is there for three periods"
    assert np.all(np.isinf(apart.least[0, 4:6]))
    assert apart.least[0, 6:] == pytest.approx(math.hypot(7.0, 1.0) - 0.1), "then r2 joins"
    assert np.all(np.isinf(apart.least[1, 4:]))
    assert np.all(np.isinf(apart.least[3]))
    assert apart.at(1, record.trajectory("r1")[:, 0]) == pytest.approx(7.0 - 0.3), "at its own samples"
    assert apart.nearest[0].tolist() == [1] * 4 + [-1] * 2 + [2] * 4


def test_a_robot_alone(room: Scene) -> None:
    scene, record = with_robots(room, 0.3), RunRecord(0)
    drive(record, "r0", Pose2D(2.0, 2.0, 0.0), [(1.0, 0.0)] * 3)
    assert np.all(np.isinf(separations(scene, record).least))
    assert separations(replace(scene, robots=()), RunRecord(0)).least.shape[0] == 0


_EMPTY = Scene("empty", 0.5, Polygon(((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))), 0.5, ())
