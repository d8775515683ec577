"""A fixed node whose every scan is one recorded scan of a real range finder."""

from __future__ import annotations

import numpy as np

from snnav_core.sensing.scan import PlanarScan
from snnav_sim.devices.single import down, up
from snnav_sim.scene_types import SensorScene

__all__ = ["Recorded"]


class Recorded:
    """Replays the ranges of its scene entry.

    Parameters
    ----------
    sensor : SensorScene
        With `ranges`.
    """

    def __init__(self, sensor: SensorScene) -> None:
        self.sensor = sensor
        self._ranges = down(np.array(sensor.ranges))

    def scan(self, time: float) -> PlanarScan:
        """Return the recorded scan, stamped `time` [s]."""
        sensor = self.sensor
        return PlanarScan(
            stamp=time,
            ranges=self._ranges,
            angle_min=float(np.float32(sensor.angle_min)),
            angle_increment=float(np.float32(sensor.resolution)),
            range_min=float(up(sensor.range_min)),
            range_max=float(down(sensor.range_max)),
        )
