"""Figures of recorded free space: cameras judged by each other, and a flight through what they show."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from mpl_toolkits.mplot3d import Axes3D
from numpy.typing import NDArray
from scipy.spatial import cKDTree

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
_ZOOM = (1.25, 1.12)
_MOST_HITS = 40_000
_MOST_DOTS = 12_000
_FINEST = 0.01  # [m]; from point to point of the upright cut
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
    """Draw a level cut at half of the flight, and an upright one that follows the flight."""
    figure = Figure(figsize=(13.0, 4.8), layout="constrained")
    level, upright = figure.subplots(1, 2)
    _draw_level_cut(level, scene, rows, area, hits)
    _draw_upright_cut(upright, scene, rows, area, hits)
    handles = [
        Patch(color=UNSEEN, label="not known to be free"),
        Patch(color=SEEN, label="free"),
        Patch(color=_KEPT, label=f"{scene.safety_margin:g} m from all that is not"),
        Line2D(
            [], [], color="black", marker=".", markersize=3, linestyle="", label=f"hits within {_LAYER:g} m"
        ),
        Line2D([], [], color=robot_colour(1), linewidth=2.0, label="flown (left: at all heights)"),
        Line2D([], [], color=CAMERA, marker="s", markersize=5, linestyle="", label="camera"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=8, frameon=False)
    figure.savefig(file, dpi=_DPI)


def _draw_level_cut(
    axes: Axes, scene: SpaceScene, rows: FloatArray, area: SpatialArea, hits: FloatArray
) -> None:
    grid, height = area.grid, float(rows[len(rows) // 2, 3])
    layer = int(np.clip((height - grid.origin[2]) / grid.spacing, 0, grid.shape[2] - 1))
    edges = (grid.origin[0], grid.high[0], grid.origin[1], grid.high[1])
    _show_kinds(axes, area.moving[:, :, layer], scene.safety_margin, edges)
    near = hits[np.abs(hits[:, 2] - height) <= _LAYER]
    _dot(axes, near[:, :2])
    axes.plot(rows[:, 1], rows[:, 2], color=robot_colour(1), linewidth=2.0)
    robot = scene.robots[0]
    _mark_ends(axes, robot.start[:2], robot.target[:2])
    for sensor in scene.sensors:
        axes.plot(sensor.position[0], sensor.position[1], "s", color=CAMERA, markersize=5)
    axes.set_xlim(min(edges[0], *(sensor.position[0] - 0.1 for sensor in scene.sensors)), edges[1])
    axes.set_ylim(edges[2], edges[3])
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(f"level cut at z = {height:.2f} m", loc="left", fontsize=10)


def _draw_upright_cut(
    axes: Axes, scene: SpaceScene, rows: FloatArray, area: SpatialArea, hits: FloatArray
) -> None:
    places = rows[:, 1:3]
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))))
    length = max(float(way[-1]), _FINEST)
    along = np.linspace(0.0, length, max(2, int(length / _FINEST)))
    low, high = float(area.grid.origin[2]), float(area.grid.high[2])
    heights = np.arange(low, high, _FINEST) + 0.5 * _FINEST
    points = np.empty((len(along), len(heights), 3))
    points[..., 0] = np.interp(along, way, places[:, 0])[:, None]
    points[..., 1] = np.interp(along, way, places[:, 1])[:, None]
    points[..., 2] = heights
    field = area.clearance_at(points.reshape(-1, 3)).reshape(points.shape[:2])
    _show_kinds(axes, field, scene.safety_margin, (0.0, length, low, float(heights[-1]) + 0.5 * _FINEST))
    apart, nearest = cKDTree(places).query(hits[:, :2], distance_upper_bound=_LAYER)
    near = np.isfinite(apart)
    _dot(axes, np.column_stack((way[nearest[near]], hits[near, 2])))
    axes.plot(way, rows[:, 3], color=robot_colour(1), linewidth=2.0)
    _mark_ends(axes, (0.0, float(rows[0, 3])), (length, scene.robots[0].target[2]))
    axes.set_xlim(-0.03 * length, 1.03 * length)
    axes.set_ylim(low, high)
    axes.set_xlabel("way flown, seen from above [m]")
    axes.set_ylabel("z [m]")
    axes.set_title("upright cut along the flight", loc="left", fontsize=10)


def _show_kinds(
    axes: Axes, field: NDArray[Any], margin: float, edges: tuple[float, float, float, float]
) -> None:
    """Show clearances (to the right, upwards) as: not free, free, margin kept."""
    kinds = (field > 0.0).astype(int) + (field >= margin)
    axes.imshow(kinds.T, origin="lower", extent=edges, cmap=ListedColormap([UNSEEN, SEEN, _KEPT]), vmin=0, vmax=2,
                interpolation="nearest")  # fmt: skip
    axes.set_facecolor(UNSEEN)


def _dot(axes: Axes, points: FloatArray) -> None:
    shown = points[:: max(1, len(points) // _MOST_HITS)]
    axes.plot(shown[:, 0], shown[:, 1], ".", color="black", markersize=0.8)


def _mark_ends(axes: Axes, start: Sequence[float], target: Sequence[float]) -> None:
    for point, marker, size in ((start, "o", 6), (target, "*", 11)):
        axes.plot(point[0], point[1], marker, color=robot_colour(1), markersize=size,
                  markeredgecolor="white", markeredgewidth=0.6)  # fmt: skip


def _draw_clearance(
    scene: SpaceScene, rows: FloatArray, to_region: FloatArray, to_hits: FloatArray, file: Path
) -> None:
    """Draw how near the flight comes, over time."""
    times = rows[:, 0]
    figure = Figure(figsize=(10.0, 3.8), layout="constrained")
    axes = figure.add_subplot()
    for values, colour, what in (
        (to_hits, "#3d405b", "the nearest hit of any camera"),
        (to_region, robot_colour(1), "what is not known to be free"),
    ):
        axes.plot(times, values, color=colour, linewidth=1.6, label=f"{what}; least {values.min():.3f} m")
    margin = scene.safety_margin
    axes.axhline(margin, color=MARGIN, linewidth=1.2, linestyle="--", label=f"safety margin {margin:g} m")
    axes.axhspan(0.0, margin, color=MARGIN, alpha=0.08, linewidth=0)
    axes.set_xlim(0.0, max(float(times[-1]), 0.1))
    axes.set_ylim(0.0, 1.15 * max(float(to_hits.max()), margin))
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("distance of the centre [m]")
    axes.set_title(f"{scene.name}: distances along the flight", loc="left", fontsize=10)
    axes.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.16), ncols=3)
    figure.savefig(file, dpi=_DPI)
