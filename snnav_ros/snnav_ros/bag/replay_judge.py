"""How near recorded people and walls came to a simulated robot: by the raw returns, apart from fusion and planner."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_opening

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.types import FloatArray
from snnav_ros.bag.recorded_scans import RecordedScan, Recording
from snnav_ros.bag.sensors_file import TopicSensor

__all__ = ["Encounter", "Outrun", "Returns", "Verdict", "count_outrun", "judge", "measured_returns"]

_NEARER_THAN_BACKGROUND = 0.3  # [m]: so much nearer than usual, a return is a person,
_LEAST_BEAMS = 3  # where so many neighbouring beams are: single ones flicker at edges and chair legs
_CODE_TOLERANCE = 0.0005 + 1e-6  # [m]
_OUTRUN = 0.05  # [m]: a return this much farther inside than the speed bound allows is no noise


@dataclass(frozen=True)
class Returns:
    """What one scan measured, with no regard to whether the fusion took it.

    Parameters
    ----------
    sensor_id : str
    stamp : float
        Of the scan [s from the start of the recording].
    points : ndarray, shape (K, 2)
        Measured surfaces [m, map].
    times : ndarray, shape (K,)
        When each was measured [s].
    is_person : ndarray of bool, shape (K,)
        Whether it lies well before what the same beam mostly sees.
    """

    sensor_id: str
    stamp: float
    points: FloatArray
    times: FloatArray
    is_person: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Encounter:
    """A return near a robot: distance from its disk [m], negative inside; time [s], place [m, map], sensor."""

    distance: float
    time: float
    x: float
    y: float
    sensor_id: str
    moving: bool


@dataclass(frozen=True)
class Verdict:
    """How a robot fared.

    Parameters
    ----------
    nearest, nearest_moving, nearest_person : Encounter or None
        Of all returns, each at the time when it was measured; while the robot moved; of people.
    met_moving, met_standing : int
        Returns inside the disk while it moved and while it stood. People do not see a simulated robot.
    times : ndarray, shape (N,)
        Control periods [s].
    distances, person_distances : ndarray, shape (N,)
        Least distance from the disk on its way through each control period to the returns of every sensor's latest
        scan, and to people among them [m]; inf where there is none.
    """

    nearest: Encounter | None
    nearest_moving: Encounter | None
    nearest_person: Encounter | None
    met_moving: int
    met_standing: int
    times: FloatArray
    distances: FloatArray
    person_distances: FloatArray


@dataclass(frozen=True, slots=True)
class Outrun:
    """Returns where nothing could have been, had nothing been faster than assumed: count, share, deepest [m]."""

    count: int
    share: float
    deepest: float


def measured_returns(recording: Recording, sensors: Sequence[TopicSensor]) -> list[Returns]:
    """Return what every scan measured, in the order of stamps."""
    found: list[Returns] = []
    for entry in sensors:
        scans = [scan for scan in recording.scans if scan.sensor_id == entry.sensor.id]
        usual = _usual_ranges(scans, entry)
        found += [_returns(scan, entry, usual[_shape(scan)]) for scan in scans]
    return sorted(found, key=lambda one: (one.stamp, one.sensor_id))


def judge(returns: Sequence[Returns], rows: FloatArray, radius: float) -> Verdict:
    """Measure the distance from the disk of a robot to every return.

    Parameters
    ----------
    returns : sequence of Returns
        By stamp.
    rows : ndarray, shape (N, 6)
        Trajectory of the robot, see `RunRecord.trajectory`.
    radius : float
        Of its disk [m].
    """
    nearest: dict[str, Encounter] = {}
    met = {True: 0, False: 0}
    for scan in returns:
        inside = (scan.times >= rows[0, 0]) & (scan.times <= rows[-1, 0])
        if not inside.any():
            continue
        distance, moving = _at_their_times(scan, rows, radius)
        for is_moving in (True, False):
            met[is_moving] += int(np.sum((distance < 0.0) & inside & (moving == is_moving)))
        for name, counted in (
            ("any", inside),
            ("moving", inside & moving),
            ("person", inside & scan.is_person),
        ):
            if counted.any():
                index = int(np.argmin(np.where(counted, distance, np.inf)))
                if name not in nearest or distance[index] < nearest[name].distance:
                    nearest[name] = _encounter(scan, index, float(distance[index]), bool(moving[index]))
    any_return, people = _between_scans(returns, rows, radius)
    return Verdict(
        nearest=nearest.get("any"),
        nearest_moving=nearest.get("moving"),
        nearest_person=nearest.get("person"),
        met_moving=met[True],
        met_standing=met[False],
        times=rows[:, 0],
        distances=any_return,
        person_distances=people,
    )


def count_outrun(
    returns: Sequence[Returns], areas: Sequence[UnoccupiedArea], boundary_speed: float
) -> Outrun:
    """Count returns that lie deeper inside an area known to be free before than the speed bound allows.

    Walkers faster than assumed show up here, and so do surfaces that a scanner did not see before, such as dark
    clothes where it says that nothing came back.
    """
    stamps = np.array([area.stamp for area in areas])
    depths: list[FloatArray] = []
    total = 0
    for scan in returns:
        index = int(np.searchsorted(stamps, scan.stamp, side="right")) - 1
        if index < 0 or areas[index].is_empty or len(scan.points) == 0:
            continue
        depth = areas[index].clearance(scan.points) - boundary_speed * (scan.times - stamps[index])
        depths.append(depth[depth > _OUTRUN])
        total += len(depth)
    found = np.concatenate(depths) if depths else np.zeros(0)
    return Outrun(len(found), len(found) / max(total, 1), float(found.max(initial=0.0)))


def _shape(scan: RecordedScan) -> tuple[int, float, float]:
    return scan.scan.ranges.size, scan.scan.angle_min, scan.scan.angle_increment


def _is_measured(scan: RecordedScan, entry: TopicSensor) -> NDArray[np.bool_]:
    ranges = scan.scan.ranges
    measured = (ranges >= scan.scan.range_min) & (ranges <= scan.scan.range_max) & (ranges > 0.0)
    for code in entry.sensor.settings.error_codes:
        measured &= ~(np.abs(ranges - code) <= _CODE_TOLERANCE)
    return measured


def _usual_ranges(
    scans: Sequence[RecordedScan], entry: TopicSensor
) -> Mapping[tuple[int, float, float], FloatArray]:
    """Return what every beam mostly measures [m], inf where mostly nothing, for every layout of beams."""
    layouts: dict[tuple[int, float, float], list[FloatArray]] = {}
    for scan in scans:
        ranges = np.where(_is_measured(scan, entry), scan.scan.ranges, np.inf)
        layouts.setdefault(_shape(scan), []).append(ranges)
    return {shape: np.median(np.stack(ranges), axis=0) for shape, ranges in layouts.items()}


def _returns(scan: RecordedScan, entry: TopicSensor, usual: FloatArray) -> Returns:
    measured = _is_measured(scan, entry)
    beams = np.flatnonzero(measured)
    pose, ranges = entry.sensor.pose, scan.scan.ranges[beams]
    angles = pose.heading + scan.scan.angles[beams]
    points = pose.position + ranges[:, None] * np.column_stack((np.cos(angles), np.sin(angles)))
    is_person = _runs(measured & (scan.scan.ranges < usual - _NEARER_THAN_BACKGROUND))
    return Returns(scan.sensor_id, scan.scan.stamp, points, scan.beam_times[beams], is_person[beams])


def _runs(nearer: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Keep runs of at least so many neighbouring beams."""
    return np.asarray(binary_opening(nearer, np.ones(_LEAST_BEAMS)), dtype=np.bool_)


def _at_their_times(scan: Returns, rows: FloatArray, radius: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the distance of every return from the disk when it was measured, and whether the robot moved then."""
    there = np.stack([np.interp(scan.times, rows[:, 0], rows[:, axis]) for axis in (1, 2)], axis=-1)
    index = np.clip(np.searchsorted(rows[:, 0], scan.times, side="right") - 1, 0, len(rows) - 1)
    distance = np.hypot(*(scan.points - there).T) - radius
    return distance, rows[index, 4] > 0.0


def _encounter(scan: Returns, index: int, distance: float, moving: bool) -> Encounter:
    x, y = scan.points[index].tolist()
    return Encounter(distance, float(scan.times[index]), x, y, scan.sensor_id, moving)


def _between_scans(
    returns: Sequence[Returns], rows: FloatArray, radius: float
) -> tuple[FloatArray, FloatArray]:
    """Return the least distance of the disk to the latest returns of all sensors in every control period."""
    ends = np.vstack((rows[1:, 1:3], rows[-1:, 1:3]))
    latest: dict[str, Returns] = {}
    following = 0
    distances, people = np.full(len(rows), math.inf), np.full(len(rows), math.inf)
    for index, row in enumerate(rows):
        while following < len(returns) and returns[following].stamp <= row[0]:
            latest[returns[following].sensor_id] = returns[following]
            following += 1
        for scan in latest.values():
            away = _from_segment(scan.points, row[1:3], ends[index]) - radius
            distances[index] = min(distances[index], float(away.min(initial=math.inf)))
            people[index] = min(people[index], float(away[scan.is_person].min(initial=math.inf)))
    return distances, people


def _from_segment(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Return the distance of points (K, 2) from a straight piece of way [m], shape (K,)."""
    way = end - start
    share = np.clip((points - start) @ way / max(float(way @ way), 1e-18), 0.0, 1.0)
    distance: FloatArray = np.hypot(*(points - start - share[:, None] * way).T)
    return distance
