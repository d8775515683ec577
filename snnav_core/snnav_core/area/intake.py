"""Which scans and images are taken for measurements at all: inputs lie, a wrong stamp above all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from snnav_core.area.settings import PlanarSensor
from snnav_core.errors import InvalidInput
from snnav_core.sensing.depth import DepthCamera, DepthImage
from snnav_core.sensing.scan import PlanarScan
from snnav_core.types import TIME_TOLERANCE, FloatArray

__all__ = ["Intake", "check_clock", "image_intake", "same_ranges", "scan_intake"]

_TELLING_RETURNS = 100  # measured distances that noise never repeats all at once


class Measurement(Protocol):
    """A scan of a planar range finder, or an image of a depth camera."""

    @property
    def stamp(self) -> float:
        """When it was measured [s]."""
        ...

    @property
    def ranges(self) -> FloatArray:
        """What was measured [m]."""
        ...


_Measured = TypeVar("_Measured", bound=Measurement)


@dataclass(frozen=True)
class Intake(Generic[_Measured]):
    """What has to be known of a sensor to tell a new measurement of it from one that lies.

    Parameters
    ----------
    what : str
        Name of a measurement of it, for messages: ``scan of lms_1``.
    range_max : callable
        Up to where the ranges of a measurement are some [m].
    same : callable
        Whether two measurements show exactly the same.
    never_repeats : bool
        Whether it has noise: two equal measurements come from a device that froze.
    """

    what: str
    range_max: Callable[[_Measured], float]
    same: Callable[[_Measured, _Measured], bool]
    never_repeats: bool

    def is_repeated(
        self, new: _Measured, before: _Measured | None, now: float | None, clock_tolerance: float
    ) -> bool:
        """Return whether a measurement only repeats the last one of its sensor, ranges and stamp.

        Parameters
        ----------
        new : PlanarScan or DepthImage
            As it came.
        before : PlanarScan or DepthImage or None
            What was taken last from this sensor.
        now : float or None
            Time at its arrival [s]; None where there is no clock to compare with.
        clock_tolerance : float
            How far ahead of `now` its stamp may be [s].

        Raises
        ------
        InvalidInput
            If the stamp is ahead of the clock or older than the last one, if a measurement of the same stamp has other
            ranges, or if a device that never repeats itself does.
        """
        check_clock(self.what, new.stamp, now, clock_tolerance)
        if before is None:
            return False
        stamped = f"{self.what} stamped {new.stamp:.3f} s"
        if new.stamp < before.stamp - TIME_TOLERANCE:
            raise InvalidInput(f"{stamped} is older than its last ({before.stamp:.3f} s): ignored")
        if new.stamp <= before.stamp + TIME_TOLERANCE:
            if not self.same(before, new):
                raise InvalidInput(
                    f"{stamped} differs from its last, which has the same stamp: "
                    "ignored; each measurement needs its own stamp"
                )
            return True
        if self.never_repeats and (repeated := self._repeated_returns(before, new)) >= _TELLING_RETURNS:
            raise InvalidInput(
                f"{stamped} is frozen: all ranges are those of {before.stamp:.3f} s, {repeated} returns; "
                "restart the device, or set never_repeats to false for one without noise"
            )
        return False

    def _repeated_returns(self, first: _Measured, second: _Measured) -> int:
        """Number of beams that returned in both, if all of them measured the same; else 0.

        Beams that one of the two lost tell nothing: a frozen device may lose beams on the way all the same.
        """
        if first.ranges.shape != second.ranges.shape:
            return 0
        both = np.ones(first.ranges.shape, dtype=np.bool_)
        for one in (first, second):
            both &= (one.ranges > 0.0) & (one.ranges <= self.range_max(one))
        return int(both.sum()) if np.array_equal(first.ranges[both], second.ranges[both]) else 0


def scan_intake(sensor: PlanarSensor) -> Intake[PlanarScan]:
    """Return the intake of a planar range finder."""
    return Intake(
        f"scan of {sensor.id}", lambda scan: scan.range_max, same_ranges, sensor.settings.never_repeats
    )


def image_intake(camera: DepthCamera, never_repeats: bool) -> Intake[DepthImage]:
    """Return the intake of a depth camera."""
    return Intake(
        f"image of {camera.id}",
        lambda _: camera.model.range_max,
        lambda first, second: np.array_equal(first.ranges, second.ranges, equal_nan=True),
        never_repeats,
    )


def check_clock(what: str, stamp: float, now: float | None, tolerance: float) -> None:
    """Make sure that a stamp [s] is not ahead of the clock `now` [s], if there is one, by more than a tolerance [s].

    Raises
    ------
    InvalidInput
        With what bears the stamp: in the future it would pass for new.
    """
    if now is not None and not stamp <= now + tolerance + TIME_TOLERANCE:
        raise InvalidInput(
            f"{what} stamped {stamp:.3f} s is {stamp - now:.3f} s ahead of the clock ({now:.3f} s): ignored; "
            "synchronise the clocks or raise clock_tolerance"
        )


def same_ranges(first: PlanarScan, second: PlanarScan) -> bool:
    """Return whether two scans measured exactly the same."""
    return (
        first.angle_min == second.angle_min
        and first.angle_increment == second.angle_increment
        and first.range_min == second.range_min
        and first.range_max == second.range_max
        and np.array_equal(first.ranges, second.ranges, equal_nan=True)
    )
