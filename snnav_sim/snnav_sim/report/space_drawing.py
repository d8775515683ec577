"""A room in space on matplotlib axes: bodies, cameras, people, ways, from a viewpoint."""

from __future__ import annotations

import numpy as np
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

from snnav_core.types import FloatArray
from snnav_sim.report.drawing import MOVER
from snnav_sim.space_types import Box, Mesh, Solid, SpaceScene
from snnav_sim.space_world import boxes_of, outline_of, triangles_of

__all__ = ["draw_room", "faces_of", "set_up_view"]

BODY = "#7d8597"
CAMERA = "#3d405b"
_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
_AIM = 0.6  # [m]; length of the line that shows where a camera looks


def faces_of(solid: Solid) -> list[FloatArray]:
    """Return the faces of a body, each (V, 3) [m]."""
    if isinstance(solid, Mesh):
        return list(triangles_of(solid))
    if isinstance(solid, Box):
        faces = []
        for low, high in boxes_of(solid):
            eight = np.array(
                [[(low, high)[number >> axis & 1][axis] for axis in range(3)] for number in range(8)]
            )
            faces += [eight[list(face)] for face in _FACES]
        return faces
    outline = outline_of(solid.outline)
    below = np.column_stack((outline, np.full(len(outline), solid.bottom)))
    above = np.column_stack((outline, np.full(len(outline), solid.top)))
    sides = [np.array([below[i - 1], below[i], above[i], above[i - 1]]) for i in range(len(outline))]
    return [below, above, *sides]


def set_up_view(axes: Axes3D, scene: SpaceScene, elevation: float, azimuth: float) -> None:
    """Show the whole room to scale from a viewpoint [degrees]."""
    low, high = np.array(scene.low), np.array(scene.high)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_zlim(low[2], high[2])
    axes.set_box_aspect(tuple((high - low).tolist()), zoom=1.05 if elevation < 80.0 else 1.2)
    axes.view_init(elev=elevation, azim=azimuth)
    axes.set_proj_type("ortho")
    axes.set_xlabel("x [m]", fontsize=8)
    axes.set_ylabel("y [m]", fontsize=8)
    if elevation < 80.0:
        axes.set_zlabel("z [m]", fontsize=8)
    else:
        axes.set_zticks([])
    axes.tick_params(labelsize=7)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
        axis._axinfo["grid"].update(linewidth=0.4, color=(0.0, 0.0, 0.0, 0.1))


def draw_room(axes: Axes3D, scene: SpaceScene, time: float | None = None) -> None:
    """Draw bodies (faint, to be looked through), cameras with where they look, and movers with their ways."""
    for body in scene.obstacles:
        faces = faces_of(body.solid)
        axes.add_collection3d(
            Poly3DCollection(faces, facecolor=BODY, alpha=0.10, edgecolor=BODY, linewidths=0.25)
        )
    for mover in scene.movers:
        place = mover.positions(0.0 if time is None else time)[0]
        faces = [face + place for face in faces_of(mover.solid)]
        axes.add_collection3d(Poly3DCollection(faces, facecolor=MOVER, alpha=0.35, edgecolor="none"))
        ways = np.array(mover.waypoints)
        axes.plot(*ways.T, color=MOVER, linewidth=1.0, linestyle=":")
    places = np.array([sensor.position for sensor in scene.sensors]).reshape(-1, 3)
    if len(places):
        aims = np.array([sensor.camera.rotation[:, 0] for sensor in scene.sensors])
        axes.scatter(*places.T, color=CAMERA, marker="s", s=14, depthshade=False)
        lines = np.stack((places, places + _AIM * aims), axis=1)
        axes.add_collection3d(Line3DCollection(lines, colors=CAMERA, linewidths=1.2))
