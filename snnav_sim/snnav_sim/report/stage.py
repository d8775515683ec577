"""One view of a run that can be set to any moment: for pictures over time and for the animation."""

from __future__ import annotations

import math

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.markers import MarkerStyle
from matplotlib.patches import Circle as CirclePatch
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from matplotlib.transforms import Affine2D

from snnav_sim.report.drawing import (
    MARGIN,
    MOVER,
    REMEMBERED,
    SEEN,
    SEEN_EDGE,
    UNSEEN,
    draw_sensor,
    draw_world,
    fill,
    frame,
    outline,
)
from snnav_sim.report.look import Look
from snnav_sim.report.moment import Moments
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import Circle, RobotScene, Scene
from snnav_sim.world import mover_positions

__all__ = ["Stage", "stage_legend"]

# A slender arrowhead that points along x.
_ARROW = Outline(np.array([(1.0, 0.0), (-0.8, 0.62), (-0.45, 0.0), (-0.8, -0.62), (1.0, 0.0)]))


class _Robot:
    """The marks of one robot."""

    def __init__(
        self, axes: Axes, robot: RobotScene, look: Look, colour: str, margin: float, size: float
    ) -> None:
        self.robot, self._trail, self._shows_ahead = robot, look.trail, not look.crowd
        thin = 0.6 if look.crowded else 1.0
        self.ahead = Line2D([], [], color=colour, linewidth=thin, linestyle=(0, (4, 2)), zorder=5)
        self.driven = Line2D([], [], color=colour, linewidth=0.8 * look.width, zorder=6)
        self.margin = CirclePatch(
            robot.start,
            margin,
            facecolor="none",
            edgecolor=MARGIN,
            linewidth=0.9 * thin,
            linestyle=(0, (3, 2)),
            zorder=7,
        )
        self.disk = CirclePatch(
            robot.start, robot.radius, facecolor=colour, edgecolor="none", alpha=0.4, zorder=8
        )
        self.arrow = Line2D([], [], color=colour, linestyle="none", markersize=size, zorder=9)
        self.arrow.set(markeredgecolor="white", markeredgewidth=0.6 * look.marks)
        self.target = Line2D([], [], color=colour, marker="X", markersize=0.75 * size, zorder=8)
        self.target.set(markeredgecolor="white")
        for line in (self.ahead, self.driven, self.arrow, self.target):
            axes.add_line(line)
        for patch in (self.margin, self.disk):
            axes.add_patch(patch)

    @property
    def artists(self) -> list[Artist]:
        return [self.ahead, self.driven, self.margin, self.disk, self.arrow, self.target]

    def move(self, moments: Moments, time: float) -> None:
        """Set all marks to a time [s]."""
        moment = moments.robot(self.robot, time, self._trail)
        for artist in self.artists:
            artist.set_visible(moment is not None)
        if moment is None:
            return
        if self._shows_ahead:
            self.ahead.set_data(moment.ahead[:, 0], moment.ahead[:, 1])
        self.driven.set_data(moment.driven[:, 0], moment.driven[:, 1])
        x, y = self.robot.target_at(time)
        self.target.set_data([x], [y])
        self.margin.set_center(moment.position)
        self.disk.set_center(moment.position)
        self.arrow.set_data([moment.position[0]], [moment.position[1]])
        self.arrow.set_marker(MarkerStyle(_ARROW.transformed(Affine2D().rotate(moment.heading))))


class Stage:
    """Axes with a scene, set to one moment after the other.

    Parameters
    ----------
    axes : Axes
    scene : Scene
    truth : GroundTruth
    moments : Moments
    size : float
        Of the arrowheads of robots [points].
    """

    def __init__(
        self, axes: Axes, scene: Scene, truth: GroundTruth, moments: Moments, size: float = 12.0
    ) -> None:
        self._axes, self._scene, self._moments = axes, scene, moments
        fill(axes, shapely.Polygon(scene.workspace), facecolor=UNSEEN, edgecolor="none", zorder=0)
        empty = outline(shapely.Polygon())
        self._area = PathPatch(empty, facecolor=SEEN, edgecolor=SEEN_EDGE, linewidth=0.6, zorder=1)
        self._remembered = PathPatch(empty, facecolor=REMEMBERED, edgecolor="none", zorder=1.5)
        axes.add_patch(self._area)
        axes.add_patch(self._remembered)
        draw_world(axes, scene, truth)
        for sensor in scene.sensors:
            draw_sensor(axes, scene, sensor, limits=False)
        self._movers = [self._add_mover(axes, index) for index in range(len(scene.movers))]
        self._robots = []
        look = Look.of(scene)
        size *= look.marks
        for robot, colour in zip(scene.robots, look.colours, strict=True):
            self._robots.append(_Robot(axes, robot, look, colour, scene.safety_margin, size))
        frame(axes, scene)
        robots = [artist for robot in self._robots for artist in robot.artists]
        # what changes is drawn over what stays: a changing area would cover the rest
        changing = [*self._movers, *robots] if moments.area_is_one else [*axes.patches[1:], *axes.lines]
        self.changing: list[Artist] = sorted(changing, key=lambda artist: artist.get_zorder())
        """What changes from moment to moment, and what lies above it, from below."""

    def _add_mover(self, axes: Axes, index: int) -> PathPatch:
        shape = self._scene.movers[index].shape
        if isinstance(shape, Circle):
            path = Outline.circle((shape.x, shape.y), shape.radius)
        else:
            path = outline(shapely.Polygon(shape.points))
        patch = PathPatch(path, facecolor=MOVER, edgecolor="none", zorder=5)
        axes.add_patch(patch)
        return patch

    def show(self, time: float) -> None:
        """Set everything to a time [s]."""
        area, remembered = self._moments.area(time)
        self._area.set_path(outline(area))
        self._remembered.set_path(outline(remembered))
        for mover, patch in zip(self._scene.movers, self._movers, strict=True):
            shift = Affine2D().translate(*mover_positions(mover, time)[0].tolist())
            patch.set_transform(shift + self._axes.transData)
        for robot in self._robots:
            robot.move(self._moments, time)


def stage_legend(scene: Scene, moments: Moments) -> list[Line2D | Patch]:
    """Return what the marks of a stage mean."""
    look = Look.of(scene)
    trail = f"driven in the last {look.trail:g} s" if math.isfinite(look.trail) else "driven"
    handles: list[Line2D | Patch] = [*look.legend(1.8, "" if look.crowded else f", {trail}")]
    if look.crowded:
        handles.append(Line2D([], [], color="gray", linewidth=1.3, label=trail))
    if scene.robots and not look.crowd:
        handles.append(
            Line2D([], [], color="gray", linewidth=1.0, linestyle=(0, (4, 2)), label="path at that time")
        )
    if scene.robots:
        label = f"safety margin {scene.safety_margin:g} m"
        handles.append(Line2D([], [], color=MARGIN, linewidth=0.9, linestyle=(0, (3, 2)), label=label))
    area = "fused area" if scene.recorded else "unoccupied area as published"
    handles.append(Patch(facecolor=SEEN, edgecolor=SEEN_EDGE, label=area))
    if moments.remembers:
        handles.append(Patch(facecolor=REMEMBERED, label="remembered, out of sight"))
    handles.append(Patch(facecolor=UNSEEN, edgecolor="#cccccc", linewidth=0.5, label="not known to be free"))
    if scene.movers:
        handles.append(Patch(facecolor=MOVER, label="moving body"))
    handles.append(
        Line2D([], [], color="black", marker="o", linestyle="none", markersize=4, label="range finder")
    )
    if scene.robots:
        handles.append(
            Line2D([], [], color="gray", marker="X", linestyle="none", markersize=6, label="target")
        )
    return handles
