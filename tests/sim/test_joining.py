"""Robots that join, leave and are sent elsewhere while a scene runs without ROS."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from snnav_core.types import StopReason
from snnav_sim.ending import EndWatch
from snnav_sim.report.metrics import compute_metrics
from snnav_sim.report.moment import Moments
from snnav_sim.report.record import RunRecord
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene import Retarget, RobotScene, Scene, dump_scene, find_scene, load_scene, parse_scene
from snnav_sim.simulation import simulate


def team(room: Scene, **changes: object) -> Scene:
    """One robot of the room and another that crosses its way; the changes are those of the other."""
    (first,) = room.robots
    other = RobotScene("q", (8.0, 4.5), -math.pi / 2, (8.0, 1.2), 0.8, 1.5, 0.2)
    return replace(room, robots=(first, replace(other, **changes)))


def test_events_count_from_sampling_instants(room: Scene) -> None:
    robot = replace(room.robots[0], joins_at=0.7, leaves_at=3.0, retargets=(Retarget(1.2, (5.0, 5.0)),))
    scene = replace(room, sampling_interval=0.5, robots=(robot,))
    present = [time for time in np.arange(0.0, 5.0, 0.25) if scene.is_present(robot, time)]
    assert (present[0], present[-1]) == (1.0, 2.75)
    assert [robot.target_at(time) for time in (1.0, 1.5, 2.0)] == [robot.target, (5.0, 5.0), (5.0, 5.0)]
    assert robot.last_target == (5.0, 5.0)
    assert [scene.changes_after(time) for time in (0.0, 2.5, 3.0)] == [True, True, False]


def test_what_is_written_is_read_again(room: Scene) -> None:
    scene = team(
        room, joins_at=1.5, leaves_at=20.0, retargets=(Retarget(3.0, (5.0, 3.0)), Retarget(4.0, (6.0, 3.0)))
    )
    assert parse_scene(dump_scene(scene), "x.yaml") == scene
    assert "joins_at" not in dump_scene(room)


def test_a_robot_has_samples_and_decisions_only_while_it_is_there(room: Scene) -> None:
    scene = team(room, joins_at=1.2, leaves_at=3.0)
    record = simulate(scene)
    join = scene.instant(1.2)
    rows = record.trajectory("q")
    assert rows[0, 0] == join
    assert tuple(rows[0, 1:3]) == (8.0, 4.5)
    assert rows[-1, 0] == pytest.approx(3.0 - scene.control_period)
    times = [decision.time for decision in record.decisions_of("q")]
    assert (times[0], times[-1]) == (join, 3.0 - scene.sampling_interval)
    moments = Moments(scene, record, GroundTruth(scene))
    seen = [moments.robot(scene.robots[1], time) is not None for time in (join - 0.1, join, 2.9, 3.0)]
    assert seen == [False, True, True, False]
    metrics = compute_metrics(scene, record)["robots"]
    assert (metrics["q"]["reason"], metrics["q"]["reached"]) == ("left", False)
    assert "3 s" in metrics["q"]["message"]


def test_another_target_is_gone_to_and_judged(room: Scene) -> None:
    scene = team(room, retargets=(Retarget(2.0, (3.0, 5.0)),))
    record = simulate(scene)
    metrics = compute_metrics(scene, record)["robots"]["q"]
    assert metrics["reached"]
    assert metrics["optimum_length"] is None
    assert math.dist(record.trajectory("q")[-1, 1:3], (3.0, 5.0)) < 0.5
    assert all(robot["margin_violations"] == 0 for robot in compute_metrics(scene, record)["robots"].values())


def test_who_is_no_longer_there_is_not_kept_clear_of(room: Scene) -> None:
    """The other one stands on the way until it leaves."""
    (first,) = room.robots
    scene = team(room, start=(5.0, 1.0), target=(5.0, 1.0), leaves_at=30.0)
    metrics = compute_metrics(scene, simulate(scene))["robots"]["r"]
    assert metrics["least_separation"] >= scene.safety_margin
    gone = replace(scene, robots=(replace(first, joins_at=31.0), scene.robots[1]))
    alone = compute_metrics(gone, simulate(gone))["robots"]["r"]
    assert (alone["least_separation"], alone["reached"]) == (None, True)
    assert alone["travelled_length"] == pytest.approx(6.0, abs=0.35)


def test_the_end_waits_for_all_that_is_to_come(room: Scene) -> None:
    (first,) = room.robots
    arrived = {"r": StopReason.ARRIVED.value}
    late = replace(first, id="late", start=(8.0, 4.0), joins_at=30.0)
    watch = EndWatch(replace(room, robots=(first, late)))
    assert all(watch.update(0.5 * step, arrived) == "" for step in range(60))
    assert watch.update(30.0, arrived) == ""
    assert watch.update(30.5, {**arrived, "late": "arrived"}) == "all robots arrived"
    leaving = EndWatch(replace(room, robots=(replace(first, leaves_at=8.0),)))
    assert [leaving.update(time, {}) for time in (7.5, 8.0)] == ["", "all robots arrived or left"]
    sent = replace(room, robots=(replace(first, retargets=(Retarget(9.0, (5.0, 5.0)),)),))
    assert [EndWatch(sent).update(time, arrived) for time in (8.5, 9.0)] == ["", "all robots arrived"]


def test_a_run_that_ended_before_somebody_joined_says_so(room: Scene) -> None:
    scene = replace(team(room, joins_at=50.0), time_limit=2.0)
    robot = compute_metrics(scene, simulate(scene))["robots"]["q"]
    assert (robot["reason"], robot["least_separation"]) == ("not_joined", None)
    assert compute_metrics(scene, RunRecord(0))["robots"]["r"]["reason"] == "no_decision"


@pytest.mark.slow
def test_ten_robots_of_which_some_come_go_and_change_their_mind() -> None:
    scene = load_scene(find_scene("ten_robots"))
    assert len(scene.robots) == 10
    metrics = compute_metrics(scene, simulate(scene))
    assert metrics["reason"] == "all robots arrived or left"
    gone = [robot.id for robot in scene.robots if robot.leaves_at < scene.time_limit]
    assert len(gone) == 2
    for name, robot in metrics["robots"].items():
        assert robot["reached"] or name in gone
        assert robot["margin_violations"] == 0
        assert robot["least_separation"] >= scene.safety_margin
