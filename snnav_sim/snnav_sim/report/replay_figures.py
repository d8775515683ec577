"""Figures of a replay: recorded people, the area and the simulated robots at some times; distances over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle as CirclePatch
from matplotlib.patches import Patch
from shapely.geometry.base import BaseGeometry

from snnav_core.types import FloatArray
from snnav_sim.report.drawing import MARGIN, MOVER, SEEN, SEEN_EDGE, SOLID, UNSEEN, fill, robot_colour

__all__ = ["Distances", "Moment", "RobotMoment", "draw_distances", "draw_moments"]

_WIDTH = 11.0  # inches
_DPI = 110
_EXTENT_SHARE = (1.0, 99.0)  # percentiles of the returns that the figure has to show
_PAD = 0.4  # [m]
_ARROW = 1.6  # length of the line that shows the heading, in radii


@dataclass(frozen=True)
class RobotMoment:
    """A robot at one time: where it is [m, rad, map], where it has been and plans to be, what it does in words."""

    id: str
    position: tuple[float, float]
    heading: float
    radius: float
    goal: tuple[float, float]
    driven: FloatArray
    planned: FloatArray | None
    doing: str


@dataclass(frozen=True)
class Moment:
    """What there is to see at one time [s]: the area, latest returns (K, 2) of people and others [m, map], robots."""

    time: float
    area: BaseGeometry
    people: FloatArray
    others: FloatArray
    robots: tuple[RobotMoment, ...]


@dataclass(frozen=True)
class Distances:
    """Distances of one robot's disk over time [s], [m]: to all returns and to people; times when it stood."""

    id: str
    times: FloatArray
    to_returns: FloatArray
    to_people: FloatArray
    standing: Sequence[tuple[float, float]]


def draw_moments(title: str, sensors: FloatArray, moments: Sequence[Moment], file: Path) -> None:
    """Draw some moments side by side as a PNG.

    Parameters
    ----------
    title : str
    sensors : ndarray, shape (S, 2)
        Positions of the scanners [m, map].
    moments : sequence of Moment
    file : path
    """
    low, high = _extent(sensors, moments)
    width, height = (high - low).tolist()
    columns = len(moments) if height > 1.6 * width else min(2, len(moments))
    lines = math.ceil(len(moments) / columns)
    panel = (_WIDTH - 0.6) / columns - 0.3
    size = (_WIDTH, lines * (min(panel * height / width, 9.0) + 0.55) + 1.0)
    figure = Figure(figsize=size, layout="constrained")
    panels = figure.subplots(lines, columns, squeeze=False)
    for index, axes in enumerate(panels.flat):
        if index >= len(moments):
            axes.set_visible(False)
            continue
        _draw_moment(axes, sensors, moments[index])
        axes.set_xlim(low[0], high[0])
        axes.set_ylim(low[1], high[1])
        axes.set_aspect("equal")
        axes.label_outer()
        if axes.get_subplotspec().is_last_row():
            axes.set_xlabel("x [m]")
        if axes.get_subplotspec().is_first_col():
            axes.set_ylabel("y [m]")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    handles = _legend(moments[0].robots)
    figure.legend(
        handles=handles, loc="outside lower center", ncols=min(7, len(handles)), fontsize=8, frameon=False
    )
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)


def draw_distances(title: str, robots: Sequence[Distances], file: Path) -> None:
    """Draw the distance from every robot's disk to the nearest return over time as a PNG, one panel a robot."""
    figure = Figure(figsize=(_WIDTH, 0.9 + 3.1 * len(robots)), layout="constrained")
    panels = figure.subplots(len(robots), 1, squeeze=False, sharex=True)[:, 0]
    for index, (axes, robot) in enumerate(zip(panels, robots, strict=True)):
        for begin, end in robot.standing:
            axes.axvspan(begin, end, color="#8a8a8a", alpha=0.16, linewidth=0)
        axes.plot(
            robot.times,
            robot.to_returns,
            color=SOLID,
            linewidth=0.9,
            alpha=0.7,
            label="to the nearest return",
        )
        _draw_to_people(axes, robot)
        axes.axhline(0.0, color=MARGIN, linewidth=1.2, linestyle="--")
        axes.set_ylim(min(-0.05, 1.1 * float(robot.to_returns.min(initial=0.0))), _top(robot))
        axes.set_xlim(robot.times[0], robot.times[-1])
        axes.grid(alpha=0.25, linewidth=0.5)
        axes.set_ylabel("distance from the disk [m]")
        axes.set_title(robot.id, loc="left", fontsize=9, color=robot_colour(index))
    panels[-1].set_xlabel("time from the start of the recording [s]")
    handles, _ = panels[0].get_legend_handles_labels()
    handles += [
        Patch(facecolor="#8a8a8a", alpha=0.16, label="robot stands"),
        Line2D([], [], color=MARGIN, linewidth=1.2, linestyle="--", label="rim of the disk"),
    ]
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)


def _draw_to_people(axes: Axes, robot: Distances) -> None:
    there = np.where(np.isfinite(robot.to_people), robot.to_people, np.nan)
    axes.plot(robot.times, there, color=MOVER, linewidth=1.6, label="to the nearest person")
    if np.isfinite(there).any():
        lowest = int(np.nanargmin(there))
        axes.plot(robot.times[lowest], there[lowest], marker="o", markersize=4, color=MOVER)
        axes.annotate(
            f"{there[lowest]:.2f} m",
            (robot.times[lowest], there[lowest]),
            textcoords="offset points",
            xytext=(6, 9),
            fontsize=8,
            color=MOVER,
        )


def _top(robot: Distances) -> float:
    seen = np.concatenate([robot.to_returns, robot.to_people])
    seen = seen[np.isfinite(seen)]
    return 1.1 * float(seen.max()) if len(seen) else 1.0


def _extent(sensors: FloatArray, moments: Sequence[Moment]) -> tuple[FloatArray, FloatArray]:
    """Return the corners of what has to be seen: areas, robots, sensors and nearly all returns."""
    points = [sensors]
    for moment in moments:
        if not moment.area.is_empty:
            points.append(np.reshape(moment.area.bounds, (2, 2)))
        points += [np.array([robot.position, robot.goal]) for robot in moment.robots]
        returns = np.vstack((moment.people, moment.others))
        if len(returns):
            points.append(np.percentile(returns, _EXTENT_SHARE, axis=0))
    corners = np.vstack(points)
    return corners.min(axis=0) - _PAD, corners.max(axis=0) + _PAD


def _draw_moment(axes: Axes, sensors: FloatArray, moment: Moment) -> None:
    axes.set_facecolor(UNSEEN)
    fill(axes, moment.area, facecolor=SEEN, edgecolor=SEEN_EDGE, linewidth=0.6, zorder=1)
    axes.plot(*moment.others.T, ".", color=SOLID, markersize=2.0, zorder=3)
    axes.plot(*moment.people.T, ".", color=MOVER, markersize=5.0, zorder=6)
    axes.plot(
        *sensors.T, "^", color="black", markersize=6, markeredgecolor="white", linestyle="none", zorder=8
    )
    for index, robot in enumerate(moment.robots):
        _draw_robot(axes, robot, robot_colour(index))
    doing = "; ".join(
        robot.doing if len(moment.robots) == 1 else f"{robot.id} {robot.doing}" for robot in moment.robots
    )
    axes.set_title(f"{moment.time:.1f} s: {doing}", loc="left", fontsize=9)


def _draw_robot(axes: Axes, robot: RobotMoment, colour: str) -> None:
    axes.plot(*robot.driven.T, color=colour, linewidth=1.4, alpha=0.35, zorder=4)
    if robot.planned is not None:
        axes.plot(*robot.planned[:, :2].T, color=colour, linewidth=1.6, zorder=5)
    axes.plot(*robot.goal, marker="X", markersize=9, color=colour, markeredgecolor="white", zorder=7)
    x, y = robot.position
    axes.add_patch(
        CirclePatch((x, y), robot.radius, facecolor=colour, edgecolor="white", linewidth=0.8, zorder=9)
    )
    tip = _ARROW * robot.radius
    axes.plot(
        [x, x + tip * math.cos(robot.heading)],
        [y, y + tip * math.sin(robot.heading)],
        color=colour,
        linewidth=2.0,
        zorder=9,
    )


def _legend(robots: Sequence[RobotMoment]) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=robot_colour(index), marker="o", markersize=7, label=f"{robot.id} and its path")
        for index, robot in enumerate(robots)
    ]
    marks = (
        (robot_colour(0), "X", 7, "target"),
        (MOVER, ".", 7, "returns of people"),
        (SOLID, ".", 4, "other returns"),
        ("black", "^", 5, "range finder"),
    )
    handles.append(
        Line2D([], [], color=robot_colour(0), linewidth=1.4, alpha=0.35, label="driven on this trip")
    )
    handles += [
        Line2D([], [], color=colour, marker=marker, markersize=size, linestyle="none", label=label)
        for colour, marker, size, label in marks
    ]
    handles.append(Patch(facecolor=SEEN, edgecolor=SEEN_EDGE, label="known to be free"))
    return handles
