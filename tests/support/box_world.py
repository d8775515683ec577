"""A world of boxes for tests: exact ranges of cameras, exact distances of points."""

from __future__ import annotations

import numpy as np

from snnav_core.sensing.depth import DepthCamera, DepthImage
from snnav_core.types import FloatArray


def ranges(camera: DepthCamera, boxes: FloatArray, room: FloatArray) -> FloatArray:
    """Distances along all rays to the nearest of boxes (K, 2, 3), or to the room (2, 3) around, (rows, columns)."""
    rays = camera.model.rays() @ camera.rotation.T
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / rays
        to_room = (room[:, None, None, :] - camera.position) * inverse
        nearest = np.maximum(to_room[0], to_room[1]).min(axis=-1)
        for low, high in boxes:
            one, other = (low - camera.position) * inverse, (high - camera.position) * inverse
            enter = np.minimum(one, other).max(axis=-1)
            leave = np.maximum(one, other).min(axis=-1)
            met = (enter <= leave) & (enter > 0.0)
            nearest = np.where(met, np.minimum(nearest, enter), nearest)
    return nearest


def image(camera: DepthCamera, boxes: FloatArray, room: FloatArray, stamp: float = 0.0) -> DepthImage:
    return DepthImage(stamp, ranges(camera, boxes, room))


def distance(points: FloatArray, boxes: FloatArray) -> FloatArray:
    """Distance of points (..., 3) to the nearest box (K, 2, 3)."""
    away = np.full(points.shape[:-1], np.inf)
    for low, high in boxes:
        outside = np.maximum(np.maximum(low - points, points - high), 0.0)
        away = np.minimum(away, np.linalg.norm(outside, axis=-1))
    return away
