"""What ``snnav windows`` does."""

from __future__ import annotations

import argparse
import math

import numpy as np

from snnav_ros.bag.drives import Drive, read_drive
from snnav_ros.bag.errors import BagError
from snnav_ros.bag.files import write_atomically
from snnav_ros.run_display import make_console
from snnav_sim.report.window_figure import WindowCurves, draw_window

__all__ = ["run", "window_curves"]

_STEP = 0.1  # [s] from point to point of a curve
_MOST_STEPS = 3000  # more cannot be told apart in a figure


def run(arguments: argparse.Namespace) -> int:
    """Run ``snnav windows``."""
    if arguments.out is not None and arguments.out.suffix != ".png":
        raise BagError(f"{arguments.out}: only .png can be drawn; give such a name")
    drive = read_drive(arguments.bag, arguments.robot)
    begin, end = _part(drive, arguments)
    lines, status = _summary(drive, begin, end)
    if arguments.out is not None:
        curves = window_curves(drive, begin, end)
        write_atomically(arguments.out, lambda draft: draw_window(lines[0], curves, draft))
        lines.append(f"figure: {arguments.out}")
    console = make_console()
    for line in lines:
        console.print(line, soft_wrap=True, highlight=False, markup=False)
    return status


def window_curves(drive: Drive, begin: float, end: float, zero: float = 0.0) -> WindowCurves:
    """Return what `draw_window` draws.

    Parameters
    ----------
    drive : Drive
    begin, end : float
        Log times [s].
    zero : float
        Log time that the figure calls zero [s].
    """
    count = max(1, min(_MOST_STEPS, round((end - begin) / _STEP)))
    times = np.linspace(begin, end, count + 1)
    speeds, turn_rates, left = drive.over_time(times)
    marks = [(event.log - zero, event.text) for event in drive.events if begin <= event.log <= end]
    silences = [(max(first, begin) - zero, min(last, end) - zero) for first, last in drive.silences()]
    return WindowCurves(
        drive.robot_id,
        times - zero,
        speeds,
        turn_rates,
        left,
        marks,
        [pair for pair in silences if pair[0] < pair[1]],
    )


def _part(drive: Drive, arguments: argparse.Namespace) -> tuple[float, float]:
    """Return the log times of the part that was asked for."""
    last = max(float(drive.poses[-1, 0]), float(drive.clock[-1, 0]))
    end = last if arguments.duration is None else min(last, arguments.start + arguments.duration)
    if arguments.start >= end:
        raise BagError(
            f"{arguments.bag}: ends at {last:.1f} s; give a smaller --start than {arguments.start:g}"
        )
    return arguments.start, end


def _summary(drive: Drive, begin: float, end: float) -> tuple[list[str], int]:
    """Return the result in lines, and the exit status."""
    motions = drive.motions()
    there = (motions.log >= begin) & (motions.log <= end)
    way = f"{drive.robot_id} drove {drive.distance(begin, end):.1f} m in {end - begin:.1f} s"
    late = (motions.end - motions.allowed_until)[there]
    outside = late > 1e-6
    if not outside.any():
        nearest = f", the nearest to its end {-late.max():.2f} s before it" if len(late) else ""
        return [f"{way}, always inside a certified window{nearest}"], 0
    first = float(motions.log[there][outside][0])
    worst = float(late.max())
    by = f"by up to {worst:.2f} s" if math.isfinite(worst) else "some without any"
    return [
        f"{way}, {int(outside.sum())} of {len(late)} motions outside its certified windows",
        f"outside {by}, first {first:.2f} s from the start of the recording",
    ], 1
