"""Read one exposure of a depth camera from a file, as points in the camera's optical frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from snnav_core.types import FloatArray
from snnav_ros.bag.cameras_file import CameraFiles
from snnav_ros.bag.errors import BagError, one_line
from snnav_ros.bag.pcd import read_pcd

__all__ = ["read_points"]

_WHOLE = ("I;16", "I;16B", "I;16L", "I")


def read_points(path: Path, entry: CameraFiles) -> FloatArray:
    """Return the points of a depth image or PCD file, (rows, columns, 3) [m, optical frame], NaN without reading.

    Raises
    ------
    BagError
        One line: the file cannot be read, is cut short, has another size or no reading at all.
    """
    points = read_pcd(path) if path.suffix.lower() == ".pcd" else _from_depths(path, entry)
    expected = (entry.camera.model.rows, entry.camera.model.columns)
    if points.shape[:2] != expected:
        raise BagError(
            f"{path}: has {points.shape[1]} x {points.shape[0]} pixels, the size of {entry.camera.id} is "
            f"[{expected[1]}, {expected[0]}]; correct one of them"
        )
    if path.suffix.lower() == ".pcd":
        with np.errstate(invalid="ignore"):
            measured = np.isfinite(points).all(axis=-1) & (points[..., 2] > 0.0)
        points = np.where(measured[..., None], points, np.nan)
        _check_rays(path, entry, points)
    if not np.isfinite(points).any():
        raise BagError(f"{path}: holds no reading at all; leave the file out")
    return points


def _from_depths(path: Path, entry: CameraFiles) -> FloatArray:
    """Return the points of an image of depths along the optical axis."""
    try:
        with Image.open(path) as image:
            mode = image.mode
            counts = np.asarray(image)
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        reason = getattr(error, "strerror", None) or one_line(error)
        raise BagError(
            f"{path}: cannot be read ({reason}); give a whole 16-bit image, or copy it again"
        ) from None
    if mode not in _WHOLE or counts.ndim != 2:
        raise BagError(f"{path}: is an image of mode {mode}; depths are 16-bit grey values")
    depth = np.where(counts > 0, counts * entry.unit, np.nan)
    expected = (entry.camera.model.rows, entry.camera.model.columns)
    return entry.rays * depth[..., None] if depth.shape == expected else np.zeros((*depth.shape, 3))


def _check_rays(path: Path, entry: CameraFiles, points: FloatArray) -> None:
    """Make sure that the points of a cloud lie where its pixels look."""
    column_step, row_step = entry.camera.model.column_step, entry.camera.model.row_step
    off = np.abs(points[..., :2] / points[..., 2:] - entry.rays[..., :2]) / (column_step, row_step)
    worst = float(np.nanmax(off, initial=0.0))
    if worst > 1.0:
        raise BagError(
            f"{path}: points lie up to {worst:.1f} pixels off where focal and centre of {entry.camera.id} say that "
            "their pixels look; correct these, or give points in the optical frame (z forward)"
        )
