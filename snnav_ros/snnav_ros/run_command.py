"""The subcommands `snnav scenes` and `snnav run`."""

from __future__ import annotations

import argparse
import re
import tempfile
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.table import Table

from snnav_core.errors import InvalidInput
from snnav_ros.argument_types import whole
from snnav_ros.available import require_ros
from snnav_ros.run_display import make_console, run_display
from snnav_sim.report.record import RunRecord
from snnav_sim.scene import AnyScene, find_scene, list_scenes, load_any_scene
from snnav_sim.scene_read import LARGEST_SEED

__all__ = ["add_parsers"]


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
    run.add_argument(
        "--planners",
        type=int,
        default=1,
        metavar="N",
        help="so many planner nodes share the robots (default: 1)",
    )
    run.add_argument(
        "--seed", type=whole(0, LARGEST_SEED), metavar="N", help="instead of the seed of the scene"
    )
    run.add_argument("--out", type=Path, metavar="DIR", help="run directory (default: runs/SCENE-DATE-TIME)")
    run.add_argument("--no-figures", action="store_true", help="draw nothing")
    run.set_defaults(func=_run)


def _scenes(_: argparse.Namespace) -> int:
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    for name, description in list_scenes().items():
        table.add_row(f"[bold]{name}[/bold]", description)
    make_console().print(table)
    return 0


def _run(arguments: argparse.Namespace) -> int:
    from snnav_sim.report.tables import result_table
    from snnav_sim.report.write import check_run_directory, write_run_directory

    if arguments.core and (arguments.realtime or arguments.processes or arguments.planners != 1):
        raise InvalidInput("--core does not go with --realtime, --processes or --planners; leave one out")
    scene = load_any_scene(find_scene(arguments.scene))
    robots = len(scene.robots)
    if not 1 <= arguments.planners <= max(1, robots):
        raise InvalidInput(
            f"--planners {arguments.planners}: robots of {scene.name}: {robots}; give 1 to {max(1, robots)}"
        )
    if not arguments.core:
        require_ros("`snnav run` without --core")
    directory = arguments.out or Path("runs") / f"{_file_name(scene.name)}-{clock.strftime('%Y%m%d-%H%M%S')}"
    check_run_directory(directory)
    console = make_console()
    with _workplace(directory) as workplace, run_display(console, scene) as display:
        record, attachments = _carry_out(scene, arguments, workplace, display.show)
        display.evaluate()
        metrics = write_run_directory(
            directory, scene, record, attachments=attachments, figures=not arguments.no_figures
        )
    console.print(result_table(metrics, scene.safety_margin))
    console.print(f"run directory: {directory}", soft_wrap=True, highlight=False)
    return 0


def _file_name(name: str) -> str:
    """Return a scene name as one part of a path: it may contain slashes and dots."""
    return re.sub(r"[^\w-]+", "_", name).strip("_") or "run"


def _carry_out(
    scene: AnyScene,
    arguments: argparse.Namespace,
    workplace: Path,
    show: Callable[[float, RunRecord], None],
) -> tuple[RunRecord, dict[str, Path]]:
    """Run the scene; return the record and what belongs to it."""
    if arguments.core:
        from snnav_sim.simulation import simulation_of

        simulation = simulation_of(scene, arguments.seed)
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
        planners=arguments.planners,
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
