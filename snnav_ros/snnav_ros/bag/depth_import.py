"""Turn depth images and PCD files into a rosbag2 bag of organized clouds, with models and poses of the cameras."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from snnav_core.types import FloatArray
from snnav_ros.bag.cameras_file import OPTICAL, CameraFiles, CamerasFile
from snnav_ros.bag.depth_images import read_points
from snnav_ros.bag.messages import camera_info, organized_cloud, static_transforms
from snnav_ros.bag.writer import BagWriter
from snnav_ros.convert import MAP_FRAME

__all__ = ["DepthSummary", "write_depth_bag"]

_NANOSECONDS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class DepthSummary:
    """What a bag holds of one camera: images, share of pixels with a reading, least and largest range [m]."""

    camera: str
    images: int
    valid: float
    nearest: float
    farthest: float


def write_depth_bag(
    source: CamerasFile, directory: str | Path, progress: Callable[[int], None] | None = None
) -> list[DepthSummary]:
    """Write a bag with a cloud and a camera model for every image, and the poses of all cameras.

    Parameters
    ----------
    source : CamerasFile
    directory : path-like
        The bag to make; it must not exist.
    progress : callable, optional
        Called with the number of images written.

    Raises
    ------
    BagError
        If a file cannot be used or the bag cannot be written; there is no bag then.

    Notes
    -----
    Clouds are given in the frame of the sensor (x forward, y left, z up), camera models in ``<id>_optical``
    (z forward, REP 103). Both frames hang on the map by ``/tf_static``.
    """
    images = sorted(
        ((index, number) for number, entry in enumerate(source.cameras) for index in range(len(entry.files)))
    )
    ranges: list[list[FloatArray]] = [[] for _ in source.cameras]
    with BagWriter(directory) as bag:
        bag.write("tf_static", static_transforms(0, _frames(source)), 0)
        for done, (index, number) in enumerate(images):
            entry = source.cameras[number]
            points = read_points(entry.files[index], entry)
            ranges[number].append(np.linalg.norm(points, axis=-1))
            stamp_ns = round(index * source.period * _NANOSECONDS)
            _write(bag, entry, points, stamp_ns)
            if progress is not None:
                progress(done + 1)
    return [_summary(entry.camera.id, each) for entry, each in zip(source.cameras, ranges, strict=True)]


def _write(bag: BagWriter, entry: CameraFiles, points: FloatArray, stamp_ns: int) -> None:
    """Write one image: the cloud in the sensor's frame and the model of the camera."""
    name, model = entry.camera.id, entry.camera.model
    focal = (1.0 / model.column_step, 1.0 / model.row_step)
    centre = (model.column_centre, model.row_centre)
    cloud = organized_cloud(stamp_ns, name, points @ OPTICAL.T)
    info = camera_info(stamp_ns, f"{name}_optical", (model.columns, model.rows), focal, centre)
    bag.write(f"sensors/{name}/camera_info", info, stamp_ns)
    bag.write(f"sensors/{name}/points", cloud, stamp_ns)


def _frames(source: CamerasFile) -> list[tuple[str, str, FloatArray, FloatArray]]:
    """Return parent, child, position [m] and rotation of every frame."""
    frames: list[tuple[str, str, FloatArray, FloatArray]] = []
    for entry in source.cameras:
        camera = entry.camera
        frames.append((MAP_FRAME, camera.id, camera.position, camera.rotation))
        frames.append((camera.id, f"{camera.id}_optical", np.zeros(3), OPTICAL))
    return frames


def _summary(camera: str, ranges: list[FloatArray]) -> DepthSummary:
    values = np.concatenate([each.ravel() for each in ranges])
    valid = np.isfinite(values)
    measured = values[valid]
    return DepthSummary(
        camera, len(ranges), float(valid.mean()), float(measured.min()), float(measured.max())
    )
