"""Figures of recorded free space: cameras judged by each other, and a flight through what they show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D

from snnav_core.area.spatial import SpatialArea
from snnav_core.types import FloatArray
from snnav_sim.report.cross_view import CrossView
from snnav_sim.report.drawing import MARGIN, SEEN, UNSEEN, robot_colour
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.flight_view import write_flight_view
from snnav_sim.report.recorded_flight_metrics import recorded_clearances
from snnav_sim.report.space_drawing import CAMERA, draw_room, set_up_view
from snnav_sim.space_types import SpaceScene

__all__ = ["draw_false_free", "draw_recorded_flight"]

_DPI = 110
_KEPT = "#6fa8d6"  # where the margin is kept
_FINE = 0.0025  # [m]; between two margins of the curve
_VIEWS = ((24.0, -118.0), (89.9, -90.0))  # from behind the cameras and from above [degrees]
_ZOOM = (1.45, 1.25)
_MOST_HITS = 40_000
_MOST_DOTS = 12_000
_LAYER = 0.1  # [m]; hits this near to a cut are shown in it


def draw_false_free(views: Sequence[CrossView], margin: float, file: Path) -> None:
    """Draw the share of false-free hits above the margin, for every pair of cameras, as a PNG."""
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    axes = figure.add_subplot()
    deepest = max((float(view.depths[-1]) for view in views if len(view.depths)), default=0.0)
    margins = np.arange(0.0, max(1.5 * margin, deepest + 0.02) + _FINE, _FINE)
    for number, view in enumerate(views):
        colour = robot_colour(number)
        for shares, style, what in (
            ([view.share(each) for each in margins.tolist()], "-", "of all in view"),
            ([view.open_share(each) for each in margins.tolist()], ":", "of those not hidden"),
        ):
            curve = np.where(np.array(shares) > 0.0, shares, np.nan)
            label = f"hits of {view.hits_of} in free space by {view.claims}, {what}"
            axes.plot(margins, 100.0 * curve, style, color=colour, linewidth=1.6, label=label)
    axes.axhline(1.0, color=MARGIN, linewidth=1.0, linestyle="--", label="1 %")
    axes.axvline(margin, color="black", linewidth=1.0, linestyle="--", label=f"in use: {margin:g} m")
    axes.set_yscale("log")
    axes.set_xlim(0.0, float(margins[-1]))
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.set_xlabel("margin taken off on all sides [m]")
    axes.set_ylabel("hits in free space [%]")
    axes.set_title("What one camera calls free, by the hits of another", loc="left", fontsize=10)
    axes.legend(fontsize=8, frameon=False)
    figure.savefig(file, dpi=_DPI)


def draw_recorded_flight(
    scene: SpaceScene, record: FlightRecord, area: SpatialArea, hits: FloatArray, directory: Path
) -> None:
    """Draw the flight of the first robot from two viewpoints, in cuts, its clearances, and write its view."""
    rows = record.trajectory(scene.robots[0].id)
    to_region, to_hits = recorded_clearances(rows, area, hits)
    shown = hits[:: max(1, len(hits) // _MOST_HITS)]
    _draw_views(scene, rows, shown, directory / "scene.png")
    _draw_cuts(scene, rows, area, hits, directory / "cuts.png")
    _draw_clearance(scene, rows, to_region, to_hits, directory / "clearance.png")
    dots = hits[:: max(1, len(hits) // _MOST_DOTS)]
    nearest = {scene.robots[0].id: np.minimum(to_region, to_hits)}
    write_flight_view(scene, record, directory / "view.html", nearest, dots)


def _draw_views(scene: SpaceScene, rows: FloatArray, hits: FloatArray, file: Path) -> None:
    figure = Figure(figsize=(14.0, 6.0))
    robot = scene.robots[0]
    for index, (elevation, azimuth) in enumerate(_VIEWS):
        axes = cast(Axes3D, figure.add_subplot(1, 2, index + 1, projection="3d", computed_zorder=False))
        set_up_view(axes, scene, elevation, azimuth)
        axes.set_box_aspect(tuple((np.array(scene.high) - scene.low).tolist()), zoom=_ZOOM[index])
        axes.scatter(*hits.T, c=hits[:, 2], cmap="viridis", s=0.4, alpha=0.5, linewidths=0, depthshade=False)
        draw_room(axes, scene)
        axes.plot(*rows[:, 1:4].T, color=robot_colour(1), linewidth=2.4)
        axes.scatter(*robot.start, color=robot_colour(1), s=34, depthshade=False)
        axes.scatter(*robot.target, color=robot_colour(1), marker="*", s=110, depthshade=False)
    figure.suptitle(f"{scene.name}: hits of all cameras and the flight", x=0.02, ha="left", fontsize=11)
    handles = [
        Line2D(
            [], [], color="#35b779", marker="o", markersize=3, linestyle="", label="hits, coloured by height"
        ),
        Line2D([], [], color=robot_colour(1), linewidth=2.4, label="flown"),
        Line2D([], [], color=robot_colour(1), marker="o", linestyle="", label="start"),
        Line2D([], [], color=robot_colour(1), marker="*", markersize=10, linestyle="", label="target"),
        Line2D([], [], color=CAMERA, marker="s", markersize=4, label="camera and where it looks"),
    ]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), fontsize=8, frameon=False)
    figure.subplots_adjust(left=0.03, right=0.98, bottom=0.09, top=0.95, wspace=0.04)
    figure.savefig(file, dpi=_DPI)


def _draw_cuts(scene: SpaceScene, rows: FloatArray, area: SpatialArea, hits: FloatArray, file: Path) -> None:
    """Draw a level and an upright cut through the middle of the flight."""
    middle = rows[len(rows) // 2, 1:4]
    figure = Figure(figsize=(13.0, 4.6), layout="constrained")
    for index, (across, along, normal) in enumerate(((0, 1, 2), (0, 2, 1))):
        axes = figure.add_subplot(1, 2, index + 1)
        _draw_cut(axes, scene, rows, area, hits, (across, along, normal), float(middle[normal]))
    handles = [
        Patch(color=UNSEEN, label="not known to be free"),
        Patch(color=SEEN, label="free"),
        Patch(color=_KEPT, label=f"{scene.safety_margin:g} m from all that is not"),
        Line2D(
            [], [], color="black", marker=".", markersize=3, linestyle="", label=f"hits within {_LAYER:g} m"
        ),
        Line2D([], [], color=robot_colour(1), linewidth=2.0, label="flown (all heights)"),
        Line2D([], [], color=CAMERA, marker="s", markersize=5, linestyle="", label="camera"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=8, frameon=False)
    figure.savefig(file, dpi=_DPI)


def _draw_cut(
    axes: Axes,
    scene: SpaceScene,
    rows: FloatArray,
    area: SpatialArea,
    hits: FloatArray,
    order: tuple[int, int, int],
    place: float,
) -> None:
    """Draw what is free in one plane; `order`: axis to the right, axis upwards, axis that is cut at `place` [m]."""
    right, up, normal = order
    grid = area.grid
    layer = int(np.clip((place - grid.origin[normal]) / grid.spacing, 0, grid.shape[normal] - 1))
    field = np.take(area.moving, layer, axis=normal)
    kinds = (field > 0.0).astype(int) + (field >= scene.safety_margin)
    edges = (grid.origin[right], grid.high[right], grid.origin[up], grid.high[up])
    axes.imshow(kinds.T, origin="lower", extent=edges, cmap=ListedColormap([UNSEEN, SEEN, _KEPT]), vmin=0, vmax=2,
                interpolation="nearest")  # fmt: skip
    near = hits[np.abs(hits[:, normal] - place) <= _LAYER]
    near = near[:: max(1, len(near) // _MOST_HITS)]
    axes.plot(near[:, right], near[:, up], ".", color="black", markersize=0.8)
    axes.plot(rows[:, 1 + right], rows[:, 1 + up], color=robot_colour(1), linewidth=2.0)
    robot = scene.robots[0]
    for point, marker, size in ((robot.start, "o", 6), (robot.target, "*", 11)):
        axes.plot(point[right], point[up], marker, color=robot_colour(1), markersize=size,
                  markeredgecolor="white", markeredgewidth=0.6)  # fmt: skip
    for sensor in scene.sensors:
        axes.plot(sensor.position[right], sensor.position[up], "s", color=CAMERA, markersize=5)
    axes.set_xlim(edges[0], edges[1])
    axes.set_ylim(edges[2], edges[3])
    axes.set_xlabel(f"{'xyz'[right]} [m]")
    axes.set_ylabel(f"{'xyz'[up]} [m]")
    axes.set_title(f"cut at {'xyz'[normal]} = {place:.2f} m", loc="left", fontsize=10)


def _draw_clearance(
    scene: SpaceScene, rows: FloatArray, to_region: FloatArray, to_hits: FloatArray, file: Path
) -> None:
    """Draw how near the flight comes, along its way."""
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(rows[:, 1:4], axis=0), axis=1))))
    figure = Figure(figsize=(10.0, 3.8), layout="constrained")
    axes = figure.add_subplot()
    for values, colour, what in (
        (to_hits, "#3d405b", "the nearest hit of any camera"),
        (to_region, robot_colour(1), "what is not known to be free"),
    ):
        axes.plot(way, values, color=colour, linewidth=1.6, label=f"{what}; least {values.min():.3f} m")
    margin = scene.safety_margin
    axes.axhline(margin, color=MARGIN, linewidth=1.2, linestyle="--", label=f"safety margin {margin:g} m")
    axes.axhspan(0.0, margin, color=MARGIN, alpha=0.08, linewidth=0)
    axes.set_xlim(0.0, max(float(way[-1]), 0.1))
    axes.set_ylim(0.0, 1.15 * max(float(to_hits.max()), margin))
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.set_xlabel("way flown [m]")
    axes.set_ylabel("distance of the centre [m]")
    axes.set_title(f"{scene.name}: distances along the flight", loc="left", fontsize=10)
    axes.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.16), ncols=3)
    figure.savefig(file, dpi=_DPI)
