"""The subcommand `snnav coverage`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from snnav_core.errors import InvalidInput
from snnav_ros.run_display import make_console
from snnav_sim.scene import SpaceScene, find_scene, load_any_scene

if TYPE_CHECKING:
    from snnav_sim.report.coverage import Coverage

__all__ = ["add_parsers"]


def add_parsers(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand; it sets ``func``."""
    parser = subparsers.add_parser(
        "coverage",
        help="what the cameras of a scene in space see, and where robots can get",
        description="Look once with all cameras of a scene in space and tell what they see, each alone and together, "
        "the connected parts of the region in which a robot may stay for a window, and whether every target can be "
        "reached. The status is 0 when all can, else 1.",
    )
    parser.add_argument(
        "scene", metavar="SCENE|FILE.yaml", help="name of a scene (`snnav scenes`) or a scene file"
    )
    parser.add_argument("--out", type=Path, metavar="FILE.png", help="draw cuts through the room")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    parser.set_defaults(func=_coverage)


def _coverage(arguments: argparse.Namespace) -> int:
    from snnav_sim.report.coverage import measure_coverage

    scene = load_any_scene(find_scene(arguments.scene))
    if not isinstance(scene, SpaceScene):
        raise InvalidInput(
            f"{scene.name}: is a scene in the plane; `snnav run` draws what its sensors see (figures/scene.png)"
        )
    if arguments.out is not None and arguments.out.suffix != ".png":
        raise InvalidInput(f"--out {arguments.out}: give a file that ends in .png")
    coverage = measure_coverage(scene)
    if arguments.json:
        print(json.dumps(coverage.summary(), indent=2, ensure_ascii=False))
    else:
        _tell(scene, coverage)
    if arguments.out is not None:
        from snnav_sim.report.coverage_figure import draw_coverage

        try:
            arguments.out.parent.mkdir(parents=True, exist_ok=True)
            draw_coverage(scene, coverage, arguments.out)
        except OSError as error:
            raise InvalidInput(
                f"--out {arguments.out}: cannot be written ({error.strerror}): give another file"
            ) from None
    return 0 if all(verdict == "reachable" for verdict in coverage.robots.values()) else 1


def _tell(scene: SpaceScene, coverage: Coverage) -> None:
    console = make_console()
    table = Table(box=None, padding=(0, 2, 0, 0))
    for heading in ("camera", "sees", "alone"):
        table.add_column(heading, justify="left" if heading == "camera" else "right")
    for name, (share, alone) in coverage.cameras.items():
        table.add_row(name, f"{100.0 * share:.1f} %", f"{100.0 * alone:.1f} %")
    console.print(table)
    console.print(
        f"together {100.0 * coverage.seen_share:.1f} % of the free space of {scene.name}", highlight=False
    )
    volumes = ", ".join(f"{volume:.1f}" for volume in coverage.volumes[:6]) or "none"
    more = f", {len(coverage.volumes) - 6} smaller ones" if len(coverage.volumes) > 6 else ""
    kept = f"{coverage.distance:.2f} m from all and {coverage.growth:.2f} m more from what may move"
    console.print(f"connected parts (m³) that keep {kept}: {volumes}{more}", highlight=False)
    for name, verdict in coverage.robots.items():
        console.print(f"{name}: {verdict}", highlight=False)
