"""Random scenes of campaigns: legal, reproducible, of every sort, fair to the robots."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.errors import InvalidInput
from snnav_sim.campaign.generate import KINDS, campaign_scene
from snnav_sim.campaign.reference import connected, planned_distance, window_distance
from snnav_sim.campaign.run import run_seed
from snnav_sim.report.optimum import reduced
from snnav_sim.scene import Circle, Scene, dump_scene, parse_scene
from snnav_sim.scene_faults import FAULT_KINDS
from snnav_sim.world import World, mover_positions

seeds = st.integers(0, 10_000)
kinds = st.sampled_from([kind for kind in KINDS if kind != "flight"])
SERIES = range(40)


def still_area(scene: Scene) -> shapely.Geometry:
    return World(replace(scene, movers=())).true_unoccupied_area()


@given(kinds, seeds)
def test_a_scene_is_legal_and_the_same_for_the_same_seed(kind: str, seed: int) -> None:
    scene = campaign_scene(kind, seed)
    assert parse_scene(dump_scene(scene), "again") == scene
    assert campaign_scene(kind, seed) == scene
    assert (scene.name, scene.seed) == (f"{kind}_{seed}", seed)
    assert campaign_scene(kind, seed + 1).robots != scene.robots
    assert all(sensor.noise == "lms200" for sensor in scene.sensors)


@given(kinds, seeds)
def test_robots_start_with_the_margin_to_everything_and_apart(kind: str, seed: int) -> None:
    scene = campaign_scene(kind, seed)
    starts = np.array([robot.start for robot in scene.robots])
    assert World(scene).obstacle_clearance(starts).min() > scene.safety_margin
    for index, robot in enumerate(scene.robots):
        assert scene.boundary_speed < robot.speed
        for other in scene.robots[:index]:
            apart = scene.safety_margin + max(robot.radius, other.radius)
            assert math.dist(robot.start, other.start) > apart
            assert math.dist(robot.target, other.target) > apart


@given(seeds)
def test_nobody_walks_where_a_robot_starts_or_shall_go(seed: int) -> None:
    """A robot may stand at its start for a whole window, and at a target that is not one of those anywhere."""
    scene = campaign_scene("dynamic", seed)
    (robot,) = scene.robots
    for walker in scene.movers:
        assert isinstance(walker.shape, Circle)
        assert walker.loop
        assert 0.0 < walker.speed <= scene.boundary_speed
        places = mover_positions(walker, np.linspace(0.0, 120.0, 1500))
        assert World(scene).static_region.buffer(-walker.shape.radius).covers(shapely.MultiPoint(places))
        gaps = np.hypot(*(places - np.array(robot.start)).T) - walker.shape.radius
        assert gaps.min() > window_distance(scene, robot)


@given(seeds)
@settings(max_examples=15)
def test_nobody_is_locked_in_by_robots_that_stand_at_their_targets_or_starts(seed: int) -> None:
    scene = campaign_scene("multi", seed)
    area = still_area(scene)
    for robot in scene.robots:
        region = reduced(area, planned_distance(scene, robot))
        if not connected(region, robot.start, robot.target):
            continue
        for end in ("start", "target"):
            for other in scene.robots:
                far = scene.safety_margin + max(robot.radius, other.radius)
                place = getattr(other, end)
                if other is not robot and math.dist(place, robot.start) > far < math.dist(
                    place, robot.target
                ):
                    region = region.difference(shapely.Point(place).buffer(far))
            assert connected(region, robot.start, robot.target)
            region = reduced(area, planned_distance(scene, robot))


def test_there_are_scenes_of_every_sort() -> None:
    static = [campaign_scene("static", seed) for seed in SERIES]
    assert {scene.boundary_speed for scene in static} == {0.0}
    assert {len(scene.border.vertices) == 4 for scene in static} == {True, False}
    assert {len(scene.sensors) for scene in static} == {3, 4, 5, 6, 7, 8}
    shapes = [shape for scene in static for shape in scene.obstacles]
    assert 0 < sum(isinstance(shape, Circle) for shape in shapes) < len(shapes)
    assert any(not scene.obstacles for scene in static)
    dynamic = [campaign_scene("dynamic", seed) for seed in SERIES]
    assert {len(scene.movers) for scene in dynamic} == {0, 1, 2, 3, 4, 5}
    periods = [sensor.scan_period for scene in dynamic for sensor in scene.sensors]
    assert len(set(periods)) > 20
    multi = [campaign_scene("multi", seed) for seed in SERIES]
    counts = [len(scene.robots) for scene in multi]
    assert min(counts) == 2
    assert 18 <= max(counts) <= 20
    assert any(len({robot.radius for robot in scene.robots}) > 3 for scene in multi)
    assert any(len({robot.speed for robot in scene.robots}) > 3 for scene in multi)
    faulty = [campaign_scene("faults", seed) for seed in SERIES]
    met = [{fault.kind for sensor in scene.sensors for fault in sensor.faults} for scene in faulty]
    assert {frozenset(some) for some in met} == {
        *(frozenset([kind]) for kind in FAULT_KINDS),
        frozenset(FAULT_KINDS),
    }


@pytest.mark.parametrize("kind", ["static", "dynamic", "multi"])
def test_most_targets_can_be_reached_and_some_cannot(kind: str) -> None:
    feasible = []
    for seed in SERIES:
        scene = campaign_scene(kind, seed)
        area = still_area(scene)
        for robot in scene.robots:
            region = reduced(area, planned_distance(scene, robot))
            feasible.append(connected(region, robot.start, robot.target))
    assert 0.75 * len(feasible) <= sum(feasible) < len(feasible)


def test_campaigns_with_different_seeds_share_no_run() -> None:
    runs = [run_seed(seed, number) for seed in range(5) for number in (0, 1, 999_999)]
    assert len(set(runs)) == len(runs)


def test_an_unknown_kind_is_named() -> None:
    with pytest.raises(
        InvalidInput, match="kind 'swarm' of a campaign is not known: give one of static, dynamic"
    ):
        campaign_scene("swarm", 1)
