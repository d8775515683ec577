"""The subcommand `snnav campaign`."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from snnav_ros.argument_types import whole
from snnav_ros.run_display import make_console
from snnav_sim.campaign.ledger import Campaign, Ledger, open_ledger
from snnav_sim.campaign.pool import Progress as Report
from snnav_sim.campaign.pool import finish
from snnav_sim.campaign.run import SEED_STRIDE
from snnav_sim.scene_read import LARGEST_SEED

__all__ = ["add_parsers"]

_KINDS = {
    "static": "one robot, nothing moves",
    "dynamic": "one robot among up to five people who walk to and fro",
    "multi": "two to twenty robots",
    "faults": "one robot, people, and range finders that fail",
    "flight": "one to eight flying robots, people, and cameras of which some fail",
}
_BAR_WIDTH = 20


def add_parsers(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand; it sets ``func``."""
    parser = subparsers.add_parser(
        "campaign",
        help="run hundreds of random scenes and judge them",
        description="Run random scenes without ROS in parallel and judge every run against ground truth. Finished runs "
        "are kept: the same command goes on after an interruption. The status is 0 when no run failed, no robot "
        "collided and the safety margin was kept, else 1.",
    )
    kinds = "; ".join(f"{kind}: {text}" for kind, text in _KINDS.items())
    parser.add_argument("--kind", choices=tuple(_KINDS), required=True, help=kinds)
    parser.add_argument(
        "--runs", type=whole(1, SEED_STRIDE), default=100, metavar="N", help="number of runs (100)"
    )
    largest = LARGEST_SEED // SEED_STRIDE - 1
    parser.add_argument("--seed", type=whole(0, largest), default=1, metavar="S", help="of all scenes (1)")
    jobs = os.cpu_count() or 1
    parser.add_argument(
        "--jobs", type=whole(1, 1000), default=jobs, metavar="J", help=f"processes (here: {jobs})"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="directory of the campaign")
    parser.set_defaults(func=_campaign)


def _campaign(arguments: argparse.Namespace) -> int:
    from snnav_sim.campaign.summary import write_summary
    from snnav_sim.campaign.totals import is_clean

    console = make_console()
    campaign = Campaign(arguments.kind, arguments.runs, arguments.seed)
    with open_ledger(campaign, arguments.out) as ledger:
        _carry_out(console, ledger, arguments.jobs)
        summary = write_summary(ledger.directory, campaign, ledger.records)
    console.print(_table(summary))
    console.print(f"page: {arguments.out / 'index.html'}", soft_wrap=True, highlight=False)
    return 0 if is_clean(summary) else 1


def _carry_out(console: Console, ledger: Ledger, jobs: int) -> None:
    """Make the missing runs; after an interruption tell how to go on."""
    try:
        with _display(console, ledger) as report:
            finish(ledger, jobs, report)
    except KeyboardInterrupt:
        done, runs = len(ledger.records), ledger.campaign.runs
        console.print(f"{done} of {runs} runs are kept: the same command goes on", highlight=False)
        raise


@contextmanager
def _display(console: Console, ledger: Ledger) -> Iterator[Report | None]:
    """Provide what shows the progress: a bar on a terminal, which goes away at the end, else nothing."""
    if not console.is_terminal:
        yield None
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(_BAR_WIDTH),
        MofNCompleteColumn(),
        TextColumn("{task.fields[state]}"),
        TimeElapsedColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        campaign = ledger.campaign
        done = len(ledger.records)
        task = bar.add_task(f"campaign {campaign.kind}", total=campaign.runs, completed=done, state="")

        def report(_: Mapping[str, Any]) -> None:
            bar.update(
                task, completed=len(ledger.records), state=_state(ledger, bar.tasks[task].elapsed, done)
            )

        yield report


def _state(ledger: Ledger, elapsed: float | None, before: int) -> str:
    """How it goes: the rate, the robots that arrived, and what must not be."""
    robots = [robot for record in ledger.records for robot in record["robots"].values()]
    rate = 60.0 * (len(ledger.records) - before) / elapsed if elapsed else 0.0
    arrived = sum(robot["reached"] for robot in robots)
    bad = sum(bool(robot["collisions"] or robot["margin_violations"]) for robot in robots)
    failed = sum(bool(record["error"]) for record in ledger.records)
    warning = f", [red]{bad} violations, {failed} failed[/red]" if bad or failed else ""
    return f"{rate:.0f}/min, {arrived} of {len(robots)} robots arrived{warning}"


def _table(summary: Mapping[str, Any]) -> Table:
    def spread(key: str) -> str:
        return ", ".join(f"{name} {value:.3f}" for name, value in (summary[key] or {}).items()) or "-"

    share = summary["feasible_reached_share"]
    reached = f"{summary['feasible_reached']} of {summary['feasible']}"
    stops = ", ".join(
        f"{reason.replace('_', ' ')} {n}" for reason, n in summary["not_reached_by_reason"].items()
    )
    rows = {
        "runs": f"{summary['runs']}, {summary['failed_runs']} failed",
        "targets that can be reached, and were": reached
        + ("" if share is None else f" ({100.0 * share:.1f} %)"),
        "all robots, arrived": f"{summary['robots']}, {summary['reached']}",
        "others": stops or "none",
        "collisions, margin violations": f"{summary['collisions']}, {summary['margin_violations']}",
        "walked up to, hit beyond the window": f"{summary['walked_into']}, {summary['hit_standing']}",
        "length / optimum at the planning distance": spread("ratio_planned"),
        "length / optimum at the safety margin": spread("ratio_safety_margin"),
    }
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    for name, value in rows.items():
        table.add_row(name, value)
    return table
