"""The region that tracked bodies leave: what they explain counts as free, all else that was not seen as standing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
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

_RIM = 0.02  # [m] around hits that belongs to what was hit
_NEAR_HOLE = 0.1  # [m] from a hole to the hits on its rim
_LEAST_DEPTH = 0.3  # [m] behind its hits that even a small body may reach
_LONGEST_LINK = 0.5  # [m] between neighbouring hits on one surface that is looked for around a body
_OVERLAP = 1e-6  # [m] by which pieces are grown, so that no slit stays between them


def build_scene(
    time: float,
    area: UnoccupiedArea,
    returns: FusedReturns,
    owned: NDArray[np.bool_],
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
    owned : ndarray of bool, shape (K,)
        Hits on bodies that move.
    tracks : sequence of Track
    settings : TrackerSettings
    """
    moving, explained = [], []
    for track in tracks:
        if not track.moving:
            continue
        seen = track.seen == time
        outline, parts = _outline(time, area, track, returns, ~owned)
        unseen_for = time - float(track.samples[-1].times.mean())
        doubt = settings.range_noise + unseen_for * track.deviation
        deviation = min(track.deviation, settings.top_speed)
        moving.append(MovingObstacle(track.id, outline, 0.0, track.velocity, time, doubt, deviation))
        if seen:
            explained.append(parts)
    region = as_multipolygon(union_all([area.region, *explained])) if explained else area.region
    standing, exteriors = _standing(time, region, tracks, settings)
    return TrackedScene(time, (*moving, *standing), exteriors)


def _surfaces(returns: FusedReturns, chosen: NDArray[np.bool_], around: Polygon) -> NDArray[np.object_]:
    """What was hit near a body and is not it: the hits, and the links between neighbours on one surface."""
    low, high = np.array(around.bounds[:2]) - _LONGEST_LINK, np.array(around.bounds[2:]) + _LONGEST_LINK
    near = chosen & ((returns.points >= low) & (returns.points <= high)).all(axis=1)
    links = np.flatnonzero((np.diff(returns.surfaces) == 0) & near[1:] & near[:-1])
    ends = np.stack((returns.points[links], returns.points[links + 1]), axis=1)
    return np.concatenate((shapely.points(returns.points[near]), shapely.linestrings(ends)))


def _outline(
    time: float, area: UnoccupiedArea, track: Track, returns: FusedReturns, others: NDArray[np.bool_]
) -> tuple[FloatArray, BaseGeometry]:
    """Convex outline of a moving body (N, 2), and what is free as soon as it has gone.

    The outline covers all hits within the window, undone for the motion, and what was not seen behind them, as deep as
    the body is wide. Only what the hits of now enclose is free without it, or the whole hole when nothing else was hit
    on its rim.
    """
    now = np.concatenate((track.samples[-1].points, track.hits_at(time)))
    hull = shapely.buffer(shapely.MultiPoint(now).convex_hull, _RIM, quad_segs=2)
    around = shapely.buffer(hull, max(_LEAST_DEPTH, track.extent), quad_segs=4)
    unseen = shapely.get_parts(difference(around, area.region))
    hidden = [part for part in unseen if part.intersects(hull)]
    accumulated = shapely.buffer(shapely.MultiPoint(track.all_hits_at(time)).convex_hull, _RIM, quad_segs=2)
    outline = union_all([hull, accumulated, *hidden]).convex_hull
    fixed = _surfaces(returns, others, around)
    rim = around.exterior
    holes = [
        part for part in hidden if part.distance(rim) > 0.0 and not shapely.dwithin(fixed, part, _RIM).any()
    ]
    explained = union_all([hull, *shapely.buffer(holes, _OVERLAP)]) if holes else hull
    touched = fixed[shapely.dwithin(fixed, explained, _RIM)]
    if len(touched):
        explained = difference(explained, shapely.buffer(union_all(touched), _RIM, quad_segs=2))
    return _counter_clockwise(outline), explained


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
