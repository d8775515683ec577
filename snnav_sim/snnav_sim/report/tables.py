"""The result of a run as a table for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

__all__ = ["result_table"]


def result_table(metrics: Mapping[str, Any], safety_margin: float) -> RenderableType:
    """Return a renderable for `rich`: one row per robot, step times and why the run ended below.

    Parameters
    ----------
    metrics : mapping
        As returned by `snnav_sim.report.metrics.compute_metrics`.
    safety_margin : float
        Of the scene [m]; least clearances below it are red.
    """
    table = Table(
        title=f"{metrics['scene']}, seed {metrics['seed']}",
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
    )
    table.add_column("robot")
    table.add_column("reached")
    for name in ("time\ns", "length\nm", "optimum\nm", "clearance\nm", "to others\nm"):
        table.add_column(name, justify="right")
    table.add_column("reason")
    for robot, values in metrics["robots"].items():
        table.add_row(
            robot,
            Text("yes", style="green") if values["reached"] else Text("no", style="red"),
            _number(values["arrival_time"], 1),
            _number(values["travelled_length"], 2),
            _number(values["optimum_length"], 2),
            _margin(values["least_clearance"], safety_margin),
            _margin(values["least_separation"], safety_margin),
            values["reason"].replace("_", " "),
        )
    return Group(table, Text(_footer(metrics, safety_margin), style="dim"))


def _footer(metrics: Mapping[str, Any], safety_margin: float) -> str:
    lines = [f"{metrics['reason']}; safety margin {safety_margin:g} m"]
    steps = [
        f"{name} step {step['p50']:.1f} ms (p99 {step['p99']:.1f})"
        for name in ("planner", "fusion")
        if (step := metrics[name]["step_ms"])["p50"] is not None
    ]
    if steps:
        lines.append(", ".join(steps))
    return "\n".join(lines)


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _margin(value: float | None, safety_margin: float) -> Text:
    style = "" if value is None or value >= safety_margin else "bold red"
    return Text(_number(value, 3), style=style)
