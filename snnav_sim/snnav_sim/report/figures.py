"""The scene of a run from above, with what was seen, planned and driven."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle as CirclePatch
from matplotlib.patches import Patch

from snnav_core.types import FloatArray
from snnav_sim.report.drawing import (
    MOVER,
    SEEN,
    SEEN_EDGE,
    UNSEEN,
    draw_mover,
    draw_sensor,
    draw_world,
    fill,
    frame,
)
from snnav_sim.report.look import Look, short_names
from snnav_sim.report.record import RunRecord
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import Mover, RobotScene, Scene
from snnav_sim.world import mover_positions

__all__ = ["draw_scene"]

_REDUCED = "#5b8db8"
_OUTLINE: dict[str, Any] = {"facecolor": "none", "linewidth": 0.8}
_WIDTH = 11.0  # inches
_DPI = 110
_PATHS_SHOWN = 6
_GHOSTS = 5
_LONGEST = 90  # letters of a reason in a title


def draw_scene(scene: Scene, record: RunRecord, truth: GroundTruth, file: Path) -> None:
    """Draw the scene from above with sensors, areas, paths and trajectories as a PNG."""
    width, height = (scene.workspace.max(axis=0) - scene.workspace.min(axis=0)).tolist()
    figure = Figure(
        figsize=(_WIDTH, min(14.0, max(3.5, (_WIDTH - 1.0) * height / width + 1.6))), layout="constrained"
    )
    axes = figure.add_subplot()
    fill(axes, shapely.Polygon(scene.workspace), facecolor=UNSEEN, edgecolor="none")
    fill(axes, truth.area, facecolor=SEEN, edgecolor=SEEN_EDGE, linewidth=0.6)
    margin = truth.reduced_area(scene.safety_margin)
    fill(axes, margin, edgecolor=_REDUCED, linestyle=(0, (4, 3)), **_OUTLINE)
    planned = _planning_distance(scene, record)
    if planned is not None:
        fill(axes, truth.reduced_area(planned), edgecolor=_REDUCED, linestyle=(0, (1, 3)), **_OUTLINE)
    draw_world(axes, scene, truth)
    limits = [draw_sensor(axes, scene, sensor) for sensor in scene.sensors]
    for mover in scene.movers:
        _draw_way(axes, mover, record.end)
    look = Look.of(scene)
    for robot, colour in zip(scene.robots, look.colours, strict=True):
        _draw_drive(axes, scene, robot, record, look, colour)
    frame(axes, scene)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_title(_title(scene, record), loc="left", fontsize=11)
    handles = _legend(scene, planned, any(limits))
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)


def _draw_drive(
    axes: Axes, scene: Scene, robot: RobotScene, record: RunRecord, look: Look, colour: str
) -> None:
    """Draw start, published paths, trajectory and target of a robot."""
    rows = record.trajectory(robot.id)
    for path in _shown_paths(record, robot.id) if not look.crowded else ():
        axes.plot(path[:, 0], path[:, 1], color=colour, linewidth=0.8, alpha=0.45, zorder=5)
    axes.plot(rows[:, 1], rows[:, 2], color=colour, linewidth=look.width, zorder=6, label=robot.id)
    disk = CirclePatch(
        robot.start, robot.radius, facecolor="white", edgecolor=colour, linewidth=1.5 * look.marks, zorder=7
    )
    axes.add_patch(disk)
    if look.named:
        name = short_names([each.id for each in scene.robots])[robot.id]
        away = np.array(robot.start) - robot.target
        x, y = np.array(robot.start) + (robot.radius + 0.5) * away / max(float(np.hypot(*away)), 1e-9)
        axes.text(
            float(x),
            float(y),
            name,
            color=colour,
            fontsize=8,
            ha="center",
            va="center",
            zorder=9,
            clip_on=True,
        )
    if not look.crowded and (scene.movers or len(scene.robots) > 1):
        _draw_robot_ghosts(axes, rows, robot.radius, colour)
    size = 9 * look.marks
    for target in (robot.target, *(change.target for change in robot.retargets)):
        axes.plot(*target, marker="X", markersize=size, color=colour, markeredgecolor="white", zorder=8)


def _planning_distance(scene: Scene, record: RunRecord) -> float | None:
    """Return the least distance that a path was planned for [m], if a line for it can be told from the margin's."""
    distances = [d.planning_distance for d in record.decisions if d.planning_distance is not None]
    planned = min(distances, default=0.0)
    return planned if planned > 1.1 * scene.safety_margin else None


def _title(scene: Scene, record: RunRecord) -> str:
    return f"{scene.name}, seed {record.seed}" + (
        f": {_short(record.reason)} at {record.end:.1f} s" if record.samples else ""
    )


def _short(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"


def _draw_way(axes: Axes, mover: Mover, end: float) -> None:
    """Draw the way of a body and where it is at some times."""
    way = mover_positions(mover, np.linspace(0.0, end, 400))
    axes.plot(way[:, 0], way[:, 1], color=MOVER, linewidth=0.9, linestyle=":", zorder=4)
    for index, time in enumerate(np.linspace(0.0, end, _GHOSTS)):
        draw_mover(axes, mover, float(time), alpha=0.25 + 0.6 * index / (_GHOSTS - 1), zorder=5)


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


def _legend(scene: Scene, planned: float | None, limits: bool) -> list[Line2D | Patch]:
    look = Look.of(scene)
    handles: list[Line2D | Patch] = [*look.legend(max(look.width, 1.5))]
    if look.named:
        handles.append(
            Line2D([], [], color="gray", linewidth=look.width, label="trajectory of the robot named")
        )
    handles.append(
        Line2D([], [], color="black", marker="o", linestyle="none", markersize=4, label="range finder")
    )
    handles.append(
        Patch(
            facecolor=SEEN,
            edgecolor=SEEN_EDGE,
            label="fused area" if scene.recorded else _area_name(scene),
        )
    )
    margin = f"reduced by the safety margin {scene.safety_margin:g} m"
    handles.append(Line2D([], [], color=_REDUCED, linestyle=(0, (4, 3)), linewidth=0.8, label=margin))
    if planned is not None:
        label = f"reduced by {planned:.2f} m: planned for"
        handles.append(Line2D([], [], color=_REDUCED, linestyle=(0, (1, 3)), linewidth=0.8, label=label))
    if limits:
        handles.append(Line2D([], [], color="black", linestyle=":", linewidth=0.7, label="limit of a range"))
    if scene.movers:
        handles.append(Patch(facecolor=MOVER, alpha=0.6, label="moving body (darker: later)"))
    handles.append(Line2D([], [], color="gray", marker="X", linestyle="none", markersize=6, label="target"))
    return handles


def _area_name(scene: Scene) -> str:
    return "what sensors see without moving bodies" if scene.movers else "unoccupied area (true)"
