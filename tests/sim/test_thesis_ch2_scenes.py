"""The three simulations of ch. 2 with the global planner against ground truth, and a body that breaks its word."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from snnav_core.planning.spacetime_problem import CandidateOutcome
from snnav_core.types import FloatArray
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.report.record import RunRecord
from snnav_sim.report.separation import separations
from snnav_sim.scene import Scene, find_scene, load_scene
from snnav_sim.simulation import simulate
from snnav_sim.world import World

STATIC, DYNAMIC, TEN = "thesis_ch2_static", "thesis_ch2_dynamic", "thesis_ch2_ten_robots"
# Scene -> safety margin of its table, and how long the run of the thesis took [s], where it is told.
TABLE = {STATIC: (0.6, None), DYNAMIC: (0.8, 27.3), TEN: (0.8, 36.9)}
RUNS = [(STATIC, False), (STATIC, True), (DYNAMIC, False), (DYNAMIC, True), (TEN, False)]
NOISY_TEN = pytest.param(TEN, True, marks=pytest.mark.nightly)


def scene_of(name: str, noise: bool = False) -> Scene:
    scene = load_scene(find_scene(name))
    kind = "lms200" if noise else "none"
    return replace(scene, sensors=tuple(replace(sensor, noise=kind) for sensor in scene.sensors))


@cache
def driven(name: str, noise: bool) -> tuple[RunRecord, dict[str, Any]]:
    scene = scene_of(name, noise)
    record = simulate(scene)
    return record, compute_metrics(scene, record)


def clearances(scene: Scene, record: RunRecord, robot: str) -> tuple[FloatArray, FloatArray]:
    """Rows of a trajectory and the distance to the nearest true body or wall at each."""
    rows = record.trajectory(robot)
    return rows, World(scene).obstacle_clearance(rows[:, 1:3], rows[:, 0])


@pytest.mark.parametrize("name", TABLE)
def test_parameters_of_the_tables(name: str) -> None:
    scene = scene_of(name)
    assert scene.plans_globally
    assert (scene.sampling_interval, scene.safety_margin) == (0.3, TABLE[name][0])
    assert {(robot.speed, robot.max_turn_rate) for robot in scene.robots} == {(0.5, 2.0)}
    assert len(scene.robots) == (10 if name == TEN else 1)


@pytest.mark.parametrize("name", TABLE)
def test_sensors_see_all_that_is_free(name: str) -> None:
    """Then they see every boundary (assumption of ch. 2), at the start and later."""
    world = World(scene_of(name))
    for time in (0.0, 15.0, 30.0):
        unseen = 1.0 - world.true_unoccupied_area(time).area / world.free_region(time).area
        assert unseen < 0.001


def test_bodies_that_move_do_not_run_into_anything() -> None:
    for name in (DYNAMIC, TEN):
        scene = scene_of(name)
        for mover in scene.movers:
            others = replace(scene, movers=tuple(other for other in scene.movers if other is not mover))
            times = np.linspace(0.0, 40.0, 81)
            centres = np.array(mover.start) + times[:, None] * np.array(mover.velocity)
            assert World(others).obstacle_clearance(centres, times).min() > 1.0


@pytest.mark.parametrize(("name", "noise"), [*RUNS, NOISY_TEN])
def test_targets_are_reached_at_the_margin(name: str, noise: bool) -> None:
    scene, (_, metrics) = scene_of(name, noise), driven(name, noise)
    for robot in metrics["robots"].values():
        assert robot["reached"]
        assert robot["least_clearance"] >= scene.safety_margin
        assert robot["margin_violations"] == 0
        assert robot["largest_turn_rate"] <= 2.0
        assert robot["least_area_clearance"] is None, "it keeps clear of bodies, not of what is unseen"


@pytest.mark.parametrize(("name", "noise"), [(TEN, False), NOISY_TEN])
def test_ten_robots_keep_their_distance(name: str, noise: bool) -> None:
    scene, (record, _) = scene_of(name, noise), driven(name, noise)
    apart = separations(scene, record)
    assert apart.least.min() >= 0.8
    rows = [record.trajectory(robot.id) for robot in scene.robots]
    count = min(len(each) for each in rows)
    places = np.stack([each[:count, 1:3] for each in rows])
    gaps = np.hypot(*np.moveaxis(places[:, None] - places[None], 3, 0))
    gaps[np.arange(10), np.arange(10)] = np.inf
    assert gaps.min() >= apart.least.min() - 1e-9, "between centres, along the motion too"


@pytest.mark.parametrize("name", [STATIC, DYNAMIC])
@pytest.mark.parametrize("noise", [False, True])
def test_the_shortest_of_several_homotopy_classes_is_chosen(name: str, noise: bool) -> None:
    plan = driven(name, noise)[0].plans[0][1]
    reached = [one for one in plan.candidates if one.outcome is CandidateOutcome.REACHED]
    assert len(reached) >= 2
    assert len({one.turns for one in reached}) == len(reached), "each makes other turns around bodies"
    assert plan.travel_time == min(one.travel_time for one in reached)


@pytest.mark.parametrize(("name", "noise"), RUNS)
def test_plans_are_near_their_bound_and_told_in_the_metrics(name: str, noise: bool) -> None:
    record, metrics = driven(name, noise)
    for plan in (plan for robot in metrics["robots"].values() for plan in robot["plans"]):
        assert plan["candidates"]["reached"] >= 1
        assert plan["gap"] == pytest.approx(plan["travel_time"] / plan["bound"] - 1.0, abs=1e-3)
        assert plan["gap"] < 0.05
    assert metrics["planner"]["plans"] == len(record.plans)
    assert len(metrics["planner"]["planning_ms"]) >= 1


@pytest.mark.parametrize("name", [DYNAMIC, TEN])
def test_it_takes_about_as_long_as_in_the_thesis(name: str) -> None:
    arrivals = [robot["arrival_time"] for robot in driven(name, False)[1]["robots"].values()]
    assert max(arrivals) == pytest.approx(TABLE[name][1], rel=0.1)


@pytest.mark.parametrize(("name", "noise"), [(DYNAMIC, False), (DYNAMIC, True)])
def test_robots_wait_until_bodies_are_tracked(name: str, noise: bool) -> None:
    record, _ = driven(name, noise)
    first = [decision for decision in record.decisions if decision.time < 0.5]
    assert [decision.reason for decision in first] == ["not_tracked", "not_tracked"]
    assert all("not yet known" in decision.message for decision in first)


def test_a_path_is_given_out_for_a_short_time_only() -> None:
    scene, (record, _) = scene_of(DYNAMIC), driven(DYNAMIC, False)
    window = scene.time_window * scene.sampling_interval
    paths = [decision for decision in record.decisions if decision.path is not None]
    assert all(decision.path.start_time == pytest.approx(decision.time) for decision in paths)
    assert all(decision.time < decision.valid_until <= decision.time + window + 1e-6 for decision in paths)


def test_a_body_that_stops_on_its_way_is_noticed() -> None:
    """Uniform motion is what is promised for; who breaks it costs the margin no longer than until it is noticed."""
    scene = scene_of(DYNAMIC)
    body = scene.movers[1]
    assert body.start is not None
    speed = float(np.hypot(*body.velocity))
    stop = (body.start[0] + 6.0 * body.velocity[0], body.start[1] + 6.0 * body.velocity[1])
    changed = replace(body, start=None, velocity=(0.0, 0.0), waypoints=(body.start, stop), speed=speed)
    scene = replace(scene, movers=(scene.movers[0], changed, *scene.movers[2:]))
    record = simulate(scene)
    assert record.reason == "all robots arrived"
    assert len(record.plans) >= 2, "another plan was made"
    rows, clearance = clearances(scene, record, "robot_1")
    moves = rows[:, 4] > 0.0
    late = 2.0 * scene.sampling_interval * speed
    assert clearance[moves].min() >= scene.safety_margin - late
    assert clearance.min() > scene.robots[0].radius
