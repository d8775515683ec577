"""Random rooms for flying robots: legal, reproducible, of every sort; their runs are judged against ground truth."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.flight_types import FlightCommand, FlyerState
from snnav_sim.campaign.generate import campaign_scene
from snnav_sim.campaign.judge_flight import judge_flight
from snnav_sim.campaign.run import campaign_run
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.scene import SpaceScene, dump_scene, parse_any_scene
from snnav_sim.space_world import SpaceWorld

SERIES = range(40)


@cache
def room(seed: int) -> SpaceScene:
    scene = campaign_scene("flight", seed)
    assert isinstance(scene, SpaceScene)
    return scene


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_a_room_is_legal_and_fair(seed: int) -> None:
    scene = room(seed)
    assert parse_any_scene(dump_scene(scene), "again") == scene
    world = SpaceWorld(scene)
    for index, robot in enumerate(scene.robots):
        ends = np.array([robot.start, robot.target])
        for time in (0.0, 3.0, 11.0, 29.0):
            assert world.clearance(ends, time).min() > scene.safety_margin
        for other in scene.robots[:index]:
            for one, two in ((robot.start, other.start), (robot.target, other.target)):
                assert math.dist(one, two) > scene.safety_margin + robot.radius


def test_there_are_rooms_of_every_sort() -> None:
    rooms = [room(seed) for seed in SERIES]
    assert {1, 2} < {len(scene.robots) for scene in rooms}
    for sort in (
        lambda s: bool(s.movers),
        lambda s: any(body.known_static for body in s.obstacles),
        lambda s: any(sensor.faults for sensor in s.sensors),
        lambda s: any(sensor.noise == "tof" for sensor in s.sensors),
    ):
        share = sum(map(sort, rooms)) / len(rooms)
        assert 0.1 < share < 0.9


@cache
def outcome(seed: int) -> dict[str, Any]:
    return campaign_run("flight", seed)


@pytest.mark.parametrize("seed", [0, 4, 5])
def test_runs_end_well_or_with_a_reason(seed: int) -> None:
    assert outcome(seed)["error"] == ""
    for robot in outcome(seed)["robots"].values():
        assert robot["collisions"] == robot["margin_violations"] == 0
        assert robot["reached"] == robot["feasible"]
        assert robot["reached"] or robot["reason"] == "goal_blocked"


@pytest.mark.nightly
def test_a_long_series_keeps_its_margins() -> None:
    robots = [robot for seed in range(100, 300) for robot in campaign_run("flight", seed)["robots"].values()]
    assert not any(robot["collisions"] or robot["margin_violations"] for robot in robots)
    feasible = [robot for robot in robots if robot["feasible"]]
    assert sum(robot["reached"] for robot in feasible) >= 0.97 * len(feasible)


def test_who_flies_through_a_wall_is_found_out() -> None:
    scene, record = room(0), FlightRecord(0)
    robot = scene.robots[0]
    for tick in range(10):
        place = np.array([scene.high[0] - 0.3 + 0.05 * tick, 1.0, 1.0])
        state = FlyerState(robot.id, place, np.array([1.0, 0.0, 0.0]), 0.05 * tick, 0.7)
        record.add_flight(robot.id, 0.05 * tick, state, FlightCommand(0.7, np.zeros(3)))
    judged = judge_flight(scene, record)["robots"][robot.id]
    assert judged["margin_violations"] == 10
    assert judged["collisions"] >= 7
    assert not judged["reached"]


def test_a_run_is_kept_as_files(tmp_path: Path) -> None:
    campaign_run("flight", 5, tmp_path)
    assert (tmp_path / "scenes" / "flight_5.yaml").is_file()
    assert (tmp_path / "pictures" / "flight_5.png").is_file()
