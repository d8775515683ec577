"""`make bench`: the speeds that matter beside peers, measured in one run."""

from __future__ import annotations

import platform
import sys

import area_bench
import crowd_bench
import flight_bench
import lidar_bench
import planning_bench
import spacetime_bench
import swap_bench
import tof_bench
from harness import Row
from rich.console import Console
from rich.table import Table

BENCHES = {
    "planning: one robot, thesis_ch3_scene1": planning_bench.rows,
    "unoccupied area: 12 scanners of 361 beams, 3 robots removed": area_bench.rows,
    "scanner: 361 beams against 200 segments": lidar_bench.rows,
    "ToF camera: 128 x 128 pixels against 504 triangles": tof_bench.rows,
    **flight_bench.benches(),
    "fusion and decision for all robots, hall of 80 x 60 m, 40 scanners, delta 1 s": crowd_bench.rows,
    **swap_bench.benches(),
    **spacetime_bench.benches(),
}


def table_of(title: str, rows: list[Row]) -> Table:
    """Lay out one benchmark; the last column compares peers with the first row."""
    table = Table(title=title, title_justify="left")
    for heading in ("what", "result", "demanded", "peer takes"):
        table.add_column(heading, justify="left" if heading == "what" else "right")
    for row in rows:
        table.add_row(row.what, row.result, row.demanded, row.ratio(rows[0]))
    return table


def main() -> int:
    """Run all benchmarks, or those with one of the given words in the title; return 1 when a speed is missed."""
    words = sys.argv[1:]
    chosen = {
        title: measure
        for title, measure in BENCHES.items()
        if not words or any(word in title for word in words)
    }
    console = Console(width=None if sys.stdout.isatty() else 120, highlight=False)
    if not chosen:
        console.print(f"no benchmark has one of {words} in its title; there are:", *BENCHES, sep="\n  ")
        return 2
    console.print(
        f"Python {platform.python_version()}, {platform.machine()}, one run; peers against the first line\n"
    )
    missed = []
    for title, measure in chosen.items():
        with console.status(title):
            rows = measure()
        console.print(table_of(title, rows))
        missed += [f"{title}: {row.what}" for row in rows if row.missed]
    for name in missed:
        console.print(f"slower than demanded: {name}", style="red")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
