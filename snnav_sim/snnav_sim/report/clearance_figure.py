"""Clearance of all robots over time, beside the margin."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from snnav_core.types import FloatArray
from snnav_sim.report.drawing import MARGIN, draw_shares
from snnav_sim.report.look import Look
from snnav_sim.report.record import RunRecord
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import Scene

__all__ = ["draw_clearance"]

_WIDTH = 11.0  # inches
_DPI = 110
_SHOWN = 8.0  # times the margin; larger distances are left out when there are many robots


def draw_clearance(scene: Scene, record: RunRecord, truth: GroundTruth, file: Path) -> None:
    """Draw the distances of every robot's centre over time as a PNG.

    To the boundary of the true unoccupied area (Ch. 3: to the undetected areas) and to the true obstacles; with the
    global planner, which keeps clear of bodies (Ch. 2), to these only.
    """
    figure = Figure(figsize=(_WIDTH, 4.2), layout="constrained")
    axes = figure.add_subplot()
    look = Look.of(scene)
    if look.crowded:
        bottom, top = _draw_many_distances(axes, scene, record, truth, look)
    else:
        bottom, top = _draw_few_distances(axes, scene, record, truth, look)
    axes.axhspan(bottom, scene.safety_margin, color=MARGIN, alpha=0.08, linewidth=0)
    label = f"safety margin {scene.safety_margin:g} m"
    axes.axhline(scene.safety_margin, color=MARGIN, linewidth=1.2, linestyle="--", label=label)
    axes.set_xlim(0.0, max(record.end, scene.sampling_interval))
    axes.set_ylim(bottom, 1.05 * top)
    axes.grid(alpha=0.25, linewidth=0.5)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("distance [m]")
    what = "bodies and walls" if scene.plans_globally else "all that may hide an obstacle"
    what = "fused area and recorded returns" if scene.recorded else what
    axes.set_title(f"{scene.name}: distance from the robot's centre to {what}", loc="left", fontsize=11)
    axes.legend(fontsize=8, ncols=3, frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.15))
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)


def _draw_few_distances(
    axes: Axes, scene: Scene, record: RunRecord, truth: GroundTruth, look: Look
) -> tuple[float, float]:
    """Draw two named curves of every robot; return how far up and down to show [m]."""
    bottom, top = 0.0, 2.0 * scene.safety_margin
    for robot, colour in zip(scene.robots, look.colours, strict=True):
        rows = record.trajectory(robot.id)
        if len(rows) > 0:
            low, high = _draw_distances(axes, scene, truth, robot.id, rows, colour)
            bottom, top = min(bottom, low), max(top, high)
    return bottom, top


def _draw_many_distances(
    axes: Axes, scene: Scene, record: RunRecord, truth: GroundTruth, look: Look
) -> tuple[float, float]:
    """Draw one thin curve per robot, or shares of them, and the least distance of all; return the limits [m]."""
    times = np.arange(0.0, record.end + scene.control_period, scene.control_period)
    curves = np.full((len(scene.robots), len(times)), np.inf)
    lowest: tuple[float, float, str] = (math.inf, 0.0, "")
    for index, robot in enumerate(scene.robots):
        rows = record.trajectory(robot.id)
        if len(rows) == 0:
            continue
        distance, when = truth.clearance(rows[:, 1:3], rows[:, 0]), rows[:, 0]
        if not scene.plans_globally:
            distance, exact = truth.area_clearance(rows[:, 1:3], rows[:, 0])
            distance, when = distance[exact], rows[exact, 0]
        curves[index] = np.interp(times, when, distance, left=np.inf, right=np.inf)
        low = int(np.argmin(distance))
        lowest = min(lowest, (float(distance[low]), float(when[low]), robot.id))
    if look.crowd:
        draw_shares(axes, times, curves)
    for curve, colour in zip(curves, look.colours, strict=True) if look.named else ():
        axes.plot(times, curve, color=colour, linewidth=0.7)
    axes.plot(times, curves.min(axis=0), color="black", linewidth=1.6, label="least of all robots")
    least, time, name = lowest
    if name:
        label = f"least: {np.floor(100.0 * least) / 100.0:.2f} m, {name}, {time:.1f} s"
        axes.plot(time, least, "o", color="black", markersize=5, label=label, zorder=5)
    shown = max(_SHOWN * scene.safety_margin, 1.5 * least if name else 0.0)
    return min(0.0, least), shown


def _draw_distances(
    axes: Axes, scene: Scene, truth: GroundTruth, name: str, rows: FloatArray, colour: str
) -> tuple[float, float]:
    """Draw the curves of one robot with their lowest points; return the least and greatest distance [m]."""
    to_obstacles = truth.clearance(rows[:, 1:3], rows[:, 0])
    if scene.recorded or scene.plans_globally:
        return _draw_curve(axes, rows[:, 0], to_obstacles, name, color=colour, linewidth=1.7)
    to_area, exact = truth.area_clearance(rows[:, 1:3], rows[:, 0])
    area = f"{name}: unoccupied area's boundary"
    low, _ = _draw_curve(axes, rows[exact, 0], to_area[exact], area, color=colour, linewidth=1.7)
    dots: dict[str, Any] = {"color": colour, "linewidth": 1.0, "linestyle": (0, (1, 1.5))}
    _, high = _draw_curve(axes, rows[:, 0], to_obstacles, f"{name}: obstacles", **dots)
    return low, high


def _draw_curve(
    axes: Axes, times: FloatArray, distance: FloatArray, label: str, **style: Any
) -> tuple[float, float]:
    lowest = int(np.argmin(distance))
    least = np.floor(100.0 * distance[lowest]) / 100.0
    axes.plot(times, distance, label=f"{label}, least {least:.2f} m", **style)
    axes.plot(times[lowest], distance[lowest], marker="o", markersize=4, color=style["color"])
    return float(distance[lowest]), float(distance.max())
