"""From recorded images to what is free: the cameras judged by each other, and the region of all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from snnav_core.area.doubted import CameraErrors, Outlook, common_area, least_of
from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_core.sensing.depth import DepthImage
from snnav_core.types import FloatArray
from snnav_ros.bag.errors import NetworkError
from snnav_ros.bag.recorded_depth import DepthRecording
from snnav_ros.bag.settings import FreeSpaceSettings
from snnav_sim.report.cross_view import CrossView, compare_views, values_at

__all__ = ["FreeSpace", "find_free_space"]

_SAME_TIME = 0.05  # [s] between two images that are compared with each other
_OUTLIERS = 0.1  # percent of the hits on either side that the grid need not hold


@dataclass(frozen=True)
class FreeSpace:
    """What some cameras show.

    Parameters
    ----------
    grid : Grid
    views : tuple of CrossView
        Every camera judged by every other one.
    area : SpatialArea
        The region that all cameras together show free over the whole recording, errors taken off.
    hits : ndarray, shape (N, 3)
        All measurements of all images of all cameras [m, map].
    hits_inside : int
        How many of these lie in the region.
    """

    grid: Grid
    views: tuple[CrossView, ...]
    area: SpatialArea
    hits: FloatArray
    hits_inside: int


def find_free_space(
    recording: DepthRecording, settings: FreeSpaceSettings, progress: Callable[[int], None] | None = None
) -> FreeSpace:
    """Carve, judge and unite.

    Parameters
    ----------
    recording : DepthRecording
    settings : FreeSpaceSettings
    progress : callable, optional
        Called with the number of steps done: one for every pair of cameras, and one for the region.

    Raises
    ------
    NetworkError
        If nothing is seen that would fill a cell.
    """
    errors = CameraErrors(settings.range_accuracy, settings.range_growth, settings.pose_accuracy)
    hits = np.concatenate(
        [
            points[np.isfinite(points[:, 0])]
            for camera in recording.cameras
            for image in recording.images[camera.id]
            for points in [camera.cloud(image).reshape(-1, 3)]
        ]
    )
    grid = _grid(recording, hits, settings)
    outlooks = {camera.id: Outlook(camera, grid, errors) for camera in recording.cameras}
    views: list[CrossView] = []
    for one, other in permutations(recording.cameras, 2):
        pairs = _pairs(recording.images[one.id], recording.images[other.id])
        views.append(compare_views(outlooks[one.id], other, pairs, grid, settings.pose_accuracy))
        if progress is not None:
            progress(len(views))
    shown = [outlooks[name].clearance(least_of(images, 0.0)) for name, images in recording.images.items()]
    area = common_area(shown, grid, settings.pose_accuracy, 0.0)
    inside = int(np.count_nonzero(values_at(area.moving, grid, hits) > 0.0))
    return FreeSpace(grid, tuple(views), area, hits, inside)


def _grid(recording: DepthRecording, hits: FloatArray, settings: FreeSpaceSettings) -> Grid:
    """Return the cells of the box around the cameras and nearly all that they hit; outside nothing is free."""
    places = np.array([camera.position for camera in recording.cameras])
    low, high = np.percentile(hits, (_OUTLIERS, 100.0 - _OUTLIERS), axis=0)
    spacing = settings.grid_spacing
    low = np.floor(np.minimum(low, places.min(axis=0)) / spacing) * spacing
    high = np.ceil(np.maximum(high, places.max(axis=0)) / spacing) * spacing
    if not (high - low >= spacing).all():
        raise NetworkError(
            f"{recording.path}: what is seen fills no cell of {spacing:g} m; give another --spacing"
        )
    return Grid.covering(low, high, spacing)


def _pairs(images: Sequence[DepthImage], others: Sequence[DepthImage]) -> list[tuple[DepthImage, DepthImage]]:
    """Return the images of two cameras that were taken at the same time."""
    stamps = np.array([image.stamp for image in others])
    nearest = [int(np.argmin(np.abs(stamps - image.stamp))) for image in images]
    return [
        (image, others[index])
        for image, index in zip(images, nearest, strict=True)
        if abs(others[index].stamp - image.stamp) <= _SAME_TIME
    ]
