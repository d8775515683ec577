"""Rounding to single precision, the precision of a LaserScan message, in the safe direction.

What a device returns is exact in single precision: a message carries it unchanged, and the run without ROS
computes with the same numbers as the nodes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from snnav_core.types import FloatArray

__all__ = ["down", "up"]


def down(values: ArrayLike) -> FloatArray:
    """Round to the next smaller single: a range that grows would claim free space."""
    exact = np.asarray(values, dtype=np.float64)
    single = exact.astype(np.float32)
    lower = np.nextafter(single, np.float32(-np.inf))
    return np.where(single > exact, lower, single).astype(np.float64)


def up(values: ArrayLike) -> FloatArray:
    """Round to the next larger single."""
    return -down(-np.asarray(values, dtype=np.float64))
