"""How robots look in figures, by how many there are: each its own colour while colours can be told apart."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.colors import to_hex
from matplotlib.lines import Line2D

from snnav_sim.report.drawing import robot_colour
from snnav_sim.scene_types import RobotScene, Scene

__all__ = ["Look", "short_names"]

_FEW, _SOME = 8, 24  # robots; up to so many have a colour of their own and a line in the legend, and a colour
_KINDS = 8
_TRAIL = 8.0  # [s]


@dataclass(frozen=True)
class Look:
    """Colours, widths and what is left out when there are many robots.

    Parameters
    ----------
    colours : tuple of str
        One per robot.
    handles : tuple of (str, str)
        Colour and label of the robots, or kinds of robots, that the legend names; may be empty.
    named : bool
        Names stand beside the robots, not in the legend.
    width : float
        Of a trajectory [points].
    marks : float
        Share of the usual size of arrowheads and targets.
    trail : float
        How long trajectories are shown where the robots move [s].
    crowded : bool
        Published paths and places in between are left out.
    crowd : bool
        Too many to be told apart: no curve of their own over time, no path ahead.
    """

    colours: tuple[str, ...]
    handles: tuple[tuple[str, str], ...]
    named: bool = False
    width: float = 2.2
    marks: float = 1.0
    trail: float = math.inf
    crowded: bool = False
    crowd: bool = False

    @classmethod
    def of(cls, scene: Scene) -> Look:
        """Return the look for the robots of a scene."""
        robots = scene.robots
        if len(robots) <= _FEW:
            few = tuple(robot_colour(index) for index in range(len(robots)))
            return cls(few, tuple((c, robot.id) for c, robot in zip(few, robots, strict=True)))
        if len(robots) <= _SOME:
            own = tuple(_hue(index, len(robots)) for index in range(len(robots)))
            return cls(own, (), named=True, width=1.3, marks=0.75, trail=_TRAIL, crowded=True)
        kinds: dict[tuple[float, float], list[RobotScene]] = {}
        for robot in robots:
            kinds.setdefault((robot.radius, robot.speed), []).append(robot)
        number = {kind: index for index, kind in enumerate(kinds)}
        colours = tuple(robot_colour(number[robot.radius, robot.speed]) for robot in robots)
        handles = [(robot_colour(index), _kind_label(alike)) for index, alike in enumerate(kinds.values())]
        if len(kinds) > _KINDS:
            handles = [("none", f"{len(robots)} robots of {len(kinds)} kinds")]
        return cls(colours, tuple(handles), width=0.8, marks=0.5, trail=_TRAIL, crowded=True, crowd=True)

    def legend(self, width: float, suffix: str = "") -> list[Line2D]:
        """Return handles for a legend."""
        return [
            Line2D([], [], color=colour, linewidth=width, label=f"{label}{suffix}")
            for colour, label in self.handles
        ]


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Return what is left of every name without the stem that all share: robot_7 is 7."""
    stems = {_stem(name) for name in names}
    stem = stems.pop() if len(names) > 1 and len(stems) == 1 else ""
    return {name: name[len(stem) :].lstrip("_") or name for name in names}


def _stem(name: str) -> str:
    return name.rstrip("0123456789").rstrip("_")


def _hue(index: int, count: int) -> str:
    """Return one of `count` colours around the circle of hues, dark and light in turn."""
    lightness = 0.33 if index % 2 else 0.5
    return to_hex(colorsys.hls_to_rgb(index / count, lightness, 0.75))


def _kind_label(alike: list[RobotScene]) -> str:
    """Return number, common name and properties of robots of one kind."""
    stems = {_stem(robot.id) for robot in alike}
    name = stems.pop() if len(stems) == 1 else "robot"
    first = alike[0]
    return f"{len(alike)} x {name}: radius {first.radius:g} m, {first.speed:g} m/s"
