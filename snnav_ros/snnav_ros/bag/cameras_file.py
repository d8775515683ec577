"""The file that says where the depth cameras of a recording hang, how they look, and which files hold their images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.sensing.depth import DepthCamera, pinhole
from snnav_core.types import FloatArray
from snnav_ros.bag.errors import BagError, one_line
from snnav_ros.convert import MAP_FRAME
from snnav_sim.scene_yaml import Field, read_document

__all__ = ["OPTICAL", "CameraFiles", "CamerasFile", "read_cameras"]

OPTICAL: FloatArray = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Optical frame (x right, y down, z forward) -> camera frame (x forward, y left, z up)."""

_REQUIRED = ("files", "size", "focal", "centre", "pose")
_MOST_PIXELS = 10_000
_OFF = 1e-3  # how far a rotation that was rounded may be off one
_FORM = "{cameras: {<id>: {files: ..., size: [640, 480], focal: ..., centre: ..., pose: ...}}}"
_ROWS = "three rows of four numbers: the optical frame in the map, [[r, r, r, x], [r, r, r, y], [r, r, r, z]]"


@dataclass(frozen=True)
class CameraFiles:
    """One camera with its images.

    Parameters
    ----------
    camera : DepthCamera
    files : tuple of Path
        In order of time.
    unit : float
        Length of one count of a depth image [m].
    """

    camera: DepthCamera
    files: tuple[Path, ...]
    unit: float

    @property
    def rays(self) -> FloatArray:
        """Directions of all pixels in the optical frame with z = 1, (rows, columns, 3)."""
        rays = self.camera.model.rays() @ OPTICAL
        scaled: FloatArray = rays / rays[..., 2:]
        return scaled


@dataclass(frozen=True)
class CamerasFile:
    """All cameras of a recording; image i of each is taken at i times `period` [s]."""

    cameras: tuple[CameraFiles, ...]
    period: float


def read_cameras(path: str | Path) -> CamerasFile:
    """Read a file of cameras, YAML or JSON.

    Parameters
    ----------
    path : path-like
        docs/real-depth.md has all keys.

    Raises
    ------
    SnnavError
        One line with file, line, key, value and remedy.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or one_line(error)
        raise BagError(f"{path}: cannot be read ({reason}); give a YAML or JSON file {_FORM}") from None
    if not text.strip():
        raise BagError(f"{path}: the file is empty; write {_FORM}")
    entries = read_document(text, str(path)).mapping(("cameras",), ("frame", "period", "note"))
    if "frame" in entries:
        entries["frame"].choice((MAP_FRAME,))
    period = entries["period"].number("s", 0.0, above=True) if "period" in entries else 1.0
    found = entries["cameras"].children()
    if not found:
        entries["cameras"].fail(f"{entries['cameras'].quoted()} names no camera", f"write {_FORM}")
    places = entries["cameras"].mapping((), found)  # refuses a name given twice
    return CamerasFile(tuple(_camera(name, place, path.parent) for name, place in places.items()), period)


def _camera(name: str, place: Field, folder: Path) -> CameraFiles:
    entries = place.mapping(_REQUIRED, ("unit", "note"))
    size = entries["size"].items("[columns, rows]")
    if len(size) != 2:
        entries["size"].fail(f"{entries['size'].quoted()}, expected 2", "write [columns, rows]")
    columns, rows = (item.whole(2, _MOST_PIXELS) for item in size)
    focal, centre = (_pair(entries[key]) for key in ("focal", "centre"))
    if min(focal) <= 0.0:
        entries["focal"].fail(f"{list(focal)} is out of range", "give two positive numbers [pixels]")
    pose = entries["pose"]
    position, rotation = _pose(pose)
    try:
        camera = DepthCamera(name, position, rotation @ OPTICAL.T, pinhole(columns, rows, focal, centre))
    except InvalidInput as error:
        pose.fail(str(error), f"give {_ROWS}")
    unit = entries["unit"].number("m", 0.0, above=True) if "unit" in entries else 0.001
    return CameraFiles(camera, _files(entries["files"], folder), unit)


def _pair(field: Field) -> tuple[float, float]:
    items = field.items("[column, row]")
    if len(items) != 2:
        field.fail(f"{field.quoted()}, expected 2", "write [column, row] in pixels")
    return items[0].number("pixels"), items[1].number("pixels")


def _files(field: Field, folder: Path) -> tuple[Path, ...]:
    """Return the files that a pattern names, by name."""
    pattern = field.text().strip()
    whole = Path(pattern)
    base = Path(whole.anchor) if whole.is_absolute() else folder
    try:
        found = tuple(sorted(base.glob(str(whole.relative_to(whole.anchor)))))
    except (ValueError, NotImplementedError) as error:
        field.fail(f"{field.quoted()} is no pattern ({one_line(error)})", "write something like cam1/*.png")
    if not found:
        field.fail(f"no file is named {field.quoted()}", f"give a pattern of files below {base}")
    return found


def _pose(field: Field) -> tuple[FloatArray, FloatArray]:
    """Return position and rotation of the optical frame in the map; a rotation that was rounded is made one again."""
    rows = [[item.number("m") for item in row.items(_ROWS)] for row in field.items(_ROWS)]
    if [len(row) for row in rows] not in ([4, 4, 4], [4, 4, 4, 4]):
        field.fail(f"{field.quoted()} is no pose", f"write {_ROWS}")
    matrix = np.array(rows[:3])
    left, _, right = np.linalg.svd(matrix[:, :3])
    rotation: FloatArray = left @ right
    if np.abs(rotation - matrix[:, :3]).max() > _OFF or np.linalg.det(rotation) < 0.0:
        field.fail("the first three columns are no rotation", f"give {_ROWS}")
    return matrix[:, 3], rotation
