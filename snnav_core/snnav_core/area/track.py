"""What is known of one body."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from shapely.geometry.base import BaseGeometry

from snnav_core.area.drift import BodySample
from snnav_core.types import FloatArray

__all__ = ["Track"]

_MOST_SAMPLES = 6  # that a velocity is fitted to


@dataclass
class Track:
    """What is known of one body."""

    id: str
    samples: deque[BodySample] = field(default_factory=deque)
    seen: float = -math.inf  # time of the last update that saw it
    moving: bool = False
    velocity: FloatArray = field(default_factory=lambda: np.zeros(2))
    deviation: float = math.inf
    bound: BaseGeometry | None = None  # nothing of the body lies outside of it, at the last update

    @property
    def extent(self) -> float:
        """Diagonal of the box around the last hits [m]."""
        return float(np.hypot(*np.ptp(self.samples[-1].points, axis=0)))

    def hits_at(self, time: float) -> FloatArray:
        """Where the last hits are at a time [s] if the body keeps its velocity, shape (n, 2) [m, map]."""
        last = self.samples[-1]
        return last.points + (time - last.times)[:, None] * self.velocity

    def chosen_samples(self) -> list[BodySample]:
        """Some samples, evenly over the window, the last one among them."""
        chosen = np.unique(np.linspace(0, len(self.samples) - 1, _MOST_SAMPLES).round().astype(np.int64))
        return [self.samples[index] for index in chosen]
