"""Runs are judged by what truly happened: who came too near to whom, and whether that had been promised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from snnav_core.types import Pose2D, TimedPath, VelocityCommand
from snnav_sim.campaign.generate import campaign_scene
from snnav_sim.campaign.judge import judge
from snnav_sim.campaign.reference import seen_area
from snnav_sim.report.record import Decision, RunRecord
from snnav_sim.scene import Circle, Mover, Scene, parse_scene
from snnav_sim.world import World

HALL = """\
name: hall
sampling_interval: 0.5
boundary_speed: 0.4
safety_margin: 0.5
workspace: {polygon: [[0, 0], [20, 0], [20, 8], [0, 8]]}
sensors:
  - {id: a, device: lms200, position: [0.1, 0.1], heading_deg: 45, field_of_view_deg: 180, resolution_deg: 1,
     range_max: 30}
robots:
  - {id: r, start: [4, 4], heading_deg: 0, target: [16, 4], speed: 1.0, max_turn_rate: 1.0, radius: 0.3}
"""


@pytest.fixture
def hall() -> Scene:
    return parse_scene(HALL, "hall.yaml")


def with_walker(scene: Scene, position: float, velocity: float) -> Scene:
    """Somebody of 0.3 m radius on the line of the robot, `position` [m] ahead of its start."""
    body = Circle(0.0, 0.0, 0.3)
    return replace(scene, movers=(Mover("w", body, start=(4.0 + position, 4.0), velocity=(velocity, 0.0)),))


def drive(scene: Scene, speed: float, duration: float, promised_until: float, name: str = "r") -> RunRecord:
    """A robot that drives along x from its start, with a path of time 0 that is certified until then."""
    record = RunRecord(0)
    x, y = next(robot.start for robot in scene.robots if robot.id == name)
    for tick in range(round(duration / 0.05)):
        record.add_sample(
            name, 0.05 * tick, Pose2D(x + speed * 0.05 * tick, y, 0.0), VelocityCommand(speed, 0.0)
        )
    path = TimedPath(0.0, 0.1, np.array([[x, y], [x + 0.1, y]]))
    record.decisions.append(Decision(0.0, name, path, valid_until=promised_until))
    return record


def test_a_robot_that_keeps_away_has_no_violation(hall: Scene) -> None:
    robot = judge(with_walker(hall, 6.0, 0.0), drive(hall, 1.0, 4.0, 4.0))["robots"]["r"]
    assert [robot[key] for key in ("collisions", "margin_violations", "hit_standing", "walked_into")] == [
        0
    ] * 4
    assert robot["feasible"]
    assert robot["least_clearance"] == pytest.approx(6.0 - 0.3 - 3.95, abs=1e-3)


def test_who_drives_into_somebody_collides_promised_or_not(hall: Scene) -> None:
    for until in (4.0, -1.0):
        robot = judge(with_walker(hall, 3.0, 0.0), drive(hall, 1.0, 3.5, until))["robots"]["r"]
        assert robot["margin_violations"] > robot["collisions"] > 0
        assert robot["walked_into"] == robot["hit_standing"] == 0


def test_a_body_that_comes_within_the_window_is_a_violation_later_it_is_counted_apart(hall: Scene) -> None:
    scene = with_walker(hall, 1.6, -0.4)  # the margin is lost after 2 s, the disk is touched after 2.5 s
    within = judge(scene, drive(hall, 0.0, 3.0, 2.5))["robots"]["r"]
    assert within["margin_violations"] == pytest.approx(20, abs=1)
    assert within["collisions"] == pytest.approx(10, abs=1)
    assert within["walked_into"] == within["hit_standing"] == 0
    beyond = judge(scene, drive(hall, 0.0, 3.0, 1.5))["robots"]["r"]
    assert beyond["margin_violations"] == beyond["collisions"] == 0
    assert beyond["walked_into"] == pytest.approx(20, abs=1)
    assert beyond["hit_standing"] == pytest.approx(10, abs=1)


def test_a_robot_that_flees_from_who_has_walked_up_to_it_does_no_wrong_but_one_that_drives_on_into_him_does(
    hall: Scene,
) -> None:
    scene = with_walker(hall, 1.25, -0.4)  # the margin is lost after 1.1 s
    for speed, collides in ((-1.0, False), (1.0, True)):
        record = drive(hall, 0.0, 1.5, 0.5)
        for tick in range(20):
            x = 4.0 + speed * 0.05 * tick
            record.add_sample("r", 1.5 + 0.05 * tick, Pose2D(x, 4.0, 0.0), VelocityCommand(1.0, 0.0))
        robot = judge(scene, record)["robots"]["r"]
        assert robot["walked_into"] > 0
        assert (robot["collisions"] > 0) == collides
        assert robot["hit_standing"] == 0


def test_a_turn_that_promises_no_more_than_standing_counts_for_as_long_as_the_margin_lasts(
    hall: Scene,
) -> None:
    scene = with_walker(hall, 1.2, -0.4)
    record = drive(hall, 0.0, 3.0, 0.0)
    turn = TimedPath(0.5, 0.1, np.array([[4.0, 4.0], [4.0, 4.0]]), turn_to=1.0)
    for clearance, promised in ((0.5 + 0.4 * 0.4, False), (0.5 + 0.4 * 0.6, True)):
        record.decisions[1:] = [Decision(0.5, "r", turn, valid_until=2.5, least_clearance=clearance)]
        robot = judge(scene, record)["robots"]["r"]
        assert (robot["margin_violations"] > 0) == promised
        assert (robot["walked_into"] > 0) == (not promised)


def test_robots_always_promise_each_other_their_margin(hall: Scene) -> None:
    (robot,) = hall.robots
    scene = replace(hall, robots=(robot, replace(robot, id="s", start=(4.0, 4.7))))
    record = drive(scene, 0.0, 1.0, -1.0)
    other = drive(scene, 0.0, 1.0, -1.0, "s")
    record.samples |= other.samples
    for judged in judge(scene, record)["robots"].values():
        assert judged["margin_violations"] == 20
        assert judged["collisions"] == 0
        assert judged["least_separation"] == pytest.approx(0.4, abs=1e-3)


def test_a_target_behind_a_wall_cannot_be_reached(hall: Scene) -> None:
    text = HALL.replace(
        "robots:", "obstacles:\n  - {polygon: [[10, -1], [10.2, -1], [10.2, 9], [10, 9]]}\nrobots:"
    )
    walled = parse_scene(text, "walled.yaml")
    for key in ("feasible", "feasible_by_sight"):
        assert judge(hall, drive(hall, 0.0, 1.0, 1.0))["robots"]["r"][key]
        assert not judge(walled, drive(walled, 0.0, 1.0, 1.0))["robots"]["r"][key]


def test_scans_show_most_of_what_can_be_seen_and_hardly_more() -> None:
    for kind in ("static", "dynamic", "multi"):
        for seed in range(5):
            scene = campaign_scene(kind, seed)
            seen, sight = seen_area(scene), World(replace(scene, movers=())).true_unoccupied_area()
            assert seen.difference(sight).area < 0.01 * sight.area, (
                scene.name
            )  # tips and pockets between beams
            assert seen.area > 0.9 * sight.area, scene.name
