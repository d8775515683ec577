"""Figures of a run: the scene with what was seen, planned and driven; the clearance over time."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle as CirclePatch
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from shapely.geometry.base import BaseGeometry

from snnav_core.types import FloatArray
from snnav_sim.report.record import RunRecord
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import Circle, Mover, Scene, SensorScene, Shape
from snnav_sim.world import mover_positions, solid

__all__ = ["draw_clearance", "draw_scene"]

_ROBOT_COLOURS = ("#0b5fa5", "#d1495b", "#2e8b57", "#8d5a97", "#e08e0b", "#00798c", "#6b4226", "#444444")
_SEEN, _SOLID, _UNSEEN, _MOVER, _MARGIN = "#dcebf7", "#4a4a4a", "#f4f1ec", "#c06014", "#c1121f"
_REDUCED = "#5b8db8"
_OUTLINE: dict[str, Any] = {"facecolor": "none", "linewidth": 0.8}
_WIDTH = 11.0  # inches
_DPI = 110
_PATHS_SHOWN = 6
_GHOSTS = 5


def draw_scene(scene: Scene, record: RunRecord, truth: GroundTruth, file: Path) -> None:
    """Draw the scene from above with sensors, areas, paths and trajectories as a PNG."""
    low, high = scene.workspace.min(axis=0), scene.workspace.max(axis=0)
    width, height = (high - low).tolist()
    figure = Figure(
        figsize=(_WIDTH, min(14.0, max(3.5, (_WIDTH - 1.0) * height / width + 1.6))), layout="constrained"
    )
    axes = figure.add_subplot()
    border = shapely.Polygon(scene.workspace)
    _fill(axes, border, facecolor=_UNSEEN, edgecolor="none")
    _fill(axes, truth.area, facecolor=_SEEN, edgecolor="#9dbfdb", linewidth=0.6)
    _fill(
        axes, truth.reduced_area(scene.safety_margin), edgecolor=_REDUCED, linestyle=(0, (4, 3)), **_OUTLINE
    )
    planned = _planning_distance(scene, record)
    if planned is not None:
        _fill(axes, truth.reduced_area(planned), edgecolor=_REDUCED, linestyle=(0, (1, 3)), **_OUTLINE)
    _draw_world(axes, scene, truth)
    for sensor in scene.sensors:
        _draw_sensor(axes, sensor, border, detailed=len(scene.sensors) <= 20)
    for mover in scene.movers:
        _draw_mover(axes, mover, _end(record))
    for index, robot in enumerate(scene.robots):
        colour = _ROBOT_COLOURS[index % len(_ROBOT_COLOURS)]
        rows = record.trajectory(robot.id)
        for path in _shown_paths(record, robot.id):
            axes.plot(path[:, 0], path[:, 1], color=colour, linewidth=0.8, alpha=0.45, zorder=5)
        axes.plot(rows[:, 1], rows[:, 2], color=colour, linewidth=2.2, zorder=6, label=robot.id)
        axes.add_patch(
            CirclePatch(
                robot.start, robot.radius, facecolor="white", edgecolor=colour, linewidth=1.5, zorder=7
            )
        )
        if scene.movers or len(scene.robots) > 1:
            _draw_robot_ghosts(axes, rows, robot.radius, colour)
        axes.plot(*robot.target, marker="X", markersize=9, color=colour, markeredgecolor="white", zorder=8)
    pad = 0.02 * max(width, height)
    axes.set_xlim(low[0] - pad, high[0] + pad)
    axes.set_ylim(low[1] - pad, high[1] + pad)
    axes.set_aspect("equal")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(_title(scene, record), loc="left", fontsize=11)
    figure.legend(
        handles=_legend(scene, planned), loc="outside lower center", ncols=5, fontsize=8, frameon=False
    )
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)


def draw_clearance(scene: Scene, record: RunRecord, truth: GroundTruth, file: Path) -> None:
    """Draw the distance of every robot's centre to the true obstacles over time as a PNG."""
    figure = Figure(figsize=(_WIDTH, 4.2), layout="constrained")
    axes = figure.add_subplot()
    bottom, top = 0.0, 3.0 * scene.safety_margin
    for index, robot in enumerate(scene.robots):
        rows = record.trajectory(robot.id)
        if len(rows) == 0:
            continue
        colour = _ROBOT_COLOURS[index % len(_ROBOT_COLOURS)]
        clearance = truth.clearance(rows[:, 1:3], rows[:, 0])
        lowest = int(np.argmin(clearance))
        axes.plot(
            rows[:, 0],
            clearance,
            color=colour,
            linewidth=1.6,
            label=f"{robot.id}, least {clearance[lowest]:.2f} m",
        )
        axes.plot(rows[lowest, 0], clearance[lowest], marker="o", markersize=4, color=colour)
        bottom, top = min(bottom, float(clearance.min())), max(top, float(clearance.max()))
    axes.axhspan(bottom, scene.safety_margin, color=_MARGIN, alpha=0.08, linewidth=0)
    axes.axhline(
        scene.safety_margin,
        color=_MARGIN,
        linewidth=1.2,
        linestyle="--",
        label=f"safety margin {scene.safety_margin:g} m",
    )
    axes.set_xlim(0.0, max(_end(record), scene.sampling_interval))
    axes.set_ylim(bottom, 1.05 * top)
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("clearance [m]")
    what = "fused area and recorded returns" if scene.recorded else "true obstacles, bodies and walls"
    axes.set_title(f"{scene.name}: distance from the robot's centre to {what}", loc="left", fontsize=11)
    axes.legend(fontsize=8, ncols=3, frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.15))
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)


def _planning_distance(scene: Scene, record: RunRecord) -> float | None:
    """Return the least distance that a path was planned for [m], if a line for it can be told from the margin's."""
    distances = [d.planning_distance for d in record.decisions if d.planning_distance is not None]
    planned = min(distances, default=0.0)
    return planned if planned > 1.1 * scene.safety_margin else None


def _end(record: RunRecord) -> float:
    return max((rows[-1][0] for rows in record.samples.values() if rows), default=0.0)


def _title(scene: Scene, record: RunRecord) -> str:
    return f"{scene.name}, seed {record.seed}" + (
        f": {record.reason} at {_end(record):.1f} s" if record.samples else ""
    )


def _fill(axes: Axes, region: BaseGeometry, **style: Any) -> None:
    """Draw polygons with their holes."""
    vertices: list[FloatArray] = []
    codes: list[np.uint8] = []
    for ring in shapely.get_rings(shapely.get_parts(region)):
        points = shapely.get_coordinates(ring)
        code = [Outline.MOVETO, *[Outline.LINETO] * (len(points) - 2), Outline.CLOSEPOLY]
        vertices.append(points)
        codes.extend(code)
    if vertices:
        axes.add_patch(PathPatch(Outline(np.concatenate(vertices), codes), **style))


def _draw_shape(axes: Axes, shape: Shape, shift: tuple[float, float], **style: Any) -> None:
    if isinstance(shape, Circle):
        centre = (shape.x + shift[0], shape.y + shift[1])
        axes.add_patch(CirclePatch(centre, shape.radius, **style))
    else:
        _fill(axes, shapely.Polygon(shape.points + np.asarray(shift)), **style)


def _draw_world(axes: Axes, scene: Scene, truth: GroundTruth) -> None:
    if scene.recorded:
        axes.plot(truth.returns[:, 0], truth.returns[:, 1], ".", color=_SOLID, markersize=0.8, zorder=3)
        return
    border = shapely.Polygon(scene.workspace)
    solids = shapely.union_all([solid(shape) for shape in scene.obstacles])
    _fill(axes, shapely.intersection(solids, border), facecolor=_SOLID, edgecolor="none", zorder=3)
    _fill(axes, border, facecolor="none", edgecolor="black", linewidth=2.0, zorder=4)


def _draw_sensor(axes: Axes, sensor: SensorScene, border: BaseGeometry, detailed: bool) -> None:
    """Draw a sensor, its direction, and the outline of its field of view and range inside the workspace."""
    x, y = sensor.position
    axes.plot(x, y, marker="o", markersize=4.5 if detailed else 2.5, color="black", zorder=9)
    if not detailed:
        return
    first = sensor.heading + sensor.angle_min
    angles = first + np.linspace(0.0, sensor.field_of_view, 181)
    rim = np.stack((x + sensor.range_max * np.cos(angles), y + sensor.range_max * np.sin(angles)), axis=-1)
    inside = shapely.intersection(shapely.LineString(rim), border)
    for part in shapely.get_parts(inside):
        points = shapely.get_coordinates(part)
        axes.plot(
            points[:, 0], points[:, 1], color="black", linewidth=0.5, linestyle=":", alpha=0.6, zorder=2
        )
    if not sensor.all_round:
        reach = 0.018 * math.sqrt(border.area) + 0.2
        for angle in (first, first + sensor.field_of_view):
            ends = [x, x + reach * math.cos(angle)], [y, y + reach * math.sin(angle)]
            points = shapely.get_coordinates(shapely.LineString(np.transpose(ends)).intersection(border))
            axes.plot(points[:, 0], points[:, 1], color="black", linewidth=1.1, zorder=9)


def _draw_mover(axes: Axes, mover: Mover, end: float) -> None:
    """Draw the way of a body and where it is at some times."""
    way = mover_positions(mover, np.linspace(0.0, end, 400))
    axes.plot(way[:, 0], way[:, 1], color=_MOVER, linewidth=0.9, linestyle=":", zorder=4)
    for index, time in enumerate(np.linspace(0.0, end, _GHOSTS)):
        x, y = mover_positions(mover, float(time))[0].tolist()
        strength = 0.25 + 0.6 * index / (_GHOSTS - 1)
        _draw_shape(axes, mover.shape, (x, y), facecolor=_MOVER, edgecolor="none", alpha=strength, zorder=5)


def _draw_robot_ghosts(axes: Axes, rows: FloatArray, radius: float, colour: str) -> None:
    """Draw where a robot is at the times at which the moving bodies are drawn."""
    times = np.linspace(0.0, rows[-1, 0], _GHOSTS) if len(rows) else np.zeros(0)
    for index, time in enumerate(times[1:-1], start=1):
        x, y = (float(np.interp(time, rows[:, 0], rows[:, axis])) for axis in (1, 2))
        strength = 0.25 + 0.6 * index / (_GHOSTS - 1)
        axes.add_patch(
            CirclePatch((x, y), radius, facecolor=colour, edgecolor="none", alpha=strength, zorder=7)
        )


def _shown_paths(record: RunRecord, robot: str) -> list[FloatArray]:
    """Return some of the published paths of a robot, evenly over the run."""
    paths = [decision.path.points for decision in record.decisions_of(robot) if decision.path is not None]
    if len(paths) <= _PATHS_SHOWN:
        return paths
    return [paths[index] for index in np.linspace(0, len(paths) - 1, _PATHS_SHOWN).astype(int)]


def _legend(scene: Scene, planned: float | None) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=_ROBOT_COLOURS[index % len(_ROBOT_COLOURS)], linewidth=2.2, label=robot.id)
        for index, robot in enumerate(scene.robots[:8])
    ]
    if len(scene.robots) > 8:
        more = f"and {len(scene.robots) - 8} more"
        handles.append(Line2D([], [], color="none", label=more))
    handles.append(
        Line2D([], [], color="black", marker="o", linestyle="none", markersize=4, label="range finder")
    )
    handles.append(
        Patch(
            facecolor=_SEEN,
            edgecolor="#9dbfdb",
            label="fused area" if scene.recorded else "unoccupied area (true)",
        )
    )
    margin = f"reduced by the safety margin {scene.safety_margin:g} m"
    handles.append(Line2D([], [], color=_REDUCED, linestyle=(0, (4, 3)), linewidth=0.8, label=margin))
    if planned is not None:
        label = f"reduced by {planned:.2f} m: planned for"
        handles.append(Line2D([], [], color=_REDUCED, linestyle=(0, (1, 3)), linewidth=0.8, label=label))
    if not scene.recorded:
        handles.append(
            Line2D([], [], color="black", linestyle=":", linewidth=0.7, label="limit of its range")
        )
    if scene.movers:
        handles.append(Patch(facecolor=_MOVER, alpha=0.6, label="moving body (darker: later)"))
    handles.append(Line2D([], [], color="gray", marker="X", linestyle="none", markersize=6, label="target"))
    return handles
