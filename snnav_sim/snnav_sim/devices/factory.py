"""From the entry of a scene to the device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from snnav_core.area.robots import RobotTrack
from snnav_core.sensing.scan import PlanarScan
from snnav_sim.devices.lms200 import Lms200
from snnav_sim.devices.recorded import Recorded
from snnav_sim.scene_types import SensorScene
from snnav_sim.world import World

__all__ = ["RangeFinder", "make_device"]


class RangeFinder(Protocol):
    """What every planar range finder of a scene can do."""

    sensor: SensorScene

    def scan(self, time: float) -> PlanarScan:
        """Return the scan measured at a time [s]."""
        ...


def make_device(
    sensor: SensorScene, world: World, seed: int, robots: Sequence[RobotTrack] = ()
) -> RangeFinder:
    """Return the device that a scene asks for.

    Parameters
    ----------
    sensor : SensorScene
    world : World
        What it measures.
    seed : int
        Of its noise and drop-outs.
    robots : sequence of RobotTrack
        Where robots are; a device that `sees_robots` measures them.
    """
    return Recorded(sensor) if sensor.device == "recorded" else Lms200(sensor, world, seed, robots)
