"""The region that tracked bodies leave: what they explain counts as free, all else that was not seen as standing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment
from shapely.geometry import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

from snnav_core.area.overlay import difference, union_all
from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.area.returns import FusedReturns
from snnav_core.area.track import Track
from snnav_core.area.tracker_settings import TrackedScene, TrackerSettings
from snnav_core.obstacles import MovingObstacle
from snnav_core.types import FloatArray

__all__ = ["build_scene"]

_RIM = 0.02  # [m] around hits that belongs to the body
_NEAR_HOLE = 0.1  # [m] from a hole to the hits on its rim


def build_scene(
    time: float,
    area: UnoccupiedArea,
    returns: FusedReturns,
    tracks: Sequence[Track],
    settings: TrackerSettings,
) -> TrackedScene:
    """Say what moves, what stands, and in which region.

    Parameters
    ----------
    time : float
        [s]
    area : UnoccupiedArea
        What is free.
    returns : FusedReturns
    tracks : sequence of Track
        Their `bound` is renewed.
    settings : TrackerSettings
    """
    moving, filled = [], []
    for track in tracks:
        if track.moving:
            outline, fill = _outline(time, area, track)
            moving.append(
                MovingObstacle(
                    track.id,
                    outline,
                    0.0,
                    track.velocity,
                    time,
                    position_deviation=settings.range_noise,
                    velocity_deviation=min(track.deviation, settings.top_speed),
                )
            )
            if track.seen == time:
                filled.append(fill)
    region = as_multipolygon(union_all([area.region, *filled])) if filled else area.region
    standing, exteriors = _standing(time, region, tracks, settings)
    return TrackedScene(time, (*moving, *standing), exteriors)


def _outline(time: float, area: UnoccupiedArea, track: Track) -> tuple[FloatArray, BaseGeometry]:
    """Convex outline of a moving body (N, 2) and the part of it that its hits explain."""
    raw = np.concatenate((track.samples[-1].points, track.hits_at(time)))
    hull = shapely.buffer(shapely.MultiPoint(raw).convex_hull, _RIM, quad_segs=2)
    depth = max(0.3, track.extent)
    around = shapely.buffer(hull, depth, quad_segs=4)
    unseen = shapely.get_parts(difference(around, area.region))
    hidden = [part for part in unseen if part.intersects(hull)]
    whole = union_all([hull, *hidden]).convex_hull
    isolated = [part for part in hidden if part.distance(around.exterior) > 0.0]
    return _counter_clockwise(whole), union_all([hull, *(part.buffer(1e-6) for part in isolated)])


def _standing(
    time: float, region: MultiPolygon, tracks: Sequence[Track], settings: TrackerSettings
) -> tuple[list[MovingObstacle], tuple[FloatArray, ...]]:
    """Holes of the region as standing bodies, and the exteriors."""
    exteriors = tuple(_counter_clockwise(Polygon(polygon.exterior)) for polygon in region.geoms)
    holes = [Polygon(hole) for polygon in region.geoms for hole in polygon.interiors]
    owners = _owners(holes, [track for track in tracks if not track.moving and track.seen == time])
    bodies = []
    for index, hole in enumerate(holes):
        track = owners.get(index)
        name = f"unseen_{index + 1}" if track is None else track.id
        deviation = 0.0 if track is None else min(track.deviation, settings.top_speed)
        outline = _counter_clockwise(hole)
        bodies.append(MovingObstacle(name, outline, 0.0, np.zeros(2), time, velocity_deviation=deviation))
    return bodies, exteriors


def _owners(holes: list[Polygon], tracks: list[Track]) -> dict[int, Track]:
    """The standing body that most hits on the rim of each hole belong to, each body once."""
    if not holes or not tracks:
        return {}
    points = np.concatenate([track.samples[-1].points for track in tracks])
    owner = np.repeat(np.arange(len(tracks)), [len(track.samples[-1].points) for track in tracks])
    hits, near = shapely.STRtree(holes).query_nearest(shapely.points(points), max_distance=_NEAR_HOLE)
    votes = np.zeros((len(holes), len(tracks)))
    np.add.at(votes, (near, owner[hits]), 1.0)
    rows, columns = linear_sum_assignment(votes, maximize=True)
    return {int(r): tracks[c] for r, c in zip(rows, columns, strict=True) if votes[r, c] > 0.0}


def _counter_clockwise(polygon: Polygon) -> FloatArray:
    ring: FloatArray = shapely.get_coordinates(shapely.orient_polygons(polygon).exterior)[:-1]
    return ring
