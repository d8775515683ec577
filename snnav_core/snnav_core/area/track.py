"""What is known of one body."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from snnav_core.area.body_sample import BodySample
from snnav_core.area.drift import Drift
from snnav_core.types import FloatArray

__all__ = ["Track"]

_MOST_SAMPLES = 6  # that a velocity is fitted to


@dataclass(eq=False)
class Track:
    """One body, from measurement to measurement.

    Parameters
    ----------
    number : int
    samples : deque of BodySample
        Within the window, in the order of time.
    seen : float
        Time of the last update that saw it [s].
    moving : bool
    found_moving : int
        How many times in a row it was found to move.
    drift : Drift or None
        What the fit says of its velocity; None where none is known.
    standing_deviation : float
        Of the velocity of a body that stands [m/s]; inf while too little is known.
    """

    number: int
    samples: deque[BodySample] = field(default_factory=deque)
    seen: float = -math.inf
    moving: bool = False
    found_moving: int = 0
    drift: Drift | None = None
    standing_deviation: float = math.inf

    @property
    def id(self) -> str:
        """Its name."""
        return f"body_{self.number}"

    @property
    def velocity(self) -> FloatArray:
        """[m/s], shape (2,); exactly 0 unless the body moves."""
        return np.zeros(2) if self.drift is None or not self.moving else self.drift.velocity

    @property
    def deviation(self) -> float:
        """Standard deviation of the velocity [m/s]; inf while too little is known."""
        return self.standing_deviation if self.drift is None or not self.moving else self.drift.deviation

    @property
    def walks(self) -> bool:
        """Whether it moves and changes its shape, as the legs of somebody do."""
        return self.moving and self.drift is not None and not self.drift.rigid

    @property
    def extent(self) -> float:
        """Diagonal of the box around the last hits [m]."""
        return float(np.hypot(*np.ptp(self.samples[-1].points, axis=0)))

    def hits_at(self, time: float, sample: int = -1) -> FloatArray:
        """Where the hits of a sample are at a time [s] if the body keeps its velocity, shape (n, 2) [m, map]."""
        chosen = self.samples[sample]
        return chosen.points + (time - chosen.times)[:, None] * self.velocity

    def all_hits_at(self, time: float) -> FloatArray:
        """Where the hits of all samples are at a time [s], shape (n, 2) [m, map]."""
        return np.concatenate([self.hits_at(time, index) for index in range(len(self.samples))])

    def chosen_samples(self) -> list[BodySample]:
        """Some samples, evenly over the window, the last one among them."""
        chosen = np.unique(np.linspace(0, len(self.samples) - 1, _MOST_SAMPLES).round().astype(np.int64))
        return [self.samples[index] for index in chosen]

    def take(self, sample: BodySample, window: float) -> None:
        """Add the newest sample and forget those older than the window [s]; again for further hits at the same time."""
        if self.samples and self.samples[-1].taken == sample.taken:
            sample = self.samples.pop().joined(sample)
        self.samples.append(sample)
        while sample.taken - self.samples[0].taken > window:
            self.samples.popleft()

    def absorb(self, other: Track) -> None:
        """Take what is known of another track that turned out to show the same body."""
        merged = {sample.taken: sample for sample in self.samples}
        for sample in other.samples:
            merged[sample.taken] = merged[sample.taken].joined(sample) if sample.taken in merged else sample
        self.samples = deque(merged[taken] for taken in sorted(merged))
        self.seen = max(self.seen, other.seen)
