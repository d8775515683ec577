"""Positions over time: what was known, planned and driven at even times of a run."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.figure import Figure

from snnav_sim.report.look import Look
from snnav_sim.report.moment import Moments
from snnav_sim.report.stage import Stage, stage_legend
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import Scene

__all__ = ["draw_snapshots"]

_WIDTH = 12.0  # inches
_DPI = 110
_STILL, _MOVING = 4, 6  # panels
_WIDE = 1.9  # width over height of a workspace from which two panels stand side by side and not three


def draw_snapshots(scene: Scene, truth: GroundTruth, moments: Moments, file: Path) -> None:
    """Draw positions over time (figures of Ch. 3) as a PNG: four panels, six among moving bodies."""
    times = moments.times(_MOVING if scene.movers and not Look.of(scene).crowd else _STILL)
    width, height = (scene.workspace.max(axis=0) - scene.workspace.min(axis=0)).tolist()
    most = 2 if len(times) <= _STILL or width / height >= _WIDE else 3
    columns = min(most, len(times))
    rows = math.ceil(len(times) / columns)
    panel = _WIDTH / columns
    tall = min(16.0, max(3.0, rows * (0.93 * panel * height / width + 0.45) + 0.7))
    figure = Figure(figsize=(_WIDTH, tall), layout="constrained")
    grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for index, axes in enumerate(grid.flat):
        if index >= len(times):
            axes.set_axis_off()
            continue
        Stage(axes, scene, truth, moments).show(times[index])
        axes.set_title(f"t = {times[index]:g} s", fontsize=10)
        axes.tick_params(labelsize=7)
        axes.set_xlabel("x [m]" if index + columns >= len(times) else "", fontsize=8)
        axes.set_ylabel("y [m]" if index % columns == 0 else "", fontsize=8)
    figure.suptitle(f"{scene.name}: positions over time", x=0.01, ha="left", fontsize=12)
    figure.legend(
        handles=stage_legend(scene, moments), loc="outside lower center", ncols=5, fontsize=8, frameon=False
    )
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)
