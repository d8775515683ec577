"""The sensors of a fusion node and the robots that they see, from a scene or from parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from snnav_core.area.fusion import PlanarSensor
from snnav_core.sensing.scan import ScanSettings
from snnav_core.types import Pose2D, RobotSpec
from snnav_ros.nodes.robots import read_robot_spec
from snnav_ros.parameters import ParameterReader
from snnav_sim.configure import planar_sensor
from snnav_sim.scene import AnyScene, Scene

__all__ = ["ListenedSensor", "read_seen_robots", "read_sensors"]


@dataclass(frozen=True)
class ListenedSensor:
    """A sensor, and in which frame its scans come."""

    sensor: PlanarSensor
    frame: str


def read_sensors(reader: ParameterReader, scene: Scene | None) -> list[ListenedSensor]:
    """Declare the parameters of all sensors.

    Parameters
    ----------
    reader : ParameterReader
    scene : Scene or None
        Its sensors, unless the parameter `sensors` names others.

    Raises
    ------
    ParameterError
        If there is no sensor, or one has no place.
    """
    known = {} if scene is None else {sensor.id: planar_sensor(sensor) for sensor in scene.sensors}
    text = "Ids of the sensors; each has its own group of parameters. By default those of the scene."
    ids: tuple[str, ...] = reader.value("sensors", tuple[str, ...], text, tuple(known))
    if not ids:
        reader.fail("sensors", "is empty; list the ids of the sensors, or give `scene`")
    if len(set(ids)) != len(ids):
        reader.fail("sensors", f"value {list(ids)} names a sensor twice; give different ids")
    return [_read(reader, sensor_id, known.get(sensor_id)) for sensor_id in ids]


def _read(reader: ParameterReader, sensor_id: str, known: PlanarSensor | None) -> ListenedSensor:
    given = {} if known is None else {"default": (known.pose.x, known.pose.y)}
    where = f"{sensor_id}.position"
    x_y = reader.value(where, tuple[float, ...], "Surveyed position [m, map].", **given)
    if len(x_y) != 2 or not all(map(math.isfinite, x_y)):
        reader.fail(where, f"value {list(x_y)} is no point; give two numbers [x, y]")
    given = {} if known is None else {"default": math.degrees(known.pose.heading)}
    heading_deg = reader.value(
        f"{sensor_id}.heading_deg", float, "Surveyed direction of bearing zero [degree, map].", **given
    )
    if not math.isfinite(heading_deg):
        reader.fail(f"{sensor_id}.heading_deg", f"value {heading_deg} is no angle; give degrees")
    heading = math.radians(heading_deg)
    if known is not None and heading_deg == given["default"]:
        heading = known.pose.heading
    text = "frame_id of its scans; the id by default. Drivers often say `laser` or `cloud`."
    frame = reader.value(f"{sensor_id}.frame", str, text, sensor_id)
    # A real device has noise: one that repeats itself is broken. Only a simulated one may be without.
    defaults = {"never_repeats": True} if known is None else _fields(known.settings)
    settings = reader.settings(ScanSettings, sensor_id, **defaults)
    return ListenedSensor(PlanarSensor(sensor_id, Pose2D(x_y[0], x_y[1], heading), settings), frame)


def read_seen_robots(
    reader: ParameterReader, scene: AnyScene | None, seeing: Sequence[str], *, may_be_none: bool = False
) -> list[RobotSpec]:
    """Declare the parameters of the robots that sensors see.

    Parameters
    ----------
    reader : ParameterReader
    scene : Scene or SpaceScene or None
        Its robots that are there at the start, if a sensor sees them and unless the parameter `robots` names others.
    seeing : sequence of str
        Ids of the sensors that see robots: those near the floor, and all cameras in space.
    may_be_none : bool
        Whether there may be no robot at the start because robots join.

    Raises
    ------
    ParameterError
        If a sensor sees robots and none is named, or the other way round, or a value is missing.
    """
    there = [] if scene is None or not seeing else [r for r in scene.robots if scene.is_present(r, 0.0)]
    known = {robot.id: robot.spec for robot in there}
    text = (
        "Ids of the robots that sensors with `sees_robots`, or cameras, see, each with its own group of parameters "
        "as of the planner node (radius, speed, max_turn_rate, can_turn_in_place); by default the scene's."
    )
    ids: tuple[str, ...] = reader.value("robots", tuple[str, ...], text, tuple(known))
    if seeing and not ids and not may_be_none:
        reader.fail("robots", f"is empty, but sensor {seeing[0]} sees robots; list their ids")
    if ids and not seeing:
        reader.fail("robots", f"value {list(ids)}: no sensor sees robots; set <sensor>.sees_robots to true")
    if len(set(ids)) != len(ids):
        reader.fail("robots", f"value {list(ids)} names a robot twice; give different ids")
    return [read_robot_spec(reader, robot_id, known.get(robot_id)) for robot_id in ids]


def _fields(settings: ScanSettings) -> dict[str, object]:
    return {name: getattr(settings, name) for name in ScanSettings.__dataclass_fields__}
