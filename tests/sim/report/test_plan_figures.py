"""The figures and the numbers of plans in space-time stand in the run directory of scenes with the global planner."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from snnav_sim.report.record import RunRecord
from snnav_sim.report.write import write_run_directory
from snnav_sim.scene import Circle, Mover, Scene
from snnav_sim.simulation import simulate

FIGURES = ("candidates.png", "spacetime.png")


@pytest.fixture
def planned(room: Scene) -> tuple[Scene, RunRecord]:
    body = Mover("body", Circle(0.0, 0.0, 0.3), start=(5.0, 6.5), velocity=(0.1, 0.0))
    (robot,) = room.robots
    second = replace(robot, id="s", start=(2.0, 6.5), target=(2.0, 4.5))
    scene = replace(
        room, planner="global", movers=(body,), boundary_speed=0.2, robots=(robot, second), time_limit=3.0
    )
    return scene, simulate(scene)


@pytest.mark.parametrize("count", [1, 2])
def test_candidates_and_space_time_are_drawn(
    planned: tuple[Scene, RunRecord], count: int, tmp_path: Path
) -> None:
    scene, record = planned
    scene = replace(scene, robots=scene.robots[:count])
    kept = {robot.id for robot in scene.robots}
    record.plans = [(time, plan) for time, plan in record.plans if plan.robot_id in kept]
    record.decisions = [one for one in record.decisions if one.robot in kept]
    record.samples = {name: rows for name, rows in record.samples.items() if name in kept}
    write_run_directory(tmp_path / "run", scene, record)
    for name in FIGURES:
        picture = imread(tmp_path / "run" / "figures" / name)
        assert min(picture.shape[:2]) > 300
        assert np.unique(picture[..., :3].reshape(-1, 3), axis=0).shape[0] > 20, "not an empty sheet"
    robots = json.loads((tmp_path / "run" / "metrics.json").read_text())["robots"]
    assert all(len(robot["plans"]) >= 1 for robot in robots.values())


def test_a_run_without_plans_has_no_such_figures(room: Scene, tmp_path: Path) -> None:
    scene = replace(room, time_limit=1.0)
    metrics = write_run_directory(tmp_path / "run", scene, simulate(scene))
    assert not any((tmp_path / "run" / "figures" / name).exists() for name in FIGURES)
    assert "plans" not in metrics["planner"]
