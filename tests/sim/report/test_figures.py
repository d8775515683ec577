"""Figures and the animation: they open, show what they say, and stay small."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from numpy.typing import NDArray
from PIL import Image

from snnav_sim.report import clearance_figure, figures
from snnav_sim.report.animation import draw_animation
from snnav_sim.report.drawing import MOVER, REMEMBERED, SEEN
from snnav_sim.report.moment import Moments
from snnav_sim.report.record import RunRecord
from snnav_sim.report.snapshots import draw_snapshots
from snnav_sim.report.stage import stage_legend
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene import Scene, find_scene, load_scene
from snnav_sim.scene_types import Circle, Mover
from snnav_sim.simulation import simulate


@pytest.fixture(scope="module")
def busy() -> tuple[Scene, RunRecord]:
    scene = load_scene(find_scene("hello"))
    walker = Mover("w", Circle(0.0, 0.0, 0.4), ((3.0, 5.4), (3.0, 4.0)), speed=0.3, loop=True)
    scene = replace(scene, movers=(walker,), boundary_speed=0.3, time_limit=6.0)
    return scene, simulate(scene)


def parts(run: tuple[Scene, RunRecord]) -> tuple[Scene, GroundTruth, Moments]:
    scene, record = run
    truth = GroundTruth(scene)
    return scene, truth, Moments(scene, record, truth)


def share(image: NDArray[np.uint8], colour: str) -> float:
    """Of the pixels that have a colour exactly."""
    wanted = np.array([int(colour[index : index + 2], 16) for index in (1, 3, 5)])
    return float(np.mean(np.all(image[..., :3] == wanted, axis=-1)))


def test_the_animation_opens_moves_and_is_small(tmp_path: Path, busy: tuple[Scene, RunRecord]) -> None:
    scene, truth, moments = parts(busy)
    file = tmp_path / "run.gif"
    draw_animation(scene, truth, moments, file)
    with Image.open(file) as image:
        assert 60 <= image.n_frames <= 100
        assert image.info["loop"] == 0, "again and again"
        frames = []
        for index in (0, image.n_frames // 2, image.n_frames - 1):
            image.seek(index)
            frames.append(np.asarray(image.convert("RGB")))
    assert file.stat().st_size < 3e6
    assert not np.array_equal(frames[0], frames[1])
    assert not np.array_equal(frames[1], frames[2])
    for frame in frames:
        assert share(frame, SEEN) > 0.3, "colours are kept to the last bit"
        assert share(frame, MOVER) > 0.001
    still = np.all(frames[0][-40:] == frames[2][-40:])
    assert still, "what does not change does not flicker"


def test_a_long_run_has_no_more_frames(tmp_path: Path, room: Scene) -> None:
    rows = [(0.05 * tick, 2.0 + 0.0005 * tick, 2.0, 0.0, 0.01, 0.0) for tick in range(12001)]
    record = RunRecord(0, samples={"r": rows})
    scene, truth, moments = parts((room, record))
    draw_animation(scene, truth, moments, tmp_path / "run.gif")
    with Image.open(tmp_path / "run.gif") as image:
        assert image.n_frames <= 100


@pytest.mark.parametrize("moving", [True, False])
def test_snapshots(tmp_path: Path, busy: tuple[Scene, RunRecord], moving: bool) -> None:
    scene, record = busy
    scene = scene if moving else replace(scene, movers=())
    draw_snapshots(*parts((scene, record)), tmp_path / "snapshots.png")
    image = np.round(255 * imread(tmp_path / "snapshots.png")).astype(np.uint8)
    assert image.shape[1] > 1000
    assert share(image, SEEN) > 0.2
    assert (share(image, MOVER) > 1e-4) == moving


def test_legends_name_what_is_drawn(busy: tuple[Scene, RunRecord]) -> None:
    scene, _, moments = parts(busy)
    moving = [str(handle.get_label()) for handle in stage_legend(scene, moments)]
    assert {"robot_1, driven", "moving body", "remembered, out of sight", "target"} <= set(moving)
    still, _, moments = parts((replace(scene, movers=()), RunRecord(0)))
    assert not {"moving body", "remembered, out of sight"} & {
        h.get_label() for h in stage_legend(still, moments)
    }


@pytest.mark.parametrize(("reach", "shown"), [(4.0, True), (40.0, False)])
def test_the_limit_of_a_range_is_named_where_it_is_drawn(
    tmp_path: Path, room: Scene, monkeypatch: pytest.MonkeyPatch, reach: float, shown: bool
) -> None:
    scene = replace(room, sensors=tuple(replace(sensor, range_max=reach) for sensor in room.sensors))
    named: list[bool] = []
    original = figures._legend

    def spy(scene: Scene, planned: float | None, limits: bool) -> list[object]:
        named.append(limits)
        return list(original(scene, planned, limits))

    monkeypatch.setattr(figures, "_legend", spy)
    figures.draw_scene(scene, RunRecord(0), GroundTruth(scene), tmp_path / "scene.png")
    assert named == [shown]


def test_the_clearance_figure_has_both_distances(
    tmp_path: Path, busy: tuple[Scene, RunRecord], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, record = busy
    labels: list[str] = []
    original = clearance_figure._draw_curve

    def spy(
        axes: object, times: object, distance: NDArray[np.float64], label: str, **style: object
    ) -> object:
        labels.append(f"{label} {math.floor(100 * distance.min()) / 100:.2f}")
        return original(axes, times, distance, label, **style)  # type: ignore[arg-type]

    monkeypatch.setattr(clearance_figure, "_draw_curve", spy)
    truth = GroundTruth(scene)
    clearance_figure.draw_clearance(scene, record, truth, tmp_path / "clearance.png")
    rows = record.trajectory("robot_1")
    least = truth.area_clearance(rows[:, 1:3], rows[:, 0])[0].min()
    assert labels[0] == f"robot_1: unoccupied area's boundary {math.floor(100 * least) / 100:.2f}"
    assert labels[1].startswith("robot_1: obstacles")


def test_a_recorded_network_is_drawn_too(tmp_path: Path, recorded: Scene, room: Scene) -> None:
    robot = replace(room.robots[0], start=(1.0, 1.0), target=(2.0, 2.0))
    scene = replace(recorded, robots=(robot,), time_limit=2.0)
    run = parts((scene, simulate(scene)))
    assert not run[2].remembers
    draw_snapshots(*run, tmp_path / "snapshots.png")
    draw_animation(*run, tmp_path / "animation.gif")
    image = np.round(255 * imread(tmp_path / "snapshots.png")).astype(np.uint8)
    assert share(image, REMEMBERED) == 0.0
    assert share(image, SEEN) > 0.02
