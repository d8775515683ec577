"""An independent check of driven trajectories against the fused area and every measured return.

It shares no code with planner, certificate and fusion: returns are placed with their own formula, distances come
from shapely's tree.
"""

from __future__ import annotations

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.types import FloatArray
from snnav_sim.scene import Scene

__all__ = ["MarginCheck", "recorded_returns"]


def recorded_returns(scene: Scene) -> FloatArray:
    """Return every measured surface point of a scene's recorded scans [m, map], shape (K, 2).

    Readings beyond the sensor's range_cut are returns too; the cut only limits what counts as free.
    """
    points = [np.zeros((0, 2))]
    for sensor in scene.sensors:
        ranges = np.array(sensor.ranges)
        angles = sensor.heading + sensor.angle_min + sensor.resolution * np.arange(len(ranges))
        valid = (ranges > 0.0) & (ranges >= sensor.range_min) & (ranges <= sensor.range_max)
        offsets = ranges[valid, None] * np.column_stack((np.cos(angles[valid]), np.sin(angles[valid])))
        points.append(np.asarray(sensor.position) + offsets)
    return np.concatenate(points)


class MarginCheck:
    """Distances of motions to the boundary of an area and to single points.

    Parameters
    ----------
    area : shapely polygon or multipolygon
        Where a robot may be [m, map].
    returns : ndarray, shape (K, 2)
        Measured surface points [m, map].
    """

    def __init__(self, area: BaseGeometry, returns: FloatArray) -> None:
        self._area = area
        rings = [shapely.get_coordinates(ring) for ring in shapely.get_rings(shapely.get_parts(area))]
        pieces = [np.stack((ring[:-1], ring[1:]), axis=1) for ring in rings]
        segments = np.concatenate([np.zeros((0, 2, 2)), *pieces])
        self._boundary = shapely.STRtree(shapely.linestrings(segments) if len(segments) else [])
        self._returns = shapely.STRtree(shapely.points(returns) if len(returns) else [])

    def clearances(self, rows: FloatArray, period: float) -> tuple[FloatArray, FloatArray]:
        """Return lower bounds of the distances along every motion.

        Parameters
        ----------
        rows : ndarray, shape (N, 6), N >= 1
            time, x, y, heading, speed, turn rate at every control sample, as in a `RunRecord`; speed and turn rate
            belong to the motion that begins there.
        period : float
            Control period [s].

        Returns
        -------
        to_area : ndarray, shape (N,)
            Least distance to the boundary of the area from sample to sample [m], negative outside.
        to_returns : ndarray, shape (N,)
            Least distance to any return [m]; inf without returns.

        Notes
        -----
        Between samples a robot drives an arc of length s that turns by a; the arc leaves its chord by at most
        s a / 8, which is taken off the distance of the chord.
        """
        points = rows[:, 1:3]
        chords = shapely.linestrings(np.stack((points, np.vstack((points[1:], points[-1:]))), axis=1))
        bulge = np.abs(rows[:, 4] * rows[:, 5]) * period**2 / 8.0
        bulge[-1] = 0.0
        shapely.prepare(self._area)
        inside = shapely.intersects_xy(self._area, points[:, 0], points[:, 1])
        to_area = _nearest(self._boundary, chords)
        return np.where(inside, to_area, -to_area) - bulge, _nearest(self._returns, chords) - bulge


def _nearest(tree: shapely.STRtree, lines: FloatArray) -> FloatArray:
    """Return the distance of every line to the nearest geometry of a tree [m], shape (N,)."""
    if len(tree) == 0:
        return np.full(len(lines), np.inf)
    (index, _), distance = tree.query_nearest(lines, all_matches=False, return_distance=True)
    nearest = np.empty(len(lines))
    nearest[index] = distance
    return nearest
