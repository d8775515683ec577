"""From one planar range measurement to the area that it shows to be free (Ch. 3, "detected area")."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from snnav_core.errors import InvalidInput, ScanError
from snnav_core.sensing.star import BeamFan, star_rings
from snnav_core.sensing.thinning import thin_ring
from snnav_core.types import FloatArray, Pose2D

__all__ = [
    "LMS200_ERROR_CODES",
    "BeamCounts",
    "DetectedArea",
    "PlanarScan",
    "ScanSettings",
    "detect_planar",
]

LMS200_ERROR_CODES = (16.375, 16.379, 16.381, 16.383)
"""Values that the raw LMS-200 reports in place of a distance (dazzling, fault, overflow) [m]."""

_ERROR_CODE_TOLERANCE = 0.0005 + 1e-6  # [m]; float32 ranges included
_LEAST_FREE_LENGTH = 1e-3  # [m]; a shorter free length is worth nothing and makes needle polygons
_LEAST_INCREMENT = 1e-6  # [rad]
_TURN = 2.0 * math.pi


@dataclass(frozen=True)
class PlanarScan:
    """One measurement of a planar range finder.

    Parameters
    ----------
    stamp : float
        Time of the measurement [s].
    ranges : array_like, shape (B,)
        Measured distances [m], B >= 2; NaN, zero and infinity are allowed and mean what REP-117 says.
    angle_min : float
        Direction of the first beam [rad, sensor], counter-clockwise from the x axis.
    angle_increment : float
        Step from one beam to the next [rad]; negative for a device that turns clockwise or hangs upside down.
    range_min, range_max : float
        Limits of a valid distance [m].

    Raises
    ------
    ScanError
        If the scan is not usable: wrong shape, angles that are not finite, no increment, a field of more than
        one turn and one increment, limits that are not finite or not in order.
    """

    stamp: float
    ranges: FloatArray
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float

    def __post_init__(self) -> None:
        ranges = np.array(self.ranges, dtype=np.float64)
        if ranges.ndim != 1 or ranges.size < 2:
            raise ScanError(f"ranges have shape {ranges.shape}, expected (B,) with at least 2 beams")
        for name in ("stamp", "angle_min", "angle_increment", "range_min", "range_max"):
            if not math.isfinite(getattr(self, name)):
                raise ScanError(f"{name} is {getattr(self, name)}, must be finite; check the sensor driver")
        increment = abs(self.angle_increment)
        if not _LEAST_INCREMENT <= increment <= math.pi / 2:
            raise ScanError(
                f"angle_increment is {self.angle_increment} rad, its size must lie in "
                f"[{_LEAST_INCREMENT}, pi/2]; give radians, not degrees"
            )
        field = (ranges.size - 1) * increment
        if field > _TURN + 1.001 * increment:
            raise ScanError(
                f"{ranges.size} beams at angle_increment {self.angle_increment} rad cover {field:.4f} rad, "
                "more than one turn; correct angle_increment or the number of beams"
            )
        if not 0.0 <= self.range_min < self.range_max:
            raise ScanError(
                f"range_min {self.range_min} m and range_max {self.range_max} m must satisfy "
                "0 <= range_min < range_max"
            )
        ranges.setflags(write=False)
        object.__setattr__(self, "ranges", ranges)

    @property
    def angles(self) -> FloatArray:
        """Direction of every beam [rad, sensor], shape (B,)."""
        return self.angle_min + self.angle_increment * np.arange(self.ranges.size, dtype=np.float64)


@dataclass(frozen=True)
class ScanSettings:
    """How the ranges of one sensor are to be read.

    Parameters
    ----------
    inf_is_free : bool
        Whether +Inf means "free up to range_max" (REP-117 leaves it to the device). The safe default is no.
    error_codes : tuple of float
        Distances [m] that the device reports for errors, matched within 0.5 mm; see `LMS200_ERROR_CODES`.
    range_accuracy : float
        Taken off every range before it counts as free [m]; the returns themselves stay where they are.
    jump_ratio, jump_distance : float
        Two neighbouring beams belong to one surface while their lengths differ by at most
        ``jump_ratio * shorter * |angle_increment| + jump_distance`` [-], [m].
    range_cut : float or None
        A reading beyond it counts as free up to it only [m]; the surface it measured is an obstacle all the same.
    expected_beams : int or None
        Number of beams that every scan must have.
    never_repeats : bool
        Whether the device has noise, so that two of its scans are never the same: a later scan with exactly the ranges
        of the last one then comes from a device that froze, and is refused. A device without noise needs `false`.
    sees_robots : bool
        Whether its beams meet robots (it stands on the floor): returns on known robots are no obstacles.

    Raises
    ------
    InvalidInput
        If a value is out of its range.
    """

    inf_is_free: bool = False
    error_codes: tuple[float, ...] = ()
    range_accuracy: float = 0.0
    jump_ratio: float = 5.0
    jump_distance: float = 0.03
    range_cut: float | None = None
    expected_beams: int | None = None
    never_repeats: bool = False
    sees_robots: bool = False

    def __post_init__(self) -> None:
        for name in ("range_accuracy", "jump_ratio", "jump_distance"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidInput(f"{name} is {value}, must be a number >= 0")
        if self.range_cut is not None and not (math.isfinite(self.range_cut) and self.range_cut > 0.0):
            raise InvalidInput(f"range_cut is {self.range_cut} m, must be a positive number or left out")
        if self.expected_beams is not None and self.expected_beams < 2:
            raise InvalidInput(f"expected_beams is {self.expected_beams}, must be at least 2 or left out")
        codes = tuple(float(code) for code in self.error_codes)
        if not all(math.isfinite(code) for code in codes):
            raise InvalidInput(f"error_codes are {codes}, must be finite distances")
        object.__setattr__(self, "error_codes", codes)


@dataclass(frozen=True, slots=True)
class BeamCounts:
    """How many beams of a scan fell into each class; all but the first three saw nothing."""

    returned: int  # a distance to a surface
    cut: int  # a distance beyond range_cut: free up to the cut
    infinite_free: int  # +Inf, free up to range_max
    infinite_unknown: int  # +Inf, not taken for free
    not_a_number: int
    not_positive: int  # zero or a negative distance
    too_close: int  # -Inf or below range_min
    beyond_max: int  # a distance above range_max
    error_code: int


_RETURNED, _CUT, _INF_FREE, _INF_UNKNOWN, _NAN, _NOT_POSITIVE, _TOO_CLOSE, _BEYOND_MAX, _ERROR_CODE = range(9)


@dataclass(frozen=True)
class DetectedArea:
    """What one sensor saw at one time (Ch. 3, definition of the detected area).

    Parameters
    ----------
    sensor_id : str
    stamp : float
        Time of the measurement [s].
    pose : Pose2D
        Pose of the sensor [map].
    returns : ndarray, shape (K, 2)
        Positions of the measured surfaces [m, map].
    return_beam : ndarray of int, shape (K,)
        The beam of each return.
    counts : BeamCounts
        Number of beams per class.
    fan : BeamFan
        The free lengths that the rings enclose.
    simplification : float
        The outlines may lose points, and the area this much, see `thin_ring` [m].
    """

    sensor_id: str
    stamp: float
    pose: Pose2D
    returns: FloatArray
    return_beam: NDArray[np.int64]
    counts: BeamCounts
    fan: BeamFan
    simplification: float = 0.0

    @cached_property
    def rings(self) -> tuple[FloatArray, ...]:
        """Open counter-clockwise outlines of what is free, each (N, 2) [m, map].

        One for every run of neighbouring beams that see, starting at the sensor; one without the sensor when a full
        circle sees.
        """
        return tuple(thin_ring(ring, self.simplification) for ring in star_rings(self.fan, self.pose))

    @cached_property
    def polygon(self) -> shapely.Polygon | shapely.MultiPolygon:
        """The rings as a valid geometry [m, map]; several rings meet at the sensor only."""
        if len(self.rings) == 1:
            return shapely.Polygon(self.rings[0])
        if not self.rings:
            return shapely.Polygon()
        return shapely.MultiPolygon([shapely.Polygon(ring) for ring in self.rings])


def detect_planar(
    sensor_id: str, scan: PlanarScan, pose: Pose2D, settings: ScanSettings | None = None
) -> DetectedArea:
    """Turn a scan into the area that it shows to be free.

    Parameters
    ----------
    sensor_id : str
    scan : PlanarScan
    pose : Pose2D
        Pose of the sensor [map] at the stamp of the scan.
    settings : ScanSettings, optional

    Returns
    -------
    DetectedArea

    Raises
    ------
    ScanError
        If the scan has another number of beams than expected.
    InvalidInput
        If the pose is not finite.

    Notes
    -----
    REP-117: NaN, 0, negative values, values outside [range_min, range_max], -Inf and error codes show nothing;
    +Inf is free up to range_max only where the settings say so.
    """
    settings = settings or ScanSettings()
    if settings.expected_beams is not None and scan.ranges.size != settings.expected_beams:
        raise ScanError(
            f"sensor {sensor_id!r}: scan has {scan.ranges.size} beams, expected {settings.expected_beams}; "
            "correct expected_beams or the sensor's resolution"
        )
    if not (math.isfinite(pose.x) and math.isfinite(pose.y) and math.isfinite(pose.heading)):
        raise InvalidInput(f"sensor {sensor_id!r}: pose is {pose}, must be finite")
    classes = _classify(scan, settings)
    free = _free_lengths(scan, classes, settings)
    surface = np.where(classes <= _CUT, scan.ranges, np.where(classes == _INF_FREE, np.inf, 0.0))
    limits = settings.jump_ratio, settings.jump_distance
    fan = BeamFan(
        free, scan.angle_min, scan.angle_increment, *limits, surface=surface, accuracy=settings.range_accuracy
    )
    beam = np.flatnonzero(classes <= _CUT)
    angles = pose.heading + scan.angles[beam]
    returns = pose.position + scan.ranges[beam, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    counts = BeamCounts(*np.bincount(classes, minlength=9).tolist())
    return DetectedArea(sensor_id, scan.stamp, pose, returns, beam, counts, fan)


def _classify(scan: PlanarScan, settings: ScanSettings) -> NDArray[np.uint8]:
    """Return the class of every beam, shape (B,); later lines win."""
    ranges = scan.ranges
    classes = np.full(ranges.shape, _RETURNED, dtype=np.uint8)
    if settings.range_cut is not None:
        classes[ranges > settings.range_cut] = _CUT
    classes[ranges > scan.range_max] = _BEYOND_MAX
    classes[ranges < scan.range_min] = _TOO_CLOSE
    classes[(ranges <= 0.0) & (ranges != -np.inf)] = _NOT_POSITIVE
    classes[ranges == np.inf] = _INF_FREE if settings.inf_is_free else _INF_UNKNOWN
    for code in settings.error_codes:
        classes[np.abs(ranges - code) <= _ERROR_CODE_TOLERANCE] = _ERROR_CODE
    classes[np.isnan(ranges)] = _NAN
    return classes


def _free_lengths(scan: PlanarScan, classes: NDArray[np.uint8], settings: ScanSettings) -> FloatArray:
    """Return the length along every beam that is free [m], shape (B,); 0 where the beam saw nothing."""
    reach = np.where(classes <= _INF_FREE, np.minimum(scan.ranges, scan.range_max), 0.0)
    free = reach - settings.range_accuracy
    if settings.range_cut is not None:
        free = np.minimum(free, settings.range_cut)
    return np.where(free >= _LEAST_FREE_LENGTH, free, 0.0)
