"""Timing, and one row of the table."""

from __future__ import annotations

import gc
import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Row:
    """One line of a benchmark.

    Parameters
    ----------
    what : str
    result : str
        As printed.
    seconds : float
        Time of one unit of work [s], to compare with; not finite when the work was not finished.
    demanded : str
        The limit, as printed.
    missed : bool
        Whether the limit is not met.
    peer : bool
        Whether this is somebody else's work, to be compared with the first row.
    """

    what: str
    result: str
    seconds: float = math.nan
    demanded: str = ""
    missed: bool = False
    peer: bool = False

    def ratio(self, ours: Row) -> str:
        """Return how many times as long this takes as `ours`."""
        return (
            f"{self.seconds / ours.seconds:.3g} x the time"
            if self.peer and math.isfinite(self.seconds)
            else ""
        )


def absent(peer: str) -> Row:
    """Return the row of a peer that is not installed."""
    return Row(peer, "not installed (make bench installs it)", peer=True)


def stopwatch(work: Callable[[], object]) -> float:
    """Return how long one call takes [s]."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def repeat(work: Callable[[], object], repetitions: int, warm_up: int = 3) -> np.ndarray:
    """Return the times of repeated calls [s], shape (repetitions,), the garbage collector held back."""
    for _ in range(warm_up):
        work()
    gc.collect()
    gc.disable()
    try:
        return np.array([stopwatch(work) for _ in range(repetitions)])
    finally:
        gc.enable()


def milliseconds(times: np.ndarray) -> str:
    """Say median and 99th percentile of times [s]."""
    median, high = np.percentile(times, (50, 99)) * 1e3
    return f"p50 {median:.2f} ms, p99 {high:.2f} ms"


def limited(what: str, times: np.ndarray, limit_ms: float) -> Row:
    """Return a row whose 99th percentile has a limit [ms]."""
    missed = float(np.percentile(times, 99)) * 1e3 > limit_ms
    return Row(what, milliseconds(times), float(np.median(times)), f"p99 <= {limit_ms:g} ms", missed)
