"""What arrives from a sensor and when: it measures at instants of its own, and faults meet what it measured."""

from __future__ import annotations

import heapq
import math
from typing import Generic, Protocol, TypeVar

from snnav_sim.devices.faults import Delivery, FaultStages, Measurement
from snnav_sim.scene_types import SensorScene
from snnav_sim.space_types import DepthSensor

__all__ = ["MOST_ARRIVALS", "SensorFeed"]

MOST_ARRIVALS = 9
"""At one time no more than the newest nine scans arrive: with the word that ends a tick of lockstep they fill the queue
of a listener."""

_MOST_MEASURED = 100  # a device that nobody heard for longer makes no older scans
_SAME_TIME = 5e-10  # [s]


_Measured = TypeVar("_Measured", covariant=True)


class Measuring(Protocol[_Measured]):
    """A device that measures whenever it is asked."""

    @property
    def sensor(self) -> SensorScene | DepthSensor:
        """What the scene says of it."""
        ...

    def scan(self, time: float) -> _Measured:
        """Return what it measures at a time [s]."""
        ...


class SensorFeed(Generic[Measurement]):
    """The scans of one sensor in the order in which they arrive.

    Parameters
    ----------
    device : RangeFinder or DepthDevice
        Measures scan number k at `scan_offset` + k times `period`.
    period : float
        Time from scan to scan [s], see `Scene.scan_period`.
    seed : int
        Of the faults.
    """

    def __init__(self, device: Measuring[Measurement], period: float, seed: int) -> None:
        self.device: Measuring[Measurement] = device
        sensor = device.sensor
        self._offset, self._period = sensor.scan_offset, period
        self._stages = FaultStages(sensor.faults, seed, sensor.id)
        self.reset()

    def reset(self) -> None:
        """Begin again, as after a jump of time."""
        self._stages.reset()
        self._next = 0
        self._sequence = 0
        self._under_way: list[tuple[float, int, Measurement]] = []

    def arrivals(self, time: float) -> list[Measurement]:
        """Return what arrives after the last call and up to `time` [s], at most the newest `MOST_ARRIVALS`.

        Scans keep the stamps that the device gave them; they may be older than the call before, and out of order.
        """
        newest = math.floor((time - self._offset + 2.0 * _SAME_TIME) / self._period)
        for number in range(max(self._next, newest - _MOST_MEASURED + 1), newest + 1):
            instant = round(self._offset + number * self._period, 9)
            for entry in self._stages.pass_on(Delivery(number, instant, instant, self.device.scan(instant))):
                heapq.heappush(self._under_way, (entry.arrival, self._sequence, entry.scan))
                self._sequence += 1
        self._next = max(self._next, newest + 1)
        arrived = []
        while self._under_way and self._under_way[0][0] <= time + _SAME_TIME:
            arrived.append(heapq.heappop(self._under_way)[2])
        return arrived[-MOST_ARRIVALS:]
