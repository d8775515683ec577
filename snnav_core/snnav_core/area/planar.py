"""The unoccupied area of the plane as polygons with holes, and its reduction by a distance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import shapely
from shapely.geometry import MultiPolygon, Point, Polygon
from shapely.geometry.base import BaseGeometry

from snnav_core.area.clearance import ClearanceField
from snnav_core.area.overlay import difference, intersection, union_all
from snnav_core.errors import InvalidInput
from snnav_core.sensing.thinning import thin_ring
from snnav_core.types import FloatArray

__all__ = [
    "LostPart",
    "UnoccupiedArea",
    "as_multipolygon",
    "component_at",
    "grow",
    "reduce_area",
    "remove_disks",
    "shrink",
]

_FINE, _COARSE = 16, 8  # segments of a quarter circle: below 1 m, where passages are narrow, and above
_SIMPLE = 4
_FINER = (1.0, 2.0, 4.0)  # where rings touch with points left out, the tolerance is divided by these
_MANY_VERTICES = 6000
_SLIT_VERTICES, _SLIT_LENGTH = (
    600,
    12.0,
)  # an outline longer than this times the root of its area goes to and fro ...
_OBSTACLE_LENGTH = 6.0  # ... unless it leads round holes: they allow for this times the root of their areas
_PIECE = 16  # boundary segments


def as_multipolygon(geometry: BaseGeometry) -> MultiPolygon:
    """Return the polygonal part of a geometry as a MultiPolygon (points and lines are dropped)."""
    if isinstance(geometry, MultiPolygon):
        return geometry
    parts = shapely.get_parts(geometry)
    return MultiPolygon([p for p in shapely.get_parts(parts) if isinstance(p, Polygon) and not p.is_empty])


def _ring(coordinates: FloatArray, counter_clockwise: bool) -> FloatArray:
    ring = np.ascontiguousarray(coordinates[:-1, :2])
    x, y = ring[:, 0], ring[:, 1]
    area = float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))
    return ring if (area > 0.0) == counter_clockwise else ring[::-1].copy()


@dataclass(frozen=True)
class LostPart:
    """What a sensor saw last that is silent now.

    Parameters
    ----------
    sensor_id : str
    stamp : float or None
        Of its last usable scan [s]; None when there never was one.
    region : shapely.MultiPolygon
        What that scan showed to be free [m, map]; empty when there never was one.
    """

    sensor_id: str
    stamp: float | None
    region: MultiPolygon


@dataclass(frozen=True)
class UnoccupiedArea:
    """What is known to be free of obstacles; everything else counts as obstacle (Ch. 3, A(t)).

    Parameters
    ----------
    stamp : float
        Time for which the area holds [s].
    region : shapely.MultiPolygon
        Closed polygons with holes [m, map], possibly empty.
    contradictions : mapping of str to int
        Per sensor: returns that lie well inside what other sensors called free.
    lost : tuple of LostPart
        One for every sensor that is silent at the stamp; explains refusals, changes no decision.
    """

    stamp: float
    region: MultiPolygon
    contradictions: Mapping[str, int] = field(default_factory=dict)
    lost: tuple[LostPart, ...] = ()

    def __post_init__(self) -> None:
        # One orientation everywhere: an area that went through a message plans to the last bit like the original.
        object.__setattr__(self, "region", shapely.orient_polygons(self.region))

    @cached_property
    def rings(self) -> tuple[FloatArray, ...]:
        """Open boundary rings, each (N, 2) [m, map]: an exterior (counter-clockwise), then its holes (clockwise)."""
        rings: list[FloatArray] = []
        for polygon in self.region.geoms:
            rings.append(_ring(shapely.get_coordinates(polygon.exterior), True))
            rings.extend(_ring(shapely.get_coordinates(hole), False) for hole in polygon.interiors)
        return tuple(rings)

    @classmethod
    def from_rings(
        cls, stamp: float, rings: Sequence[FloatArray], contradictions: Mapping[str, int] | None = None
    ) -> UnoccupiedArea:
        """Build the area from rings in the order of `rings`; orientation tells exteriors from holes.

        Raises
        ------
        InvalidInput
            If a ring has fewer than three points, is not finite, or a hole precedes every exterior.
        """
        polygons: list[tuple[FloatArray, list[FloatArray]]] = []
        for index, ring in enumerate(rings):
            points = np.asarray(ring, dtype=np.float64)
            if (
                points.ndim != 2
                or points.shape[0] < 3
                or points.shape[1] != 2
                or not np.isfinite(points).all()
            ):
                raise InvalidInput(
                    f"ring {index} has shape {points.shape}: expected at least three finite points"
                )
            x, y = points[:, 0], points[:, 1]
            if float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) > 0.0:
                polygons.append((points, []))
            elif polygons:
                polygons[-1][1].append(points)
            else:
                raise InvalidInput(f"ring {index} is a hole (clockwise) without an exterior before it")
        region = MultiPolygon([Polygon(exterior, holes) for exterior, holes in polygons])
        return cls(stamp, region, dict(contradictions or {}))

    @cached_property
    def clearance_field(self) -> ClearanceField:
        """Signed distance to the boundary of the area, for many points at once."""
        return ClearanceField(self.rings)

    def restamped(
        self,
        stamp: float,
        contradictions: Mapping[str, int] | None = None,
        lost: tuple[LostPart, ...] | None = None,
    ) -> UnoccupiedArea:
        """The same region at another time [s], sharing what was computed from it."""
        contradictions = self.contradictions if contradictions is None else contradictions
        twin = UnoccupiedArea(stamp, self.region, contradictions, self.lost if lost is None else lost)
        twin.__dict__["rings"] = self.rings
        twin.__dict__["clearance_field"] = self.clearance_field
        return twin

    def clearance(self, points: FloatArray, limit: float = math.inf) -> FloatArray:
        """Signed distance of points (N, 2) [m, map] to the boundary of the area [m]; negative outside.

        Distances beyond the limit [m] need not be told apart, see `ClearanceField.query`.
        """
        return self.clearance_field.query(points, limit)[0]

    @property
    def is_empty(self) -> bool:
        """Whether nothing is known to be free."""
        return bool(self.region.is_empty)


def shrink(geometry: BaseGeometry, distance: float) -> MultiPolygon:
    """Points of the geometry at least `distance` [m] inside its boundary, never more than that.

    Shapely rounds corners by chords of the arc, which would add free space; the distance is enlarged by at most 0.3 %,
    so that the result errs on the side of less.
    """
    if distance <= 0.0:
        return as_multipolygon(geometry)
    if _is_ragged(geometry):
        return as_multipolygon(difference(geometry, _boundary_band(geometry, distance)))
    return as_multipolygon(geometry.buffer(-_outside(distance), quad_segs=_segments(distance)))


def _is_ragged(geometry: BaseGeometry) -> bool:
    """Whether `_boundary_band` is faster than one buffer of the whole.

    It is for many vertices, and for fans of slits that all meet at a scanner, as scans full of holes leave them: there
    the offset lines of every slit cross those of every other one (2,000 vertices: 0.8 to 2 s against 0.06 s).
    """
    vertices = int(shapely.get_num_coordinates(geometry))
    if not _SLIT_VERTICES < vertices <= _MANY_VERTICES:
        return vertices > _MANY_VERTICES
    holes = [hole for polygon in as_multipolygon(geometry).geoms for hole in polygon.interiors]
    compact = _SLIT_LENGTH * math.sqrt(geometry.area)
    # Around obstacles an outline may be long as well, but a slit has next to no area.
    compact += _OBSTACLE_LENGTH * sum(math.sqrt(Polygon(hole).area) for hole in holes)
    return bool(geometry.length > compact)


def _segments(distance: float) -> int:
    return _FINE if distance < 1.0 else _COARSE


def _outside(distance: float | FloatArray, segments: int | None = None) -> float | FloatArray:
    """Radius of a polygonal arc of shapely that lies outside of the true circle everywhere.

    Its corners are on the circle. GEOS rounds the number of chords of a partial arc, so that one chord may span up to
    1.5 times a quarter circle / segments.
    """
    segments = segments or _segments(float(np.max(distance)))
    return distance / math.cos(1.5 * math.pi / (4 * segments))


def _boundary_band(geometry: BaseGeometry, distance: float) -> BaseGeometry:
    """All points nearer to the boundary than `distance` [m], as a union of the bands of short pieces.

    For ragged outlines of many vertices, as real scans give, six times as fast as one buffer of the whole.
    """
    pieces = []
    for ring in shapely.get_rings(shapely.get_parts(geometry)):
        points = shapely.get_coordinates(ring)
        pieces += [
            shapely.linestrings(points[begin : begin + _PIECE + 1])
            for begin in range(0, len(points) - 1, _PIECE)
        ]
    bands = shapely.buffer(np.array(pieces), _outside(distance), quad_segs=_segments(distance))
    return union_all(bands)


def grow(geometry: BaseGeometry, distance: float) -> BaseGeometry:
    """Points within `distance` [m] of the geometry, never fewer than that (for obstacles)."""
    return geometry.buffer(_outside(distance), quad_segs=_segments(distance))


def reduce_area(
    region: BaseGeometry, distance: float, simplification: float = 0.0, quick: bool = False
) -> MultiPolygon:
    """The d-reduction R[region, distance] (Ch. 3), conservative.

    Parameters
    ----------
    region : shapely geometry
        Polygons [m, map].
    distance : float
        Distance to keep from the boundary [m].
    simplification : float
        Tolerance [m] of leaving out points, of the boundary before and of the result after the reduction. The latter
        can move the start of a ring by twice as much, so the reduction is enlarged by that.
    quick : bool
        Where rings touch with points left out, leave out fewer instead of mending them: up to twice as fast, and the
        result has some more points.

    Returns
    -------
    shapely.MultiPolygon
        Subset of the exact reduction, short of it by at most 5 `simplification` + 2.1 % of the distance (1.1 % for
        chords that replace arcs, 1 % by which GEOS levels dents of the outline).
    """
    if simplification <= 0.0:
        return shrink(region, distance)
    left = shrink(_thinned(region, simplification, quick), distance + 2.0 * simplification)
    simple = shapely.simplify(left, simplification, preserve_topology=True)
    return as_multipolygon(simple if simple.is_valid else shapely.make_valid(simple))


def _thinned(region: BaseGeometry, tolerance: float, quick: bool) -> BaseGeometry:
    for finer in _FINER if quick else _FINER[:1]:
        thinned = _with_fewer_points(region, tolerance / finer)
        if thinned.is_valid:
            return thinned
    # A chord that replaces points may touch another ring: what both enclose counts as free then.
    return region if quick else intersection(shapely.make_valid(thinned), region)


def _with_fewer_points(region: BaseGeometry, tolerance: float) -> MultiPolygon:
    polygons = []
    for polygon in as_multipolygon(region).geoms:
        exterior = thin_ring(_ring(shapely.get_coordinates(polygon.exterior), True), tolerance)
        holes = [
            thin_ring(_ring(shapely.get_coordinates(hole), False), tolerance) for hole in polygon.interiors
        ]
        polygons.append(Polygon(exterior, holes))
    return MultiPolygon(polygons)


def component_at(region: MultiPolygon, point: FloatArray) -> Polygon | None:
    """The component of the region that holds the point (2,) [m, map], or None."""
    probe = Point(float(point[0]), float(point[1]))
    for polygon in region.geoms:
        if polygon.covers(probe):
            return polygon
    return None


def remove_disks(
    region: MultiPolygon, centres: FloatArray, radii: FloatArray, simple: bool = False
) -> MultiPolygon:
    """Remove the disks of robots from the region (Ch. 3, unoccupied area).

    Parameters
    ----------
    region : shapely.MultiPolygon
    centres : ndarray, shape (K, 2)
        Robot positions [m, map]. Never pass the planned robot's own (deviation C3-1).
    radii : ndarray, shape (K,)
        Radii of the disks [m]; the removed polygon contains the whole disk.
    simple : bool
        Polygons of 16 corners, up to 2 % larger than the disks, instead of 32 and 1.1 %.
    """
    if len(centres) == 0:
        return region
    radii = np.asarray(radii, dtype=np.float64)
    # Around a point the chords are all alike.
    enlarged = radii / math.cos(math.pi / (4 * _SIMPLE)) if simple else _outside(radii, _COARSE)
    disks = shapely.buffer(
        shapely.points(np.asarray(centres, dtype=np.float64)),
        enlarged,
        quad_segs=_SIMPLE if simple else _COARSE,
    )
    return as_multipolygon(difference(region, union_all(disks)))
