"""The subcommands `snnav scenes` and `snnav run`."""

from __future__ import annotations

import argparse
import math
import tempfile
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from snnav_core.errors import InvalidInput
from snnav_ros.available import require_ros
from snnav_sim.report.record import RunRecord
from snnav_sim.scene import Scene, find_scene, list_scenes, load_scene

__all__ = ["add_parsers"]

_PLAIN_WIDTH = 120  # columns when the output is no terminal
_PLAIN_PERIOD = 5.0  # [s] from line to line then


def add_parsers(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommands; each sets ``func``."""
    scenes = subparsers.add_parser("scenes", help="list the scenes that come with snnav")
    scenes.set_defaults(func=_scenes)
    run = subparsers.add_parser(
        "run",
        help="run a scene",
        description="Run a scene through the ROS nodes (or without ROS) and write a run directory: scene, metrics "
        "against ground truth, trajectories, paths, figures, and the recorded bag.",
    )
    run.add_argument(
        "scene", metavar="SCENE|FILE.yaml", help="name of a scene (`snnav scenes`) or a scene file"
    )
    run.add_argument("--core", action="store_true", help="without ROS, the closed loop in one program")
    run.add_argument(
        "--realtime", action="store_true", help="by the clock on the wall instead of in lockstep"
    )
    run.add_argument("--processes", action="store_true", help="every node as a process of its own")
    run.add_argument("--seed", type=_seed, metavar="N", help="instead of the seed of the scene")
    run.add_argument("--out", type=Path, metavar="DIR", help="run directory (default: runs/SCENE-DATE-TIME)")
    run.add_argument("--no-figures", action="store_true", help="draw nothing")
    run.set_defaults(func=_run)


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) > 2**53:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 0 on")
    return int(text)


def _scenes(_: argparse.Namespace) -> int:
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    for name, description in list_scenes().items():
        table.add_row(f"[bold]{name}[/bold]", description)
    _console().print(table)
    return 0


def _run(arguments: argparse.Namespace) -> int:
    from snnav_sim.report.tables import result_table
    from snnav_sim.report.write import check_run_directory, write_run_directory

    if arguments.core and (arguments.realtime or arguments.processes):
        raise InvalidInput("--core does not go with --realtime or --processes; leave one out")
    scene = load_scene(find_scene(arguments.scene))
    if not arguments.core:
        require_ros("`snnav run` without --core")
    directory = arguments.out or Path("runs") / f"{scene.name}-{clock.strftime('%Y%m%d-%H%M%S')}"
    check_run_directory(directory)
    console = _console()
    with _workplace(directory) as workplace, _progress(console, scene) as show:
        record, attachments = _carry_out(scene, arguments, workplace, show)
        metrics = write_run_directory(
            directory, scene, record, attachments=attachments, figures=not arguments.no_figures
        )
    console.print(result_table(metrics, scene.safety_margin))
    console.print(f"run directory: {directory}", soft_wrap=True, highlight=False)
    return 0


def _carry_out(
    scene: Scene,
    arguments: argparse.Namespace,
    workplace: Path,
    show: Callable[[float, RunRecord], None],
) -> tuple[RunRecord, dict[str, Path]]:
    """Run the scene; return the record and what belongs to it."""
    if arguments.core:
        from snnav_sim.simulation import Simulation

        simulation = Simulation(scene, arguments.seed)
        return simulation.run(lambda time, _: show(time, simulation.record)), {}
    from snnav_ros.bringup import run_scene

    bag = workplace / "bag"
    record = run_scene(
        scene,
        processes=arguments.processes,
        realtime=arguments.realtime,
        seed=arguments.seed,
        bag=bag,
        progress=show,
    )
    return record, {"bag": bag}


@contextmanager
def _workplace(directory: Path) -> Iterator[Path]:
    """Provide a directory on the disk of the run directory, so that the bag is moved there and not copied."""
    try:
        directory.parent.mkdir(parents=True, exist_ok=True)
        workplace = tempfile.TemporaryDirectory(prefix=f".{directory.name}.", dir=directory.parent)
    except OSError as error:
        raise InvalidInput(
            f"{directory}: cannot be written ({error.strerror}): give another directory"
        ) from None
    with workplace as name:
        yield Path(name)


def _console() -> Console:
    console = Console()
    return console if console.is_terminal else Console(width=_PLAIN_WIDTH)


@contextmanager
def _progress(console: Console, scene: Scene) -> Iterator[Callable[[float, RunRecord], None]]:
    """Show simulated time and how far the robots have to go: a bar on a terminal, else a line now and then."""
    if not console.is_terminal:
        last = -math.inf

        def tell(time: float, record: RunRecord) -> None:
            nonlocal last
            if clock.monotonic() - last >= _PLAIN_PERIOD:
                last = clock.monotonic()
                console.print(f"{time:7.1f} s  {_distances(scene, record)}", highlight=False)

        yield tell
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[time]:.1f} s  {task.fields[distances]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        whole = sum(math.dist(robot.start, robot.target) for robot in scene.robots)
        task: Any = bar.add_task(scene.name, total=whole or 1.0, time=0.0, distances="starting")

        def show(time: float, record: RunRecord) -> None:
            rest = sum(_to_go(scene, record).values())
            bar.update(task, completed=max(0.0, whole - rest), time=time, distances=_distances(scene, record))

        yield show


def _to_go(scene: Scene, record: RunRecord) -> dict[str, float]:
    """Return how far every robot is from its target [m]."""
    where = {robot.id: robot.start for robot in scene.robots}
    where |= {name: (rows[-1][1], rows[-1][2]) for name, rows in record.samples.items() if rows}
    return {robot.id: math.dist(where[robot.id], robot.target) for robot in scene.robots}


def _distances(scene: Scene, record: RunRecord) -> str:
    return ", ".join(f"{name} {distance:.1f} m" for name, distance in _to_go(scene, record).items())
