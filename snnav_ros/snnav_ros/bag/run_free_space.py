"""What ``snnav free-space`` does."""

from __future__ import annotations

import argparse
import csv
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from snnav_core.area.spatial import SpatialArea
from snnav_core.navigator.flight_settings import FlightDistances
from snnav_core.types import FloatArray, RobotSpec
from snnav_ros.bag.errors import NetworkError
from snnav_ros.bag.files import check_directory, make_directory
from snnav_ros.bag.free_space import FreeSpace, find_free_space
from snnav_ros.bag.progress import counter
from snnav_ros.bag.recorded_depth import DepthRecording, read_depth_recording
from snnav_ros.bag.settings import FreeSpaceSettings
from snnav_ros.run_display import make_console
from snnav_sim.configure_flight import flight_settings
from snnav_sim.recorded_flight import RecordedFlight, far_apart
from snnav_sim.report.cross_view import CrossView
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.recorded_flight_metrics import recorded_flight_metrics
from snnav_sim.report.write import write_tables
from snnav_sim.space_types import DepthSensor, FlyerScene, Point3, SpaceScene

__all__ = ["run"]

_MARK = "free_space.json"  # the file by which a directory of results is known
_MOST = 0.01  # share of the hits of a camera that may lie in what another one calls free
_ROBOT = "flyer"


def run(arguments: argparse.Namespace) -> int:
    """Run ``snnav free-space``."""
    names = [field.name for field in fields(FreeSpaceSettings) if field.name in arguments]
    settings = FreeSpaceSettings(**{name: getattr(arguments, name) for name in names})
    RobotSpec(_ROBOT, settings.radius, settings.speed, settings.max_turn_rate)
    directory = check_directory(arguments.out or Path("runs") / f"{arguments.bag.stem}-free-space", _MARK)
    recording = read_depth_recording(arguments.bag, settings.range_max)
    for warning in recording.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    count = len(recording.cameras)
    if count < 2:
        print(
            f"warning: {arguments.bag}: one camera only; nobody tells whether its free space is",
            file=sys.stderr,
        )
    with counter("comparing cameras", count * (count - 1)) as progress:
        space = find_free_space(recording, settings, progress)
    ends = _ends(arguments, space.area, settings)
    scene = _scene(recording, space, settings, ends)
    record = RecordedFlight(scene, space.area).run()
    flight = recorded_flight_metrics(scene, record, space.area, space.hits)
    metrics = _metrics(recording, space, flight)

    def fill(draft: Path) -> None:
        how = {"bag": str(recording.path), "settings": asdict(settings), "robot": ends[0], "goal": ends[1]}
        _write_json(draft / _MARK, how)
        _write_json(draft / "metrics.json", metrics)
        _write_views(draft / "cross_views.csv", space.views)
        write_tables(draft, record)
        if not arguments.no_figures:
            _draw(draft / "figures", scene, record, space, settings)

    make_directory(directory, _MARK, fill)
    _tell(recording, space, settings, flight)
    print(f"results: {directory}")
    good = all(view.share(settings.pose_accuracy) < _MOST for view in space.views)
    return 0 if good and flight["reached"] and not flight["margin_violations"] else 1


def _ends(
    arguments: argparse.Namespace, area: SpatialArea, settings: FreeSpaceSettings
) -> tuple[Point3, Point3]:
    """Return start and target: as given, else far apart in the largest part in which there is room for a flight."""
    begin, end = (getattr(arguments, name, None) for name in ("robot", "goal"))
    if (begin is None) != (end is None):
        raise NetworkError("--robot and --goal go together; give both, or none to have them chosen")
    if begin is not None and end is not None:
        return begin, end
    # What is planned for at most: the margin, the tolerance, half a diagonal that may be lost between cells.
    chosen = far_apart(area, settings.safety_margin + 2.0 * area.grid.half_diagonal)
    if chosen is None:
        raise NetworkError(
            f"{arguments.bag}: nowhere is room for a robot with a margin of {settings.safety_margin:g} m; "
            "give a smaller --margin and --radius, or a smaller --pose-accuracy if the poses are that good"
        )
    first, second = chosen
    x0, y0, z0 = np.round(first, 3).tolist()
    x1, y1, z1 = np.round(second, 3).tolist()
    return (x0, y0, z0), (x1, y1, z1)


def _scene(
    recording: DepthRecording,
    space: FreeSpace,
    settings: FreeSpaceSettings,
    ends: tuple[Point3, Point3],
) -> SpaceScene:
    """Return the scene of the flight: a box that holds all that was seen, the cameras, one robot."""
    sensors = tuple(
        DepthSensor(
            camera.id,
            "tof",
            _point(camera.position),
            look_at=_point(camera.position + camera.rotation[:, 0]),
            columns=camera.model.columns,
            rows=camera.model.rows,
        )
        for camera in recording.cameras
    )
    begin, end = ends
    heading = math.atan2(end[1] - begin[1], end[0] - begin[0])
    robot = FlyerScene(
        _ROBOT, begin, heading, 0.0, end, settings.speed, settings.max_turn_rate, settings.radius
    )
    scene = SpaceScene(
        name=recording.path.stem,
        sampling_interval=settings.sampling_interval,
        low=_point(space.grid.origin),
        high=_point(space.grid.high),
        safety_margin=settings.safety_margin,
        sensors=sensors,
        robots=(robot,),
        known_border=False,
        grid_spacing=settings.grid_spacing,
        seed=settings.seed,
        control_period=settings.control_period,
        time_window=settings.time_window,
    )
    FlightDistances(robot.spec, flight_settings(scene, settings.seed))  # refuses a margin that is too small
    return scene


def _point(values: FloatArray) -> Point3:
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return x, y, z


def _metrics(recording: DepthRecording, space: FreeSpace, flight: dict[str, Any]) -> dict[str, Any]:
    """Return the content of ``metrics.json``; docs/real-depth.md explains its keys."""
    cell = space.grid.spacing**3
    return {
        "recording": recording.path.stem,
        "images": {name: len(images) for name, images in recording.images.items()},
        "hits": len(space.hits),
        "views": [view.summary() for view in space.views],
        "grid": {"shape": list(space.grid.shape), "spacing": space.grid.spacing},
        "hits_in_free_region": space.hits_inside,
        "free_volume": round(float(np.count_nonzero(space.area.moving > 0.0)) * cell, 3),
        "flight": flight,
    }


def _tell(
    recording: DepthRecording, space: FreeSpace, settings: FreeSpaceSettings, flight: dict[str, Any]
) -> None:
    console = make_console()
    if space.views:
        console.print(_table(space.views, settings))
    volume = float(np.count_nonzero(space.area.moving > 0.0)) * space.grid.spacing**3
    console.print(
        f"all cameras: {volume:.2f} m³ free, {settings.pose_accuracy:g} m and the errors of the ranges taken off; "
        f"{space.hits_inside} of {len(space.hits)} hits lie in it",
        highlight=False,
    )
    verdict = (
        f"reached after {flight['duration']:.1f} s"
        if flight["reached"]
        else f"NOT reached: {flight['reason']}"
    )
    console.print(f"flight: {verdict}", highlight=False, markup=False)
    if flight["least_clearance"] is not None:
        console.print(
            f"{flight['travelled_length']:.2f} m flown, {flight['paths']} certified paths; never nearer than "
            f"{flight['least_clearance']:.3f} m to what is not known to be free (margin {settings.safety_margin:g} m) "
            f"and {flight['nearest_hit']:.3f} m to any hit",
            highlight=False,
        )


def _table(views: Sequence[CrossView], settings: FreeSpaceSettings) -> Table:
    """Return one row for every camera judged by another one."""
    table = Table(
        title="hits of one camera in what another one alone calls free",
        caption=f"errors of ranges up to {settings.range_accuracy:g} m + {settings.range_growth:g}/m r² taken off; "
        f"with margin: {settings.pose_accuracy:g} m more on all sides",
        title_justify="left",
        caption_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
    )
    table.add_column("free by")
    table.add_column("hits of")
    for name in (
        "pairs",
        "hits\nin view",
        "as carved",
        "with\nmargin",
        "of those\nnot hidden",
        "worst\npair",
        "deepest\nm",
    ):
        table.add_column(name, justify="right")
    for view in views:
        margin = settings.pose_accuracy
        table.add_row(
            view.claims,
            view.hits_of,
            str(view.pairs),
            str(view.hits),
            f"{100 * view.carved / max(view.hits, 1):.2f} %",
            f"{100 * view.share(margin):.4f} %",
            f"{100 * view.open_share(margin):.4f} %",
            f"{100 * view.worst:.4f} %",
            f"{max(view.depths[-1], 0.0):.3f}" if len(view.depths) else "-",
        )
    return table


def _write_views(path: Path, views: Sequence[CrossView]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["claims", "hits_of", "margin", "hits", "open_hits", "false_free", "volume"])
        for view in views:
            for row in view.summary()["by_margin"]:
                counts = (view.hits, view.open_hits, row["false_free"], row["volume"])
                writer.writerow([view.claims, view.hits_of, row["margin"], *counts])


def _draw(
    directory: Path, scene: SpaceScene, record: FlightRecord, space: FreeSpace, settings: FreeSpaceSettings
) -> None:
    from snnav_sim.report.free_space_figures import (
        draw_false_free,
        draw_recorded_flight,
    )  # takes a second to import

    directory.mkdir()
    if space.views:
        draw_false_free(space.views, settings.pose_accuracy, directory / "false_free.png")
    draw_recorded_flight(scene, record, space.area, space.hits, directory)


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
