"""Figures of a run in space: the room from two viewpoints and the distances over time."""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mpl_toolkits.mplot3d import Axes3D

from snnav_core.types import FloatArray
from snnav_sim.report.drawing import MARGIN, MOVER, robot_colour
from snnav_sim.report.flight_metrics import flight_clearances, flight_separations
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.flight_view import write_flight_view
from snnav_sim.report.space_drawing import CAMERA, draw_room, set_up_view
from snnav_sim.space_types import SpaceScene

__all__ = ["draw_flight", "draw_flight_clearance", "draw_flight_scene", "draw_tracking"]

_DPI = 110
_VIEWS = ((28.0, -58.0), (89.9, -90.0))  # from aside and from above [degrees]
_SHOWN = 6.0  # times the margin; larger distances are cut off
_ARROWS = 3.0  # [s] between two marks on a trajectory


def draw_flight(scene: SpaceScene, record: FlightRecord, directory: Path) -> None:
    """Draw all figures of a run into a directory."""
    draw_flight_scene(scene, record, directory / "scene.png")
    if not any(record.samples.values()):
        return
    write_flight_view(scene, record, directory / "view.html")
    draw_flight_clearance(scene, record, directory / "clearance.png")
    if any(record.errors.values()):
        draw_tracking(scene, record, directory / "tracking.png")


def draw_flight_scene(scene: SpaceScene, record: FlightRecord, file: Path) -> None:
    """Draw room, cameras, people at the end, trajectories, starts and targets from two viewpoints as a PNG."""
    figure = Figure(figsize=(14.0, 6.6))
    for index, (elevation, azimuth) in enumerate(_VIEWS):
        axes = cast(Axes3D, figure.add_subplot(1, 2, index + 1, projection="3d", computed_zorder=False))
        set_up_view(axes, scene, elevation, azimuth)
        draw_room(axes, scene, record.end)
        for number, robot in enumerate(scene.robots):
            colour, rows = robot_colour(number), record.trajectory(robot.id)
            if robot.curve:
                path = next((d.path for d in record.decisions_of(robot.id) if d.path is not None), None)
                if path is not None:
                    axes.plot(*path.points.T, color="black", linewidth=1.0, linestyle="--")
            axes.plot(*rows[:, 1:4].T, color=colour, linewidth=2.0)
            axes.scatter(*robot.start, color=colour, s=34, depthshade=False)
            axes.scatter(*robot.target, color=colour, marker="*", s=110, depthshade=False)
    figure.suptitle(f"{scene.name}: from aside and from above", x=0.02, ha="left", fontsize=11)
    handles = [
        Line2D([], [], color=robot_colour(k), linewidth=2.0, label=robot.id)
        for k, robot in enumerate(scene.robots)
    ]
    handles += [
        Line2D([], [], color="grey", marker="o", linestyle="", label="start"),
        Line2D([], [], color="grey", marker="*", markersize=10, linestyle="", label="target"),
    ]
    if scene.sensors:
        handles.append(
            Line2D([], [], color=CAMERA, marker="s", markersize=4, label="camera and where it looks")
        )
    if scene.movers:
        handles.append(
            Line2D([], [], color=MOVER, linewidth=5, alpha=0.5, label="people (at the end) and their ways")
        )
    if any(robot.curve for robot in scene.robots):
        handles.append(Line2D([], [], color="black", linestyle="--", linewidth=1.0, label="given curve"))
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), fontsize=8, frameon=False)
    figure.subplots_adjust(left=0.01, right=0.98, bottom=0.07, top=0.95, wspace=0.02)
    figure.savefig(file, dpi=_DPI)


def draw_flight_clearance(scene: SpaceScene, record: FlightRecord, file: Path) -> None:
    """Draw the distance of every robot's centre to the nearest true body, and to other robots, over time as a PNG."""
    clearances, separations = flight_clearances(scene, record), flight_separations(scene, record)
    several = len(scene.robots) > 1
    figure = Figure(figsize=(11.0, 6.4 if several else 3.8), layout="constrained")
    panels = [("the nearest body, floor, wall or ceiling", clearances)]
    if several:
        panels.append(("the nearest sphere of another robot", separations))
    for index, (what, distances) in enumerate(panels):
        axes = figure.add_subplot(len(panels), 1, index + 1)
        least = min((float(each.min(initial=np.inf)) for each in distances.values()), default=np.inf)
        for number, robot in enumerate(scene.robots):
            rows: FloatArray = record.trajectory(robot.id)
            axes.plot(
                rows[:, 0], distances[robot.id], color=robot_colour(number), linewidth=1.4, label=robot.id
            )
        axes.axhline(scene.safety_margin, color=MARGIN, linewidth=1.2, linestyle="--",
                     label=f"safety margin {scene.safety_margin:g} m")  # fmt: skip
        axes.axhspan(min(0.0, least), scene.safety_margin, color=MARGIN, alpha=0.08, linewidth=0)
        top = max(
            (float(each[np.isfinite(each)].max(initial=0.0)) for each in distances.values()), default=1.0
        )
        axes.set_ylim(
            min(0.0, least), min(1.08 * max(top, scene.safety_margin), _SHOWN * scene.safety_margin)
        )
        axes.set_xlim(0.0, max(record.end, scene.sampling_interval))
        axes.grid(alpha=0.25, linewidth=0.5)
        axes.set_ylabel("distance [m]")
        axes.set_title(f"{scene.name}: to {what}; least {least:.3f} m", loc="left", fontsize=10)
    axes.set_xlabel("time [s]")
    axes.legend(fontsize=8, ncols=5, frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.18))
    figure.savefig(file, dpi=_DPI)


def draw_tracking(scene: SpaceScene, record: FlightRecord, file: Path) -> None:
    """Draw e_d and e_a of every robot over time as a PNG; e_d on a logarithmic scale."""
    figure = Figure(figsize=(11.0, 5.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    for number, robot in enumerate(scene.robots):
        rows = np.array(record.errors.get(robot.id, [])).reshape(-1, 3)
        above.plot(rows[:, 0], 1e3 * np.maximum(rows[:, 1], 1e-5), color=robot_colour(number), label=robot.id)
        below.plot(rows[:, 0], np.degrees(rows[:, 2]), color=robot_colour(number), linewidth=1.0)
    above.axhline(50.0, color=MARGIN, linewidth=1.0, linestyle="--", label="50 mm")
    above.set_yscale("log")
    above.set_ylabel("distance error e_d [mm]")
    below.set_ylabel("angle error e_a [deg]")
    below.set_xlabel("time [s]")
    for axes in (above, below):
        axes.grid(alpha=0.25, linewidth=0.5)
    above.legend(fontsize=8, ncols=5, frameon=False, loc="upper right")
    above.set_title(f"{scene.name}: how far robots are off their paths", loc="left", fontsize=10)
    figure.savefig(file, dpi=_DPI)
