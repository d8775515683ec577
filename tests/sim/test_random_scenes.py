"""The random halls of the faulty runs (tests/system): valid, reproducible, fair to the robot, faulty as asked."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_sim.random_scenes import faulty_scene
from snnav_sim.scene import Circle, Fault, Scene, dump_scene, parse_scene
from snnav_sim.scene_faults import FAULT_KINDS
from snnav_sim.world import mover_positions

seeds = st.integers(0, 10_000)
some_kinds = st.lists(st.sampled_from(sorted(FAULT_KINDS)), min_size=1, unique=True)


def all_faults(scene: Scene) -> list[Fault]:
    return [fault for sensor in scene.sensors for fault in sensor.faults]


@given(seeds, some_kinds)
def test_a_scene_is_valid_and_has_the_faults_that_were_asked_for(seed: int, kinds: list[str]) -> None:
    scene = faulty_scene(seed, kinds)
    assert parse_scene(dump_scene(scene), "again") == scene
    assert {fault.kind for fault in all_faults(scene)} == set(kinds)
    low_x, low_y, high_x, high_y = *scene.workspace.min(axis=0), *scene.workspace.max(axis=0)
    assert 12.0 <= high_x - low_x <= 20.0
    assert 12.0 <= high_y - low_y <= 20.0
    assert 2 <= len(scene.sensors) <= 4
    assert all(sensor.noise == "lms200" for sensor in scene.sensors)
    assert all(0.1 <= scene.scan_period(sensor) <= 0.5 for sensor in scene.sensors)
    assert len(scene.obstacles) <= 4
    assert len(scene.movers) <= 2
    assert len(scene.robots) == 1


@given(seeds)
def test_the_same_seed_gives_the_same_scene_and_the_kinds_change_the_faults_only(seed: int) -> None:
    scene = faulty_scene(seed)
    assert scene == faulty_scene(seed)
    assert {fault.kind for fault in all_faults(scene)} == set(FAULT_KINDS)
    other = faulty_scene(seed, ["delay"])
    assert replace(other, sensors=scene.sensors, description=scene.description) == scene
    assert faulty_scene(seed + 1).robots != scene.robots


@given(seeds)
def test_walkers_never_come_near_a_robot_whatever_it_does(seed: int) -> None:
    """While one moves, the robot cannot have driven to within the margin of it; it knows nothing at time 0."""
    scene = faulty_scene(seed)
    (robot,) = scene.robots
    assert all(sensor.scan_offset > 0.0 for sensor in scene.sensors)
    for walker in scene.movers:
        assert walker.speed <= scene.boundary_speed
        assert isinstance(walker.shape, Circle)
        legs = [math.dist(*leg) for leg in pairwise(walker.waypoints)]
        times = np.linspace(0.0, sum(legs) / walker.speed, 500)
        apart = np.hypot(*(mover_positions(walker, times) - np.array(robot.start)).T)
        driven = robot.speed * np.maximum(0.0, times - scene.sampling_interval)
        gap = apart - walker.shape.radius - driven
        assert gap.min() >= scene.safety_margin


@given(seeds)
def test_what_no_receiver_could_notice_does_not_happen(seed: int) -> None:
    scene = faulty_scene(seed)
    for sensor in scene.sensors:
        frozen = [fault for fault in sensor.faults if fault.kind == "frozen"]
        others = [fault for fault in sensor.faults if fault.kind != "frozen"]
        assert all(fault.begin > one.end for one in frozen for fault in others)
        late = any(fault.kind in ("delay", "reorder") for fault in others)
        for fault in others:
            if fault.kind == "clock_offset" and fault.seconds > 0.0:
                assert fault.seconds > scene.sampling_interval
                assert not late


def test_there_are_halls_of_every_sort() -> None:
    scenes = [faulty_scene(seed) for seed in range(60)]
    assert {len(scene.sensors) for scene in scenes} == {2, 3, 4}
    assert {len(scene.movers) for scene in scenes} == {0, 1, 2}
    assert {len(scene.obstacles) for scene in scenes} == {0, 1, 2, 3, 4}
    assert any(scene.boundary_speed == 0.0 for scene in scenes)
    alone = [faulty_scene(seed, ["drop_out"]) for seed in range(60)]
    struck = [sum(bool(sensor.faults) for sensor in scene.sensors) / len(scene.sensors) for scene in alone]
    assert 15 < struck.count(1.0) < 45, "in some, all sensors at once"
    ends = [fault.end for scene in alone for fault in all_faults(scene)]
    assert 0 < sum(math.isinf(end) for end in ends) < len(ends) / 4


def test_an_unknown_kind_is_named() -> None:
    with pytest.raises(ValueError, match="kind 'lost' is not known; give some of drop_out, delay"):
        faulty_scene(1, ["lost"])
