"""Scenes in space through the nodes: the paths of the run without ROS, and what line 1 of flying robots demands.

Margins are judged against the true bodies at every 0.05 s, errors of tracking by a tracker of the recorder's own that
follows the published paths from where odometry says the robot was.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from snnav_core.errors import InvalidInput
from snnav_ros.bag.drives import read_drive
from snnav_ros.bag.reader import BagReader
from snnav_ros.bringup import run_scene
from snnav_ros.convert import flyer_state_from_message, nanoseconds
from snnav_ros.convert.spatial_area import spatial_area_from_message
from snnav_sim.report.flight_metrics import (
    compute_flight_metrics,
    flight_clearances,
    flight_separations,
)
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.write import paths_digest
from snnav_sim.scene import SpaceScene, find_scene, load_any_scene
from snnav_sim.scene_types import Fault
from snnav_sim.simulation_flight import FlightSimulation
from snnav_sim.space_types import FlyerScene

LEAN = ("hello_flight", "thesis_ch4_tracking")
LONG = ("thesis_ch4_static", "thesis_ch4_dynamic", "thesis_ch4_four_robots")


def scene_of(name: str) -> SpaceScene:
    scene = load_any_scene(find_scene(name))
    assert isinstance(scene, SpaceScene)
    return scene


@cache
def alone(name: str) -> FlightRecord:
    return FlightSimulation(scene_of(name)).run()


def flown(name: str, **how: Any) -> FlightRecord:
    record = run_scene(scene_of(name), **how)
    assert isinstance(record, FlightRecord)
    return record


def judge(name: str, record: FlightRecord) -> None:
    """See that all arrived, kept their margins to the truth and to each other, and stayed on their paths."""
    scene = scene_of(name)
    metrics = compute_flight_metrics(scene, record)["robots"]
    for robot in scene.robots:
        rows = record.trajectory(robot.id)
        np.testing.assert_allclose(np.diff(rows[:, 0]), 0.05)
        assert np.linalg.norm(rows[-1, 1:4] - robot.target) <= 0.14
        assert metrics[robot.id]["reached"]
        assert flight_clearances(scene, record)[robot.id].min() >= scene.safety_margin
        assert flight_separations(scene, record)[robot.id].min() >= scene.safety_margin
        errors = np.array(record.errors[robot.id])
        assert errors[errors[:, 0] >= errors[0, 0] + 3.0, 1].max() <= 0.05


def compare(record: FlightRecord, other: FlightRecord) -> None:
    """See that two runs are the same: reasons, paths, places, errors of tracking."""
    assert record.reason == other.reason
    assert record.digests() == other.digests()
    assert paths_digest(record) == paths_digest(other)
    assert record.errors == other.errors
    for name in other.samples:
        ours, theirs = record.trajectory(name), other.trajectory(name)
        np.testing.assert_array_equal(ours[:, :4], theirs[:, :4])
        np.testing.assert_allclose(ours[:, 4:], theirs[:, 4:], atol=1e-9)


@pytest.mark.parametrize("name", LEAN)
def test_same_paths_with_and_without_ros_and_line_1_holds(name: str) -> None:
    record = flown(name)
    judge(name, record)
    compare(record, alone(name))


def test_same_paths_in_several_processes_and_a_bag_that_says_all(tmp_path: Path) -> None:
    name = "hello_flight"
    scene, record = scene_of(name), flown(name, processes=True, bag=tmp_path / "bag")
    compare(record, alone(name))
    instants = [nanoseconds(0.2 * k) for k in range(len(record.fusion_seconds))]
    with BagReader(tmp_path / "bag") as bag:
        areas = [(entry.stamp_ns, entry.message) for entry in bag.messages(["/unoccupied_area"])]
        states = [flyer_state_from_message(entry.message, "bee") for entry in bag.messages(["/bee/odom"])]
        for sensor in scene.sensors:
            stamps = [entry.stamp_ns for entry in bag.messages([f"/sensors/{sensor.id}/points"])]
            assert stamps == instants
    assert [stamp for stamp, _ in areas] == instants
    assert spatial_area_from_message(areas[-1][1]).grid.shape == scene.grid.shape
    np.testing.assert_array_equal([state.position for state in states], record.trajectory("bee")[:, 1:4])
    motions = read_drive(tmp_path / "bag", "bee").motions()
    assert len(motions.outside()) == 0
    np.testing.assert_array_equal(motions.after[-1], record.trajectory("bee")[-1, 1:4])


def test_cameras_with_rates_and_faults_and_a_robot_on_a_curve_lead_to_the_same_paths() -> None:
    plain = scene_of("hello_flight")
    first, second, *others = plain.sensors
    first = replace(first, scan_period=0.15, scan_offset=0.03, faults=(Fault("delay", seconds=0.25),))
    second = replace(second, faults=(Fault("drop_out", 1.0, 4.0),))
    way = ((0.7, 0.7, 2.3), (0.7, 1.5, 2.3), (0.7, 2.2, 2.0))
    wasp = FlyerScene("wasp", way[0], 0.0, 0.0, way[-1], 0.5, 2.0, 0.1, way)
    scene = replace(plain, sensors=(first, second, *others), robots=(*plain.robots, wasp))
    record = run_scene(scene)
    assert isinstance(record, FlightRecord)
    compare(record, FlightSimulation(scene).run())
    assert record.digests() != alone("hello_flight").digests()
    assert flight_clearances(scene, record)["bee"].min() >= scene.safety_margin


def test_another_seed_is_another_roadmap() -> None:
    record = flown("hello_flight", seed=2)
    assert record.seed == 2
    compare(record, FlightSimulation(scene_of("hello_flight"), 2).run())
    assert record.digests() != alone("hello_flight").digests()


@pytest.mark.slow
def test_four_robots_through_the_nodes() -> None:
    name = "thesis_ch4_four_robots"
    record = flown(name)
    judge(name, record)
    compare(record, alone(name))


@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("processes", [False, True], ids=["one process", "processes"])
@pytest.mark.parametrize("name", LONG)
def test_the_simulations_of_the_thesis_through_the_nodes(name: str, processes: bool) -> None:
    first = flown(name, processes=processes)
    judge(name, first)
    compare(first, alone(name))
    compare(flown(name), first)


def test_one_planner_serves_all_that_fly() -> None:
    with pytest.raises(InvalidInput, match="in space one serves all; give 1"):
        run_scene(scene_of("thesis_ch4_four_robots"), planners=2)
