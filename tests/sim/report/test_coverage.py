"""What cameras see and where robots can get is told before anything flies."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes

from snnav_sim.report.coverage import Coverage, measure_coverage
from snnav_sim.report.coverage_figure import draw_coverage
from snnav_sim.scene import SpaceScene, find_scene, load_any_scene
from snnav_sim.space_types import Box


def scene() -> SpaceScene:
    loaded = load_any_scene(find_scene("hello_flight"))
    assert isinstance(loaded, SpaceScene)
    return loaded


@cache
def whole() -> Coverage:
    return measure_coverage(scene())


def test_four_cameras_cover_both_rooms() -> None:
    assert whole().seen_share > 0.95
    assert whole().robots == {"bee": "reachable"}
    assert len(whole().volumes) == 1
    shares = np.array(list(whole().cameras.values()))
    assert (shares[:, 0] >= shares[:, 1]).all()
    assert shares[:, 1].sum() <= whole().seen_share


def test_what_is_missing_is_named() -> None:
    west = replace(scene(), sensors=scene().sensors[:2])
    assert measure_coverage(west).robots["bee"] == "the target is not seen, or not free"
    closed = replace(
        scene(), obstacles=(replace(scene().obstacles[0], solid=Box((3.0, 0.0, 0.0), (3.4, 4.0, 3.0))),)
    )
    coverage = measure_coverage(closed)
    assert coverage.robots["bee"] == "start and target are in different components"
    assert len(coverage.volumes) == 2
    near = replace(scene(), robots=(replace(scene().robots[0], target=(5.4, 2.6, 2.8)),))
    assert "of the margin of 0.4 m" in measure_coverage(near).robots["bee"]


def test_cuts_are_drawn(tmp_path: Path) -> None:
    draw_coverage(scene(), whole(), tmp_path / "cuts.png")
    assert (tmp_path / "cuts.png").stat().st_size > 10_000


@pytest.mark.parametrize("height", [0.4, 1.2, 1.5, 2.3, 2.9])
def test_every_target_is_drawn_in_one_cut(
    height: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    plot = Axes.plot

    def note(self: Axes, *arguments: Any, **options: Any) -> Any:
        drawn.append(arguments[2])
        return plot(self, *arguments, **options)

    monkeypatch.setattr(Axes, "plot", note)
    robot = replace(scene().robots[0], target=(5.4, 2.6, height))
    tall = replace(scene(), robots=(robot,), high=(*scene().high[:2], 3.0 * scene().high[2]))
    draw_coverage(tall, whole(), tmp_path / "cuts.png")
    assert drawn.count("*") == 1
    assert drawn.count("o") == 1
