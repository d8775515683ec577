"""Types of command line arguments: numbers within bounds, with messages that name value and bound."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

__all__ = ["labelled", "number", "whole"]


def number(least: float, above: bool = False) -> Callable[[str], float]:
    """Return an argparse type: a finite number from `least` on (or above it)."""

    def parse(text: str) -> float:
        value = float(text)
        if not math.isfinite(value) or value < least or (above and value == least):
            raise argparse.ArgumentTypeError(f"{text} must be {'above' if above else 'at least'} {least:g}")
        return value

    parse.__name__ = "number"
    return parse


def whole(least: int, most: int | None = None) -> Callable[[str], int]:
    """Return an argparse type: a whole number from `least` on, up to `most` where that is given."""
    bounds = f"of at least {least}" if most is None else f"from {least} to {most}"

    def parse(text: str) -> int:
        if not (text.isdecimal() and least <= int(text) <= (int(text) if most is None else most)):
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number {bounds}")
        return int(text)

    return parse


def labelled(form: str) -> Callable[[str], tuple[str, tuple[float, ...]]]:
    """Return an argparse type: numbers as in `form`, such as ``X,Y``, perhaps after ``ID=``."""
    count = form.count(",") + 1

    def parse(text: str) -> tuple[str, tuple[float, ...]]:
        name, separator, rest = text.rpartition("=")
        try:
            values = tuple(float(part) for part in rest.split(","))
        except ValueError:
            values = ()
        if len(values) != count or not all(map(math.isfinite, values)) or bool(separator) != bool(name):
            raise argparse.ArgumentTypeError(f"{text!r} is not {form} or ID={form} with finite numbers")
        return name.strip(), values

    return parse
