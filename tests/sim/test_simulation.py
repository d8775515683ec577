"""The closed loop without ROS."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from snnav_sim.ending import EndWatch
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.scene import Circle, Mover, Scene, find_scene, load_scene
from snnav_sim.simulation import simulate


def test_hello_reaches_its_target_with_the_margin_kept() -> None:
    scene = load_scene(find_scene("hello"))
    seen: list[tuple[float, int]] = []
    record = simulate(scene, progress=lambda time, arrived: seen.append((time, arrived)))
    robot = compute_metrics(scene, record)["robots"]["robot_1"]
    assert robot["reached"]
    assert robot["margin_violations"] == 0
    assert robot["largest_turn_rate"] <= scene.robots[0].max_turn_rate
    assert record.reason == "all robots arrived"
    assert seen[-1] == (robot["arrival_time"], 1)
    assert [time for time, _ in seen] == pytest.approx(np.arange(len(seen)) * scene.sampling_interval)


def test_same_seed_same_paths_other_seed_other_paths() -> None:
    scene = replace(load_scene(find_scene("hello")), time_limit=2.0)
    first, second, other = simulate(scene), simulate(scene), simulate(scene, seed=2)
    assert first.digests() == second.digests()
    assert first.digests() != other.digests()
    assert first.samples == second.samples
    assert (first.seed, other.seed) == (1, 2)


def test_samples_are_one_control_period_apart_and_end_at_rest(room: Scene) -> None:
    record = simulate(room)
    rows = record.trajectory("r")
    assert np.diff(rows[:, 0]) == pytest.approx(np.full(len(rows) - 1, room.control_period))
    assert rows[-1, 4] == 0.0
    assert (
        np.hypot(*np.diff(rows[:, 1:3], axis=0).T).max() <= room.robots[0].speed * room.control_period + 1e-9
    )
    assert record.reason == "all robots arrived"


def test_a_target_in_a_wall_ends_the_run_with_a_typed_reason(room: Scene) -> None:
    scene = replace(room, robots=(replace(room.robots[0], target=(5.0, 4.0)),))
    record = simulate(scene)
    robot = compute_metrics(scene, record)["robots"]["r"]
    assert (robot["reached"], robot["reason"]) == (False, "goal_blocked")
    assert robot["travelled_length"] == 0.0
    assert record.reason == "no way on for 30 sampling intervals (r: goal_blocked)"


def test_the_time_limit(room: Scene) -> None:
    record = simulate(replace(room, time_limit=2.0))
    assert record.reason == "time limit of 2 s"
    assert record.trajectory("r")[-1, 0] == pytest.approx(2.0)


def test_a_scene_without_robots_ends_at_once(room: Scene, recorded: Scene) -> None:
    for scene in (replace(room, robots=()), recorded):
        record = simulate(scene)
        assert record.reason == "no robots in the scene"
        assert record.samples == {}


def test_the_end_watch_waits_longer_where_bodies_move(room: Scene) -> None:
    body = Mover("m", Circle(0.0, 0.0, 0.2), start=(1.0, 1.0), velocity=(0.1, 0.0))
    for scene, patience in ((room, 30), (replace(room, movers=(body,)), 120)):
        watch = EndWatch(scene)
        reasons = [watch.update(0.5 * step, {"r": "no_path"}) for step in range(patience)]
        assert reasons[:-1] == [""] * (patience - 1)
        assert "r: no_path" in reasons[-1]
        watch = EndWatch(scene)
        for step in range(3 * patience):
            stops = {} if step % patience == patience - 1 else {"r": "no_path"}
            assert watch.update(0.5 * step, stops) == "", "a path now and then is progress"


@pytest.mark.slow
def test_three_robots_cross_the_factory_among_two_people() -> None:
    scene = load_scene(find_scene("factory"))
    assert len(scene.sensors) >= 8
    assert (len(scene.robots), len(scene.movers)) == (3, 2)
    metrics = compute_metrics(scene, simulate(scene))
    assert metrics["duration"] < 80.0
    for robot in metrics["robots"].values():
        assert robot["reached"]
        assert robot["margin_violations"] == 0
        assert robot["least_separation"] >= scene.safety_margin
