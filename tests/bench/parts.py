"""Where the time of a step goes: processor time of the threads inside named functions of snnav."""

from __future__ import annotations

import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any


class PartTimer:
    """Adds up the processor time spent in groups of functions; what a nested group takes is not counted twice."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self._stack = threading.local()
        self._lock = threading.Lock()

    def wrap(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that does the same and is timed as a part."""

        def timed(*arguments: Any, **named: Any) -> Any:
            inner = self._stack.__dict__.setdefault("inner", [0.0])
            inner.append(0.0)
            begin = time.thread_time()
            try:
                return function(*arguments, **named)
            finally:
                whole = time.thread_time() - begin
                own = whole - inner.pop()
                inner[-1] += whole
                with self._lock:
                    self.seconds[part] += own

        return timed

    @contextmanager
    def watching(self, parts: Mapping[str, Sequence[tuple[Any, str]]]) -> Iterator[None]:
        """Time functions, given as (module or class, name), wherever snnav's modules have bound them."""
        bound: list[tuple[Any, str, Any]] = []
        for part, functions in parts.items():
            for owner, name in functions:
                original = owner.__dict__[name]
                timed = self.wrap(part, original)
                places = [owner] if isinstance(owner, type) else _snnav_modules()
                for place in places:
                    names = [key for key, value in vars(place).items() if value is original]
                    bound += [(place, key, original) for key in names]
                    for key in names:
                        setattr(place, key, timed)
        try:
            yield
        finally:
            for place, key, original in bound:
                setattr(place, key, original)

    def shares(self) -> str:
        """Say which part takes how much of all that was timed."""
        total = sum(self.seconds.values())
        ordered = sorted(self.seconds.items(), key=lambda item: -item[1])
        return ", ".join(f"{part} {taken / total:.0%}" for part, taken in ordered)


def _snnav_modules() -> list[Any]:
    return [module for name, module in list(sys.modules.items()) if name.startswith("snnav_")]
