"""Bodies and their velocities from successive fused measurements (Ch. 2, D_i and v_Di)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from snnav_core.area.body_sample import BodySample
from snnav_core.area.clusters import cluster_returns
from snnav_core.area.drift import fit_drift, overlap
from snnav_core.area.explained import build_scene
from snnav_core.area.overlay import intersection
from snnav_core.area.parting import Measurements
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.area.returns import FusedReturns
from snnav_core.area.sightings import Sightings
from snnav_core.area.track import Track
from snnav_core.area.tracker_settings import TrackedScene, TrackerSettings
from snnav_core.errors import InvalidInput
from snnav_core.types import TIME_TOLERANCE, FloatArray

__all__ = ["ObstacleTracker", "TrackedScene", "TrackerSettings"]

_NEAR = 0.1  # [m]; a hit is where the body was expected
_FRAGMENT = 0.5  # share of its hits that lie where a moving body is expected: a part of it
_SAME_WAY = 3.0  # velocities that differ by less, in deviations, are the same
_SAME_SPEED = 0.02  # [m/s] added to these deviations
_STAYS_MOVING = 0.5  # share of the confidence at which a body that moved counts as moving still
_OVERSHOOT = 1.25  # times the top speed: an estimate may be above it
_SURELY_MOVING = 2  # times in a row that a body was found to move, before it goes on unseen
_UNCERTAIN = 0.1  # weight of a track whose motion is not known yet, beside others
_SURE = 0.1  # [m/s] deviation of a velocity that tells where hits on a body were before
_GOES_ALONG = 0.5  # share of hits that lie over others when a motion is undone
_STANDS_FOR = 0.5  # [s] for which beams have met the same where something stands beside a body


class ObstacleTracker:
    """Follows bodies from measurement to measurement.

    Parameters
    ----------
    settings : TrackerSettings, optional

    Notes
    -----
    A body moves when two things come together: beams meet it that looked farther before, or look past where it was,
    and its velocity is significant. All else stands, and what no body explains is not free.
    """

    def __init__(self, settings: TrackerSettings | None = None) -> None:
        self.settings = settings or TrackerSettings()
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a jump of time."""
        self.tracks: list[Track] = []
        self._sightings = Sightings(self.settings.window, self.settings.free_depth)
        self._measurements = Measurements(self.settings.window)
        self._known: dict[int, float] = {}
        self._count = 0
        self._time = -math.inf

    def update(self, time: float, returns: FusedReturns, area: UnoccupiedArea) -> TrackedScene:
        """Take one fused measurement.

        Parameters
        ----------
        time : float
            [s]
        returns : FusedReturns
            The latest hits of all sensors, robots left out (`AreaFusion.returns`).
        area : UnoccupiedArea
            What is free at `time`.

        Returns
        -------
        TrackedScene

        Raises
        ------
        InvalidInput
            If time does not go on; call `reset` after a jump of time.
        """
        if not (math.isfinite(time) and time > self._time + TIME_TOLERANCE):
            raise InvalidInput(
                f"tracker: update at {time} s after that at {self._time} s; reset it after a jump"
            )
        self._time = time
        labels, gaps = self._labels(returns)
        evidence = self._sightings.take(time, returns)
        apart = np.array([track.moving and not track.walks for track in self.tracks], dtype=np.bool_)
        fresh = self._fresh(returns)
        steady = self._sightings.steady(
            returns.sensors, returns.beams, returns.ranges, time - _STANDS_FOR + TIME_TOLERANCE
        )
        moving = np.array([track.moving for track in self.tracks] + [False], dtype=np.bool_)
        steady &= ~moving[labels]  # it may have slowed down, or stand on that leg
        clusters, stands = cluster_returns(
            returns, self.settings.link_distance, labels, evidence, self.settings.leg_distance, apart, steady
        )
        single = np.bincount(clusters)[clusters] < self.settings.least_points if len(clusters) else fresh
        owners = self._match(clusters, labels, gaps, evidence, stands)
        numbers = np.full(int(clusters.max(initial=-1)) + 1, -1)
        numbers[list(owners)] = [track.number for track in owners.values()]
        self._measurements.take(time, returns, single, numbers[clusters], fresh)
        for track in dict.fromkeys(owners.values()):
            own = np.isin(clusters, [cluster for cluster, owner in owners.items() if owner is track])
            track.seen = time
            if (own & fresh).any():
                track.take(self._measurements.sample(own & fresh), self.settings.window)
                beside = own if stands[own].all() else stands & ~own
                if not track.moving:
                    self._measurements.part(track, returns.points[beside], keep=beside is own)
                self._judge(track, int((own & evidence).sum()) + self._left(track))
        self._gather()
        self._join(area, owners)
        for (
            track
        ) in self.tracks:  # beams that graze a wall meet it now and then: nothing is expected from one sight
            track.moving &= track.seen == time or track.found_moving >= _SURELY_MOVING
        self.tracks = [track for track in self.tracks if time - track.seen <= self.settings.patience]
        owned = np.isin(clusters, [cluster for cluster, track in owners.items() if track.moving])
        return build_scene(time, area, returns, owned, self.tracks, self.settings)

    def _labels(self, returns: FusedReturns) -> tuple[NDArray[np.int64], FloatArray]:
        """Index of the track that each hit lies nearest to, -1 for none, and how far off as a share of its gate."""
        labels, shares = np.full(len(returns), -1, dtype=np.int64), np.ones(len(returns))
        if not self.tracks or len(returns) == 0:
            return labels, shares
        expected = [track.hits_at(self._time) for track in self.tracks]
        owner = np.repeat(np.arange(len(expected)), [len(points) for points in expected])
        gates = np.array([self._gate(track) for track in self.tracks])
        moved = np.array([track.velocity for track in self.tracks])
        distance, nearest = cKDTree(np.concatenate(expected)).query(
            returns.points, distance_upper_bound=float(gates.max())
        )
        found = np.isfinite(distance)
        label = owner[np.where(found, nearest, 0)]
        late = (self._time - returns.times) * np.hypot(*moved[label].T)
        share = np.where(found, np.maximum(distance - late, 0.0), np.inf) / gates[label]
        labels[share < 1.0] = label[share < 1.0]
        shares[share < 1.0] = share[share < 1.0]
        return labels, shares

    def _gate(self, track: Track) -> float:
        passed = self._time - float(track.samples[-1].times.max())
        speed = min(2.0 * track.deviation, self.settings.top_speed)
        return (self.settings.leg_distance if track.walks else _NEAR) + passed * speed

    def _match(
        self,
        clusters: NDArray[np.int64],
        labels: NDArray[np.int64],
        shares: FloatArray,
        evidence: NDArray[np.bool_],
        stands: NDArray[np.bool_],
    ) -> dict[int, Track]:
        """Give every cluster its track; clusters without one start a track if they are large enough."""
        sizes = np.bincount(clusters) if len(clusters) else np.zeros(0, dtype=np.int64)
        arrived = np.bincount(clusters, weights=evidence) if len(clusters) else np.zeros(0)
        still = np.bincount(clusters, weights=~stands) == 0.0 if len(clusters) else arrived
        votes = np.zeros((len(sizes), len(self.tracks)))
        known = labels >= 0
        known_so_far = [
            track.moving or len(track.samples) >= self.settings.least_samples for track in self.tracks
        ]
        trust = np.where([*known_so_far, False], 1.0, _UNCERTAIN)
        np.add.at(votes, (clusters[known], labels[known]), trust[labels[known]] * (1.0 - shares[known]))
        rows, columns = linear_sum_assignment(votes, maximize=True)
        tracks = list(self.tracks)
        owners = {int(r): tracks[c] for r, c in zip(rows, columns, strict=True) if votes[r, c] > 0.0}
        self._absorb(votes, tracks, owners)
        for cluster in np.flatnonzero(sizes >= self.settings.least_points).tolist():
            if cluster in owners:
                continue
            best = tracks[int(votes[cluster].argmax())] if tracks else None
            least = _FRAGMENT * sizes[cluster]
            if best is not None and best.moving and votes[cluster].max() > least:
                is_part = not best.walks or arrived[cluster] > least
            else:
                is_part = False
            if best is not None and is_part:
                owners[cluster] = best
                continue
            self._count += 1
            owners[cluster] = Track(self._count)
            owner = next((key for key, track in owners.items() if track is best), -1)
            if (
                best is not None
                and owner >= 0
                and votes[cluster].max() > 0.0
                and still[cluster] != still[owner]
            ):
                owners[cluster].samples = best.samples.copy()  # they were taken for one
            self.tracks.append(owners[cluster])
        return owners

    def _absorb(self, votes: FloatArray, tracks: list[Track], owners: dict[int, Track]) -> None:
        """Make one of tracks whose hits are one cluster now: legs, or parts of a body."""
        left = [track for track in tracks if track not in owners.values()]
        for track in left:
            column = votes[:, tracks.index(track)]
            owner = owners.get(int(column.argmax())) if column.any() else None
            if owner is None or (track.moving and not track.walks):
                continue
            if owner.walks or (owner.moving and self._goes_along(owner, track, 1.0)):
                self._measurements.absorb(owner, track)
                self.tracks.remove(track)

    def _fresh(self, returns: FusedReturns) -> NDArray[np.bool_]:
        """Whether hits belong to a scan that was not there at the last update."""
        fresh = np.zeros(len(returns), dtype=np.bool_)
        for sensor in np.unique(returns.sensors).tolist():
            own = returns.sensors == sensor
            stamp = float(returns.times[own].max())
            fresh[own] = stamp > self._known.get(sensor, -math.inf) + TIME_TOLERANCE
            self._known[sensor] = stamp
        return fresh

    def _left(self, track: Track) -> int:
        """Number of hits on a body at the start of the window through which sensors look now."""
        first = track.samples[0]
        return self._sightings.left(first.sensors, first.beams, first.ranges) if len(track.samples) > 1 else 0

    def _judge(self, track: Track, evidence: int) -> None:
        """Decide whether a body moves, and how fast."""
        settings = self.settings
        known = len(track.samples) >= settings.least_samples
        track.standing_deviation = settings.least_speed if known else math.inf
        if track.extent > settings.largest_body or not known:
            track.moving = False
        elif track.moving or evidence >= settings.least_evidence:
            guess = track.velocity if track.moving else None
            track.drift = drift = fit_drift(self._samples(track), settings.range_noise, guess)
            needed = settings.confidence * (_STAYS_MOVING if track.moving else 1.0)
            speed = float(np.hypot(*drift.velocity))
            track.moving = (
                drift.significance > needed
                and settings.least_speed < speed <= _OVERSHOOT * settings.top_speed
            )
            track.standing_deviation = max(settings.least_speed, drift.deviation)
        track.found_moving = track.found_moving + 1 if track.moving else 0

    def _gather(self) -> None:
        """Take what turns out to go along with bodies that keep their shape."""
        for track in self.tracks:
            if track.seen == self._time and track.moving and not track.walks and track.deviation < _SURE:
                others = [other.number for other in self.tracks if other is not track and other.moving]
                if self._measurements.gather(track, others, self._sightings, self.settings.range_noise):
                    self._judge(track, self.settings.least_evidence)

    def _samples(self, track: Track) -> list[BodySample]:
        """What a velocity is fitted to; only beams that met what stands, or goes elsewhere, tell that they passed."""
        samples = track.chosen_samples()
        passing = [sample.passing for sample in samples]
        steady = self._sightings.steady(
            np.concatenate([beams.ends // 2 for beams in passing]),
            np.concatenate([beams.beams for beams in passing]),
            np.concatenate([beams.ranges for beams in passing]),
        )
        others = [other.number for other in self.tracks if self._go_apart(track, other)]
        borders = np.cumsum([len(beams.ends) for beams in passing])[:-1]
        return [
            replace(
                sample,
                passing=beams.part(
                    np.isin(beams.surfaces, beams.surfaces[stands]) | np.isin(beams.bodies, others)
                ),
            )
            for sample, beams, stands in zip(samples, passing, np.split(steady, borders), strict=True)
        ]

    def _join(self, area: UnoccupiedArea, owners: dict[int, Track]) -> None:
        """Make one of tracks that go the same way and have nothing free between them."""
        seen = [track for track in self.tracks if track.seen == self._time]
        for track in (track for track in seen if track.moving):
            for other in (other for other in seen if other is not track):
                if track in self.tracks and other in self.tracks and self._are_one(track, other, area):
                    self._measurements.absorb(track, other)
                    self._judge(track, self.settings.least_evidence)
                    self.tracks.remove(other)
                    owners.update((key, track) for key, owner in owners.items() if owner is other)

    def _go_apart(self, track: Track, other: Track) -> bool:
        """Whether both move, with velocities that certainly differ."""
        if not (track.moving and other.moving) or track.drift is None or other.drift is None:
            return False
        apart = track.drift.velocity - other.drift.velocity
        doubt = track.drift.covariance + other.drift.covariance + _SAME_SPEED**2 * np.eye(2)
        return bool(apart @ np.linalg.solve(doubt, apart) > _SAME_WAY**2)

    def _goes_along(self, track: Track, other: Track, ratio: float) -> bool:
        """Whether what was seen too seldom to tell its motion goes with a body, so many times better than it stands."""
        if track.walks or len(other.samples) < 2:
            return False
        samples, noise = list(other.samples), self.settings.range_noise
        along, resting = (overlap(samples, moved, noise) for moved in (track.velocity, np.zeros(2)))
        return along >= max(_GOES_ALONG, ratio * resting)

    def _are_one(self, track: Track, other: Track, area: UnoccupiedArea) -> bool:
        if self._go_apart(track, other):
            return False
        if not other.moving and len(other.samples) < 2:
            return False
        points = np.concatenate((track.samples[-1].points, other.samples[-1].points))
        if float(np.hypot(*np.ptp(points, axis=0))) > self.settings.largest_body:
            return False
        hulls = [shapely.MultiPoint(one.samples[-1].points).convex_hull for one in (track, other)]
        between = shapely.shortest_line(*hulls)
        if intersection(between, area.region).length > self.settings.free_depth:
            return False
        if track.walks or other.walks:
            return other.moving
        return self._goes_along(track, other, 0.0 if other.moving else 2.0)
