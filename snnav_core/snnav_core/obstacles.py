"""Bodies in uniform linear motion, as the global planner sees them (Ch. 2, D_i)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.types import FloatArray

__all__ = ["MovingObstacle"]


def _standing() -> FloatArray:
    return np.zeros(2)


@dataclass(frozen=True)
class MovingObstacle:
    """A body that keeps its velocity: D_i(t) = D_i(stamp) + v_i (t - stamp).

    Parameters
    ----------
    id : str
        Name of the body.
    outline : array_like, shape (N, 2)
        Vertices at `stamp` [m, map], counter-clockwise, not repeated at the end; N = 1 makes a disk, N = 2 a capsule.
    radius : float
        The polygon is grown by this [m].
    velocity : array_like, shape (2,)
        [m/s, map].
    stamp : float
        Time of the outline [s].
    position_deviation, velocity_deviation : float
        Standard deviations of what was measured [m] and [m/s]; 0 for a body that is known.

    Raises
    ------
    InvalidInput
        If a number is not finite, the outline has another shape, or radius and outline leave a single point.

    Notes
    -----
    Deviation C2-1: the velocity is a vector, and the printed factor t is left out.
    """

    id: str
    outline: FloatArray
    radius: float = 0.0
    velocity: FloatArray = field(default_factory=_standing)
    stamp: float = 0.0
    position_deviation: float = 0.0
    velocity_deviation: float = 0.0

    def __post_init__(self) -> None:
        outline = np.array(self.outline, dtype=np.float64)
        velocity = np.array(self.velocity, dtype=np.float64)
        if outline.ndim != 2 or outline.shape[0] < 1 or outline.shape[1] != 2:
            raise InvalidInput(
                f"body {self.id!r}: outline has shape {outline.shape}, expected (N, 2), N >= 1"
            )
        if velocity.shape != (2,):
            raise InvalidInput(f"body {self.id!r}: velocity has shape {velocity.shape}, expected (2,)")
        if not (np.isfinite(outline).all() and np.isfinite(velocity).all() and math.isfinite(self.stamp)):
            raise InvalidInput(f"body {self.id!r}: outline, velocity or stamp contain NaN or infinity")
        for name in ("radius", "position_deviation", "velocity_deviation"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidInput(f"body {self.id!r}: {name} is {value}, must be a number of at least 0")
        if len(outline) == 1 and self.radius == 0.0:
            raise InvalidInput(f"body {self.id!r} is a single point; give it a radius")
        for name, array in (("outline", outline), ("velocity", velocity)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def speed(self) -> float:
        """Magnitude of the velocity [m/s]."""
        return float(np.hypot(*self.velocity))

    def outline_at(self, time: float) -> FloatArray:
        """Vertices at a time [s]: shape (N, 2) [m, map]."""
        return self.outline + self.velocity * (time - self.stamp)
