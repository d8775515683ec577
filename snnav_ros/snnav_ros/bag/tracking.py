"""Bodies that move in a recording: its scans go through fusion and tracker at their own time."""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from snnav_core.area.fusion import AreaFusion, FusionSettings
from snnav_core.area.tracks import ObstacleTracker, TrackerSettings
from snnav_core.errors import InvalidInput
from snnav_core.obstacles import MovingObstacle
from snnav_core.types import FloatArray
from snnav_ros.bag.errors import BagError
from snnav_ros.bag.recorded_scans import Recording
from snnav_ros.bag.sensors_file import TopicSensor
from snnav_ros.bag.settings import TracksSettings

__all__ = ["BodyTrack", "TrackedRow", "TracksRecord", "track_recording"]

_LONGEST_SILENCE = 0.5  # [s]; an older scan shows nobody any more


@dataclass(frozen=True, slots=True)
class TrackedRow:
    """One body at one time [s]: where it is [m, map], its velocity and its deviation [m/s], how far it reaches [m]."""

    time: float
    id: str
    x: float
    y: float
    vx: float
    vy: float
    deviation: float
    radius: float

    @property
    def speed(self) -> float:
        """Magnitude of the velocity [m/s]."""
        return math.hypot(self.vx, self.vy)


@dataclass(frozen=True)
class BodyTrack:
    """All that is known of one body: rows in the order of time."""

    id: str
    rows: tuple[TrackedRow, ...]

    @property
    def speeds(self) -> FloatArray:
        """Magnitudes of the velocities [m/s], shape (N,)."""
        return np.array([row.speed for row in self.rows])


@dataclass
class TracksRecord:
    """What came of a recording.

    Parameters
    ----------
    times : list of float
        Of the fused measurements [s].
    rows : list of TrackedRow
        Every body that moved, at every measurement.
    outlines : list of tuple
        Time and the bodies that moved then.
    seconds : list of float
        Computing time of every update of the tracker [s].
    refused : dict
        Sensor id -> why scans were refused by the fusion, one line each.
    """

    times: list[float] = field(default_factory=list)
    rows: list[TrackedRow] = field(default_factory=list)
    outlines: list[tuple[float, tuple[MovingObstacle, ...]]] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    refused: dict[str, list[str]] = field(default_factory=dict)

    @property
    def bodies(self) -> list[BodyTrack]:
        """The bodies, those first that were followed longest."""
        rows: dict[str, list[TrackedRow]] = {}
        for row in self.rows:
            rows.setdefault(row.id, []).append(row)
        bodies = [BodyTrack(name, tuple(own)) for name, own in rows.items()]
        return sorted(bodies, key=lambda body: (-len(body.rows), body.rows[0].time))


def track_recording(
    recording: Recording, sensors: Sequence[TopicSensor], settings: TracksSettings
) -> TracksRecord:
    """Follow whoever moves.

    Parameters
    ----------
    recording : Recording
    sensors : sequence of TopicSensor
    settings : TracksSettings

    Raises
    ------
    BagError
        If the recording is shorter than two measurements.
    """
    first = max(
        min(scan.arrival for scan in recording.scans if scan.sensor_id == entry.sensor.id)
        for entry in sensors
    )
    count = math.floor((recording.end - first) / settings.sampling_interval + 1e-9)
    if count < 1:
        raise BagError(
            f"{recording.path}: {recording.end - first:.2f} s with all sensors, shorter than --interval "
            f"{settings.sampling_interval:g}; give a smaller one or more of the recording"
        )
    fusion = AreaFusion([entry.sensor for entry in sensors], FusionSettings(max_scan_age=_LONGEST_SILENCE))
    tracker = ObstacleTracker(
        TrackerSettings(
            window=settings.window,
            top_speed=settings.top_speed,
            range_noise=settings.range_noise,
            free_depth=settings.free_depth,
        )
    )
    record, next_scan = TracksRecord(), 0
    for time in first + settings.sampling_interval * np.arange(count + 1):
        while next_scan < len(recording.scans) and recording.scans[next_scan].arrival <= time + 1e-9:
            entry = recording.scans[next_scan]
            next_scan += 1
            try:
                fusion.add_scan(entry.sensor_id, entry.scan)
            except InvalidInput as error:
                record.refused.setdefault(entry.sensor_id, []).append(str(error))
        _update(record, tracker, fusion, float(time))
    return record


def _update(record: TracksRecord, tracker: ObstacleTracker, fusion: AreaFusion, time: float) -> None:
    returns, area = fusion.returns(time), fusion.area(time)
    before = clock.perf_counter()
    scene = tracker.update(time, returns, area)
    record.seconds.append(clock.perf_counter() - before)
    record.times.append(time)
    moving = tuple(body for body in scene.obstacles if body.speed > 0.0)
    record.outlines.append((time, moving))
    places = {track.id: track.hits_at(time) for track in tracker.tracks}
    for body in moving:
        hits = places[body.id]
        x, y = (0.5 * (hits.min(axis=0) + hits.max(axis=0))).tolist()
        radius = float(np.hypot(*(body.outline - (x, y)).T).max()) + body.radius
        vx, vy = body.velocity.tolist()
        record.rows.append(TrackedRow(time, body.id, x, y, vx, vy, body.velocity_deviation, radius))
