"""What is where at a moment of a run: area, robots, paths."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.types import FloatArray
from snnav_sim.report.record import RunRecord
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import RobotScene, Scene
from snnav_sim.visibility import ring_segments, visible_region

__all__ = ["Moments", "RobotMoment"]

_TIME = 1e-6  # [s]
_SLIVER = 0.002  # share of the size of the workspace; thinner remembered parts are not shown


@dataclass(frozen=True)
class RobotMoment:
    """One robot at a moment.

    Parameters
    ----------
    position : tuple of float
        [m, map]
    heading : float
        [rad, map]
    driven : ndarray, shape (N, 2)
        Trajectory up to now, or its last part [m, map].
    ahead : ndarray, shape (M, 2)
        What is left of the path that it follows [m, map]; empty while it has none.
    """

    position: tuple[float, float]
    heading: float
    driven: FloatArray
    ahead: FloatArray


class Moments:
    """A run to be looked at again.

    Parameters
    ----------
    scene : Scene
    record : RunRecord
    truth : GroundTruth
    """

    def __init__(self, scene: Scene, record: RunRecord, truth: GroundTruth) -> None:
        self._scene, self._record, self._truth = scene, record, truth
        self._stamps = [stamp for stamp, _ in record.areas]
        self._rows = {robot.id: record.trajectory(robot.id) for robot in scene.robots}
        self._decisions = {robot.id: record.decisions_of(robot.id) for robot in scene.robots}
        self._decided = {name: [d.time for d in of] for name, of in self._decisions.items()}
        self._parts: tuple[int, tuple[BaseGeometry, BaseGeometry]] | None = None

    @property
    def end(self) -> float:
        """Time of the last sample [s]."""
        return max((float(rows[-1, 0]) for rows in self._rows.values() if len(rows)), default=0.0)

    @property
    def remembers(self) -> bool:
        """Whether parts of the published area may be out of sight at their time."""
        scene = self._scene
        return not scene.recorded and (self._truth.memory.moves or scene.sees_robots)

    @property
    def area_is_one(self) -> bool:
        """Whether the same area was published all the time."""
        return not self.remembers and len({id(region) for _, region in self._record.areas}) <= 1

    def times(self, count: int) -> list[float]:
        """Return so many even times up to the end, each a sampling instant [s]."""
        delta = self._scene.sampling_interval
        times = {math.floor(self.end * (index + 1) / count / delta + _TIME) * delta for index in range(count)}
        return sorted(times)

    def area(self, time: float) -> tuple[BaseGeometry, BaseGeometry]:
        """Return what of the last published area is in sight and what is only remembered [m, map]."""
        index = bisect.bisect_right(self._stamps, time + _TIME) - 1
        if index < 0:
            return shapely.Polygon(), shapely.Polygon()
        if self._parts is None or self._parts[0] != index:
            self._parts = index, self._split(*self._record.areas[index])
        return self._parts[1]

    def _split(self, stamp: float, region: BaseGeometry) -> tuple[BaseGeometry, BaseGeometry]:
        if not self.remembers:
            return region, shapely.Polygon()
        out_of_sight = region
        for view in self._in_sight(stamp):
            out_of_sight = shapely.difference(out_of_sight, view)
        low, high = self._scene.workspace.min(axis=0), self._scene.workspace.max(axis=0)
        width = _SLIVER * float((high - low).max())
        remembered = out_of_sight.buffer(-0.5 * width, join_style="mitre").buffer(
            0.5 * width, join_style="mitre"
        )
        return region, remembered

    def _in_sight(self, stamp: float) -> list[BaseGeometry]:
        """Return what each sensor can see at a sampling instant [s], robots in the way of those on the floor."""
        world = self._truth.world
        if not self._scene.sees_robots:
            return self._truth.memory.views(round(stamp / self._scene.sampling_interval))
        robots = [
            shapely.Point(moment.position).buffer(robot.radius)
            for robot in self._scene.robots
            if (moment := self.robot(robot, stamp)) is not None
        ]
        free = world.free_region(stamp)
        above = ring_segments(free)
        on_floor = ring_segments(shapely.difference(free, shapely.union_all(robots)))
        return [
            visible_region(
                sensor.position,
                sensor.heading + sensor.angle_min,
                sensor.field_of_view,
                sensor.range_max,
                on_floor if sensor.sees_robots else above,
            )
            for sensor in self._scene.sensors
            if not world.is_covered(sensor.position, stamp)
        ]

    def robot(self, robot: RobotScene, time: float, trail: float = math.inf) -> RobotMoment | None:
        """Return a robot at a time [s] with the last `trail` [s] of its trajectory.

        None before its first sample and once it left.
        """
        rows = self._rows[robot.id]
        last = int(np.searchsorted(rows[:, 0], time + _TIME, side="right")) - 1 if len(rows) else -1
        if last < 0 or self._scene.instant(robot.leaves_at) <= time + _TIME:
            return None
        first = int(np.searchsorted(rows[:, 0], time - trail))
        driven = rows[min(first, last) : last + 1, 1:3]
        position = (float(rows[last, 1]), float(rows[last, 2]))
        return RobotMoment(position, float(rows[last, 3]), driven, self._ahead(robot.id, time, driven[-1]))

    def _ahead(self, name: str, time: float, position: FloatArray) -> FloatArray:
        index = bisect.bisect_right(self._decided[name], time + _TIME) - 1
        path = self._decisions[name][index].path if index >= 0 else None
        if path is None:
            return np.zeros((0, 2))
        passed = math.floor((time - path.start_time) / path.step + _TIME) + 1
        return np.vstack((position, np.asarray(path.points)[passed:, :2]))
