"""The region of a workspace that is given by its rings."""

from __future__ import annotations

import shapely
from shapely.geometry import MultiPolygon

from snnav_core.types import FloatArray

__all__ = ["workspace_region"]


def workspace_region(rings: tuple[FloatArray, ...]) -> MultiPolygon:
    """Return the region of a workspace: counter-clockwise rings without what clockwise rings enclose [m, map]."""
    shells = [shapely.Polygon(ring) for ring in rings if shapely.is_ccw(shapely.LinearRing(ring))]
    holes = [ring for ring in rings if not shapely.is_ccw(shapely.LinearRing(ring))]
    parts = [
        shapely.Polygon(shell.exterior, [hole for hole in holes if shell.covers(shapely.Point(hole[0]))])
        for shell in shells
    ]
    return MultiPolygon(parts)
