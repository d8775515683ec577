"""Signals that are noted, not raised: what a node is doing is done to its end."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["noted_signals"]

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def noted_signals() -> Iterator[Callable[[], bool]]:
    """Provide a function that tells whether SIGINT or SIGTERM came; outside the main thread none is noted."""
    told = False

    def note(*_: Any) -> None:
        nonlocal told
        told = True

    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    previous = {number: signal.signal(number, note) for number in _SIGNALS}
    try:
        yield lambda: told
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
