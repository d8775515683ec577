"""What ``snnav evaluate-logs`` does."""

from __future__ import annotations

import argparse
import sys

from rich.console import Console

from snnav_ros.bag.evaluation import evaluate
from snnav_ros.bag.evaluation_report import MARK, evaluation_table, is_accepted, write_evaluation
from snnav_ros.bag.files import check_directory
from snnav_ros.bag.progress import counter
from snnav_ros.bag.settings import EvaluationSettings, NetworkSettings

__all__ = ["run"]

_TABLE_WIDTH = 160  # columns, when the output is not a terminal


def run(arguments: argparse.Namespace) -> int:
    """Run ``snnav evaluate-logs``."""
    check_directory(arguments.out, MARK)
    settings = EvaluationSettings(arguments.nodes, arguments.pairs, NetworkSettings(seed=arguments.seed))
    with counter("routes", len(arguments.logs) * (1 + arguments.pairs)) as progress:
        results = evaluate(arguments.logs, settings, arguments.jobs, progress)
    for result in results:
        for warning in result.building.warnings:
            print(f"warning: {warning}", file=sys.stderr)
    console = Console()
    if not console.is_terminal:
        console = Console(width=_TABLE_WIDTH)
    console.print(evaluation_table(results, settings.network.safety_margin))
    write_evaluation(arguments.out, results, settings)
    print(f"written: {arguments.out} (tables, figures, scenes of failed routes)")
    return 0 if is_accepted(results) else 1
