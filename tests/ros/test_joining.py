"""Robots that join, leave and are sent elsewhere in mid-run, through one planner node and through several."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from snnav_core.errors import InvalidInput
from snnav_ros.bringup import run_scene, share_robots
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.report.record import RunRecord
from snnav_sim.scene import Retarget, Scene, find_scene, load_scene
from snnav_sim.simulation import simulate

HELLO = load_scene(find_scene("hello"))


def shift() -> Scene:
    """One is sent back on its way, one joins and meets it, one stands in the way and leaves; scanners on the floor."""
    (first,) = HELLO.robots
    first = replace(first, start=(1.2, 4.6), target=(8.8, 4.6), retargets=(Retarget(4.0, (1.5, 1.0)),))
    second = replace(
        first, id="late", start=(8.6, 1.0), target=(1.2, 4.0), heading=np.pi, retargets=(), joins_at=1.7
    )
    third = replace(first, id="guest", start=(4.5, 4.8), target=(4.5, 5.2), retargets=(), leaves_at=5.1)
    sensors = tuple(replace(sensor, sees_robots=True) for sensor in HELLO.sensors)
    return replace(HELLO, sensors=sensors, robots=(first, second, third), time_limit=12.0)


def differences(one: RunRecord, other: RunRecord) -> list[str]:
    """Return what of two runs is not the same to the last bit."""
    found = [] if one.digests() == other.digests() else ["paths"]
    if one.samples.keys() != other.samples.keys():
        found.append("robots")
    elif not all(np.array_equal(one.trajectory(name), other.trajectory(name)) for name in one.samples):
        found.append("trajectories")
    areas = (
        [(time, region.wkb) for time, region in one.areas],
        [(time, region.wkb) for time, region in other.areas],
    )
    return found if areas[0] == areas[1] else [*found, "areas"]


@pytest.fixture(scope="module")
def alone() -> RunRecord:
    return simulate(shift())


def test_the_run_without_ros_has_all_events(alone: RunRecord) -> None:
    times = {name: (rows[0][0], rows[-1][0]) for name, rows in alone.samples.items()}
    assert times["late"][0] == 2.0
    assert times["guest"][1] == pytest.approx(5.5 - HELLO.control_period)
    assert sum(decision.path is not None for decision in alone.decisions_of("late")) > 5
    metrics = compute_metrics(shift(), alone)["robots"]
    assert all(robot["margin_violations"] == 0 for robot in metrics.values())
    assert all((robot["least_separation"] or 9.0) >= HELLO.safety_margin for robot in metrics.values())


@pytest.mark.parametrize("processes", [False, True])
def test_the_same_run_through_nodes_in_lockstep(alone: RunRecord, processes: bool) -> None:
    through_nodes = run_scene(shift(), processes=processes)
    assert differences(through_nodes, alone) == []
    assert len(through_nodes.planner_seconds) == len(alone.planner_seconds)


@pytest.mark.parametrize("planners", [2, 3])
def test_several_planners_give_the_same_run_again_and_keep_the_robots_apart(planners: int) -> None:
    """It is not that of one planner for ever: each has its own mind about who was blocked for how long."""
    scene = shift()
    one, other = (
        run_scene(scene, planners=planners),
        run_scene(scene, planners=planners, processes=planners == 2),
    )
    assert differences(one, other) == []
    metrics = compute_metrics(scene, one)["robots"]
    assert sum(decision.path is not None for decision in one.decisions) > 20
    assert all(robot["margin_violations"] == 0 for robot in metrics.values())
    assert all((robot["least_separation"] or 9.0) >= scene.safety_margin for robot in metrics.values())
    assert len(one.planner_seconds) == planners * len(one.fusion_seconds)


def test_in_real_time_two_planners_keep_the_robots_apart() -> None:
    scene = shift()
    record = run_scene(scene, realtime=True, planners=2)
    metrics = compute_metrics(scene, record)["robots"]
    assert sum(decision.path is not None for decision in record.decisions) > 10
    assert all(robot["margin_violations"] == 0 for robot in metrics.values())
    assert all((robot["least_separation"] or 9.0) >= scene.safety_margin for robot in metrics.values())
    assert record.samples["guest"][-1][0] < 6.0
    assert 1.9 < record.samples["late"][0][0] < 2.6


def test_robots_are_shared_in_the_order_in_which_they_join() -> None:
    scene = shift()
    assert share_robots(scene, 1) == {"planner_node": ["robot_1", "guest", "late"]}
    shares = share_robots(scene, 2)
    assert list(shares) == ["planner_1", "planner_2"]
    assert [name for robots in shares.values() for name in robots] == ["robot_1", "guest", "late"]
    assert all(shares.values())
    for wrong in (0, 4):
        with pytest.raises(InvalidInput, match=f"{wrong} planners for 3 robots; give 1 to 3"):
            share_robots(scene, wrong)
