"""Figures of a campaign: ratios to the optimum, distances kept, times of the steps."""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from snnav_sim.report.drawing import MARGIN

__all__ = ["margin_figure", "ratio_figure", "step_figure"]

_FIRST, _SECOND = "#0b5fa5", "#e08e0b"
_DPI = 110
_BINS = 40


def ratio_figure(planned: Sequence[float], safety_margin: Sequence[float]) -> bytes:
    """Draw how long ways were against the exact optimum at the planning distance, and at the safety margin.

    Returns
    -------
    bytes
        A PNG image.
    """
    figure, axes = _frame("travelled length / exact optimum", "robots that arrived")
    top = max(1.2, float(np.percentile([*planned, *safety_margin, 1.0], 98)) + 0.02)
    bins = np.linspace(min(0.98, *planned, *safety_margin, 1.0), top, _BINS).tolist()
    for values, colour, name in (
        (planned, _FIRST, "at the planning distance"),
        (safety_margin, _SECOND, "at the safety margin"),
    ):
        if len(values) > 0:
            median, high = np.percentile(values, (50, 95))
            label = f"{name}: median {median:.3f}, 95 % below {high:.3f}"
            axes.hist(
                np.minimum(values, top), bins, histtype="step", color=colour, linewidth=1.8, label=label
            )
            axes.axvline(high, color=colour, linewidth=1.0, linestyle=":")
    beyond = int(np.sum(np.asarray(planned) > top))
    axes.set_title(f"{beyond} beyond {top:.2f} in the last bin" if beyond else "", fontsize=9, loc="left")
    return _image(figure, axes)


def margin_figure(clearances: Sequence[float], separations: Sequence[float]) -> bytes:
    """Draw how far every robot kept beyond the safety margin from obstacles and other robots [m], as a PNG image."""
    figure, axes = _frame("least distance of a robot - safety margin (m)", "robots")
    known = [*clearances, *separations, 0.0]
    top = min(2.0, max(known))
    bins = np.linspace(min(known), max(top, 0.1), _BINS).tolist()
    for values, colour, name in (
        (clearances, _FIRST, "to obstacles, walls and walkers"),
        (separations, _SECOND, "to other robots"),
    ):
        if len(values) > 0:
            label = f"{name}: least {np.floor(1e3 * min(values)) / 1e3:+.3f} m"
            axes.hist(
                np.minimum(values, bins[-1]), bins, histtype="step", color=colour, linewidth=1.8, label=label
            )
    axes.axvline(0.0, color=MARGIN, linewidth=1.2, label="safety margin")
    return _image(figure, axes)


def step_figure(medians: Sequence[float], highest: Sequence[float]) -> bytes:
    """Draw how many runs had steps of the planner as quick as that [ms], as a PNG image."""
    figure, axes = _frame("decision step of the planner (ms)", "share of runs")
    for values, colour, name in ((medians, _FIRST, "median of a run"), (highest, _SECOND, "p99 of a run")):
        if len(values) > 0:
            ordered = np.sort(np.maximum(values, 1e-2))
            share = np.arange(1, len(ordered) + 1) / len(ordered)
            label = f"{name}: half of the runs below {np.percentile(values, 50):.1f} ms"
            axes.plot(ordered, share, color=colour, linewidth=1.8, label=label, drawstyle="steps-post")
    axes.set_xscale("log")
    axes.set_ylim(0.0, 1.02)
    return _image(figure, axes)


def _frame(x: str, y: str) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.add_subplot()
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(color="#dddddd", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _image(figure: Figure, axes: Axes) -> bytes:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, loc="best", framealpha=0.9)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=_DPI)
    return file.getvalue()
