"""The page of a campaign: one HTML file with its figures in it, and links to scenes and pictures beside it."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from snnav_sim.campaign.run import FAILURES, PICTURES, SCENES, run_name
from snnav_sim.campaign.totals import Record, robots_of

__all__ = ["page"]

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; max-width: 74em; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin-top: 2em; }
table { border-collapse: collapse; margin: 0.6em 0; }
td, th { padding: 0.25em 0.8em; border-bottom: 1px solid #ddd; text-align: left; vertical-align: top; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
.good { color: #1d7a3a; font-weight: 600; } .bad { color: #c1121f; font-weight: 600; }
.figures { display: flex; flex-wrap: wrap; gap: 1em; } .figures img { max-width: 36em; width: 100%; }
.runs img { width: 15em; } .note { color: #666; max-width: 60em; }
""".strip()


def page(directory: Path, summary: Mapping[str, Any], records: Sequence[Record]) -> str:
    """Return the page of a campaign as HTML."""
    title = f"Campaign {summary['kind']}, seed {summary['seed']}: {summary['runs']} runs"
    parts = [
        f"<h1>{escape(title)}</h1>",
        _numbers(summary),
        "<h2>How robots ended</h2>",
        _endings(records),
        "<h2>Figures</h2>",
        _figures(records),
        *_attention(directory, records),
        *_not_arrived(directory, records),
    ]
    head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{_STYLE}</style>'
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head><body>\n'
        + "\n".join(parts)
        + "\n</body></html>\n"
    )


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """An HTML table, without a header where that is empty; cells hold HTML, those of `numbers` are set to the right."""

    def line(cells: Sequence[str], tag: str) -> str:
        marks = [' class="number"' if index in numbers else "" for index in range(len(cells))]
        inner = "".join(f"<{tag}{mark}>{cell}</{tag}>" for mark, cell in zip(marks, cells, strict=True))
        return f"<tr>{inner}</tr>"

    head = line(header, "th") if header else ""
    return "<table>" + head + "".join(line(row, "td") for row in rows) + "</table>"


def _numbers(summary: Mapping[str, Any]) -> str:
    def zero(key: str) -> str:
        return f'<span class="{"bad" if summary[key] else "good"}">{summary[key]}</span>'

    def spread(key: str, digits: int) -> str:
        values = summary[key]
        return (
            "-"
            if values is None
            else ", ".join(f"{name} {value:.{digits}f}" for name, value in values.items())
        )

    def metres(key: str) -> str:
        return "-" if summary[key] is None else f"{summary[key]:+.4f} m"

    share = summary["feasible_reached_share"]
    reached = f"{summary['feasible_reached']} of {summary['feasible']}"
    reached += "" if share is None else f" ({100.0 * share:.1f} %)"
    by_sight = f"{summary['feasible_by_sight_reached']} of {summary['feasible_by_sight']}"
    beyond = f"{metres('least_clearance_over_margin')}, {metres('least_separation_over_margin')}"
    rows = [
        ("Targets that can be reached, and were", reached),
        ("The same for ideal sensors with beams everywhere", by_sight),
        ("Robots in all, and arrived", f"{summary['robots']}, {summary['reached']}"),
        ("Robots that ended neither at the target nor with a typed reason", zero("without_typed_reason")),
        ("Runs that ended with an exception", zero("failed_runs")),
        ("Robots with a collision", zero("collisions")),
        ("Robots with a margin violation", zero("margin_violations")),
        ("Robots that stood beyond their window and were walked up to", str(summary["walked_into"])),
        ("Robots that stood beyond their window and were hit", zero("hit_standing")),
        ("Least clearance, least separation, beyond the safety margin", beyond),
        ("Travelled length / exact optimum at the planning distance", spread("ratio_planned", 3)),
        ("The same in the area reduced by the safety margin", spread("ratio_safety_margin", 3)),
        ("Planner step, medians of the runs (ms)", spread("planner_p50_ms", 1)),
        ("Planner step, p99 of the runs (ms)", spread("planner_p99_ms", 1)),
        ("Simulated, computed", f"{summary['simulated_time']:.0f} s, {summary['seconds']:.0f} s"),
    ]
    return _table((), rows)


def _endings(records: Sequence[Record]) -> str:
    robots = robots_of(records)
    reasons = sorted({robot["reason"] for robot in robots}, key=lambda reason: (reason != "arrived", reason))
    rows = []
    for reason in reasons:
        some = [robot for robot in robots if robot["reason"] == reason]
        feasible = sum(robot["feasible"] for robot in some)
        rows.append(
            (escape(reason.replace("_", " ")), str(feasible), str(len(some) - feasible), str(len(some)))
        )
    return _table(("ending", "target can be reached", "cannot", "all"), rows, numbers=(1, 2, 3))


def _figures(records: Sequence[Record]) -> str:
    # drawing needs matplotlib, which takes a second to import
    from snnav_sim.report.campaign_figures import margin_figure, ratio_figure, step_figure

    robots = robots_of(records)
    feasible = [robot for robot in robots if robot["feasible"]]

    def known(values: Iterable[float | None]) -> list[float]:
        return [value for value in values if value is not None]

    def beyond(key: str) -> list[float]:
        return [robot[key] - robot["safety_margin"] for robot in robots if robot[key] is not None]

    images = {
        "Length of the ways over the optimum": ratio_figure(
            known(robot["optimum_ratio_planned"] for robot in feasible),
            known(robot["optimum_ratio"] for robot in feasible),
        ),
        "Least clearance and separation beyond the margin": margin_figure(
            beyond("least_clearance"), beyond("least_separation")
        ),
        "Times of planner steps": step_figure(
            known(record["planner_ms"].get("p50") for record in records),
            known(record["planner_ms"].get("p99") for record in records),
        ),
    }
    tags = (
        f'<img alt="{text}" src="data:image/png;base64,{base64.b64encode(image).decode()}">'
        for text, image in images.items()
    )
    return f'<div class="figures">{"".join(tags)}</div>'


def _attention(directory: Path, records: Sequence[Record]) -> list[str]:
    """Runs that must not be: exceptions, collisions, margins not kept, and bodies that walked up to a robot."""
    keys = {
        "collisions": "collision",
        "margin_violations": "margin violation",
        "hit_standing": "hit while standing beyond its window",
        "walked_into": "walked up to while standing beyond its window",
    }
    rows = []
    for record in records:
        faults = [
            f"{escape(name)}: {text} ({robot[key]} samples)"
            for name, robot in record["robots"].items()
            for key, text in keys.items()
            if robot[key]
        ]
        if record["error"]:
            faults.append(f"exception: {escape(record['error'])}")
        if faults:
            rows.append((_links(directory, record), "<br>".join(faults)))
    return ["<h2>Runs to look into</h2>", _table(("run", "what happened"), rows)] if rows else []


def _not_arrived(directory: Path, records: Sequence[Record]) -> list[str]:
    rows = []
    for record in records:
        names = [name for name, robot in record["robots"].items() if not robot["reached"]]
        if not names:
            continue
        stops = []
        for name in names:
            robot = record["robots"][name]
            can = "target can be reached" if robot["feasible"] else "target cannot be reached"
            mark = "bad" if robot["feasible"] else "note"
            stops.append(f'<span class="{mark}">{escape(name)}: {can}</span><br>{escape(robot["message"])}')
        run = run_name(record["kind"], record["seed"])
        picture = f"{PICTURES}/{run}.png"
        image = f'<a href="{picture}"><img alt="Ways of {escape(run)}" loading="lazy" src="{picture}"></a>'
        rows.append(
            (_links(directory, record), "<br>".join(stops), image if (directory / picture).is_file() else "")
        )
    if not rows:
        return ["<h2>Runs that did not arrive</h2><p>None.</p>"]
    note = (
        f'<p class="note">{len(rows)} runs. A scene runs again with <code>snnav run FILE --core</code>.</p>'
    )
    table = _table(("run", "how it ended", "picture"), rows)
    return ["<h2>Runs that did not arrive</h2>", note, f'<div class="runs">{table}</div>']


def _links(directory: Path, record: Record) -> str:
    """The name of a run with links to its files."""
    name = run_name(record["kind"], record["seed"])
    links = [
        f'<a href="{folder}/{name}{suffix}">{text}</a>'
        for folder, suffix, text in ((SCENES, ".yaml", "scene"), (FAILURES, ".txt", "traceback"))
        if (directory / folder / f"{name}{suffix}").is_file()
    ]
    return f"{escape(name)}<br>{' '.join(links)}"
