"""Ground truth against which a run is measured."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from snnav_core.area.fusion import AreaFusion
from snnav_core.types import FloatArray
from snnav_sim.configure import fusion_settings, planar_sensor
from snnav_sim.devices.recorded import Recorded
from snnav_sim.report.optimum import reduced
from snnav_sim.report.true_area import TrueMemory
from snnav_sim.scene_types import Scene
from snnav_sim.world import World

__all__ = ["GroundTruth"]


class GroundTruth:
    """Where the obstacles of a scene truly are and what its sensors could see at best.

    Parameters
    ----------
    scene : Scene

    Notes
    -----
    With recorded sensors the true obstacles are unknown: the boundary of the fused area and every single return of
    the recorded scans stand for them.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.world = World(scene)
        self._still = World(replace(scene, movers=()))
        self._reduced: dict[float, BaseGeometry] = {}
        self._distances: dict[tuple[bytes, bytes], tuple[FloatArray, NDArray[np.bool_]]] = {}

    @cached_property
    def area(self) -> BaseGeometry:
        """The true unoccupied area without moving bodies [m, map]; the fused area for recorded sensors."""
        return self._fused[0] if self.scene.recorded else self._still.true_unoccupied_area()

    def reduced_area(self, distance: float) -> BaseGeometry:
        """Return the points of `area` at least `distance` [m] from its boundary [m, map]; kept for the next call."""
        if distance not in self._reduced:
            self._reduced[distance] = reduced(self.area, distance)
        return self._reduced[distance]

    @property
    def returns(self) -> FloatArray:
        """All returns of recorded sensors [m, map], shape (K, 2); none for simulated ones."""
        return self._fused[1] if self.scene.recorded else np.zeros((0, 2))

    def clearance(self, points: FloatArray, times: FloatArray) -> FloatArray:
        """Return the distance to the nearest true obstacle, moving body or wall.

        Parameters
        ----------
        points : ndarray, shape (N, 2)
            [m, map]
        times : ndarray, shape (N,)
            [s]

        Returns
        -------
        ndarray, shape (N,)
            [m]; negative inside an obstacle. For recorded sensors: to the boundary of the fused area or the nearest
            return, whichever is nearer.
        """
        if not self.scene.recorded:
            return self.world.obstacle_clearance(points, times)
        clearance = self.area_clearance(points, times)[0]
        if len(self.returns) > 0:
            np.minimum(clearance, self._tree.query(points)[0], out=clearance)
        return clearance

    def area_clearance(self, points: FloatArray, times: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the signed distance to the boundary of the true unoccupied area, memory included.

        Parameters
        ----------
        points : ndarray, shape (N, 2)
            [m, map]
        times : ndarray, shape (N,)
            [s]

        Returns
        -------
        clearance : ndarray, shape (N,)
            [m]; negative outside. For recorded sensors: to the boundary of the fused area.
        exact : ndarray of bool, shape (N,)
            Where it is the distance itself and not a lower bound, see `TrueMemory.clearance`; the least and all below
            the safety margin are.
        """
        if self.memory.moves:
            question = points.tobytes(), times.tobytes()
            if question not in self._distances:
                self._distances[question] = self.memory.clearance(points, times)
            return self._distances[question]
        boundary = shapely.boundary(self._whole)
        shapely.prepare(self._whole)
        distance: FloatArray = shapely.distance(shapely.points(points), boundary)
        inside = shapely.intersects_xy(self._whole, points[:, 0], points[:, 1])
        return np.where(inside, distance, -distance), np.ones(len(points), dtype=np.bool_)

    @cached_property
    def memory(self) -> TrueMemory:
        """What the sensors can know to be free at best among moving bodies."""
        return TrueMemory(self.world)

    @cached_property
    def _whole(self) -> BaseGeometry:
        """What is known for ever where nothing moves, with the bodies that stand [m, map]."""
        return self.world.true_unoccupied_area() if self.scene.movers else self.area

    @cached_property
    def _fused(self) -> tuple[BaseGeometry, FloatArray]:
        sensors = self.scene.sensors
        fusion = AreaFusion([planar_sensor(sensor) for sensor in sensors], fusion_settings(self.scene))
        detected = [fusion.add_scan(sensor.id, Recorded(sensor).scan(0.0)) for sensor in sensors]
        returns = [part.returns for part in detected]
        return fusion.area(0.0).region, np.concatenate([np.zeros((0, 2)), *returns])

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.returns)
