"""Depth cameras and what one image of them says (Ch. 4, ToF camera and spinning range finder)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from snnav_core.errors import InvalidInput, ScanError
from snnav_core.types import FloatArray

__all__ = ["CameraModel", "DepthCamera", "DepthImage", "equal_angle", "looking_at", "pinhole"]

_ROTATION_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True)
class CameraModel:
    """Which direction every pixel looks in.

    Parameters
    ----------
    kind : {"equal_angle", "pinhole"}
        "equal_angle": columns are equal steps of azimuth, rows equal steps of elevation (C4-20); a spinning range
        finder is one with 360 degrees. "pinhole": columns and rows are equal steps of the tangent.
    columns, rows : int
        Size of the image.
    column_step, row_step : float
        Angle [rad] or tangent per pixel.
    column_centre, row_centre : float
        Pixel coordinates of the optical axis.
    range_min, range_max : float
        Radial distances outside are no measurement [m].

    Raises
    ------
    InvalidInput
        If a size, step or range is not positive, or an equal-angle image covers more than a sphere.
    """

    kind: Literal["equal_angle", "pinhole"]
    columns: int
    rows: int
    column_step: float
    row_step: float
    column_centre: float
    row_centre: float
    range_min: float = 0.05
    range_max: float = 9.0

    def __post_init__(self) -> None:
        if self.kind not in ("equal_angle", "pinhole"):
            raise InvalidInput(f"camera model is {self.kind!r}, must be 'equal_angle' or 'pinhole'")
        if min(self.columns, self.rows) < 2:
            raise InvalidInput(f"camera image has {self.columns} x {self.rows} pixels, needs at least 2 x 2")
        for name in ("column_step", "row_step", "range_max"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InvalidInput(f"camera: {name} is {value}, must be a positive number")
        if not 0.0 <= self.range_min < self.range_max:
            raise InvalidInput(f"camera: range_min is {self.range_min}, must lie in [0, {self.range_max})")
        if self.kind == "equal_angle":
            turn, lift = self.columns * self.column_step, self.rows * self.row_step
            if turn > 2.0 * math.pi + 1e-9 or lift > math.pi + 1e-9:
                raise InvalidInput(
                    f"camera: the image covers {math.degrees(turn):.1f} x {math.degrees(lift):.1f} degrees, "
                    "at most 360 x 180 are possible"
                )

    @property
    def around(self) -> bool:
        """Whether the first column is the neighbour of the last (a spinning range finder)."""
        whole = abs(self.columns * self.column_step - 2.0 * math.pi) < 0.5 * self.column_step
        return self.kind == "equal_angle" and whole

    def rays(self) -> FloatArray:
        """Unit vectors of all pixels in the camera frame (x forward, y left, z up), shape (rows, columns, 3)."""
        return _rays(self)


@lru_cache(maxsize=64)
def _rays(model: CameraModel) -> FloatArray:
    """Return the rays of a model; they are needed for every image, and must not be written to."""
    left = -(np.arange(model.columns) - model.column_centre) * model.column_step
    up = -(np.arange(model.rows) - model.row_centre) * model.row_step
    if model.kind == "equal_angle":
        azimuth, elevation = np.meshgrid(left, up)
        level = np.cos(elevation)
        rays = np.stack((level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)), axis=-1)
    else:
        sideways, upwards = np.meshgrid(left, up)
        rays = np.stack((np.ones_like(sideways), sideways, upwards), axis=-1)
        rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    rays.setflags(write=False)
    return rays


def equal_angle(
    columns: int = 128,
    rows: int = 128,
    width: float = math.radians(135.0),
    height: float = math.radians(135.0),
    range_min: float = 0.05,
    range_max: float = 9.0,
) -> CameraModel:
    """Return the model of a ToF camera, or of a spinning range finder (`width` 2 pi), by its field of view [rad].

    The defaults are those of the thesis (128 x 128 pixels, 135 x 135 degrees, 9 m).
    """
    centre = (0.5 * (columns - 1), 0.5 * (rows - 1))
    steps = (width / columns, height / rows)
    return CameraModel("equal_angle", columns, rows, *steps, *centre, range_min, range_max)


def pinhole(
    columns: int,
    rows: int,
    focal: tuple[float, float],
    centre: tuple[float, float],
    range_min: float = 0.05,
    range_max: float = 9.0,
) -> CameraModel:
    """Return the model of a pinhole camera by focal lengths and principal point, both as (column, row) [pixels]."""
    steps = (1.0 / focal[0], 1.0 / focal[1])
    return CameraModel("pinhole", columns, rows, *steps, *centre, range_min, range_max)


def looking_at(position: FloatArray, target: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) camera -> map of a camera that looks from a position to a target (3,) [m, map].

    Its y axis is level; straight up or down it points to y of the map.

    Raises
    ------
    InvalidInput
        If both points are the same.
    """
    forward = np.asarray(target, dtype=np.float64) - np.asarray(position, dtype=np.float64)
    length = float(np.linalg.norm(forward))
    if not length > 0.0:
        raise InvalidInput(f"a camera at {list(position)} cannot look at its own position")
    forward = forward / length
    left = np.cross((0.0, 0.0, 1.0), forward)
    width = float(np.linalg.norm(left))
    left = left / width if width > 1e-9 else np.array([0.0, 1.0, 0.0])
    return np.column_stack((forward, left, np.cross(forward, left)))


@dataclass(frozen=True)
class DepthCamera:
    """A camera that does not move.

    Parameters
    ----------
    id : str
    position : array_like, shape (3,)
        [m, map]
    rotation : array_like, shape (3, 3)
        Camera frame (x forward, y left, z up) -> map.
    model : CameraModel
    inf_is_free : bool
        Whether a pixel without return saw free space up to `range_max` (REP 117).

    Raises
    ------
    InvalidInput
        If position or rotation are not finite, or the rotation is none.
    """

    id: str
    position: FloatArray
    rotation: FloatArray
    model: CameraModel
    inf_is_free: bool = False

    def __post_init__(self) -> None:
        position = np.array(self.position, dtype=np.float64)
        rotation = np.array(self.rotation, dtype=np.float64)
        if position.shape != (3,) or not np.isfinite(position).all():
            raise InvalidInput(f"camera {self.id!r}: position is {position.tolist()}, expected three numbers")
        proper = rotation.shape == (3, 3) and bool(np.isfinite(rotation).all())
        if not proper or np.abs(rotation @ rotation.T - np.eye(3)).max() > _ROTATION_TOLERANCE:
            raise InvalidInput(f"camera {self.id!r}: rotation is no rotation: {rotation.tolist()}")
        if np.linalg.det(rotation) < 0.0:
            raise InvalidInput(f"camera {self.id!r}: rotation mirrors; its axes must be right-handed")
        for name, array in (("position", position), ("rotation", rotation)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def cloud(self, image: DepthImage) -> FloatArray:
        """Return the points that an image saw, (rows, columns, 3) [m, map], NaN where there is no measurement."""
        seen = image.measured(self.model)
        points: FloatArray = self.position + (self.model.rays() * seen[..., None]) @ self.rotation.T
        return points

    def image_from_points(self, stamp: float, points: FloatArray) -> DepthImage:
        """Return the image of an organized cloud in the camera frame, (rows, columns, 3) [m]; NaN is kept.

        Raises
        ------
        ScanError
            If the cloud has not the size of the image, or its points do not lie on the rays of the pixels.
        """
        expected = (self.model.rows, self.model.columns, 3)
        if points.shape != expected:
            raise ScanError(f"camera {self.id!r}: cloud has shape {points.shape}, expected {expected}")
        ranges = np.linalg.norm(points, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            off = np.linalg.norm(points / ranges[..., None] - self.model.rays(), axis=-1)
        worst = float(np.nanmax(off, initial=0.0))
        step = max(self.model.column_step, self.model.row_step)
        if worst > step:
            raise ScanError(
                f"camera {self.id!r}: points lie up to {worst:.3f} rad off the rays of their pixels, "
                f"which are {step:.3f} apart; check model, field of view and frame"
            )
        return DepthImage(stamp, ranges)


@dataclass(frozen=True)
class DepthImage:
    """Radial distances of one exposure.

    Parameters
    ----------
    stamp : float
        [s]
    ranges : array_like, shape (rows, columns)
        [m]; NaN, zero, negative values and values outside the range of the camera are unknown (REP 117); +inf means
        that nothing returned.

    Raises
    ------
    ScanError
        If the array is not two-dimensional, or the stamp is not finite.
    """

    stamp: float
    ranges: FloatArray

    def __post_init__(self) -> None:
        ranges = np.array(self.ranges, dtype=np.float64)
        if ranges.ndim != 2:
            raise ScanError(f"depth image has shape {ranges.shape}, expected (rows, columns)")
        if not math.isfinite(self.stamp):
            raise ScanError(f"depth image has stamp {self.stamp}, must be finite")
        ranges.setflags(write=False)
        object.__setattr__(self, "ranges", ranges)

    def measured(self, model: CameraModel) -> FloatArray:
        """Return the ranges that are measurements, (rows, columns) [m], NaN elsewhere.

        Raises
        ------
        ScanError
            If the size of the image is not that of the camera.
        """
        self.check_size(model)
        inside = (self.ranges >= model.range_min) & (self.ranges <= model.range_max) & (self.ranges > 0.0)
        return np.where(inside, self.ranges, np.nan)

    def free_up_to(self, model: CameraModel, inf_is_free: bool) -> NDArray[np.float32]:
        """Return up to where every pixel saw nothing, (rows, columns) [m]; 0 where it says nothing.

        Raises
        ------
        ScanError
            If the size of the image is not that of the camera.
        """
        free = np.nan_to_num(self.measured(model), nan=0.0)
        if inf_is_free:
            free = np.where(np.isposinf(self.ranges), model.range_max, free)
        return free.astype(np.float32)

    def check_size(self, model: CameraModel) -> None:
        """Make sure that the image has the size of the camera's.

        Raises
        ------
        ScanError
            With both sizes.
        """
        if self.ranges.shape != (model.rows, model.columns):
            raise ScanError(
                f"depth image has {self.ranges.shape[1]} x {self.ranges.shape[0]} pixels, "
                f"the camera {model.columns} x {model.rows}; check its model"
            )
