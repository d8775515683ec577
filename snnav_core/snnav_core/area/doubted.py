"""The free region of real depth cameras, whose ranges and poses are known to some accuracy only."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from snnav_core.area.cell_distance import distance_to_cells
from snnav_core.area.grid import Grid
from snnav_core.area.spatial import SpatialArea
from snnav_core.area.spatial_fusion import SpatialFusion, SpatialFusionSettings
from snnav_core.errors import InvalidInput
from snnav_core.sensing.depth import DepthCamera, DepthImage

__all__ = ["CameraErrors", "Outlook", "common_area", "least_of"]


@dataclass(frozen=True, slots=True)
class CameraErrors:
    """By how much cameras are wrong at most.

    Parameters
    ----------
    range_accuracy : float
        Of a range, at any distance [m].
    range_growth : float
        A range r is wrong by this times r squared in addition [1/m]: a step of disparity means more the farther away.
    pose_accuracy : float
        By how much what a camera sees may be shifted in the map [m]: error of its position, of its direction at the
        distances in use, of its lens.

    Raises
    ------
    InvalidInput
        If a number is negative or not finite.
    """

    range_accuracy: float = 0.01
    range_growth: float = 0.003
    pose_accuracy: float = 0.1

    def __post_init__(self) -> None:
        for name in ("range_accuracy", "range_growth", "pose_accuracy"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidInput(f"camera errors: {name} is {value}, must be a number of at least 0")

    def shortened(self, image: DepthImage) -> DepthImage:
        """Return an image whose ranges are shorter by the error that grows with the distance."""
        with np.errstate(invalid="ignore"):
            grown = self.range_growth * np.square(image.ranges)
            ranges = np.where(np.isfinite(image.ranges), image.ranges - grown, image.ranges)
        return DepthImage(image.stamp, ranges)


class Outlook:
    """What one camera alone shows free.

    Parameters
    ----------
    camera : DepthCamera
    grid : Grid
    errors : CameraErrors
    reach : float
        Clearances beyond it are not told apart [m].
    """

    def __init__(self, camera: DepthCamera, grid: Grid, errors: CameraErrors, reach: float = 2.0) -> None:
        self.camera = camera
        self._errors = errors
        settings = SpatialFusionSettings(
            grid, walled_in=False, range_accuracy=errors.range_accuracy, reach=reach
        )
        self._fusion = SpatialFusion([camera], settings)

    def clearance(self, image: DepthImage) -> NDArray[np.float32]:
        """Return the distance from every cell's centre to what one image does not show free, (nx, ny, nz) [m].

        Errors of ranges are taken off, that of the pose is not; 0 where nothing is shown.
        """
        self._fusion.reset()
        self._fusion.add_image(self.camera.id, self._errors.shortened(image))
        return self._fusion.area(image.stamp).moving


def least_of(images: Sequence[DepthImage], stamp: float) -> DepthImage:
    """Return the least range of every pixel in any of some images of one camera: what stood there at any time counts.

    A pixel says nothing only where no image has a range for it.

    Raises
    ------
    InvalidInput
        If there is no image, or they have different sizes.
    """
    if not images or len({image.ranges.shape for image in images}) != 1:
        raise InvalidInput("the least of images needs at least one, all of the same size")
    stacked = np.stack([image.ranges for image in images])
    measured = np.where(np.isfinite(stacked) & (stacked > 0.0), stacked, np.inf).min(axis=0)
    return DepthImage(stamp, np.where(np.isfinite(measured), measured, np.nan))


def common_area(
    clearances: Sequence[NDArray[np.float32]],
    grid: Grid,
    pose_accuracy: float,
    stamp: float,
    reach: float = 2.0,
) -> SpatialArea:
    """Return the union of what several cameras show free, each less the accuracy of its pose.

    Parameters
    ----------
    clearances : sequence of ndarray of float32, shape (nx, ny, nz)
        Of each camera alone (`Outlook.clearance`) [m].
    grid : Grid
    pose_accuracy : float
        [m]; taken off each before they are united: two regions shifted apart from each other must not close a gap in
        which a body stands.
    stamp, reach : float
        Of the area [s]; clearances beyond it are not told apart [m].

    Notes
    -----
    A cell is free when one camera alone shows it whole, and all within `pose_accuracy` of it.
    """
    free = np.zeros(grid.shape, dtype=np.bool_)
    for clearance in clearances:
        free |= clearance >= np.float32(pose_accuracy + grid.half_diagonal)
    solid = np.pad((~free).astype(np.uint8), 1, constant_values=1)
    distance, _ = distance_to_cells(solid, grid.spacing, reach)
    moving = np.ascontiguousarray(distance[1:-1, 1:-1, 1:-1])
    return SpatialArea(stamp, grid, moving, np.full(grid.shape, reach, dtype=np.float32))
