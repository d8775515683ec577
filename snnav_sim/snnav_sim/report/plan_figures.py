"""Plans of the global planner: all candidates from above, and the chosen ones in X-Y-T (figures of Ch. 2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from shapely.geometry.base import BaseGeometry

from snnav_core.planning.spacetime_problem import Candidate, CandidateOutcome, SpacetimePlan
from snnav_core.types import FloatArray
from snnav_sim.report.drawing import MOVER, SEEN, SOLID, draw_mover, draw_world, fill, frame, robot_colour
from snnav_sim.report.look import Look, short_names
from snnav_sim.report.record import RunRecord
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import Scene
from snnav_sim.world import mover_positions, solid

__all__ = ["draw_candidates", "draw_spacetime"]

_WIDTH = 11.0  # inches
_DPI = 110
_CHOSEN, _REACHED = robot_colour(0), [robot_colour(index) for index in range(1, 7)]
_OTHER = "#8a8a8a"
_GHOSTS = 5
_SLICES = 40  # of a body that does not move uniformly, in X-Y-T
_LISTED = 8  # candidates in a legend
_SIDES = 24  # of a disk in X-Y-T


def draw_candidates(scene: Scene, record: RunRecord, truth: GroundTruth, file: Path) -> None:
    """Draw all candidates of the first plan of every robot, and the chosen ones, from above as a PNG."""
    plans = _first_plans(scene, record)
    width, height = (scene.workspace.max(axis=0) - scene.workspace.min(axis=0)).tolist()
    figure = Figure(
        figsize=(_WIDTH, min(14.0, max(3.5, (_WIDTH - 1.0) * height / width + 1.6))), layout="constrained"
    )
    axes = figure.add_subplot()
    fill(axes, shapely.Polygon(scene.workspace), facecolor=SEEN, edgecolor="none")
    draw_world(axes, scene, truth)
    begin, end = _span(plans)
    for mover in scene.movers:
        way = mover_positions(mover, np.linspace(begin, end, 100))
        axes.plot(way[:, 0], way[:, 1], color=MOVER, linewidth=0.9, linestyle=":", zorder=4)
        for index, time in enumerate(np.linspace(begin, end, _GHOSTS)):
            draw_mover(axes, mover, float(time), alpha=0.25 + 0.6 * index / (_GHOSTS - 1), zorder=5)
    handles = _one(axes, plans[0]) if len(plans) == 1 else _several(axes, scene, plans)
    for robot in scene.robots:
        axes.plot(*robot.start, marker="o", markersize=8, color="white", markeredgecolor="black", zorder=9)
        axes.plot(*robot.target, marker="X", markersize=9, color="black", markeredgecolor="white", zorder=9)
    frame(axes, scene)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    made = min(time for time, _ in record.plans)
    axes.set_title(f"{scene.name}: candidates of the plan made at {made:.1f} s", loc="left", fontsize=11)
    if scene.movers:
        handles.append(Patch(facecolor=MOVER, alpha=0.6, label="moving body (darker: later)"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)


def _first_plans(scene: Scene, record: RunRecord) -> list[SpacetimePlan]:
    plans = [record.plans_of(robot.id) for robot in scene.robots]
    return [made[0][1] for made in plans if made]


def _span(plans: Sequence[SpacetimePlan]) -> tuple[float, float]:
    return min(plan.path.start_time for plan in plans), max(plan.path.end_time for plan in plans)


def _is_chosen(candidate: Candidate, plan: SpacetimePlan) -> bool:
    return candidate.outcome is CandidateOutcome.REACHED and np.array_equal(
        candidate.points, plan.path.points[:, :2]
    )


def _one(axes: Axes, plan: SpacetimePlan) -> list[Line2D | Patch]:
    """Draw the candidates of one robot, each that reached the target in its own colour."""
    handles: list[Line2D | Patch] = []
    reached = sorted(
        (one for one in plan.candidates if one.outcome is CandidateOutcome.REACHED),
        key=lambda one: one.travel_time,
    )
    for candidate in plan.candidates:
        if candidate.outcome is not CandidateOutcome.REACHED:
            axes.plot(*candidate.points.T, color=_OTHER, linewidth=0.9, linestyle=(0, (3, 2)), zorder=5)
    others = 0
    for candidate in reversed(reached):
        chosen = _is_chosen(candidate, plan)
        colour = _CHOSEN if chosen else _REACHED[others % len(_REACHED)]
        others += not chosen
        width = 2.8 if chosen else 1.4
        axes.plot(*candidate.points.T, color=colour, linewidth=width, zorder=7 if chosen else 6)
        label = f"{candidate.travel_time:.2f} s" + (", chosen" if chosen else "")
        handles.append(Line2D([], [], color=colour, linewidth=width, label=label))
    handles = handles[::-1][:_LISTED]
    counts = {
        outcome.value.replace("_", " "): sum(one.outcome is outcome for one in plan.candidates)
        for outcome in CandidateOutcome
        if outcome is not CandidateOutcome.REACHED
    }
    label = ", ".join(f"{count} {name}" for name, count in counts.items() if count)
    if label:
        handles.append(Line2D([], [], color=_OTHER, linewidth=0.9, linestyle=(0, (3, 2)), label=label))
    return handles


def _several(axes: Axes, scene: Scene, plans: Sequence[SpacetimePlan]) -> list[Line2D | Patch]:
    """Draw the candidates of several robots in the colours of these."""
    look = Look.of(scene)
    colours = {robot.id: colour for robot, colour in zip(scene.robots, look.colours, strict=True)}
    names = short_names([robot.id for robot in scene.robots])
    for plan in plans:
        colour = colours[plan.robot_id]
        for candidate in plan.candidates:
            if candidate.outcome is CandidateOutcome.REACHED and not _is_chosen(candidate, plan):
                axes.plot(*candidate.points.T, color=colour, linewidth=0.8, alpha=0.6, zorder=5)
        axes.plot(*plan.path.points[:, :2].T, color=colour, linewidth=2.0, zorder=6)
        (x, y), away = plan.path.points[0, :2], plan.path.points[0, :2] - plan.path.points[-1, :2]
        x, y = np.array((x, y)) + 0.7 * away / max(float(np.hypot(*away)), 1e-9)
        axes.text(x, y, names[plan.robot_id], color=colour, fontsize=9, ha="center", va="center", zorder=9)
    return [
        Line2D([], [], color="gray", linewidth=2.0, label="chosen path of the robot named"),
        Line2D(
            [], [], color="gray", linewidth=0.8, alpha=0.6, label="another candidate that reached the target"
        ),
    ]


def draw_spacetime(scene: Scene, record: RunRecord, file: Path) -> None:
    """Draw bodies and paths in X-Y-T as a PNG: what moves is a slanted column, what stands an upright one."""
    plans = _first_plans(scene, record)
    begin, end = _span(plans)
    figure = Figure(figsize=(_WIDTH, 8.5), layout="constrained")
    axes: Any = figure.add_subplot(projection="3d")
    for shape in scene.obstacles:
        ring = _ring(solid(shape))
        _column(axes, ring, np.zeros((2, 2)), np.array((begin, end)), SOLID, 0.18)
    for mover in scene.movers:
        times = np.linspace(begin, end, _SLICES if mover.start is None else 2)
        _column(axes, _ring(solid(mover.shape)), mover_positions(mover, times), times, MOVER, 0.22)
    look = Look.of(scene)
    colours = {robot.id: colour for robot, colour in zip(scene.robots, look.colours, strict=True)}
    for plan in plans:
        path = plan.path
        knots = path.start_time + path.step * np.arange(len(path))
        for candidate in plan.candidates if len(plans) == 1 else ():
            points = candidate.points
            rises = path.start_time + path.step * np.arange(len(points))
            reached = candidate.outcome is CandidateOutcome.REACHED
            style = "-" if reached else (0, (3, 2))
            axes.plot(*points.T, rises, color=_OTHER, linewidth=1.2 if reached else 0.7, linestyle=style)
        axes.plot(*path.points[:, :2].T, knots, color=colours[plan.robot_id], linewidth=2.4)
        # its shadow on the ground
        axes.plot(*path.points[:, :2].T, begin, color=colours[plan.robot_id], linewidth=0.8, alpha=0.5)
        if plan.bound is not None and len(plan.bound.route) > 1 and len(plans) == 1:
            axes.plot(*plan.bound.route.T, color="black", linewidth=1.0, linestyle=":")
    low, high = scene.workspace.min(axis=0), scene.workspace.max(axis=0)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_zlim(begin, end)
    size = high - low
    axes.set_box_aspect((float(size[0]), float(size[1]), 0.75 * float(size.max())), zoom=1.08)
    axes.view_init(elev=24, azim=-62)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    axes.set_zlabel("time [s]")
    axes.set_title(f"{scene.name}: paths and bodies in space-time", loc="left", fontsize=11)
    figure.legend(
        handles=_legend(scene, plans), loc="outside lower center", ncols=5, fontsize=8, frameon=False
    )
    figure.savefig(file, dpi=_DPI, bbox_inches="tight", pad_inches=0.15)


def _legend(scene: Scene, plans: Sequence[SpacetimePlan]) -> list[Line2D | Patch]:
    single = len(plans) == 1
    colour = Look.of(scene).colours[0] if single else "gray"
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=colour, linewidth=2.4, label="chosen path" if single else "path of a robot")
    ]
    handles.append(Line2D([], [], color=colour, linewidth=0.8, alpha=0.5, label="the same from above"))
    if single:
        handles.append(Line2D([], [], color=_OTHER, linewidth=1.2, label="other candidate"))
        if len(plans[0].candidates) > sum(
            one.outcome is CandidateOutcome.REACHED for one in plans[0].candidates
        ):
            handles.append(
                Line2D([], [], color=_OTHER, linewidth=0.7, linestyle=(0, (3, 2)), label="candidate given up")
            )
        if plans[0].bound is not None and len(plans[0].bound.route) > 1:
            handles.append(
                Line2D(
                    [],
                    [],
                    color="black",
                    linewidth=1.0,
                    linestyle=":",
                    label="lower bound of the travel time",
                )
            )
    if scene.movers:
        handles.append(Patch(facecolor=to_rgba(MOVER, 0.4), label="moving body"))
    if scene.obstacles:
        handles.append(Patch(facecolor=to_rgba(SOLID, 0.35), label="body at rest"))
    return handles


def _ring(region: BaseGeometry) -> FloatArray:
    """Outline (N, 2) [m], the first vertex repeated, with no more vertices than a picture needs."""
    ring: FloatArray = shapely.get_coordinates(shapely.get_parts(region)[0].exterior)
    if len(ring) > 2 * _SIDES:
        ring = ring[:: math.ceil(len(ring) / _SIDES)]
        ring = np.vstack((ring, ring[:1]))
    return ring


def _column(
    axes: Any, ring: FloatArray, shifts: FloatArray, times: FloatArray, colour: str, alpha: float
) -> None:
    """Draw what an outline sweeps over in X-Y-T: its side, and the rims at both ends."""
    x, y = (ring[:, axis] + shifts[:, axis, None] for axis in range(2))
    z = np.broadcast_to(times[:, None], x.shape)
    axes.plot_surface(x, y, z, color=colour, alpha=alpha, rstride=1, cstride=1, shade=False, linewidth=0)
    for level in (0, -1):
        axes.plot(x[level], y[level], z[level], color=colour, linewidth=0.8, alpha=0.9)
