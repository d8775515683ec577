"""What was taken for a part of a body and stands: it is taken out of what the body was seen as before."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from snnav_core.area.drift import BodySample
from snnav_core.area.returns import FusedReturns
from snnav_core.area.silhouette import passing_beams
from snnav_core.area.track import Track
from snnav_core.types import FloatArray

__all__ = ["Measurements"]

_SAME_PLACE = 0.1  # [m]; so near to what stands nothing else has been
_Frame = tuple[float, FusedReturns, NDArray[np.bool_], NDArray[np.int64]]


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
        self, time: float, returns: FusedReturns, single: NDArray[np.bool_], bodies: NDArray[np.int64]
    ) -> None:
        """Add a measurement [s], with the hits that belong to nothing and the tracks of the others, shapes (K,)."""
        while self._frames and time - self._frames[0][0] > self._window:
            self._frames.popleft()
        self._frames.append((time, returns, single, bodies))

    def sample(self, own: NDArray[np.bool_]) -> BodySample:
        """Some hits (K,) of the latest measurement."""
        return _sample(self._frames[-1], own)

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
        frame = next((frame for frame in self._frames if frame[0] == sample.taken), None)
        if frame is None or not left.any():
            return None
        returns, most = frame[1], 1 + max(int(frame[1].beams.max()), int(sample.beams.max()))
        chosen = most * sample.sensors[left] + sample.beams[left]
        return _sample(frame, np.isin(most * returns.sensors + returns.beams, chosen))


def _existing(samples: Iterable[BodySample | None]) -> list[BodySample]:
    return [sample for sample in samples if sample is not None]


def _sample(frame: _Frame, own: NDArray[np.bool_]) -> BodySample:
    time, returns, single, bodies = frame
    return BodySample(
        time,
        returns.points[own],
        returns.normals[own],
        returns.times[own],
        returns.spacing[own],
        returns.sensors[own],
        returns.beams[own],
        returns.ranges[own],
        returns.origins[returns.sensors[own]],
        returns.baselines[own],
        passing_beams(returns, own, single, bodies),
    )
