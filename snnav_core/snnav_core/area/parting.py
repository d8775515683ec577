"""Which hits of former measurements are on a body, now that more is known: what stands is not, what goes along is."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from snnav_core.area.body_sample import BodySample
from snnav_core.area.faces import on_faces
from snnav_core.area.returns import FusedReturns
from snnav_core.area.sightings import Sightings
from snnav_core.area.silhouette import passing_beams
from snnav_core.area.track import Track
from snnav_core.types import FloatArray

__all__ = ["Measurements"]

_SAME_PLACE = 0.1  # [m]; so near to what stands nothing else has been
_ON_BODY = 0.1  # [m] from other hits on a body, its motion undone: a hit on it
_REACH = 0.5  # [m] within which single hits may lie on a face of it
_LEAST_ON_FACE = 3  # other hits on such a face


@dataclass(frozen=True)
class _Frame:
    """One measurement: hits that belong to nothing, tracks that the others belong to, and which are not older."""

    time: float
    returns: FusedReturns
    single: NDArray[np.bool_]
    bodies: NDArray[np.int64]
    fresh: NDArray[np.bool_]

    def own(self, sample: BodySample | None) -> NDArray[np.bool_]:
        """The hits of a sample (K,)."""
        if sample is None:
            return np.zeros(len(self.returns), dtype=np.bool_)
        most = 1 + max(int(self.returns.beams.max()), int(sample.beams.max()))
        chosen = most * sample.sensors + sample.beams
        return self.fresh & np.isin(most * self.returns.sensors + self.returns.beams, chosen)


class Measurements:
    """Those within a window of time [s], from which the hits on a body can be chosen again.

    Notes
    -----
    Bodies that come near to something that stands, or start from there, are one with it at first. What stands was
    where it is at all times of the window, and no body was there: as soon as it is told apart, the earlier hits are
    divided as well, and which beams passed the body is found anew.
    """

    def __init__(self, window: float) -> None:
        self._window = window
        self._frames: deque[_Frame] = deque()

    def take(
        self,
        time: float,
        returns: FusedReturns,
        single: NDArray[np.bool_],
        bodies: NDArray[np.int64],
        fresh: NDArray[np.bool_],
    ) -> None:
        """Add a measurement [s]: which hits belong to nothing, tracks of the others, which are new; shapes (K,)."""
        while self._frames and time - self._frames[0].time > self._window:
            self._frames.popleft()
        self._frames.append(_Frame(time, returns, single, bodies, fresh))

    def sample(self, own: NDArray[np.bool_]) -> BodySample:
        """Some hits (K,) of the latest measurement."""
        return _sample(self._frames[-1], own)

    def absorb(self, track: Track, other: Track) -> None:
        """Add the hits on another track that turned out to be the same body: other beams passed the whole of it."""
        track.absorb(other)
        frames = {frame.time: frame for frame in self._frames}
        track.samples = deque(
            _sample(frames[sample.taken], frames[sample.taken].own(sample))
            if sample.taken in frames
            else sample
            for sample in track.samples
        )

    def part(self, track: Track, standing: FloatArray, keep: bool) -> None:
        """Take earlier hits on what stands (n, 2) [m, map] out of a track, or all others if they are to be kept."""
        if len(track.samples) < 2 or len(standing) == 0:
            return
        tree = cKDTree(standing)
        parted = [self._parted(sample, tree, keep) for sample in list(track.samples)[:-1]]
        track.samples = deque([*_existing(parted), track.samples[-1]])

    def _parted(self, sample: BodySample, standing: cKDTree, keep: bool) -> BodySample | None:
        distance, _ = standing.query(sample.points, distance_upper_bound=_SAME_PLACE)
        left = np.isfinite(distance) == keep
        if left.all():
            return sample
        frame = next((frame for frame in self._frames if frame.time == sample.taken), None)
        if frame is None or not left.any():
            return None
        return _sample(frame, frame.own(sample.part(left)))

    def gather(self, track: Track, others: list[int], sightings: Sightings, range_noise: float) -> bool:
        """Add hits that go along with a body: near to hits of other times, or in line with them. False for none.

        Hits on other tracks, by their numbers, and on what stands are not added.
        """
        samples = {sample.taken: sample for sample in track.samples}
        laid = [sample.points - sample.times[:, None] * track.velocity for sample in track.samples]
        tree = cKDTree(np.concatenate(laid))
        added = [
            self._near(frame, samples.get(frame.time), track, tree, others, sightings)
            for frame in self._frames
        ]
        if not any(len(hits) for hits, _ in added):
            return False
        in_line = self._in_line(track, np.concatenate(laid), [hits[far] for hits, far in added], range_noise)
        changed = False
        for frame, (hits, far), kept in zip(self._frames, added, in_line, strict=True):
            hits = np.concatenate((hits[~far], hits[far][kept]))
            if len(hits):
                own = frame.own(samples.get(frame.time))
                own[hits] = True
                samples[frame.time], changed = _sample(frame, own), True
        track.samples = deque(samples[time] for time in sorted(samples))
        return changed

    def _near(
        self,
        frame: _Frame,
        sample: BodySample | None,
        track: Track,
        tree: cKDTree,
        others: list[int],
        sightings: Sightings,
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Further hits that may be on a body (n,), and whether each is single: such ones have to be in line."""
        returns = frame.returns
        laid = returns.points - returns.times[:, None] * track.velocity
        inside = ((laid >= tree.mins - _REACH) & (laid <= tree.maxes + _REACH)).all(axis=1)
        hits = np.flatnonzero(inside & frame.fresh)
        if len(hits):
            distance, _ = tree.query(laid[hits], distance_upper_bound=_REACH)
            hits = hits[(distance < _ON_BODY) | (np.isfinite(distance) & frame.single[hits])]
            hits = hits[~frame.own(sample)[hits] & ~np.isin(frame.bodies[hits], others)]
        if len(hits):
            stands = sightings.steady(returns.sensors[hits], returns.beams[hits], returns.ranges[hits])
            hits = hits[~stands | frame.single[hits]]  # on a face that slides along itself hits seem to stand
        return hits, frame.single[hits]

    def _in_line(
        self, track: Track, laid: FloatArray, single: list[NDArray[np.int64]], range_noise: float
    ) -> list[NDArray[np.bool_]]:
        """Which single hits of every measurement lie on a face of a body, of which others are known."""
        counts = [len(hits) for hits in single]
        if sum(counts) == 0:
            return [np.zeros(0, dtype=np.bool_) for _ in counts]
        chosen = [(frame.returns, hits) for frame, hits in zip(self._frames, single, strict=True)]
        points = np.concatenate(
            [returns.points[hits] - returns.times[hits, None] * track.velocity for returns, hits in chosen]
        )
        beams = np.concatenate(
            [sample.beam_ways for sample in track.samples]
            + [
                (returns.points[hits] - returns.origins[returns.sensors[hits]]) / returns.ranges[hits, None]
                for returns, hits in chosen
            ]
        )
        normals = np.concatenate([sample.normals for sample in track.samples] + [np.zeros((len(points), 2))])
        numbers = on_faces(np.concatenate((laid, points)), normals, beams, range_noise)
        known = np.bincount(numbers[: len(laid)] + 1, minlength=int(numbers.max()) + 2)
        own = numbers[len(laid) :]
        kept = (own >= 0) & (known[own + 1] >= _LEAST_ON_FACE)
        return np.split(kept, np.cumsum(counts)[:-1])


def _existing(samples: Iterable[BodySample | None]) -> list[BodySample]:
    return [sample for sample in samples if sample is not None]


def _sample(frame: _Frame, own: NDArray[np.bool_]) -> BodySample:
    returns = frame.returns
    return BodySample(
        frame.time,
        returns.points[own],
        returns.normals[own],
        returns.times[own],
        returns.spacing[own],
        returns.sensors[own],
        returns.beams[own],
        returns.ranges[own],
        returns.origins[returns.sensors[own]],
        returns.baselines[own],
        passing_beams(returns, own, frame.single, frame.bodies),
    )
