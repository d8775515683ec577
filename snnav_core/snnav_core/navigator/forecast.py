"""What a boundary that advances will reach if it goes on as before: tells good places from bad ones, proves nothing."""

from __future__ import annotations

from collections import deque
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.navigator.context import AreaContext
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.types import TIME_TOLERANCE, FloatArray

__all__ = ["Forecast", "Trend"]

_TREND = 0.5  # [s]: what has come nearer since so long ago, or since the last decision, is expected to go on
_HORIZON = 2.0  # [s]: so far ahead
_STEP = 0.2  # [s]
_SPACING = 0.15  # [m] between points of the boundary that are looked at
_MOVES = 0.25  # share of what a boundary can move that counts as advancing ...
_NOISE = 0.03  # ... and at least this [m]: noise of the scanners moves it as well


class Forecast:
    """Where the parts of a boundary that have advanced will be if they go on.

    Parameters
    ----------
    area : UnoccupiedArea
    earlier : UnoccupiedArea or None
        The same some time ago; None where nothing is known of it.
    boundary_speed : float
        V_max [m/s].
    """

    def __init__(self, area: UnoccupiedArea, earlier: UnoccupiedArea | None, boundary_speed: float) -> None:
        self._area = area
        self.times = np.arange(0.0, _HORIZON + 0.5 * _STEP, _STEP)
        self._points, self._velocities = _advancing(area, earlier, boundary_speed)

    @cached_property
    def _fronts(self) -> list[cKDTree]:
        """What was passed up to each time."""
        passed = self._points[None] + self.times[:, None, None] * self._velocities[None]
        return [cKDTree(passed[: index + 1].reshape(-1, 2)) for index in range(len(self.times))]

    @property
    def is_quiet(self) -> bool:
        """Whether nothing advances."""
        return len(self._points) == 0

    def room(self, ways: FloatArray) -> FloatArray:
        """Distance to all that is not free, and to what will not be then, of ways (N, K, 2) at `times` (K,) [m]."""
        shape = ways.shape[:2]
        room = self._area.clearance(ways.reshape(-1, 2)).reshape(shape)
        if self.is_quiet:
            return room
        for index, front in enumerate(self._fronts):
            room[:, index] = np.minimum(room[:, index], front.query(ways[:, index])[0])
        return room

    def risk(self, ways: FloatArray, wanted: float) -> FloatArray:
        """How much of a distance [m] ways (N, K, 2) at `times` will lack, squared and averaged [m^2], shape (N,)."""
        lacking = np.maximum(0.0, wanted - self.room(ways))
        return np.asarray((lacking**2).mean(axis=1))


class Trend:
    """Keeps the areas of the last moments to tell what advances.

    Parameters
    ----------
    settings : NavigatorSettings

    Attributes
    ----------
    previous : AreaContext or None
        The area of the decision before, when it was another one.
    forecast : Forecast or None
        None where the time window looks as far ahead: what is proved needs no guess.
    """

    def __init__(self, settings: NavigatorSettings) -> None:
        window = settings.time_window * settings.sampling_interval
        self._speed = settings.boundary_speed
        self._foresees = self._speed > 0.0 and window < _HORIZON - TIME_TOLERANCE
        self._span = max(_TREND, settings.sampling_interval) + TIME_TOLERANCE
        self._earlier: deque[UnoccupiedArea] = deque()
        self.previous: AreaContext | None = None
        self.forecast: Forecast | None = None

    def follow(self, context: AreaContext | None, fresh: AreaContext) -> tuple[AreaContext, bool]:
        """Take the area of a decision; return the last one (None at first) or this, and whether it is another one."""
        area, changed = fresh.area, context is None or context.digest != fresh.digest
        self.previous = context if changed else None
        if context is not None and not changed:
            context.area = context.area.restamped(area.stamp, area.contradictions, area.lost)
            fresh = context
        if self._foresees:
            while self._earlier and self._earlier[0].stamp < area.stamp - self._span:
                self._earlier.popleft()
            self.forecast = Forecast(area, self._earlier[0] if self._earlier else None, self._speed)
            self._earlier.append(area)
        return fresh, changed


def _advancing(
    area: UnoccupiedArea, earlier: UnoccupiedArea | None, boundary_speed: float
) -> tuple[FloatArray, FloatArray]:
    """Points of the boundary that lay inside the earlier area, and how fast they came there."""
    nothing = np.zeros((0, 2)), np.zeros((0, 2))
    if earlier is None or boundary_speed == 0.0 or area.is_empty or earlier.is_empty:
        return nothing
    elapsed = area.stamp - earlier.stamp
    if elapsed <= 0.0:
        return nothing
    points = np.concatenate([_along(ring) for ring in area.rings])
    depth, gradient = earlier.clearance_field.query(points)
    reach = boundary_speed * elapsed
    advances = depth > max(_NOISE, _MOVES * reach)
    speed = np.minimum(depth[advances], reach) / elapsed
    return points[advances], speed[:, None] * gradient[advances]


def _along(ring: FloatArray) -> FloatArray:
    """Points along an open ring, no farther apart than the spacing."""
    ends = np.roll(ring, -1, axis=0)
    lengths = np.linalg.norm(ends - ring, axis=1)
    counts = np.maximum(1, np.ceil(lengths / _SPACING)).astype(np.int64)
    index = np.repeat(np.arange(len(ring)), counts)
    share = (np.arange(len(index)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[index]
    return np.asarray(ring[index] + share[:, None] * (ends - ring)[index])
