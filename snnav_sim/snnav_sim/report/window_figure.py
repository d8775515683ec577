"""Figure of a robot that stops and goes on: its speed, and below it what is left of its certified window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from snnav_core.types import FloatArray
from snnav_sim.report.drawing import MARGIN, MOVER, SEEN, SEEN_EDGE, robot_colour

__all__ = ["WindowCurves", "draw_window"]

_WIDTH = 11.0  # inches
_DPI = 110
_SILENCE = "#8a8a8a"
_TURNING = 0.05  # [rad/s]
_MOST_WORDS = 10
_LABELS_APART = 0.2  # share of the width that the words of a mark need


@dataclass(frozen=True)
class WindowCurves:
    """What is drawn of one robot.

    Parameters
    ----------
    robot_id : str
    times : ndarray, shape (K,)
        [s]
    speeds, turn_rates : ndarray, shape (K - 1,)
        From each time to the next [m/s], [rad/s].
    window_left : ndarray, shape (K,)
        How long the robot may still follow its path [s].
    marks : sequence of (float, str)
        Times [s] of what was done, in words.
    silences : sequence of (float, float)
        From when to when [s] the time by which windows end stood still.
    """

    robot_id: str
    times: FloatArray
    speeds: FloatArray
    turn_rates: FloatArray
    window_left: FloatArray
    marks: Sequence[tuple[float, str]] = ()
    silences: Sequence[tuple[float, float]] = ()


def draw_window(title: str, curves: WindowCurves, file: Path) -> None:
    """Draw speed and certified window over time as a PNG, with a line for every mark; many marks have no words.

    Parameters
    ----------
    title : str
    curves : WindowCurves
    file : Path
    """
    figure = Figure(figsize=(_WIDTH, 5.4), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    colour, times = robot_colour(0), curves.times
    above.stairs(curves.speeds, times, color=colour, linewidth=1.6)
    above.stairs(curves.speeds, times, color=colour, fill=True, alpha=0.12)
    turning = np.append(np.abs(curves.turn_rates) > _TURNING, False)
    band = {"step": "post", "transform": above.get_xaxis_transform(), "linewidth": 0}
    above.fill_between(times, 0.0, 0.035, where=turning, color=MOVER, **band)
    above.set_ylim(0.0, 1.35 * max(float(curves.speeds.max(initial=0.0)), 0.1))
    above.set_ylabel(f"speed of {curves.robot_id} [m/s]")
    below.fill_between(times, curves.window_left, facecolor=SEEN, edgecolor="none")
    below.plot(times, curves.window_left, color=SEEN_EDGE, linewidth=1.4)
    below.set_ylim(0.0, 1.1 * max(float(curves.window_left.max(initial=0.0)), 0.1))
    below.set_ylabel("left of its certified window [s]")
    below.set_xlabel("time [s]")
    for axes in (above, below):
        _draw_background(axes, curves)
    _write_marks(above, curves)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    figure.legend(
        handles=_legend(colour, curves), loc="outside lower center", ncols=5, fontsize=8, frameon=False
    )
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)


def _draw_background(axes: Axes, curves: WindowCurves) -> None:
    axes.set_xlim(curves.times[0], curves.times[-1])
    axes.grid(alpha=0.25, linewidth=0.5)
    for begin, end in curves.silences:
        axes.axvspan(begin, end, color=_SILENCE, alpha=0.16, linewidth=0)
    for time, _ in curves.marks:
        axes.axvline(time, color=MARGIN, linewidth=1.3, linestyle="--", zorder=4)


def _write_marks(axes: Axes, curves: WindowCurves) -> None:
    """Write the words of the marks, unless there are too many, beside their lines; near ones share the height."""
    if len(curves.marks) > _MOST_WORDS:
        return
    apart = _LABELS_APART * float(curves.times[-1] - curves.times[0])
    last, row = -float("inf"), 0
    for time, text in sorted(curves.marks):
        row = (row + 1) % 3 if time - last < apart else 0
        last = time
        turned = time > float(curves.times[-1]) - apart
        axes.annotate(
            text,
            (time, 0.98 - 0.09 * row),
            xycoords=axes.get_xaxis_transform(),
            textcoords="offset points",
            xytext=(-5, 0) if turned else (5, 0),
            ha="right" if turned else "left",
            va="top",
            fontsize=9,
            color=MARGIN,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.0},
            zorder=5,
        )


def _legend(colour: str, curves: WindowCurves) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=colour, linewidth=1.6, label="speed"),
        Patch(facecolor=SEEN, edgecolor=SEEN_EDGE, label="certified: may still drive so long"),
    ]
    if (np.abs(curves.turn_rates) > _TURNING).any():
        handles.append(Patch(facecolor=MOVER, label="turns"))
    if curves.marks:
        handles.append(Line2D([], [], color=MARGIN, linewidth=1.3, linestyle="--", label="what was done"))
    if curves.silences:
        handles.append(Patch(facecolor=_SILENCE, alpha=0.16, label="no /clock: ROS time stands still"))
    return handles
