"""Find the value with which a laser log says "nothing came back"; it differs from log to log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snnav_core.types import FloatArray

__all__ = ["DEVICE_REACH", "LMS_CODES", "NoReturn", "find_no_return"]

_RAW_CODES = np.array([8177, 8179, 8183, 8186, 8187, 8189, 8190, 8191])
LMS_CODES: FloatArray = np.sort(
    np.concatenate(
        [_RAW_CODES * 0.01, _RAW_CODES * 0.001, (_RAW_CODES + 8192) * 0.001, (_RAW_CODES + 24576) * 0.001]
    )
)
"""What the SICK LMS-2xx reports instead of a distance [m]: 13 bits in cm; 13, 14 and 15 bits in mm."""

DEVICE_REACH = 80.0
"""Longest range of the LMS-200 family [m]."""

_CLUSTER = 0.2  # m, codes of one log lie this close together (51.09 .. 51.16, 81.83 .. 81.91)
_LEAST_COUNT = 5  # a code is not seen only once or twice
_LEAST_PROMINENCE = 5.0  # a code is this much more frequent than a distance up there
_LEAST_PROMINENT = 30.0  # m, below this only known codes count: a wall may be seen just as often
_OUTLIERS = 0.02  # readings above the code, relative to how often it occurs
_CODE_TOLERANCE = 6e-4  # m, logs round to mm


@dataclass(frozen=True, slots=True)
class NoReturn:
    """How a log says "no return".

    Parameters
    ----------
    value : float
        The most frequent such reading [m]; inf if the log has none.
    threshold : float
        Readings at or above this are no distances [m].
    share : float
        Share of all readings that are no returns.
    """

    value: float
    threshold: float
    share: float

    def __str__(self) -> str:
        if not np.isfinite(self.value):
            return f"no value stands for no return; readings from {self.threshold:g} m are taken for one"
        share = f"{100 * self.share:.1f} % of all readings"
        return f"no return = {self.value:g} m, from {self.threshold:g} m on ({share})"


def find_no_return(readings: FloatArray) -> NoReturn:
    """Find the no-return value of all readings of a log.

    Parameters
    ----------
    readings : FloatArray
        All readings of the log [m], any shape, finite.

    Notes
    -----
    The most frequent reading from 30 m on is taken when it stands out there (at least 5 times, and 5 times as
    often as the median distance) and hardly anything lies above it; else the most frequent known code of the
    LMS within a tenth of the largest reading. Codes of one log lie within 0.2 m of each other, so everything
    from 0.2 m below the value counts as no return. Without either, only readings beyond the reach of the
    device (80 m) do. Taking a wall for the code by mistake would lose free area, never an obstacle inside it.
    """
    values, counts = np.unique(np.asarray(readings, dtype=np.float64), return_counts=True)
    value = _prominent(values, counts)
    if value is None:
        value = _known_code(values, counts)
    threshold = DEVICE_REACH if value is None else round(min(value - _CLUSTER, DEVICE_REACH), 3)
    share = float(counts[values >= threshold].sum() / max(counts.sum(), 1))
    return NoReturn(float("inf") if value is None else value, threshold, share)


def _prominent(values: FloatArray, counts: NDArray[np.int64]) -> float | None:
    far = values >= _LEAST_PROMINENT
    if not far.any():
        return None
    upper, often = values[far], counts[far]
    best = int(np.argmax(often))
    beyond = int(often[upper > upper[best] + _CLUSTER].sum())
    needed = (
        max(_LEAST_COUNT, _LEAST_PROMINENCE * float(np.median(often))) if len(often) > 1 else _LEAST_COUNT
    )
    return float(upper[best]) if often[best] >= needed and beyond <= _OUTLIERS * often[best] else None


def _known_code(values: FloatArray, counts: NDArray[np.int64]) -> float | None:
    if not len(values):
        return None
    near = np.abs(values[:, None] - LMS_CODES[None, :]).min(axis=1) < _CODE_TOLERANCE
    near &= values >= 0.9 * values[-1]
    return float(values[near][np.argmax(counts[near])]) if near.any() else None
