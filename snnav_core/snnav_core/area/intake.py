"""Which scans are taken for measurements at all: inputs lie, a wrong stamp above all."""

from __future__ import annotations

import numpy as np

from snnav_core.area.settings import PlanarSensor
from snnav_core.errors import InvalidInput
from snnav_core.sensing.scan import DetectedArea, PlanarScan

__all__ = ["TIME_TOLERANCE", "check_clock", "is_repeated", "same_ranges"]

TIME_TOLERANCE = 1e-6
"""Times no farther apart are the same time [s]."""

_TELLING_RETURNS = 100  # measured distances that noise never repeats all at once


def is_repeated(
    sensor: PlanarSensor,
    scan: PlanarScan,
    last: tuple[PlanarScan, DetectedArea] | None,
    now: float | None,
    clock_tolerance: float,
) -> bool:
    """Return whether a scan only repeats the last one of its sensor, ranges and stamp.

    Parameters
    ----------
    sensor : PlanarSensor
    scan : PlanarScan
        As it came.
    last : (PlanarScan, DetectedArea) or None
        What was taken last from this sensor.
    now : float or None
        Time at its arrival [s]; None where there is no clock to compare with.
    clock_tolerance : float
        How far ahead of `now` its stamp may be [s].

    Raises
    ------
    InvalidInput
        If the stamp is ahead of the clock or older than the last one, if a scan of the same stamp has other ranges, or
        if a device that never repeats itself does.
    """
    check_clock(f"scan of {sensor.id}", scan.stamp, now, clock_tolerance)
    if last is None:
        return False
    before, detected = last
    if scan.stamp < before.stamp - TIME_TOLERANCE:
        raise InvalidInput(
            f"scan of {sensor.id} stamped {scan.stamp:.3f} s is older than its last ({before.stamp:.3f} s): ignored"
        )
    same = same_ranges(before, scan)
    if scan.stamp <= before.stamp + TIME_TOLERANCE:
        if not same:
            raise InvalidInput(
                f"scan of {sensor.id} stamped {scan.stamp:.3f} s differs from its last, which has the same stamp: "
                "ignored; each measurement needs its own stamp"
            )
        return True
    measured = detected.counts.returned + detected.counts.cut
    if same and sensor.settings.never_repeats and measured >= _TELLING_RETURNS:
        raise InvalidInput(
            f"scan of {sensor.id} stamped {scan.stamp:.3f} s is frozen: all ranges are those of {before.stamp:.3f} s, "
            f"{measured} returns; restart the device, or set never_repeats to false for one without noise"
        )
    return False


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
