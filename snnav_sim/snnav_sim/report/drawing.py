"""What all figures of a run share: colours, polygons with holes, the world, sensors, bodies and robots."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.patches import Circle as CirclePatch
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline
from shapely.geometry.base import BaseGeometry

from snnav_core.types import FloatArray
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import Circle, Mover, Scene, SensorScene, Shape
from snnav_sim.world import mover_positions, solid

__all__ = [
    "MARGIN",
    "MOVER",
    "REMEMBERED",
    "SEEN",
    "SEEN_EDGE",
    "SOLID",
    "UNSEEN",
    "draw_mover",
    "draw_sensor",
    "draw_shape",
    "draw_shares",
    "draw_world",
    "fill",
    "frame",
    "outline",
    "robot_colour",
]

SEEN, SEEN_EDGE, SOLID, UNSEEN = "#dcebf7", "#9dbfdb", "#4a4a4a", "#f4f1ec"
REMEMBERED, MOVER, MARGIN = "#cfe5c4", "#c06014", "#c1121f"

_ROBOTS = ("#0b5fa5", "#d1495b", "#2e8b57", "#8d5a97", "#e08e0b", "#00798c", "#6b4226", "#444444")
_MANY_SENSORS = 20  # more than these are drawn as small dots


def robot_colour(index: int) -> str:
    """Return the colour of a robot by its number in the scene."""
    return _ROBOTS[index % len(_ROBOTS)]


def outline(region: BaseGeometry) -> Outline:
    """Return the rings of polygons with their holes as one path to be filled."""
    vertices: list[FloatArray] = [np.zeros((0, 2))]
    codes: list[np.uint8] = []
    for ring in shapely.get_rings(shapely.get_parts(region)):
        points = shapely.get_coordinates(ring)
        vertices.append(points)
        codes.extend([Outline.MOVETO, *[Outline.LINETO] * (len(points) - 2), Outline.CLOSEPOLY])
    return Outline(np.concatenate(vertices), np.array(codes, dtype=np.uint8))


def fill(axes: Axes, region: BaseGeometry, **style: Any) -> PathPatch:
    """Draw polygons with their holes."""
    patch = PathPatch(outline(region), **style)
    axes.add_patch(patch)
    return patch


def frame(axes: Axes, scene: Scene, border: float = 0.02) -> None:
    """Show the workspace and a share of its size around it."""
    low, high = scene.workspace.min(axis=0), scene.workspace.max(axis=0)
    pad = border * float((high - low).max())
    axes.set_xlim(low[0] - pad, high[0] + pad)
    axes.set_ylim(low[1] - pad, high[1] + pad)
    axes.set_aspect("equal")


def draw_shape(axes: Axes, shape: Shape, shift: tuple[float, float], **style: Any) -> Artist:
    """Draw a circle or polygon given about an origin at `shift` [m, map]."""
    if isinstance(shape, Circle):
        patch = CirclePatch((shape.x + shift[0], shape.y + shift[1]), shape.radius, **style)
        axes.add_patch(patch)
        return patch
    return fill(axes, shapely.Polygon(shape.points + np.asarray(shift)), **style)


def draw_mover(axes: Axes, mover: Mover, time: float, **style: Any) -> Artist:
    """Draw a body where it is at a time [s]."""
    x, y = mover_positions(mover, time)[0].tolist()
    return draw_shape(axes, mover.shape, (x, y), facecolor=MOVER, edgecolor="none", **style)


def draw_world(axes: Axes, scene: Scene, truth: GroundTruth) -> list[Artist]:
    """Draw walls and obstacles at rest, or all recorded returns."""
    if scene.recorded:
        return list(
            axes.plot(truth.returns[:, 0], truth.returns[:, 1], ".", color=SOLID, markersize=0.8, zorder=3)
        )
    border = shapely.Polygon(scene.workspace)
    solids = shapely.union_all([solid(shape) for shape in scene.obstacles])
    return [
        fill(axes, shapely.intersection(solids, border), facecolor=SOLID, edgecolor="none", zorder=3),
        fill(axes, border, facecolor="none", edgecolor="black", linewidth=2.0, zorder=4),
    ]


def draw_sensor(axes: Axes, scene: Scene, sensor: SensorScene, limits: bool = True) -> bool:
    """Draw a sensor, the ends of its field of view and, if asked for, the limit of its range in the workspace.

    Returns
    -------
    bool
        Whether there is a limit to be seen.
    """
    (x, y), detailed = sensor.position, len(scene.sensors) <= _MANY_SENSORS
    axes.plot(x, y, marker="o", markersize=4.5 if detailed else 2.5, color="black", zorder=9)
    if not detailed:
        return False
    border = shapely.Polygon(scene.workspace)
    first, shown = sensor.heading + sensor.angle_min, False
    angles = first + np.linspace(0.0, sensor.field_of_view, 181)
    rim = np.stack((x + sensor.range_max * np.cos(angles), y + sensor.range_max * np.sin(angles)), axis=-1)
    for part in shapely.get_parts(shapely.intersection(shapely.LineString(rim), border)) if limits else ():
        points = shapely.get_coordinates(part)
        axes.plot(*points.T, color="black", linewidth=0.5, linestyle=":", alpha=0.6, zorder=2)
        shown = shown or len(points) > 1
    if not sensor.all_round:
        reach = 0.018 * math.sqrt(border.area) + 0.2
        for angle in (first, first + sensor.field_of_view):
            ends = [x, x + reach * math.cos(angle)], [y, y + reach * math.sin(angle)]
            points = shapely.get_coordinates(shapely.LineString(np.transpose(ends)).intersection(border))
            axes.plot(*points.T, color="black", linewidth=1.1, zorder=9)
    return shown


def draw_shares(axes: Axes, times: FloatArray, distances: FloatArray) -> None:
    """Draw over time what a tenth, and half, of many robots are nearer than.

    Parameters
    ----------
    axes : Axes
    times : ndarray, shape (M,)
        [s]
    distances : ndarray, shape (N, M)
        Of every robot [m]; not finite while it is not there.
    """
    there = np.where(np.isfinite(distances), distances, np.nan)
    shown = np.any(np.isfinite(there), axis=0)
    for share, colour in ((50, "#8fbbe0"), (10, "#2f7ab8")):
        curve = np.nanpercentile(there[:, shown], share, axis=0)
        label = f"{'half' if share == 50 else 'a tenth'} of the robots are nearer"
        axes.plot(times[shown], curve, color=colour, linewidth=1.2, label=label)
