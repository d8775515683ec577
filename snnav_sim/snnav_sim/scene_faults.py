"""The entry of a fault in a scene file: which keys each kind has, reading and writing."""

from __future__ import annotations

import math
from typing import Any

from snnav_sim.scene_types import Fault
from snnav_sim.scene_yaml import Field

__all__ = ["FAULT_KINDS", "fault_entry", "read_fault"]

FAULT_KINDS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "drop_out": ((), ()),
    "delay": (("seconds",), ("jitter",)),
    "duplicate": ((), ()),
    "reorder": ((), ()),
    "nan": (("share",), ()),
    "zero": (("share",), ()),
    "beam_count": (("change",), ()),
    "frozen": ((), ()),
    "clock_offset": (("seconds",), ()),
}
"""Kind -> keys that it needs, keys that it may have; `from`, `until` and `probability` may stand with every kind."""

_LONGEST = 1e5  # [s]
_MOST_BEAMS = 100_000


def read_fault(field: Field) -> Fault:
    """Read one fault.

    Raises
    ------
    SceneError
        If its kind is not known, or a key is missing, unknown, or out of its range.
    """
    if "kind" not in field.children():
        field.fail("key kind is missing", f"add kind: one of {', '.join(FAULT_KINDS)}")
    kind = field.children()["kind"].choice(FAULT_KINDS)
    needed, optional = FAULT_KINDS[kind]
    entries = field.mapping(("kind", *needed), (*optional, "from", "until", "probability"))

    def number(key: str, default: float, unit: str, least: float, most: float, above: bool = False) -> float:
        return entries[key].number(unit, least, most, above) if key in entries else default

    begin = number("from", 0.0, "s", 0.0, _LONGEST)
    end = number("until", math.inf, "s", 0.0, _LONGEST)
    if end <= begin:
        entries["until"].fail(f"{end:g} is not after from {begin:g}", "give a later time, or leave it out")
    seconds = number("seconds", 0.0, "s", 0.0 if kind == "delay" else -_LONGEST, _LONGEST)
    jitter = number("jitter", 0.0, "s", 0.0, _LONGEST)
    if "seconds" in entries and seconds == jitter == 0.0:
        entries["seconds"].fail("0 changes nothing", "give another time, or remove the fault")
    return Fault(
        kind,
        begin,
        end,
        number("probability", 1.0, "probability", 0.0, 1.0, above=True),
        seconds=seconds,
        jitter=jitter,
        share=number("share", 0.0, "share", 0.0, 1.0, above=True),
        change=_change(entries["change"]) if "change" in entries else 0,
    )


def _change(field: Field) -> int:
    value = field.whole(-_MOST_BEAMS, _MOST_BEAMS)
    if value == 0:
        field.fail("0 changes nothing", "give the number of beams added, negative for beams cut off")
    return value


def fault_entry(fault: Fault) -> dict[str, Any]:
    """Return what `read_fault` reads."""
    values = {
        "seconds": fault.seconds,
        "jitter": fault.jitter,
        "share": fault.share,
        "change": fault.change,
    }
    needed, optional = FAULT_KINDS[fault.kind]
    entry: dict[str, Any] = {"kind": fault.kind, **{key: values[key] for key in (*needed, *optional)}}
    entry["from"] = fault.begin
    if math.isfinite(fault.end):
        entry["until"] = fault.end
    return {**entry, "probability": fault.probability}
