"""Drives through real buildings as a table, as CSV and JSON, and as one figure for each building."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

import snnav_core
from snnav_ros.bag.evaluation import BuildingResult, PairResult
from snnav_ros.bag.files import make_directory
from snnav_ros.bag.settings import EvaluationSettings
from snnav_sim.report.record import RunRecord
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene import Scene, dump_scene

__all__ = ["LEAST_REACHED", "MARK", "building_row", "evaluation_table", "is_accepted", "write_evaluation"]

LEAST_REACHED = 0.95
"""Share of the routes that must be reached."""

MARK = "evaluation.json"
"""The file that tells a directory of results from others."""

_ARRAYS = ("rows", "planner_ms")


def building_row(result: BuildingResult) -> dict[str, Any]:
    """Return the numbers of one building as they stand in table, CSV and JSON."""
    network, ratios = result.building.network, result.ratios
    reduced = sum(part.area for part in network.components)
    return {
        "building": result.building.name,
        "scans": result.building.scan_count,
        "nodes": len(network.scene.sensors),
        "returns": network.return_count,
        "contradicting_share": round(network.contradiction_share, 5),
        "free_area": round(network.area.region.area, 1),
        "reduced_area": round(reduced, 1),
        "largest_component_share": round(network.largest_component.area / reduced, 4),
        "pairs": len(result.pairs),
        "reached": result.reached,
        "failures": result.failures,
        "least_area_clearance": _floored(min(pair.area_clearance for pair in result.pairs)),
        "least_return_clearance": _floored(min(pair.return_clearance for pair in result.pairs)),
        "area_violations": sum(pair.area_violations for pair in result.pairs),
        "return_violations": sum(pair.return_violations for pair in result.pairs),
        "median_ratio": round(float(np.median(ratios)), 4) if ratios else None,
        "largest_ratio": round(max(ratios), 4) if ratios else None,
        "median_step_ms": round(float(np.median(result.planner_ms)), 2),
        "p99_step_ms": round(float(np.percentile(result.planner_ms, 99)), 1),
    }


def is_accepted(results: Sequence[BuildingResult]) -> bool:
    """Whether at least 95 % of all routes were reached and no margin was violated."""
    pairs = sum(len(result.pairs) for result in results)
    reached = sum(result.reached for result in results)
    return reached >= LEAST_REACHED * pairs and not any(result.violations for result in results)


def evaluation_table(results: Sequence[BuildingResult], safety_margin: float) -> RenderableType:
    """Return a renderable for `rich`: one row per building, the verdict below."""
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("building")
    for name in (
        "scans\n",
        "contra-\ndicting",
        "free\nm2",
        "con-\nnected",
        "reached\n",
        "to area\nm",
        "to return\nm",
        "violations\n",
        "ratio\nmedian",
        "\nlargest",
        "step ms\nmedian",
        "\np99",
    ):
        table.add_column(name, justify="right")
    table.add_column("not reached because")
    for result in results:
        row = building_row(result)
        failures = ", ".join(
            f"{count} {reason.replace('_', ' ')}" for reason, count in row["failures"].items()
        )
        table.add_row(
            row["building"],
            str(row["scans"]),
            f"{100 * row['contradicting_share']:.1f} %",
            f"{row['free_area']:.0f}",
            f"{100 * row['largest_component_share']:.0f} %",
            f"{row['reached']}/{row['pairs']}",
            _margin(row["least_area_clearance"], safety_margin),
            _margin(row["least_return_clearance"], safety_margin),
            Text(str(result.violations), style="bold red" if result.violations else ""),
            _number(row["median_ratio"]),
            _number(row["largest_ratio"]),
            f"{row['median_step_ms']:.1f}",
            f"{row['p99_step_ms']:.0f}",
            failures,
        )
    return Group(table, Text(_verdict(results, safety_margin)))


def _verdict(results: Sequence[BuildingResult], safety_margin: float) -> str:
    pairs = sum(len(result.pairs) for result in results)
    reached = sum(result.reached for result in results)
    violations = sum(result.violations for result in results)
    return (
        f"{reached} of {pairs} targets reached ({100 * reached / pairs:.1f} %), {violations} violations of the "
        f"safety margin {safety_margin:g} m: {'accepted' if is_accepted(results) else 'NOT accepted'}"
    )


def write_evaluation(
    directory: str | Path, results: Sequence[BuildingResult], settings: EvaluationSettings
) -> None:
    """Write buildings.csv, pairs.csv, evaluation.json, figures/ and the scenes of routes that failed.

    Raises
    ------
    BagError
        If the directory holds something else, or cannot be written.
    """

    def fill(draft: Path) -> None:
        rows = [building_row(result) for result in results]
        pairs = [_pair_row(pair) for result in results for pair in result.pairs]
        content = {
            "version": snnav_core.__version__,
            "settings": asdict(settings),
            "accepted": is_accepted(results),
            "buildings": rows,
            "pairs": pairs,
        }
        text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False)
        (draft / MARK).write_text(text + "\n", encoding="utf-8")
        _write_csv(draft / "buildings.csv", [{**row, "failures": _words(row["failures"])} for row in rows])
        _write_csv(draft / "pairs.csv", pairs)
        (draft / "figures").mkdir()
        for result in results:
            draw_building(result, draft / "figures" / f"{result.building.name}.png")
            _write_failures(result, draft / "failed")

    make_directory(directory, MARK, fill)


def draw_building(result: BuildingResult, file: Path) -> None:
    """Draw fused area, returns, sensors and all trajectories of a building."""
    # drawing needs matplotlib, which takes a second to import
    from snnav_sim.report.figures import draw_scene

    scene = _all_routes(result)
    record = RunRecord(scene.seed)
    for pair, robot in zip(result.pairs, scene.robots, strict=True):
        record.samples[robot.id] = [tuple(row) for row in pair.rows.tolist()]
    record.reason = f"{result.reached} of {len(result.pairs)} targets reached, the longest drive"
    draw_scene(scene, record, GroundTruth(scene), file)


def _all_routes(result: BuildingResult) -> Scene:
    """Return one scene that holds the robots of all routes."""
    robots = []
    for pair in result.pairs:
        (robot,) = result.building.scene(pair.pair).robots
        robots.append(replace(robot, id=f"route_{pair.pair}"))
    return replace(result.building.network.scene, robots=tuple(robots))


def _write_failures(result: BuildingResult, folder: Path) -> None:
    for pair in result.pairs:
        if not pair.reached:
            folder.mkdir(exist_ok=True)
            text = dump_scene(result.building.scene(pair.pair))
            (folder / f"{pair.building}_route_{pair.pair}.yaml").write_text(text, encoding="utf-8")


def _pair_row(pair: PairResult) -> dict[str, Any]:
    """Return the fields of a result, lengths to 0.1 mm, clearances rounded down; no value is infinite."""
    row = {name: value for name, value in vars(pair).items() if name not in _ARRAYS}
    for name, value in row.items():
        if isinstance(value, float):
            row[name] = _floored(value) if name.endswith("clearance") else round(value, 4)
    return row


def _write_csv(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def _words(failures: dict[str, int]) -> str:
    return " ".join(f"{reason}:{count}" for reason, count in failures.items())


def _floored(value: float) -> float | None:
    """Round down to 0.1 mm: a margin must not look kept by rounding."""
    return math.floor(value * 1e4) / 1e4 if math.isfinite(value) else None


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _margin(value: float | None, safety_margin: float) -> Text:
    return Text(_number(value), style="" if value is None or value >= safety_margin else "bold red")
