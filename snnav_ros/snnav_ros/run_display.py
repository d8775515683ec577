"""What a person sees while a scene runs."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from snnav_sim.report.record import RunRecord
from snnav_sim.scene import AnyScene

__all__ = ["RunDisplay", "make_console", "run_display"]

_PLAIN_WIDTH = 120  # columns when the output is no terminal
_PLAIN_PERIOD = 5.0  # [s] from line to line then
_BAR_WIDTH = 20
_MOST_NAMED = 3


def make_console() -> Console:
    """Return the console for results; as wide as the terminal, or 120 columns without one."""
    console = Console()
    return console if console.is_terminal else Console(width=_PLAIN_WIDTH)


class RunDisplay:
    """Shows simulated time and how far the robots have to go: a line now and then where there is no terminal."""

    def __init__(self, console: Console, scene: AnyScene) -> None:
        self._console, self._scene = console, scene
        self._last = -math.inf

    def show(self, time: float, record: RunRecord) -> None:
        """Show the state of the run at a simulated time [s]."""
        if clock.monotonic() - self._last >= _PLAIN_PERIOD:
            self._last = clock.monotonic()
            self._console.print(f"{time:7.1f} s  {self.distances(record)}", highlight=False)

    def evaluate(self) -> None:
        """Tell that the run is over and is being evaluated."""
        self._console.print("the run is over: it is measured and written down", highlight=False)

    def to_go(self, record: RunRecord) -> dict[str, float]:
        """Return how far every robot is from its target [m]."""
        places = {robot.id: len(robot.start) for robot in self._scene.robots}
        where: dict[str, tuple[float, ...]] = {robot.id: robot.start for robot in self._scene.robots}
        where |= {name: rows[-1][1 : 1 + places[name]] for name, rows in record.samples.items() if rows}
        return {robot.id: math.dist(where[robot.id], robot.last_target) for robot in self._scene.robots}

    def distances(self, record: RunRecord) -> str:
        """Return the same in words."""
        rest = self.to_go(record)
        if len(rest) > _MOST_NAMED:
            return f"{len(rest)} robots, {sum(rest.values()):.0f} m to go"
        return ", ".join(f"{name} {distance:.1f} m" for name, distance in rest.items())


class _Bar(RunDisplay):
    """A bar on a terminal."""

    def __init__(self, console: Console, scene: AnyScene, bar: Progress) -> None:
        super().__init__(console, scene)
        self._bar = bar
        self._whole = sum(math.dist(robot.start, robot.last_target) for robot in scene.robots) or 1.0
        self._task: Any = bar.add_task(scene.name, total=self._whole, state="starting the nodes")

    def show(self, time: float, record: RunRecord) -> None:
        done = max(0.0, self._whole - sum(self.to_go(record).values()))
        self._bar.update(self._task, completed=done, state=f"{time:.1f} s  {self.distances(record)}")

    def evaluate(self) -> None:
        self._bar.update(self._task, completed=self._whole, state="measuring, drawing")


@contextmanager
def run_display(console: Console, scene: AnyScene) -> Iterator[RunDisplay]:
    """Provide the display that fits the console; a bar goes away at the end."""
    if not console.is_terminal:
        yield RunDisplay(console, scene)
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(_BAR_WIDTH),
        TextColumn("{task.fields[state]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        yield _Bar(console, scene, bar)
