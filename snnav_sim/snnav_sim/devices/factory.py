"""From the entry of a scene to the device."""

from __future__ import annotations

from typing import Protocol

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
        """Return the scan of a sampling instant [s]."""
        ...


def make_device(sensor: SensorScene, world: World, seed: int) -> RangeFinder:
    """Return the device that a scene asks for.

    Parameters
    ----------
    sensor : SensorScene
    world : World
        What it measures.
    seed : int
        Of its noise and drop-outs.
    """
    return Recorded(sensor) if sensor.device == "recorded" else Lms200(sensor, world, seed)
