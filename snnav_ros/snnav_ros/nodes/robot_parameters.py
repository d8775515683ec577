"""The parameters of the robot node, and the robot that they describe."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlyerState, direction_of
from snnav_core.navigator.flight_settings import FlightDistances
from snnav_core.tracking.planar import PlanarTracker, TrackerSettings
from snnav_core.tracking.spatial import SpatialTracker, SpatialTrackerSettings
from snnav_core.types import Pose2D, RobotSpec, TimedPath
from snnav_ros.gate import GateRules
from snnav_ros.nodes.robot_body import Body, FlyerBody, GroundBody
from snnav_ros.parameters import ParameterReader
from snnav_sim.configure_flight import flight_settings
from snnav_sim.scene import AnyScene, RobotScene, Scene
from snnav_sim.simulation_flight import curve_of
from snnav_sim.space_types import FlyerScene

__all__ = ["RobotParameters", "read_robot"]


@dataclass(frozen=True)
class RobotParameters:
    """Parameters of the node besides those of the tracker.

    Parameters
    ----------
    robot_id : str
        Name of the robot; may stay empty when the scene has only one.
    start : tuple of float
        Where the simulated base stands at first [m, map]; three numbers for one that flies.
    heading_deg : float
        Its heading there [degree, map].
    pitch_deg : float
        The pitch of a flying base there, upwards positive [degree].
    speed : float
        Constant travelling speed [m/s].
    max_turn_rate : float
        Largest turn rate u_M [rad/s].
    radius : float
        Radius of the disk, in space of the sphere, that covers the robot [m].
    control_period : float
        From command to command [s].
    sampling_interval : float
        From path to path [s].
    base : {"simulated", "flyer", "external"}
        Drive a simulated Pioneer base, or fly a simulated flying one, and publish its odometry; or hear `<robot>/odom`
        of a real one on the ground. A flying base hovers while there is nothing to follow.
    command_timeout : float or None
        A base stops by itself when no command came for so long [s]; two control periods when left out. The simulated
        base does; a real one must be set to it or to less.
    require_certificate : bool
        Follow a path only with an accepted certificate that bears its digest and is sealed with it.
    clock_tolerance : float
        How far a stamp may lie ahead of the robot's clock [s]; what lies farther ahead stops the robot.
    pairing_patience : float or None
        The robot stops when a path is so long without its certificate, or the other way round [s]; half a sampling
        interval when left out.
    max_odometry_age : float
        With an external base: the robot is stopped when its odometry is older [s].
    stamped : bool
        Publish `<robot>/cmd_vel` as TwistStamped instead of Twist.
    joins_at : float
        The robot is in the workspace, and announces itself, from then on [s]: in simulated time, or since the start of
        the node.
    leaves_at : float or None
        It leaves then [s].
    planners : tuple of str
        Names of all planner nodes if there are several: in lockstep the robot waits until each has had its say.
    """

    robot_id: str = ""
    start: tuple[float, ...] = (0.0, 0.0)
    heading_deg: float = 0.0
    pitch_deg: float = 0.0
    speed: float = 0.5
    max_turn_rate: float = 1.0
    radius: float = 0.3
    control_period: float = 0.05
    sampling_interval: float = 1.0
    base: Literal["simulated", "flyer", "external"] = "simulated"
    command_timeout: float | None = None
    require_certificate: bool = True
    clock_tolerance: float = 0.05
    pairing_patience: float | None = None
    max_odometry_age: float = 0.5
    stamped: bool = False
    joins_at: float = 0.0
    leaves_at: float | None = None
    planners: tuple[str, ...] = ()

    @property
    def command_holds(self) -> float:
        """How long a base does what it was told last [s]."""
        return 2.0 * self.control_period if self.command_timeout is None else self.command_timeout

    @property
    def rules(self) -> GateRules:
        """What is demanded of paths and certificates."""
        patience = self.pairing_patience
        return GateRules(
            self.require_certificate,
            self.clock_tolerance,
            0.5 * self.sampling_interval if patience is None else patience,
        )


Curve = Callable[[float], TimedPath]
"""From the time at which a robot begins to follow its curve [s] to that curve as a path."""


def read_robot(reader: ParameterReader, scene: AnyScene | None) -> tuple[RobotParameters, Body, Curve | None]:
    """Declare the parameters; return them, the robot that they describe, and its curve if the scene gives it one.

    Raises
    ------
    ParameterError
        If they contradict one another.
    """
    entry = None if scene is None else _entry(reader, scene)
    settings = reader.settings(RobotParameters, **_defaults(scene, entry))
    ground = reader.settings(TrackerSettings, "tracker")
    air = reader.settings(SpatialTrackerSettings, "flight_tracker")
    reader.finish()
    if not settings.robot_id:
        reader.fail("robot_id", "is not given; name the robot")
    _check(reader, settings)
    if scene is not None and isinstance(scene, Scene) == (settings.base == "flyer"):
        fitting = "'simulated' or 'external'" if isinstance(scene, Scene) else "'flyer'"
        reader.fail("base", f"value {settings.base!r} does not go with scene {scene.name}; choose {fitting}")
    spec = RobotSpec(settings.robot_id, settings.radius, settings.speed, settings.max_turn_rate)
    try:
        if settings.base == "flyer":
            state = _flyer_state(settings, entry if isinstance(entry, FlyerScene) else None)
            body: Body = FlyerBody(state, spec, SpatialTracker(spec, air, settings.control_period))
        else:
            heading = _radians(settings.heading_deg, None if entry is None else entry.heading)
            pose = Pose2D(settings.start[0], settings.start[1], heading)
            body = GroundBody(spec, pose, PlanarTracker(spec, ground, settings.control_period))
    except InvalidInput as error:
        reader.fail("tracker", str(error))
    return settings, body, _curve(scene, entry)


def _entry(reader: ParameterReader, scene: AnyScene) -> RobotScene | FlyerScene:
    """Return the robot of the scene that the parameters name."""
    ids = [robot.id for robot in scene.robots]
    chosen = reader.peek("robot_id", ids[0] if len(ids) == 1 else "")
    if chosen not in ids:
        reader.fail(
            "robot_id", f"value {chosen!r} names no robot of {scene.name}; it has {', '.join(ids) or 'none'}"
        )
    return scene.robots[ids.index(chosen)]


def _defaults(scene: AnyScene | None, robot: RobotScene | FlyerScene | None) -> dict[str, object]:
    """Return what a scene says of a robot."""
    if scene is None or robot is None:
        return {}
    values: dict[str, object] = {
        "robot_id": robot.id,
        "start": robot.start,
        "heading_deg": math.degrees(robot.heading),
        "speed": robot.speed,
        "max_turn_rate": robot.max_turn_rate,
        "radius": robot.radius,
        "control_period": scene.control_period,
        "sampling_interval": scene.sampling_interval,
    }
    if isinstance(scene, Scene) and isinstance(robot, RobotScene):
        values["joins_at"] = scene.instant(robot.joins_at)
        values["leaves_at"] = scene.instant(robot.leaves_at) if math.isfinite(robot.leaves_at) else None
    elif isinstance(robot, FlyerScene):
        values |= {"base": "flyer", "pitch_deg": math.degrees(robot.pitch)}
    return values


def _radians(degrees: float, known: float | None) -> float:
    """Return an angle [rad]: exactly that of the scene where the parameter was not changed."""
    return known if known is not None and math.degrees(known) == degrees else math.radians(degrees)


def _flyer_state(settings: RobotParameters, entry: FlyerScene | None) -> FlyerState:
    heading = _radians(settings.heading_deg, None if entry is None else entry.heading)
    pitch = _radians(settings.pitch_deg, None if entry is None else entry.pitch)
    return FlyerState(settings.robot_id, np.array(settings.start), direction_of(heading, pitch), 0.0)


def _curve(scene: AnyScene | None, entry: RobotScene | FlyerScene | None) -> Curve | None:
    if scene is None or isinstance(scene, Scene) or not (isinstance(entry, FlyerScene) and entry.curve):
        return None
    distances = FlightDistances(entry.spec, flight_settings(scene, scene.seed))
    return partial(curve_of, entry, distances)


def _check(reader: ParameterReader, settings: RobotParameters) -> None:
    angles = settings.heading_deg, settings.pitch_deg
    numbers = 3 if settings.base == "flyer" else 2
    if len(settings.start) != numbers or not all(map(math.isfinite, (*settings.start, *angles))):
        reader.fail(
            "start",
            f"value {list(settings.start)} with heading_deg {settings.heading_deg} is no pose of a base "
            f"{settings.base!r}; give {numbers} numbers",
        )
    ratio = settings.sampling_interval / settings.control_period
    if abs(ratio - round(ratio)) > 1e-6 or ratio < 0.5:
        reader.fail(
            "control_period",
            f"value {settings.control_period} does not divide sampling_interval {settings.sampling_interval}",
        )
    if settings.leaves_at is not None and settings.leaves_at <= settings.joins_at:
        reader.fail("leaves_at", f"value {settings.leaves_at} is not after joins_at {settings.joins_at}")
    if settings.command_holds < settings.control_period:
        remark = f"value {settings.command_timeout} is below control_period {settings.control_period}"
        reader.fail("command_timeout", f"{remark}; the base would stop between commands")
    if settings.rules.pairing_patience > settings.sampling_interval:
        remark = f"value {settings.pairing_patience} is above sampling_interval {settings.sampling_interval}"
        reader.fail("pairing_patience", f"{remark}; the next path would come first")
