"""The parameters of the robot node."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from snnav_ros.gate import GateRules
from snnav_ros.parameters import ParameterReader
from snnav_sim.scene_types import RobotScene, Scene

__all__ = ["RobotParameters", "read_robot"]


@dataclass(frozen=True)
class RobotParameters:
    """Parameters of the node besides those of the tracker.

    Parameters
    ----------
    robot_id : str
        Name of the robot; may stay empty when the scene has only one.
    start : tuple of float
        Where the simulated base stands at first [m, map].
    heading_deg : float
        Its heading there [degree, map].
    speed : float
        Constant travelling speed [m/s].
    max_turn_rate : float
        Largest turn rate u_M [rad/s].
    radius : float
        Radius of the disk that covers the robot [m].
    control_period : float
        From command to command [s].
    sampling_interval : float
        From path to path [s].
    base : {"simulated", "external"}
        Drive a simulated Pioneer base and publish its odometry, or hear `<robot>/odom` of a real one.
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
    speed: float = 0.5
    max_turn_rate: float = 1.0
    radius: float = 0.3
    control_period: float = 0.05
    sampling_interval: float = 1.0
    base: Literal["simulated", "external"] = "simulated"
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


def read_robot(reader: ParameterReader, scene: Scene | None) -> tuple[RobotParameters, RobotScene | None]:
    """Declare the parameters; return them, and the robot of the scene whose heading they take over.

    Raises
    ------
    ParameterError
        If they contradict one another.
    """
    if scene is None:
        settings = reader.settings(RobotParameters)
        if not settings.robot_id:
            reader.fail("robot_id", "is not given; name the robot")
        return _checked(reader, settings), None
    ids = [robot.id for robot in scene.robots]
    chosen = reader.peek("robot_id", ids[0] if len(ids) == 1 else "")
    if chosen not in ids:
        reader.fail(
            "robot_id", f"value {chosen!r} names no robot of {scene.name}; it has {', '.join(ids) or 'none'}"
        )
    robot = scene.robots[ids.index(chosen)]
    settings = reader.settings(
        RobotParameters,
        robot_id=robot.id,
        start=robot.start,
        heading_deg=math.degrees(robot.heading),
        speed=robot.speed,
        max_turn_rate=robot.max_turn_rate,
        radius=robot.radius,
        control_period=scene.control_period,
        sampling_interval=scene.sampling_interval,
        joins_at=scene.instant(robot.joins_at),
        leaves_at=scene.instant(robot.leaves_at) if math.isfinite(robot.leaves_at) else None,
    )
    return _checked(reader, settings), robot if settings.heading_deg == math.degrees(robot.heading) else None


def _checked(reader: ParameterReader, settings: RobotParameters) -> RobotParameters:
    if len(settings.start) != 2 or not all(map(math.isfinite, (*settings.start, settings.heading_deg))):
        reader.fail(
            "start", f"value {list(settings.start)} with heading_deg {settings.heading_deg} is no pose"
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
    return settings
