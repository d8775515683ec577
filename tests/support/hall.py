"""A hall of 20 m by 12 m in which robots drive."""

from __future__ import annotations

import shapely

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon

HALL = shapely.box(0.0, 0.0, 20.0, 12.0)


def area(*obstacles: shapely.Geometry, stamp: float = 0.0) -> UnoccupiedArea:
    return UnoccupiedArea(stamp, as_multipolygon(shapely.difference(HALL, shapely.union_all(obstacles))))
