"""Faults of a sensor as stages that a measured scan passes, one after the other, on its way to whoever listens."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np

from snnav_core.sensing.depth import DepthImage
from snnav_core.sensing.scan import PlanarScan
from snnav_sim.devices.noise import generator
from snnav_sim.scene_types import Fault

__all__ = ["Delivery", "FaultStages", "Measurement"]

_FAULT_STREAM = 4  # after the streams of noise and drop-outs
_JUST_AFTER = 1e-6  # [s]

Draws = np.random.Generator
Measurement = TypeVar("Measurement", PlanarScan, DepthImage)
"""A scan of a planar range finder or an image of a depth camera."""


@dataclass(frozen=True)
class Delivery(Generic[Measurement]):
    """A scan on its way.

    Parameters
    ----------
    number : int
        Of the scan, counted from 0.
    measured : float
        When it truly was measured [s].
    arrival : float
        When it will arrive [s].
    scan : PlanarScan or DepthImage
        As it will arrive.
    """

    number: int
    measured: float
    arrival: float
    scan: Measurement


class FaultStages:
    """All faults of one sensor, in the order in which they apply.

    Parameters
    ----------
    faults : sequence of Fault
    seed : int
    sensor_id : str

    Notes
    -----
    Whether a fault meets a scan, and what it does to it, depends on seed, sensor, place in the list and the number of
    the scan only.
    """

    def __init__(self, faults: Sequence[Fault], seed: int, sensor_id: str) -> None:
        self._stages = [_STAGES[fault.kind](fault) for fault in faults]
        self._seed, self._sensor_id = seed, sensor_id

    def reset(self) -> None:
        """Forget what was held back and what was frozen."""
        for stage in self._stages:
            stage.reset()

    def pass_on(self, delivery: Delivery[Measurement]) -> list[Delivery[Measurement]]:
        """Return what becomes of a measured scan, and what it sets free."""
        under_way: list[Any] = [delivery]
        for index, stage in enumerate(self._stages):
            under_way = [out for entry in under_way for out in self._through(index, stage, entry)]
        return under_way

    def _through(self, index: int, stage: _Stage, entry: Delivery[Any]) -> list[Delivery[Any]]:
        fault = stage.fault
        if not fault.begin - 1e-9 <= entry.measured < fault.end - 1e-9:
            return stage.spare(entry)
        draws = generator(self._seed, self._sensor_id, _FAULT_STREAM, index, entry.number)
        return stage.meet(entry, draws) if draws.random() < fault.probability else stage.spare(entry)


_Changer = Callable[[Fault, Any, Draws], Any]


class _Stage(ABC):
    """One fault: what it does to a scan that it meets, and to one that it spares."""

    def __init__(self, fault: Fault) -> None:
        self.fault = fault

    def reset(self) -> None:  # noqa: B027 (most remember nothing)
        """Forget earlier scans."""

    @abstractmethod
    def meet(self, entry: Delivery[Any], draws: Draws) -> list[Delivery[Any]]:
        """Change a scan that the fault meets."""

    def spare(self, entry: Delivery[Any]) -> list[Delivery[Any]]:
        return [entry]


class _DropOut(_Stage):
    def meet(self, entry: Delivery[Any], draws: Draws) -> list[Delivery[Any]]:
        return []


class _Delay(_Stage):
    def meet(self, entry: Delivery[Any], draws: Draws) -> list[Delivery[Any]]:
        late = self.fault.seconds + self.fault.jitter * draws.random()
        return [replace(entry, arrival=entry.arrival + late)]


class _Duplicate(_Stage):
    def meet(self, entry: Delivery[Any], draws: Draws) -> list[Delivery[Any]]:
        return [entry, entry]


class _Reorder(_Stage):
    """Holds a scan back until the next one has passed; what passes while one is held back is not held itself."""

    def __init__(self, fault: Fault) -> None:
        super().__init__(fault)
        self._held: list[Delivery[Any]] = []

    def reset(self) -> None:
        self._held = []

    def meet(self, entry: Delivery[Any], draws: Draws) -> list[Delivery[Any]]:
        if self._held and self._held[0].number != entry.number:
            return self.spare(entry)
        self._held.append(entry)
        return []

    def spare(self, entry: Delivery[Any]) -> list[Delivery[Any]]:
        held, self._held = self._held, []
        free = entry.arrival + _JUST_AFTER
        return [entry, *(replace(one, arrival=max(one.arrival, free)) for one in held)]


class _Change(_Stage):
    """Changes the scan itself."""

    def __init__(self, fault: Fault, change: _Changer) -> None:
        super().__init__(fault)
        self._change = change

    def meet(self, entry: Delivery[Any], draws: Draws) -> list[Delivery[Any]]:
        return [replace(entry, scan=self._change(self.fault, entry.scan, draws))]


class _Frozen(_Stage):
    """Repeats the ranges of the last scan that it spared; of the first one where there is none."""

    def __init__(self, fault: Fault) -> None:
        super().__init__(fault)
        self._last: PlanarScan | DepthImage | None = None

    def reset(self) -> None:
        self._last = None

    def meet(self, entry: Delivery[Any], draws: Draws) -> list[Delivery[Any]]:
        if self._last is None:
            return self.spare(entry)
        return [replace(entry, scan=replace(self._last, stamp=entry.scan.stamp))]

    def spare(self, entry: Delivery[Any]) -> list[Delivery[Any]]:
        self._last = entry.scan
        return [entry]


def _some_read(value: float) -> _Changer:
    def change(fault: Fault, scan: Any, draws: Draws) -> Any:
        ranges = np.array(scan.ranges)
        count = int(np.ceil(fault.share * ranges.size - 1e-9))
        ranges.reshape(-1)[draws.permutation(ranges.size)[:count]] = value
        return replace(scan, ranges=ranges)

    return change


def _other_count(fault: Fault, scan: PlanarScan, _: Draws) -> PlanarScan:
    """Cut beams from the end, or repeat the last one there."""
    if fault.change < 0:
        return replace(scan, ranges=scan.ranges[: max(2, scan.ranges.size + fault.change)])
    return replace(scan, ranges=np.append(scan.ranges, np.full(fault.change, scan.ranges[-1])))


def _other_clock(fault: Fault, scan: Any, _: Draws) -> Any:
    return replace(scan, stamp=round(scan.stamp + fault.seconds, 9))


_STAGES: dict[str, Callable[[Fault], _Stage]] = {
    "drop_out": _DropOut,
    "delay": _Delay,
    "duplicate": _Duplicate,
    "reorder": _Reorder,
    "nan": lambda fault: _Change(fault, _some_read(np.nan)),
    "zero": lambda fault: _Change(fault, _some_read(0.0)),
    "beam_count": lambda fault: _Change(fault, _other_count),
    "frozen": _Frozen,
    "clock_offset": lambda fault: _Change(fault, _other_clock),
}
