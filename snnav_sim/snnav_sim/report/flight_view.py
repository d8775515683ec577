"""A run in space to turn and to play in a browser: one HTML file that needs nothing else."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from snnav_core.types import FloatArray
from snnav_sim.report.drawing import robot_colour
from snnav_sim.report.flight_metrics import flight_clearances
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.space_drawing import faces_of
from snnav_sim.space_types import FlyerScene, SpaceScene

__all__ = ["write_flight_view"]

_TEMPLATE = Path(__file__).with_suffix(".html")
_MOST_ROWS = 1500
_AIM = 0.6  # [m]; length of the line that shows where a camera looks


def write_flight_view(
    scene: SpaceScene,
    record: FlightRecord,
    file: Path,
    clearances: Mapping[str, FloatArray] | None = None,
    hits: FloatArray | None = None,
) -> None:
    """Write the view of a run.

    Parameters
    ----------
    scene : SpaceScene
    record : FlightRecord
    file : Path
    clearances : mapping, optional
        Robot id -> distance to be shown at every row of its trajectory [m]; to the nearest true body by default.
    hits : ndarray, shape (N, 3), optional
        Measured points to be shown as dots [m, map].

    Notes
    -----
    Long runs are shown every second, third, ... control period, so that there are at most 1500 moments.
    """
    text = json.dumps(_content(scene, record, clearances, hits), separators=(",", ":"), allow_nan=False)
    page = _TEMPLATE.read_text(encoding="utf-8")
    page = page.replace("TITLE", html.escape(scene.name)).replace("DATA", text.replace("</", "<\\/"), 1)
    file.write_text(page, encoding="utf-8")


def _content(
    scene: SpaceScene,
    record: FlightRecord,
    clearances: Mapping[str, FloatArray] | None,
    hits: FloatArray | None,
) -> dict[str, Any]:
    rows = {robot.id: record.trajectory(robot.id) for robot in scene.robots}
    count = max((len(each) for each in rows.values()), default=0)
    stride = max(1, -(-count // _MOST_ROWS))
    times = np.round(np.arange(0, count, stride) * scene.control_period, 3)
    clearances = flight_clearances(scene, record) if clearances is None else clearances
    return {
        "name": scene.name,
        "low": scene.low,
        "high": scene.high,
        "margin": scene.safety_margin,
        "period": stride * scene.control_period,
        "times": times.tolist(),
        "faces": [_rounded(face) for body in scene.obstacles for face in faces_of(body.solid)],
        "hits": [] if hits is None else _rounded(hits),
        "movers": [
            {
                "faces": [_rounded(face) for face in faces_of(mover.solid)],
                "places": _rounded(mover.positions(times)),
            }
            for mover in scene.movers
        ],
        "cameras": [
            {
                "position": sensor.position,
                "aim": _rounded(np.array(sensor.position) + _AIM * sensor.camera.rotation[:, 0]),
            }
            for sensor in scene.sensors
        ],
        "robots": [
            _robot(robot, index, record, rows[robot.id][::stride], clearances[robot.id][::stride])
            for index, robot in enumerate(scene.robots)
        ],
    }


def _robot(
    robot: FlyerScene, index: int, record: FlightRecord, rows: FloatArray, clearance: FloatArray
) -> dict[str, Any]:
    paths = [
        {
            "time": decision.time,
            "points": [] if decision.path is None else _rounded(decision.path.points[::3]),
        }
        for decision in record.decisions_of(robot.id)
    ]
    return {
        "id": robot.id,
        "colour": robot_colour(index),
        "radius": robot.radius,
        "start": robot.start,
        "target": robot.target,
        "places": _rounded(rows[:, 1:4]),
        "clearance": _rounded(clearance),
        "paths": paths,
    }


def _rounded(values: FloatArray) -> Any:
    return np.round(values, 3).tolist()
