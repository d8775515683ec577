"""What the cameras of a scene in space see, as horizontal cuts through the room."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from snnav_core.types import FloatArray
from snnav_sim.report.coverage import Coverage
from snnav_sim.report.drawing import SEEN, SOLID, UNSEEN, robot_colour
from snnav_sim.space_types import SpaceScene

__all__ = ["draw_coverage"]

_COMPONENTS = ("#6fa8d6", "#9ad0a0", "#e6c86e", "#c9a0d0")
_REST = "#e3a58f"
_DPI = 110
_CUTS = 4


def draw_coverage(scene: SpaceScene, coverage: Coverage, file: Path) -> None:
    """Draw cuts at four heights as a PNG: solid, unseen, seen, and where a robot may stay, by component."""
    low, high = np.array(scene.low), np.array(scene.high)
    heights: FloatArray = low[2] + (np.arange(_CUTS) + 0.5) * (high[2] - low[2]) / _CUTS
    shape = (high[1] - low[1]) / (high[0] - low[0])
    figure = Figure(figsize=(3.6 * _CUTS, 3.6 * shape + 1.3), layout="constrained")
    for index, height in enumerate(heights.tolist()):
        axes = figure.add_subplot(1, _CUTS, index + 1)
        _draw_cut(axes, scene, coverage, height)
        _draw_marks(axes, scene, heights, index)
        axes.set_title(f"z = {height:.2f} m", fontsize=9)
        if index == 0:
            axes.set_ylabel("y [m]")
    handles: list[Patch | Line2D] = [
        Patch(color=SOLID, label="solid"),
        Patch(color=UNSEEN, label="not seen"),
        Patch(color=SEEN, label="seen, margin not kept"),
    ]
    for index, volume in enumerate(coverage.volumes[: len(_COMPONENTS)]):
        handles.append(Patch(color=_COMPONENTS[index], label=f"reachable {index + 1}: {volume:.1f} m³"))
    if len(coverage.volumes) > len(_COMPONENTS):
        handles.append(Patch(color=_REST, label=f"{len(coverage.volumes) - len(_COMPONENTS)} smaller ones"))
    handles += [
        Line2D([], [], color="black", marker="s", markersize=4, linestyle="", label="camera"),
        Line2D([], [], color="grey", marker="o", linestyle="", label="start"),
        Line2D([], [], color="grey", marker="*", markersize=10, linestyle="", label="target"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=6, fontsize=8, frameon=False)
    kept = f"{coverage.distance:.2f} m from all"
    if coverage.growth:
        kept += f", {coverage.growth:.2f} m more from what may move"
    figure.suptitle(
        f"{scene.name}: {100.0 * coverage.seen_share:.0f} % of the free space is seen; reachable: {kept}",
        fontsize=10,
        x=0.01,
        ha="left",
    )
    figure.savefig(file, dpi=_DPI)


def _draw_cut(axes: Axes, scene: SpaceScene, coverage: Coverage, height: float) -> None:
    grid = coverage.area.grid
    layer = int(np.clip((height - grid.origin[2]) / grid.spacing, 0, grid.shape[2] - 1))
    kinds = np.where(coverage.area.moving[:, :, layer] > 0.0, 2, 1)
    kinds[coverage.solid[:, :, layer]] = 0
    labels = coverage.labels[:, :, layer]
    kinds = np.where(labels > 0, 2 + np.minimum(labels, len(_COMPONENTS) + 1), kinds)
    colours = ListedColormap([SOLID, UNSEEN, SEEN, *_COMPONENTS, _REST])
    edges = (grid.origin[0], grid.high[0], grid.origin[1], grid.high[1])
    axes.imshow(kinds.T, origin="lower", extent=edges, cmap=colours, vmin=0, vmax=colours.N - 1,
                interpolation="nearest")  # fmt: skip
    for sensor in scene.sensors:
        axes.plot(sensor.position[0], sensor.position[1], "s", color="black", markersize=3)
    axes.set_xlabel("x [m]")
    axes.tick_params(labelsize=7)


def _draw_marks(axes: Axes, scene: SpaceScene, heights: FloatArray, index: int) -> None:
    """Draw starts and targets in the cut that is nearest in height."""
    for number, robot in enumerate(scene.robots):
        for point, marker, size in ((robot.start, "o", 6), (robot.target, "*", 10)):
            if int(np.abs(heights - point[2]).argmin()) == index:
                axes.plot(point[0], point[1], marker, color=robot_colour(number), markersize=size,
                          markeredgecolor="white", markeredgewidth=0.6)  # fmt: skip
