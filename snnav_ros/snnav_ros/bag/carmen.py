"""Parse CARMEN logs: the FLASER and ROBOTLASER1 lines, gzip or plain text.

The bearing of beam i is ``start + i * step`` in the laser's frame, x ahead, counter-clockwise. FLASER lines
do not say it: start = -90 deg, step 1 deg for 180 or 181 beams and 0.5 deg for 360 or 361; ROBOTLASER1 do.
"""

from __future__ import annotations

import gzip
import math
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from snnav_core.types import FloatArray, Pose2D
from snnav_ros.bag.errors import LogError, one_line
from snnav_ros.bag.no_return import NoReturn, find_no_return

__all__ = ["NOMINAL_PERIOD", "CarmenLog", "CarmenScan", "read_carmen"]

NOMINAL_PERIOD = 0.2
"""Time from scan to scan [s] when the log's own stamps cannot be used (the LMS-200 sends about 5 scans/s)."""

_FLASER_STEPS = {180: 1.0, 181: 1.0, 360: 0.5, 361: 0.5}  # beams: degrees
_FLASER_TAIL = 9  # x y theta odom_x odom_y odom_theta ipc_time host logger_time
_ROBOTLASER_TAIL = 14  # laser pose, robot pose, tv rv forward side turn_axis, ipc_time host logger_time
_PROGRESS_EVERY = 200


@dataclass(frozen=True)
class CarmenScan:
    """One scan of a log.

    Parameters
    ----------
    line : int
        Line number in the log.
    stamp : float
        Time [s]; strictly increasing within a log.
    ranges : FloatArray
        Readings [m] as logged, shape (B,); no returns are still the log's own value.
    angle_min, angle_increment : float
        Bearing of the first beam and from beam to beam [rad, laser].
    pose : Pose2D
        Pose of the laser [m, rad, map], as corrected by whoever made the log.
    range_max : float
        The device's own range [m] when the line says it, else inf.
    """

    line: int
    stamp: float
    ranges: FloatArray
    angle_min: float
    angle_increment: float
    pose: Pose2D
    range_max: float


@dataclass(frozen=True)
class CarmenLog:
    """The usable content of a log: scans in order, its no-return value, and one warning a line."""

    path: Path
    kind: str
    scans: tuple[CarmenScan, ...]
    no_return: NoReturn
    bad_lines: int
    warnings: tuple[str, ...]


class _BadLine(ValueError):
    """A line that does not hold what its first word promises."""


def read_carmen(path: str | Path, progress: Callable[[int], None] | None = None) -> CarmenLog:
    """Read a CARMEN log.

    Parameters
    ----------
    path : path-like
        Log file, plain or gzip (told by its content, not by its name).
    progress : callable, optional
        Called now and then with the number of scans read so far.

    Returns
    -------
    CarmenLog
        FLASER scans if there are any, else ROBOTLASER1 scans.

    Raises
    ------
    LogError
        If the file cannot be read or holds no usable scan.
    """
    path = Path(path)
    found: dict[str, list[CarmenScan]] = {kind: [] for kind in _PARSERS}
    bad: list[tuple[int, str]] = []
    warnings: list[str] = []
    for number, line in _lines(path, warnings):
        kind = line.partition(" ")[0].rstrip()
        if kind in _PARSERS:
            try:
                found[kind].append(_PARSERS[kind](number, line.split()))
            except _BadLine as error:
                bad.append((number, f"{kind}: {error}"))
            if progress is not None and number % _PROGRESS_EVERY == 0:
                progress(sum(map(len, found.values())))
    kind = next((kind for kind, scans in found.items() if scans), "")
    if not kind:
        raise LogError(_nothing_usable(path, bad, warnings))
    if bad:
        warnings.append(f"{path}: {len(bad)} bad lines left out, the first is line {bad[0][0]} ({bad[0][1]})")
    scans, clock_warning = _with_clock(path, found[kind])
    warnings.extend(clock_warning)
    no_return = find_no_return(np.concatenate([scan.ranges for scan in scans]))
    return CarmenLog(path, kind, scans, no_return, len(bad), tuple(warnings))


def _nothing_usable(path: Path, bad: list[tuple[int, str]], warnings: list[str]) -> str:
    if bad:
        return f"{path}: no usable scan, all {len(bad)} are bad; the first is line {bad[0][0]} ({bad[0][1]})"
    hint = f" ({warnings[0]})" if warnings else ""
    return f"{path}: no usable scan{hint}; give a CARMEN log with FLASER or ROBOTLASER1 lines"


def _lines(path: Path, warnings: list[str]) -> Iterator[tuple[int, str]]:
    """Yield numbered lines; a file that breaks off is read up to there, with a warning."""
    number = 0
    try:
        with path.open("rb") as raw:
            zipped = raw.read(2) == b"\x1f\x8b"
        with gzip.open(path, "rb") if zipped else path.open("rb") as stream:
            for number, line in enumerate(stream, start=1):
                yield number, line.decode("ascii", errors="replace")
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        warnings.append(f"{path}: the compressed file is damaged after line {number} ({one_line(error)})")
    except OSError as error:
        reason = error.strerror or one_line(error)
        raise LogError(f"{path}: cannot be read ({reason}); give a CARMEN log, plain or gzip") from None


def _numbers(fields: list[str], name: str) -> FloatArray:
    """Parse numbers; each must be finite."""
    try:
        values = np.array(fields, dtype=np.float64)
    except ValueError:
        wrong = next((field for field in fields if not _is_number(field)), "?")
        raise _BadLine(f"{name} has {wrong[:20]!r}, expected a number") from None
    if not np.isfinite(values).all():
        raise _BadLine(
            f"{name} has {fields[int(np.argmin(np.isfinite(values)))]!r}, expected a finite number"
        )
    return values


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def _count(fields: list[str], index: int) -> int:
    if len(fields) <= index or not fields[index].isdigit():
        raise _BadLine("has no count of readings")
    return int(fields[index])


def _ranges(fields: list[str]) -> FloatArray:
    ranges = _numbers(fields, "range")
    if (ranges < 0.0).any():
        raise _BadLine(f"range is {ranges.min():g} m, must not be negative")
    return ranges


def _flaser(number: int, fields: list[str]) -> CarmenScan:
    count = _count(fields, 1)
    if len(fields) != 2 + count + _FLASER_TAIL:
        raise _BadLine(f"{len(fields)} fields, expected {2 + count + _FLASER_TAIL} for {count} readings")
    if count not in _FLASER_STEPS:
        raise _BadLine(f"{count} readings, expected one of {', '.join(map(str, _FLASER_STEPS))}")
    tail = fields[2 + count :]
    x, y, theta = _numbers(tail[:3], "pose")
    (stamp,) = _numbers(tail[6:7], "time stamp")
    step = math.radians(_FLASER_STEPS[count])
    pose = Pose2D(float(x), float(y), float(theta))
    return CarmenScan(
        number, float(stamp), _ranges(fields[2 : 2 + count]), -0.5 * math.pi, step, pose, math.inf
    )


def _robotlaser(number: int, fields: list[str]) -> CarmenScan:
    count = _count(fields, 8)
    remissions = _count(fields, 9 + count)
    expected = 10 + count + remissions + _ROBOTLASER_TAIL
    if len(fields) != expected:
        raise _BadLine(
            f"{len(fields)} fields, expected {expected} for {count} readings, {remissions} remissions"
        )
    if count < 2:
        raise _BadLine(f"{count} readings, at least 2 are needed")
    start, view, step, reach = _numbers(fields[2:6], "laser configuration")
    if step <= 0.0 or reach <= 0.0 or not view - 1.5 * step <= (count - 1) * step <= view + 1.5 * step:
        raise _BadLine(f"{count} readings of step {step:g} rad do not fit the field of view {view:g} rad")
    tail = fields[10 + count + remissions :]
    x, y, theta = _numbers(tail[:3], "laser pose")
    (stamp,) = _numbers(tail[11:12], "time stamp")
    pose = Pose2D(float(x), float(y), float(theta))
    return CarmenScan(
        number, float(stamp), _ranges(fields[9 : 9 + count]), float(start), float(step), pose, float(reach)
    )


_PARSERS: dict[str, Callable[[int, list[str]], CarmenScan]] = {"FLASER": _flaser, "ROBOTLASER1": _robotlaser}


def _with_clock(path: Path, scans: list[CarmenScan]) -> tuple[tuple[CarmenScan, ...], list[str]]:
    """Keep the log's stamps if they increase from scan to scan, else count scans at a nominal rate."""
    stamps = np.array([scan.stamp for scan in scans])
    steps = np.diff(stamps)
    wrong = int((steps < 1e-9).sum())
    if not wrong and stamps[0] >= 0.0:
        return tuple(scans), []
    what = f"{wrong} of {len(steps)} time stamps do not increase" if wrong else "time stamps are negative"
    counted = tuple(replace(scan, stamp=(k + 1) * NOMINAL_PERIOD) for k, scan in enumerate(scans))
    return counted, [f"{path}: {what}; scans are counted at {NOMINAL_PERIOD:g} s instead"]
