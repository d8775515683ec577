"""How values of a scene are written as YAML, so that reading gives back equal ones."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import yaml

from snnav_sim.scene_types import Circle, SampledScene, Shape

__all__ = ["degrees_of", "document", "head_entries", "outline_entry"]


def document(head: Mapping[str, Any], sections: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Return a scene file: one line per key, then one per item of every section."""
    lines = [f"{key}: {_flow(value)}" for key, value in head.items()]
    for key, items in sections.items():
        lines.append(f"{key}:" if items else f"{key}: []")
        lines.extend(f"  - {_flow(item)}" for item in items)
    return "\n".join(lines) + "\n"


def _flow(value: Any) -> str:
    text: str = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, width=2**30, allow_unicode=True, explicit_end=False
    )
    return text.removesuffix("\n").removesuffix("\n...")


def head_entries(scene: SampledScene) -> dict[str, Any]:
    """Return the keys that scenes in the plane and in space share, in the order of a file."""
    names = (
        "name",
        "description",
        "seed",
        "sampling_interval",
        "control_period",
        "time_window",
        "boundary_speed",
    )
    return {name: getattr(scene, name) for name in (*names, "safety_margin", "time_limit")}


def outline_entry(shape: Shape) -> dict[str, Any]:
    """Return the keys of a polygon or circle."""
    if isinstance(shape, Circle):
        return {"circle": [shape.x, shape.y, shape.radius]}
    return {"polygon": [list(vertex) for vertex in shape.vertices]}


def degrees_of(angle: float) -> float:
    """Return degrees that convert to exactly this angle, short ones first."""
    degrees = math.degrees(angle)
    for digits in range(16):
        if math.radians(round(degrees, digits)) == angle:
            return round(degrees, digits)
    neighbours = (degrees, np.nextafter(degrees, math.inf), np.nextafter(degrees, -math.inf))
    return float(next((value for value in neighbours if math.radians(value) == angle), degrees))
