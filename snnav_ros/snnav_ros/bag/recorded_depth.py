"""The images of fixed depth cameras in a recording, with models and poses as the recording itself gives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from snnav_core.errors import InvalidInput
from snnav_core.sensing.depth import CameraModel, DepthCamera, DepthImage, pinhole
from snnav_core.types import FloatArray
from snnav_ros.bag.cameras_file import OPTICAL
from snnav_ros.bag.errors import BagError
from snnav_ros.bag.reader import BagReader
from snnav_ros.convert import MAP_FRAME, image_from_message, nanoseconds_from_stamp

__all__ = ["DepthRecording", "read_depth_recording"]

_CLOUD, _INFO = "sensor_msgs/msg/PointCloud2", "sensor_msgs/msg/CameraInfo"
_SAME = 1e-6  # between two frames: their axes, and their places [m]
_MOST_FRAMES = 100
_WANTED = "clouds NAME/points with NAME/camera_info beside them, and /tf_static (`snnav import-depth` writes such bags)"


@dataclass(frozen=True)
class DepthRecording:
    """What is used of a bag.

    Parameters
    ----------
    path : Path
    cameras : tuple of DepthCamera
        By name.
    images : dict
        Name -> its images by time [s from the first one].
    warnings : tuple of str
        One line for every camera with clouds that cannot be used.
    """

    path: Path
    cameras: tuple[DepthCamera, ...]
    images: dict[str, tuple[DepthImage, ...]]
    warnings: tuple[str, ...] = ()


def read_depth_recording(path: str | Path, range_max: float) -> DepthRecording:
    """Read all organized clouds of a bag that have a camera model beside them.

    Parameters
    ----------
    path : path-like
        rosbag2 directory, ``.mcap``, ``.db3`` or ROS 1 ``.bag``.
    range_max : float
        Larger ranges are no measurement [m].

    Raises
    ------
    BagError
        One line: the bag cannot be read, lacks what is needed, or a camera has no usable cloud.
    """
    path = Path(path)
    with BagReader(path) as bag:
        pairs = _pairs(path, bag.topics)
        wanted = [*pairs, *pairs.values(), "/tf_static"]
        if not any(topic.strip("/") == "tf_static" for topic in bag.topics):
            raise BagError(f"{path}: no topic '/tf_static' says where its cameras are; it needs {_WANTED}")
        frames: dict[str, tuple[str, FloatArray]] = {}
        infos: dict[str, Any] = {}
        clouds: dict[str, list[Any]] = {topic: [] for topic in pairs}
        for found in bag.messages(wanted):
            if found.topic in clouds:
                clouds[found.topic].append(found.message)
            elif found.type_name == _INFO:
                infos.setdefault(found.topic, found.message)
            else:
                for each in found.message.transforms:
                    frames[each.child_frame_id.strip("/")] = (each.header.frame_id.strip("/"), _matrix(each))
    cameras, images, warnings = [], {}, []
    start = min(
        (nanoseconds_from_stamp(message.header.stamp) for some in clouds.values() for message in some),
        default=0,
    )
    for topic, name in _names(pairs).items():
        info = infos.get(pairs[topic])
        if info is None or not clouds[topic]:
            raise BagError(
                f"{path}: {topic} or {pairs[topic]} holds no message; leave the camera out of the bag"
            )
        camera = _camera(path, name, info, frames, range_max)
        good, faults = _images(path, camera, clouds[topic], frames, start)
        if not good:
            raise BagError(f"{path}: no usable cloud on {topic} ({faults[0]}); record it again")
        if faults:
            warnings.append(f"{path}: {len(faults)} clouds of {name} left out: {faults[0]}")
        cameras.append(camera)
        images[name] = good
    return DepthRecording(path, tuple(cameras), images, tuple(warnings))


def _pairs(path: Path, topics: Mapping[str, str]) -> dict[str, str]:
    """Return topic of clouds -> topic of the camera model beside it."""
    pairs = {}
    for topic, kind in topics.items():
        info = f"{topic.rpartition('/')[0]}/camera_info"
        if kind == _CLOUD and topics.get(info) == _INFO:
            pairs[topic] = info
    if not pairs:
        raise BagError(f"{path}: has no depth camera (topics {', '.join(topics)}); it needs {_WANTED}")
    return pairs


def _names(pairs: Mapping[str, str]) -> dict[str, str]:
    """Return topic -> name of the camera, by name: the last part of its namespace where that tells them apart."""
    spaces = {topic: topic.strip("/").rpartition("/")[0] or topic.strip("/") for topic in pairs}
    short = {topic: space.rpartition("/")[2] for topic, space in spaces.items()}
    chosen = short if len(set(short.values())) == len(short) else spaces
    return dict(sorted(chosen.items(), key=lambda item: item[1]))


def _matrix(transform: Any) -> FloatArray:
    """Return the (4, 4) matrix child -> parent of a geometry_msgs/TransformStamped; NaN if its rotation is none."""
    turn, shift = transform.transform.rotation, transform.transform.translation
    matrix: FloatArray = np.eye(4)
    quaternion = np.array([turn.x, turn.y, turn.z, turn.w], dtype=np.float64)
    if not (np.isfinite(quaternion).all() and np.linalg.norm(quaternion) > 0.0):
        return np.full((4, 4), np.nan)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = (shift.x, shift.y, shift.z)
    return matrix


def _placed(path: Path, frame: str, frames: Mapping[str, tuple[str, FloatArray]]) -> FloatArray:
    """Return the (4, 4) matrix from a frame to the map."""
    matrix, at = np.eye(4), frame.strip("/")
    for _ in range(_MOST_FRAMES):
        if at == MAP_FRAME:
            if not np.isfinite(matrix).all():
                raise BagError(
                    f"{path}: the pose of frame {frame!r} in /tf_static is no pose; publish it again"
                )
            return matrix
        if at not in frames:
            break
        at, step = frames[at]
        matrix = step @ matrix
    raise BagError(
        f"{path}: /tf_static does not say where frame {frame!r} is in {MAP_FRAME!r} (it ends at {at!r}); add it"
    )


def _camera(
    path: Path, name: str, info: Any, frames: Mapping[str, tuple[str, FloatArray]], range_max: float
) -> DepthCamera:
    k = np.asarray(info.k if hasattr(info, "k") else info.K, dtype=np.float64)  # ROS 1 writes it large
    if not (np.isfinite(k).all() and k[0] > 0.0 and k[4] > 0.0):
        raise BagError(
            f"{path}: the camera model of {name} has focal lengths {k[0]:g}, {k[4]:g}; calibrate it"
        )
    pose = _placed(path, info.header.frame_id, frames)
    try:
        model: CameraModel = pinhole(
            int(info.width), int(info.height), (k[0], k[4]), (k[2], k[5]), range_max=range_max
        )
        return DepthCamera(name, pose[:3, 3], pose[:3, :3] @ OPTICAL.T, model)
    except InvalidInput as error:
        raise BagError(f"{path}: the camera model of {name} cannot be used: {error}") from None


def _images(
    path: Path,
    camera: DepthCamera,
    clouds: list[Any],
    frames: Mapping[str, tuple[str, FloatArray]],
    start_ns: int,
) -> tuple[tuple[DepthImage, ...], list[str]]:
    """Return the usable images of a camera by time, one for each stamp, and what is wrong with the others."""
    images: dict[int, DepthImage] = {}
    faults = []
    for message in clouds:
        stamp_ns = nanoseconds_from_stamp(message.header.stamp) - start_ns
        try:
            optical = _is_optical(camera, _placed(path, message.header.frame_id, frames))
            image = image_from_message(message, camera, optical=optical)
            if not np.isfinite(image.measured(camera.model)).any():
                raise InvalidInput("no reading within the range")
            if stamp_ns in images:
                raise InvalidInput(f"two clouds with the stamp {stamp_ns * 1e-9:.3f} s")
        except InvalidInput as error:
            faults.append(str(error))
            continue
        images[stamp_ns] = DepthImage(stamp_ns * 1e-9, image.ranges)
    return tuple(images[stamp_ns] for stamp_ns in sorted(images)), faults


def _is_optical(camera: DepthCamera, pose: FloatArray) -> bool:
    """Tell whether a frame (4, 4) [map] is the optical one of a camera, or the one that looks along x."""
    for optical, rotation in ((False, camera.rotation), (True, camera.rotation @ OPTICAL)):
        if (
            np.abs(pose[:3, :3] - rotation).max() < _SAME
            and np.abs(pose[:3, 3] - camera.position).max() < _SAME
        ):
            return optical
    raise InvalidInput(
        "the frame of the cloud is neither that of its camera model nor the same with x forward and z up; "
        "publish the cloud in the frame of its camera_info"
    )
