"""The SICK LMS-200 and its like: a planar range finder with noise, resolution, error codes and drop-outs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from snnav_core.area.robots import RobotTrack
from snnav_core.sensing.scan import LMS200_ERROR_CODES, PlanarScan
from snnav_core.types import FloatArray
from snnav_sim.devices.noise import Lms200Noise, generator
from snnav_sim.devices.single import down, up
from snnav_sim.raycast import cast
from snnav_sim.scene_types import SensorScene
from snnav_sim.world import World

__all__ = ["RANGE_RESOLUTION", "Lms200"]

RANGE_RESOLUTION = 0.01
"""With noise, ranges are multiples of this [m] (the 10 mm mode)."""

_DROP_OUT_STREAM = 3


class Lms200:
    """A range finder in a world, deterministic by seed, its id and the number of the scan.

    Parameters
    ----------
    sensor : SensorScene
    world : World
    seed : int
    robots : sequence of RobotTrack
        Where robots are. A sensor that `sees_robots` measures their disks, as far as it is known where they were.

    Notes
    -----
    Without noise the ranges are exact, rounded down to single precision. A beam without return reads infinity,
    or an error code of the device when the scene asks for codes; a lost beam reads NaN, or a code; a surface
    nearer than `range_min`, or a body or a robot that stands on the device, reads 0.
    """

    def __init__(
        self, sensor: SensorScene, world: World, seed: int, robots: Sequence[RobotTrack] = ()
    ) -> None:
        self.sensor = sensor
        self._robots = robots if sensor.sees_robots else ()
        self._period = world.scene.scan_period(sensor)
        self._world, self._seed = world, seed
        self._angle_min = float(np.float32(sensor.angle_min))
        self._increment = float(np.float32(sensor.resolution))
        self._range_min, self._range_max = float(up(sensor.range_min)), float(down(sensor.range_max))
        self._noise = Lms200Noise(seed, sensor.id, sensor.beams) if sensor.noise == "lms200" else None
        self._static = self._cast(world.static_segments, world.static_circles)

    def scan(self, time: float) -> PlanarScan:
        """Return the scan measured at a time [s]."""
        ranges = self.true_ranges(time)
        number = max(0, round((time - self.sensor.scan_offset) / self._period))
        returned = np.isfinite(ranges)
        if self._noise is not None:
            noisy = np.round((ranges + self._noise.sample(number)) / RANGE_RESOLUTION) * RANGE_RESOLUTION
            ranges = np.where(returned, np.maximum(noisy, 0.0), ranges)
        ranges[returned & (ranges > self._range_max)] = np.inf
        ranges[ranges < self.sensor.range_min] = 0.0
        no_return, lost = (
            (LMS200_ERROR_CODES[0], LMS200_ERROR_CODES[-1]) if self.sensor.error_codes else (np.inf, np.nan)
        )
        ranges[np.isinf(ranges)] = no_return
        if self.sensor.drop_out > 0.0:
            draws = generator(self._seed, self.sensor.id, _DROP_OUT_STREAM, number).random(ranges.size)
            ranges[draws < self.sensor.drop_out] = lost
        return PlanarScan(
            stamp=time,
            ranges=down(ranges),
            angle_min=self._angle_min,
            angle_increment=self._increment,
            range_min=self._range_min,
            range_max=self._range_max,
        )

    def true_ranges(self, time: float) -> FloatArray:
        """Return the exact distance along every beam, infinity beyond `range_max`, shape (B,) [m]."""
        if not (self._world.scene.movers or self._robots):
            return self._static.copy()
        if self._world.is_covered(self.sensor.position, time):
            return np.zeros(self.sensor.beams)
        segments, circles = self._world.mover_shapes(time)
        circles = np.concatenate((circles, self._robot_disks(time)))
        return np.minimum(self._static, self._cast(segments, circles))

    def _robot_disks(self, time: float) -> FloatArray:
        """Return x, y, radius [m, map] of the robots known at a time [s], shape (R, 3)."""
        places = [(robot.position(time), robot.robot.radius) for robot in self._robots]
        disks = [(*place.tolist(), radius) for place, radius in places if place is not None]
        return np.array(disks, dtype=np.float64).reshape(-1, 3)

    def _cast(self, segments: FloatArray, circles: FloatArray) -> FloatArray:
        sensor = self.sensor
        return cast(
            sensor.position,
            sensor.heading,
            self._angle_min,
            self._increment,
            sensor.beams,
            segments,
            circles,
            self._range_max,
        )
