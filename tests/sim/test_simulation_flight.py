"""The closed loop in space: robots arrive, keep their margin to the truth, and the same seed gives the same run."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from snnav_sim.report.flight_metrics import compute_flight_metrics
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.write import write_run_directory
from snnav_sim.scene import SpaceScene, find_scene, load_any_scene
from snnav_sim.scene_types import Fault
from snnav_sim.simulation_flight import FlightSimulation


def scene() -> SpaceScene:
    loaded = load_any_scene(find_scene("hello_flight"))
    assert isinstance(loaded, SpaceScene)
    return loaded


@cache
def run() -> FlightRecord:
    return FlightSimulation(scene()).run()


def test_it_arrives_and_keeps_its_margin() -> None:
    metrics = compute_flight_metrics(scene(), run())["robots"]["bee"]
    assert metrics["reached"]
    assert metrics["least_clearance"] >= 0.4
    assert metrics["margin_violations"] == 0
    assert metrics["tracking_error"] <= 0.01
    assert run().samples["bee"][0][6] > 0.0  # it leaves its hover at once
    assert run().samples["bee"][-1][6] == 0.0  # and hovers in the end


def test_the_region_never_holds_what_is_solid() -> None:
    simulation = FlightSimulation(scene())
    centres = scene().grid.centres().reshape(-1, 3)
    for _ in range(3):
        simulation.decide()
        area = simulation.fusion.area(simulation.time)
        true = simulation.world.clearance(centres, simulation.time).reshape(scene().grid.shape)
        proved = np.minimum(area.moving, area.static)
        assert (proved <= np.maximum(true, 0.0) + 1e-6).all()
        for _ in range(4):
            simulation.move()


def test_the_same_seed_gives_the_same_run() -> None:
    again = FlightSimulation(scene())
    for _ in range(5):
        again.decide()
        for _ in range(4):
            again.move()
    assert again.record.digests() == run().digests()[:5]


def test_with_images_lost_and_late_it_flies_as_far_as_is_proved() -> None:
    faults = (Fault("drop_out", probability=0.3), Fault("delay", seconds=0.3, probability=0.3))
    sensors = tuple(replace(sensor, faults=faults, drop_out=0.001) for sensor in scene().sensors)
    faulty = replace(scene(), sensors=sensors, time_limit=12.0)
    record = FlightSimulation(faulty).run()
    metrics = compute_flight_metrics(faulty, record)["robots"]["bee"]
    assert metrics["margin_violations"] == 0
    assert record.rejected  # what comes too late is refused and told


def test_the_run_directory_is_complete(tmp_path: Path) -> None:
    write_run_directory(tmp_path / "run", scene(), run(), figures=False)
    assert load_any_scene(tmp_path / "run" / "scene.yaml") == scene()
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text(encoding="utf-8"))
    assert metrics["robots"]["bee"]["reached"]
    rows = (tmp_path / "run" / "trajectories.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "time,robot,x,y,z,heading,pitch,speed,turn_rate"
    assert len(rows) == 1 + len(run().samples["bee"])
    assert {len(row.split(",")) for row in rows} == {9}
    assert len((tmp_path / "run" / "tracking.csv").read_text(encoding="utf-8").splitlines()) > 100
    paths = (tmp_path / "run" / "paths.csv").read_text(encoding="utf-8").splitlines()
    assert paths[-1].endswith("arrived")
