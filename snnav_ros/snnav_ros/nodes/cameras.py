"""The depth cameras of a fusion node in space, from a scene or from parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.sensing.depth import CameraModel, DepthCamera, equal_angle, looking_at, pinhole
from snnav_core.types import FloatArray
from snnav_ros.parameters import ParameterReader
from snnav_sim.space_types import DepthSensor, SpaceScene

__all__ = ["CameraParameters", "ListenedCamera", "read_cameras"]


@dataclass(frozen=True)
class CameraParameters:
    """What has to be known of a camera besides where it is.

    Parameters
    ----------
    projection : {"equal_angle", "pinhole"}
        Pixels are equal steps of angle (also those of a spinning range finder), or of the tangent.
    columns, rows : int
        Size of the image.
    field_of_view_deg : tuple of float
        Width and height of an equal-angle image, from edge to edge [degree].
    focal_length : tuple of float
        Of a pinhole camera, along columns and rows [pixel]; empty for an equal-angle one.
    principal_point : tuple of float
        Of a pinhole camera, column and row [pixel]; the middle of the image when empty.
    range_min, range_max : float
        Radial distances outside are no measurement [m].
    inf_is_free : bool
        Whether a pixel whose `range` reads +inf saw free space up to `range_max`.
    never_repeats : bool
        Whether it has noise: two equal images come from a device that froze.
    optical : bool
        Whether its points come in an optical frame: z forward, x right, y down.
    """

    projection: Literal["equal_angle", "pinhole"] = "equal_angle"
    columns: int = 128
    rows: int = 128
    field_of_view_deg: tuple[float, ...] = (135.0, 135.0)
    focal_length: tuple[float, ...] = ()
    principal_point: tuple[float, ...] = ()
    range_min: float = 0.05
    range_max: float = 9.0
    inf_is_free: bool = False
    never_repeats: bool = True
    optical: bool = False

    @classmethod
    def of(cls, sensor: DepthSensor) -> CameraParameters:
        """Return the parameters of a camera of a scene; only a simulated one may be without noise."""
        return cls(
            columns=sensor.columns,
            rows=sensor.rows,
            field_of_view_deg=(math.degrees(sensor.width), math.degrees(sensor.height)),
            range_min=sensor.range_min,
            range_max=sensor.range_max,
            inf_is_free=sensor.no_return == "free",
            never_repeats=sensor.noise == "tof",
        )

    def model(self) -> CameraModel:
        """Return which direction every pixel looks in.

        Raises
        ------
        InvalidInput
            If a number is missing or out of its range.
        """
        ranges = (self.range_min, self.range_max)
        if self.projection == "equal_angle":
            width, height = map(math.radians, _two("field_of_view_deg", self.field_of_view_deg))
            return equal_angle(self.columns, self.rows, width, height, *ranges)
        middle = (0.5 * (self.columns - 1), 0.5 * (self.rows - 1))
        centre = _two("principal_point", self.principal_point or middle)
        return pinhole(self.columns, self.rows, _two("focal_length", self.focal_length), centre, *ranges)


@dataclass(frozen=True)
class ListenedCamera:
    """A camera, in which frame its clouds come, and how they are to be read."""

    camera: DepthCamera
    frame: str
    optical: bool
    never_repeats: bool


def read_cameras(reader: ParameterReader, scene: SpaceScene | None) -> list[ListenedCamera]:
    """Declare the parameters of all cameras.

    Parameters
    ----------
    reader : ParameterReader
    scene : SpaceScene or None
        Its cameras, unless the parameter `sensors` names others.

    Raises
    ------
    ParameterError
        If there is no camera, or one has no place.
    """
    known = {} if scene is None else {sensor.id: sensor for sensor in scene.sensors}
    text = "Ids of the cameras; each has its own group of parameters. By default those of the scene."
    ids: tuple[str, ...] = reader.value("sensors", tuple[str, ...], text, tuple(known))
    if not ids:
        reader.fail("sensors", "is empty; list the ids of the cameras, or give `scene`")
    if len(set(ids)) != len(ids):
        reader.fail("sensors", f"value {list(ids)} names a sensor twice; give different ids")
    return [_read(reader, sensor_id, known.get(sensor_id)) for sensor_id in ids]


def _read(reader: ParameterReader, name: str, known: DepthSensor | None) -> ListenedCamera:
    given = {} if known is None else {"default": known.position}
    position = _point(reader, f"{name}.position", "Surveyed position [m, map].", **given)
    assert position is not None
    rotation = _rotation(reader, name, position, known)
    text = "frame_id of its clouds; the id by default. Drivers often say `camera_depth_frame`."
    frame = reader.value(f"{name}.frame", str, text, name)
    usual = CameraParameters() if known is None else CameraParameters.of(known)
    fields = {one: getattr(usual, one) for one in CameraParameters.__dataclass_fields__}
    said = reader.settings(CameraParameters, name, **fields)
    try:
        model = known.model if known is not None and said == usual else said.model()
        camera = DepthCamera(name, position, rotation, model, said.inf_is_free)
    except InvalidInput as error:
        reader.fail(name, str(error))
    return ListenedCamera(camera, frame, said.optical, said.never_repeats)


def _rotation(
    reader: ParameterReader, name: str, position: FloatArray, known: DepthSensor | None
) -> FloatArray:
    """Return the rotation camera -> map by one of two parameters, or by the scene."""
    where = f"{name}.look_at"
    target = _point(reader, where, "A point that it looks at, its rows level [m, map].", default=None)
    text = "Roll, pitch and yaw of the camera (x forward, y left, z up) about the axes of the map [degree]."
    angles_deg = _point(reader, f"{name}.orientation_deg", text, default=None)
    if target is not None and angles_deg is not None:
        reader.fail(where, f"is given, and so is {name}.orientation_deg; give one of them")
    if target is not None:
        try:
            return looking_at(position, target)
        except InvalidInput as error:
            reader.fail(where, str(error))
    if angles_deg is not None:
        return _turned(*np.radians(angles_deg).tolist())
    if known is None:
        reader.fail(where, f"is not given; give it or {name}.orientation_deg")
    return known.camera.rotation


def _point(reader: ParameterReader, where: str, text: str, **given: object) -> FloatArray | None:
    kind = tuple[float, ...] | None if given.get("default", ()) is None else tuple[float, ...]
    values = reader.value(where, kind, text, **given)
    if values is None:
        return None
    if len(values) != 3 or not all(map(math.isfinite, values)):
        reader.fail(where, f"value {list(values)} is no point in space; give three numbers")
    return np.array(values, dtype=np.float64)


def _turned(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Return the rotation by roll about x, then pitch about y, then yaw about z (REP 103)."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(one), math.cos(one)) for one in (roll, pitch, yaw))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    about_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    about_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    turned: FloatArray = about_z @ about_y @ about_x
    return turned


def _two(name: str, values: tuple[float, ...]) -> tuple[float, float]:
    if len(values) != 2 or not all(math.isfinite(value) for value in values):
        raise InvalidInput(f"{name} is {list(values)}; give two numbers")
    return values[0], values[1]
