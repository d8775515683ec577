"""Figures and view of a flight are made whole, also of a run in which nothing flew."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from snnav_sim.report.flight_figures import draw_flight
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.space_drawing import faces_of
from snnav_sim.scene import SpaceScene, find_scene, load_any_scene
from snnav_sim.simulation_flight import FlightSimulation
from snnav_sim.space_types import Box


def scene() -> SpaceScene:
    loaded = load_any_scene(find_scene("hello_flight"))
    assert isinstance(loaded, SpaceScene)
    return loaded


def test_a_run_is_drawn_and_can_be_played(tmp_path: Path) -> None:
    simulation = FlightSimulation(scene())
    for _ in range(4):
        simulation.decide()
        for _ in range(4):
            simulation.move()
    draw_flight(scene(), simulation.record, tmp_path)
    for name in ("scene.png", "clearance.png", "tracking.png"):
        assert (tmp_path / name).stat().st_size > 10_000
    page = (tmp_path / "view.html").read_text(encoding="utf-8")
    assert "http" not in page.replace("<!DOCTYPE html>", "")  # needs nothing from elsewhere
    found = re.search(r"const data = (\{.*\});\n", page)
    assert found is not None
    data = json.loads(found.group(1))
    assert len(data["times"]) == len(data["robots"][0]["places"]) == len(data["movers"][0]["places"]) == 16
    assert len(data["robots"][0]["paths"]) == 4
    assert min(data["robots"][0]["clearance"]) >= data["margin"]


def test_a_run_without_samples_shows_the_room(tmp_path: Path) -> None:
    draw_flight(scene(), FlightRecord(1), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["scene.png"]


def test_faces_of_a_box_with_a_hole_close_it() -> None:
    box = Box((0.0, 0.0, 0.0), (1.0, 4.0, 3.0), (((0.0, 1.0, 1.0), (1.0, 2.0, 2.0)),))
    faces = faces_of(box)
    volume = 0.0
    for face in faces:  # flux of (x, 0, 0) through all faces, outwards by the sign of x - 0.5
        area = 0.5 * np.linalg.norm(sum(np.cross(face[i - 1], face[i]) for i in range(len(face))))
        if np.ptp(face[:, 0]) == 0.0 and face[0, 0] == 1.0:
            volume += area
    assert volume == pytest.approx(11.0)
