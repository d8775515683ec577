"""Figure of tracked bodies: their ways over the returns, and their speeds over time."""

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
from snnav_sim.report.drawing import MOVER, SOLID, robot_colour

__all__ = ["TrackCurve", "draw_tracks"]

_WIDTH, _DPI = 11.0, 110  # inches
_EXTENT_SHARE = (1.0, 99.0)  # percentiles of the returns that the figure has to show
_PAD = 0.4  # [m]
_MOST_POINTS = 40_000  # returns; more only blacken the figure
_SECONDS_PER_ARROW = 1.2


@dataclass(frozen=True)
class TrackCurve:
    """One body: times (N,) [s], places (N, 2) [m, map], velocities (N, 2) and their deviation (N,) [m/s]."""

    id: str
    times: FloatArray
    places: FloatArray
    velocities: FloatArray
    deviations: FloatArray


def draw_tracks(
    title: str,
    sensors: FloatArray,
    returns: FloatArray,
    people: FloatArray,
    tracks: Sequence[TrackCurve],
    span: tuple[float, float],
    file: Path,
) -> None:
    """Draw where bodies went and how fast, as a PNG.

    Parameters
    ----------
    title : str
    sensors : ndarray, shape (S, 2)
        Positions of the scanners [m, map].
    returns, people : ndarray, shape (K, 2)
        What was measured of walls and of people [m, map].
    tracks : sequence of TrackCurve
    span : pair of float
        Time shown [s].
    file : path
    """
    everything = np.concatenate((returns, people, sensors))
    low, high = np.percentile(everything, _EXTENT_SHARE, axis=0)
    low, high = np.minimum(low, sensors.min(axis=0)) - _PAD, np.maximum(high, sensors.max(axis=0)) + _PAD
    width, height = (high - low).tolist()
    figure = Figure(figsize=(_WIDTH, min(8.5, _WIDTH * height / width) + 3.4), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(min(8.5, _WIDTH * height / width), 2.6))
    above.plot(*_thinned(returns).T, ".", color=SOLID, markersize=1.0, alpha=0.5)
    above.plot(*_thinned(people).T, ".", color=MOVER, markersize=1.0, alpha=0.35)
    above.plot(*sensors.T, "^", color="black", markersize=6)
    for index, track in enumerate(tracks):
        _draw_way(above, track, robot_colour(index))
        _draw_speed(below, track, robot_colour(index))
    above.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    below.set(xlim=span, xlabel="time from the start of the recording [s]", ylabel="speed [m/s]")
    below.set_ylim(bottom=0.0)
    below.grid(alpha=0.25, linewidth=0.5)
    figure.suptitle(f"{title}: bodies that moved", x=0.01, ha="left", fontsize=11)
    figure.legend(handles=_legend(tracks), loc="outside lower center", ncols=6, fontsize=8, frameon=False)
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)


def _draw_way(axes: Axes, track: TrackCurve, colour: str) -> None:
    axes.plot(*_with_gaps(track, track.places).T, "-", color=colour, linewidth=1.6)
    axes.plot(*track.places.T, ".", color=colour, markersize=4)
    seconds = np.floor((track.times - track.times[0]) / _SECONDS_PER_ARROW)
    chosen = np.flatnonzero(np.diff(seconds, prepend=-1.0) > 0)
    axes.quiver(
        *track.places[chosen].T,
        *track.velocities[chosen].T,
        color=colour,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        width=0.003,
        zorder=5,
    )


def _draw_speed(axes: Axes, track: TrackCurve, colour: str) -> None:
    speeds = np.hypot(*track.velocities.T)
    band = _with_gaps(track, np.column_stack((track.times, speeds, track.deviations)))
    axes.fill_between(
        band[:, 0],
        np.maximum(band[:, 1] - band[:, 2], 0.0),
        band[:, 1] + band[:, 2],
        color=colour,
        alpha=0.2,
        linewidth=0,
    )
    axes.plot(band[:, 0], band[:, 1], "-", color=colour, linewidth=1.5)


def _with_gaps(track: TrackCurve, values: FloatArray) -> FloatArray:
    """Rows (N, C) with a row of NaN where the body stood or was not seen for a while."""
    steps = np.diff(track.times)
    gaps = np.flatnonzero(steps > 1.5 * np.median(steps)) + 1 if len(steps) else np.zeros(0, dtype=np.int64)
    broken: FloatArray = np.insert(values, gaps, np.nan, axis=0)
    return broken


def _thinned(points: FloatArray) -> FloatArray:
    step = max(1, len(points) // _MOST_POINTS)
    return points[::step]


def _legend(tracks: Sequence[TrackCurve]) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color="black", linestyle="", marker="^", label="scanner"),
        Line2D([], [], color=SOLID, label="returns", linestyle="", marker="."),
        Line2D([], [], color=MOVER, label="returns of people", linestyle="", marker="."),
    ]
    handles += [
        Line2D([], [], color=robot_colour(index), linewidth=1.6, label=track.id)
        for index, track in enumerate(tracks[:6])
    ]
    if tracks:
        handles.append(Patch(facecolor=robot_colour(0), alpha=0.2, label="standard deviation"))
    return handles
