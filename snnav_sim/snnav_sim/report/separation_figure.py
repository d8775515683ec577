"""Separation of robots over time: of every robot, and the least of all, beside the margin."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from snnav_sim.report.drawing import MARGIN, draw_shares
from snnav_sim.report.look import Look
from snnav_sim.report.separation import Separations
from snnav_sim.scene_types import Scene

__all__ = ["draw_separation"]

_WIDTH = 11.0  # inches
_DPI = 110
_SHOWN = 6.0  # times the safety margin; farther ones tell nothing


def draw_separation(scene: Scene, apart: Separations, file: Path) -> None:
    """Draw the distance from every robot's centre to the nearest disk, or centre, of another one over time as a PNG."""
    figure = Figure(figsize=(_WIDTH, 4.2), layout="constrained")
    axes = figure.add_subplot()
    look, margin = Look.of(scene), scene.safety_margin
    if look.crowd:
        draw_shares(axes, apart.times, apart.least)
    for index, robot in enumerate(scene.robots if not look.crowd else ()):
        label = robot.id if look.handles and not look.crowded else None
        width = 0.6 * look.width if not look.crowded else 0.7
        axes.plot(apart.times, apart.least[index], color=look.colours[index], linewidth=width, label=label)
    if len(scene.robots) > 2:
        all_of_them = apart.least.min(axis=0)
        axes.plot(apart.times, all_of_them, color="black", linewidth=1.6, label="least of all robots")
    least = _draw_least(axes, scene, apart)
    axes.axhspan(min(0.0, least), margin, color=MARGIN, alpha=0.08, linewidth=0)
    axes.axhline(margin, color=MARGIN, linewidth=1.2, linestyle="--", label=f"safety margin {margin:g} m")
    axes.set_xlim(0.0, max(float(apart.times[-1]), scene.sampling_interval))
    axes.set_ylim(min(0.0, least), _SHOWN * margin)
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("distance [m]")
    what = "centre" if scene.plans_globally else "disk"
    title = f"{scene.name}: distance from each robot's centre to the nearest {what} of another robot"
    axes.set_title(title, loc="left", fontsize=11)
    handles, labels = axes.get_legend_handles_labels()
    if look.named:
        own = "one robot each"
        handles, labels = [Line2D([], [], color="gray", linewidth=0.7), *handles], [own, *labels]
    axes.legend(
        handles, labels, fontsize=8, ncols=4, frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.14)
    )
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)


def _draw_least(axes: Axes, scene: Scene, apart: Separations) -> float:
    """Mark where two robots came nearest and return how near [m]; inf and no mark when no two were ever there."""
    row, column = np.unravel_index(int(np.argmin(apart.least)), apart.least.shape)
    least, when = float(apart.least[row, column]), float(apart.times[column])
    if math.isfinite(least):
        pair = f"{scene.robots[row].id} to {scene.robots[int(apart.nearest[row, column])].id}"
        text = f"least: {np.floor(1000.0 * least) / 1000.0:.3f} m, {pair}, {when:.1f} s"
        axes.plot(when, least, "o", color="black", markersize=5, zorder=5, label=text)
    return least
