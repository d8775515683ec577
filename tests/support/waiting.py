"""Waiting for what another process does."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable


def until(condition: Callable[[], object], what: str, longest: float = 30.0) -> None:
    """Look every 0.02 s whether something holds, for so long [s]; then the test fails."""
    end = time.monotonic() + longest
    while not condition():
        assert time.monotonic() < end, f"waited {longest} s for {what}"
        threading.Event().wait(0.02)
