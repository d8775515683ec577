"""What every robot did and why, over time: who drove, who waited, who made room for whom."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from snnav_core.types import PathSource, StopReason
from snnav_sim.report.look import short_names
from snnav_sim.report.record import Decision, RunRecord
from snnav_sim.scene_types import Scene

__all__ = ["Phase", "draw_decisions", "phases"]

_WIDTH = 11.0  # inches
_DPI = 110
_ROW, _TIGHT_ROW, _MANY = 0.27, 0.12, 40  # inches; from so many robots on rows are tight
_LETTER = 0.062  # inches, of a label in a bar
_LABEL_SIZE = 6.5  # points

# What a decision means -> label and colour, in the order of the legend.
_DRIVES, _TURNS, _ROOM, _EVADES = (
    "drives",
    "turns on the spot",
    "makes room for another",
    "evades what comes nearer",
)
_BLOCKED, _ARRIVED = "waits: another robot in the way", "arrived"
_YIELDS = "waits until another has passed"

_COLOURS = {
    _DRIVES: "#9cc3e4",
    _TURNS: "#4f83b5",
    _ROOM: "#e08e0b",
    _YIELDS: "#f6d28b",
    _EVADES: "#8d5a97",
    _BLOCKED: "#e58a94",
    _ARRIVED: "#d9e8d4",
}
_STOPPED = "stopped: "
_COLOURS |= {
    _STOPPED + "no path": "#a4161a",
    _STOPPED + "start blocked": "#e36414",
    _STOPPED + "goal blocked": "#5f0f40",
    _STOPPED + "goal unreachable": "#7f5539",
    _STOPPED + "no area": "#343a40",
    _STOPPED + "no state": "#868e96",
    _STOPPED + "no goal": "#dee2e6",
    _STOPPED + "no progress": "#bc6c25",
    _STOPPED + "not tracked": "#adb5bd",
}
_OF_PATHS = {
    PathSource.TURN_IN_PLACE.value: _TURNS,
    PathSource.YIELD.value: _ROOM,
    PathSource.EVASION.value: _EVADES,
}
_OF_STOPS = {
    StopReason.ARRIVED.value: _ARRIVED,
    StopReason.YIELDS.value: _YIELDS,
    StopReason.BLOCKED_BY_ROBOT.value: _BLOCKED,
}


@dataclass(frozen=True)
class Phase:
    """A robot did one thing for a while.

    Parameters
    ----------
    begin, end : float
        [s]
    doing : str
        In words, one of the keys of the legend.
    others : tuple of str
        The robots that the first reason given in it names.
    """

    begin: float
    end: float
    doing: str
    others: tuple[str, ...] = ()


def phases(decisions: Sequence[Decision], end: float, names: Sequence[str]) -> list[Phase]:
    """Put successive decisions of one robot that mean the same, and name the same robots, together.

    Parameters
    ----------
    decisions : sequence of Decision
        Of one robot, in order.
    end : float
        Of the last one [s].
    names : sequence of str
        Of all robots of the scene.
    """
    known = set(names)
    result: list[Phase] = []
    for index, decision in enumerate(decisions):
        until = decisions[index + 1].time if index + 1 < len(decisions) else end
        doing, others = _doing(decision), _named(decision, known)
        if result and (result[-1].doing, result[-1].others) == (doing, others):
            result[-1] = Phase(result[-1].begin, until, doing, others)
        else:
            result.append(Phase(decision.time, until, doing, others))
    return result


def _doing(decision: Decision) -> str:
    if decision.path is None:
        return _OF_STOPS.get(decision.reason, _STOPPED + decision.reason.replace("_", " "))
    return _OF_PATHS.get(decision.source, _DRIVES)


def _named(decision: Decision, known: set[str]) -> tuple[str, ...]:
    """Return the other robots that the reason of a stop names, each once."""
    if decision.path is not None or decision.reason == StopReason.ARRIVED.value:
        return ()
    words = re.findall(r"\w+", decision.message)
    return tuple(dict.fromkeys(word for word in words if word in known and word != decision.robot))


def draw_decisions(scene: Scene, record: RunRecord, file: Path) -> None:
    """Draw one row per robot with what it did over time as a PNG; bars of waiting name the other robots."""
    robots = [robot.id for robot in scene.robots]
    row = _ROW if len(robots) <= _MANY else _TIGHT_ROW
    figure = Figure(figsize=(_WIDTH, 1.3 + row * len(robots)), layout="constrained")
    axes = figure.add_subplot()
    end = max((decision.time for decision in record.decisions), default=0.0) + scene.sampling_interval
    short = short_names(robots) if row > _TIGHT_ROW else None
    seen: set[str] = set()
    for index, name in enumerate(robots):
        rows = record.trajectory(name)
        gone = len(rows) > 0 and rows[-1, 0] < record.end - 0.5 * scene.control_period
        until = float(rows[-1, 0]) + scene.control_period if gone else end
        for phase in phases(record.decisions_of(name), until, robots):
            seen.add(phase.doing)
            _draw_phase(axes, phase, index, (_WIDTH - 1.0) / end, short)
    axes.set_yticks(np.arange(len(robots)), robots, fontsize=8 if row > _TIGHT_ROW else 5)
    axes.set_ylim(len(robots) - 0.5, -0.5)
    axes.set_xlim(0.0, end)
    axes.set_xlabel("time [s]")
    axes.grid(axis="x", alpha=0.25, linewidth=0.5)
    axes.set_axisbelow(True)
    axes.set_title(f"{scene.name}: what each robot did, and whom it waited for", loc="left", fontsize=11)
    handles = [Patch(facecolor=colour, label=label) for label, colour in _COLOURS.items() if label in seen]
    handles += [Patch(facecolor="black", label=label) for label in sorted(seen - _COLOURS.keys())]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)


def _draw_phase(axes: Axes, phase: Phase, row: int, inches: float, short: Mapping[str, str] | None) -> None:
    """Draw a bar, with the short names of the robots that it waits for where they have room."""
    length = phase.end - phase.begin
    axes.barh(
        row, length, left=phase.begin, height=0.8, color=_COLOURS.get(phase.doing, "black"), linewidth=0
    )
    label = ", ".join(short[name] for name in phase.others) if short else ""
    if label and _LETTER * len(label) <= length * inches:
        middle = phase.begin + 0.5 * length
        axes.text(middle, row, label, fontsize=_LABEL_SIZE, ha="center", va="center", color="black")
