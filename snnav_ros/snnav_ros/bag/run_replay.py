"""What ``snnav replay`` does."""

from __future__ import annotations

import argparse
import math
import sys
import time as clock
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from snnav_core.errors import InvalidInput
from snnav_core.types import Pose2D, RobotSpec
from snnav_ros.bag.files import check_directory
from snnav_ros.bag.live_replay import LiveReplay, ReplayRecord, ReplayRobot
from snnav_ros.bag.live_replay import Progress as Show
from snnav_ros.bag.recorded_scans import Recording, read_recording
from snnav_ros.bag.replay_judge import count_outrun, judge, measured_returns
from snnav_ros.bag.replay_report import MARK, replay_metrics, replay_table, write_replay
from snnav_ros.bag.sensors_file import TopicSensor, read_sensors
from snnav_ros.bag.settings import ReplaySettings
from snnav_ros.run_display import make_console
from snnav_sim.report.record import RunRecord

__all__ = ["make_robots", "run"]

_PLAIN_PERIOD = 5.0  # [s] from line to line where the output is no terminal
_BAR_WIDTH = 20

Labelled = tuple[str, tuple[float, ...]]
"""An id, empty if none was given, and numbers."""


def run(arguments: argparse.Namespace) -> int:
    """Run ``snnav replay``."""
    settings = ReplaySettings(
        **{field.name: getattr(arguments, field.name) for field in fields(ReplaySettings)}
    )
    robots = make_robots(arguments.robot, arguments.goal, settings)
    directory = check_directory(arguments.out or _default_directory(arguments.bag), MARK)
    sensors = read_sensors(arguments.sensors)
    recording = read_recording(arguments.bag, sensors, arguments.start, arguments.duration)
    for warning in recording.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    replay = LiveReplay(sensors, recording, robots, settings)
    console = make_console()
    with _display(console, recording, robots) as show:
        record = replay.run(show)
        for name, lines in record.refused.items():
            print(f"warning: {len(lines)} scans of {name} refused: {lines[0]}", file=sys.stderr)
        metrics = _evaluate(arguments, sensors, recording, robots, record, settings, directory)
    console.print(replay_table(metrics, settings))
    console.print(f"run directory: {directory}", soft_wrap=True, highlight=False)
    return 1 if any(robot["returns_in_disk_moving"] for robot in metrics["robots"].values()) else 0


def make_robots(
    starts: Sequence[Labelled], goals: Sequence[Labelled], settings: ReplaySettings
) -> list[ReplayRobot]:
    """Give every robot its goal: by id, or in order.

    Raises
    ------
    InvalidInput
        If an id is given twice, or robots and goals do not match.
    """
    if len(goals) > len(starts):
        raise InvalidInput(f"{len(goals)} goals for {len(starts)} robots; give every goal a --robot")
    names = [name or f"robot_{index}" for index, (name, _) in enumerate(starts, start=1)]
    targets = [name or robot for (name, _), robot in zip(goals, names, strict=False)]
    for option, given in (("--robot", names), ("--goal", targets)):
        twice = [name for name in given if given.count(name) > 1]
        if twice:
            raise InvalidInput(f"{option}: {twice[0]!r} is given twice; write ID=X,Y... with different ids")
    for name in names:
        if name not in targets:
            raise InvalidInput(f"robot {name!r} has no goal; add --goal {name}=X,Y")
    found = []
    for name, (_, (x, y, degrees)) in zip(names, starts, strict=True):
        goal_x, goal_y = goals[targets.index(name)][1]
        spec = RobotSpec(name, settings.radius, settings.speed, settings.max_turn_rate)
        found.append(ReplayRobot(spec, Pose2D(x, y, math.radians(degrees)), (goal_x, goal_y)))
    return found


def _default_directory(bag: Path) -> Path:
    return Path("runs") / f"{bag.stem}-{clock.strftime('%Y%m%d-%H%M%S')}"


def _evaluate(
    arguments: argparse.Namespace,
    sensors: Sequence[TopicSensor],
    recording: Recording,
    robots: Sequence[ReplayRobot],
    record: ReplayRecord,
    settings: ReplaySettings,
    directory: Path,
) -> dict[str, Any]:
    """Measure, draw and write; return the metrics."""
    returns = measured_returns(recording, sensors)
    verdicts = {
        robot.spec.id: judge(returns, record.run.trajectory(robot.spec.id), robot.spec.radius)
        for robot in robots
    }
    outrun = count_outrun(returns, record.areas, settings.boundary_speed)
    metrics = replay_metrics(recording, robots, record, verdicts, outrun, settings)
    draw = None
    if not arguments.no_figures:
        from snnav_ros.bag.replay_moments import draw_replay  # matplotlib takes a second to import

        title = f"{recording.path.stem}, people up to {settings.boundary_speed:g} m/s"
        draw = partial(
            draw_replay,
            title=title,
            sensors=sensors,
            robots=robots,
            record=record,
            returns=returns,
            verdicts=verdicts,
        )
    how = {
        "bag": str(recording.path),
        "start_ns": recording.start_ns,
        "start": arguments.start,
        "duration": arguments.duration,
        "robots": {robot.spec.id: {"start": asdict(robot.start), "goal": robot.goal} for robot in robots},
        "settings": asdict(settings),
    }
    write_replay(directory, arguments.sensors, metrics, record, how, draw)
    return metrics


@contextmanager
def _display(console: Console, recording: Recording, robots: Sequence[ReplayRobot]) -> Iterator[Show]:
    """Show how far the recording is; a bar on a terminal, else a line now and then."""
    if not console.is_terminal:
        last = -math.inf

        def tell(time: float, record: RunRecord) -> None:
            nonlocal last
            if clock.monotonic() - last >= _PLAIN_PERIOD:
                last = clock.monotonic()
                console.print(f"{time:7.1f} s  {_state(record, robots)}", highlight=False)

        yield tell
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(_BAR_WIDTH),
        TextColumn("{task.fields[state]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(recording.path.stem, total=recording.end, state="")

        def advance(time: float, record: RunRecord) -> None:
            bar.update(task, completed=time, state=f"{time:.1f} s  {_state(record, robots)}")

        yield advance


def _state(record: RunRecord, robots: Sequence[ReplayRobot]) -> str:
    """Return what every robot does, in a word or two."""
    latest = {decision.robot: decision for decision in record.decisions[-len(robots) :]}
    return ", ".join(
        f"{robot.spec.id} {latest[robot.spec.id].reason.replace('_', ' ') or 'under way'}" for robot in robots
    )
