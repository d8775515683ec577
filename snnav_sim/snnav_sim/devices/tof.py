"""Range finders in space: the time-of-flight camera and the spinning range finder (Ch. 4)."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from snnav_core.area.camera_network import spheres_at
from snnav_core.area.robots import RobotTrack
from snnav_core.sensing.depth import DepthImage
from snnav_core.types import FloatArray
from snnav_sim.devices.noise import generator
from snnav_sim.raycast3d import cast_spheres
from snnav_sim.space_types import DepthSensor
from snnav_sim.space_world import SpaceWorld

__all__ = ["TOF_ACCURACY", "DepthDevice"]

_DEVIATION = 0.005  # [m]
_CUT = 4.0  # deviations
TOF_ACCURACY = _CUT * _DEVIATION
"""With noise, ranges are wrong by no more than this [m]."""

_NOISE_STREAM = 5
_DROP_OUT_STREAM = 6


class DepthDevice:
    """A range finder in a world in space, deterministic by seed, its id and the number of the image.

    Parameters
    ----------
    sensor : DepthSensor
    world : SpaceWorld
    seed : int
    robots : collection of RobotTrack
        Where robots are; they are seen like any other body, as far as it is known where they were. The first image, at
        time 0, is taken before they are put into the room: it shows what is behind them.

    Notes
    -----
    Radial ranges as REP 117 has them: +inf where nothing is within reach, -inf where a surface is nearer than
    `range_min`, NaN for a lost pixel. The noise is normal and cut off at four deviations of 5 mm. A device with
    `wrap` cannot tell a range from one that is longer by it: it shows the rest, which is never too far. Ranges are
    rounded to single precision: a message carries them unchanged.
    """

    def __init__(
        self, sensor: DepthSensor, world: SpaceWorld, seed: int, robots: Collection[RobotTrack] = ()
    ) -> None:
        self.sensor = sensor
        self._world, self._seed, self._robots = world, seed, robots
        self._period = world.scene.scan_period(sensor)
        camera = sensor.camera
        self._origin = camera.position
        self._rays = np.ascontiguousarray((camera.model.rays() @ camera.rotation.T).reshape(-1, 3))
        self._still = world.still_ranges(self._origin, self._rays)

    def scan(self, time: float) -> DepthImage:
        """Return the image measured at a time [s]."""
        sensor = self.sensor
        ranges = self.true_ranges(time)
        number = max(0, round((time - sensor.scan_offset) / self._period))
        if sensor.noise == "tof":
            draws = generator(self._seed, sensor.id, _NOISE_STREAM, number)
            ranges += _DEVIATION * np.clip(draws.standard_normal(len(ranges)), -_CUT, _CUT)
        if sensor.wrap is not None:
            ranges = np.mod(ranges, sensor.wrap)
        ranges[ranges > sensor.range_max] = np.inf
        ranges[ranges < sensor.range_min] = -np.inf
        if sensor.drop_out > 0.0:
            draws = generator(self._seed, sensor.id, _DROP_OUT_STREAM, number)
            ranges[draws.random(len(ranges)) < sensor.drop_out] = np.nan
        single = ranges.astype(np.float32).astype(np.float64)
        return DepthImage(round(time, 9), single.reshape(sensor.rows, sensor.columns))

    def true_ranges(self, time: float) -> FloatArray:
        """Return exact ranges of all pixels at a time [s], row by row, (rows * columns,) [m]."""
        ranges = self._still.copy()
        self._world.shorten(self._origin, self._rays, time, ranges)
        if self._robots and time > 0.0:
            cast_spheres(self._origin, self._rays, spheres_at(self._robots, time, np.inf), ranges)
        return ranges
