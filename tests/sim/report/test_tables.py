"""The table for the terminal."""

from __future__ import annotations

import io

from rich.console import Console

from snnav_sim.report.metrics import compute_metrics
from snnav_sim.report.record import RunRecord
from snnav_sim.report.tables import result_table
from snnav_sim.scene import Scene


def test_it_fits_eighty_columns_and_marks_a_violated_margin(room: Scene) -> None:
    metrics = compute_metrics(room, RunRecord(3, reason="time limit of 300 s"))
    metrics["robots"]["r"].update(least_clearance=0.123, travelled_length=12.3456)
    output = io.StringIO()
    Console(file=output, width=80, force_terminal=True, color_system="standard").print(
        result_table(metrics, 0.5)
    )
    text = output.getvalue()
    assert "room, seed 3" in text
    assert "12.35" in text
    assert "\x1b[1;31m" in text
    assert "0.123" in text
    assert "time limit of 300 s; safety margin 0.5 m" in text
