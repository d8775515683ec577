"""What a scene holds: frozen values in SI units and radians, as read from a scene file."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from snnav_core.types import FloatArray, Pose2D, RobotSpec

__all__ = [
    "Circle",
    "Fault",
    "Mover",
    "Point",
    "Polygon",
    "Retarget",
    "RobotScene",
    "SampledScene",
    "Scene",
    "SensorScene",
    "Shape",
]

_SAME_TIME = 1e-9  # [s]

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Polygon:
    """A simple polygon by its vertices [m], in either direction, the first not repeated."""

    vertices: tuple[Point, ...]

    @property
    def points(self) -> FloatArray:
        """Vertices [m], shape (N, 2)."""
        return np.array(self.vertices, dtype=np.float64).reshape(-1, 2)


@dataclass(frozen=True, slots=True)
class Circle:
    """A disk by centre and radius [m]."""

    x: float
    y: float
    radius: float


Shape = Polygon | Circle


@dataclass(frozen=True, slots=True)
class Mover:
    """A body that moves without turning; its shape is given about its own origin.

    Either `waypoints` and `speed` are given, or `start` and `velocity`.

    Parameters
    ----------
    id : str
    shape : Polygon or Circle
        About the origin of the body [m].
    waypoints : tuple of points
        Corners of the way of the origin [m, map], at least two; empty when `start` is given.
    speed : float
        Speed along the waypoints [m/s].
    loop : bool
        Turn back at the ends for ever, else stay at the last waypoint.
    start : point or None
        Position of the origin at time 0 [m, map].
    velocity : point
        Constant velocity from `start` for ever [m/s, map].
    """

    id: str
    shape: Shape
    waypoints: tuple[Point, ...] = ()
    speed: float = 0.0
    loop: bool = False
    start: Point | None = None
    velocity: Point = (0.0, 0.0)

    @property
    def top_speed(self) -> float:
        """Largest speed of the body [m/s]."""
        return self.speed if self.start is None else math.hypot(*self.velocity)


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong with the scans of a sensor; which parameters count depends on the kind.

    Parameters
    ----------
    kind : str
        ``drop_out``, ``delay``, ``duplicate``, ``reorder``, ``nan``, ``zero``, ``beam_count``, ``frozen`` or
        ``clock_offset``; see docs/scene-format.md.
    begin, end : float
        The fault meets scans measured from `begin` until before `end` [s].
    probability : float
        That it meets one of these scans.
    seconds : float
        Of a delay; of a clock offset, where a positive one is a clock that is ahead [s].
    jitter : float
        A delay is longer by up to this [s].
    share : float
        Of the beams that read NaN or zero.
    change : int
        Beams added to the end of a scan; cut from it where negative.
    """

    kind: str
    begin: float = 0.0
    end: float = math.inf
    probability: float = 1.0
    seconds: float = 0.0
    jitter: float = 0.0
    share: float = 0.0
    change: int = 0


@dataclass(frozen=True, slots=True)
class SensorScene:
    """One planar range finder at a surveyed pose.

    Parameters
    ----------
    id : str
    device : str
        ``lms200`` (simulated) or ``recorded`` (every scan is `ranges`).
    position : point
        [m, map].
    heading : float
        Direction of bearing zero [rad, map].
    field_of_view : float
        Angle from the first to the last beam; 2 pi for all round [rad].
    resolution : float
        Angle from beam to beam [rad].
    range_max : float
        Greatest measured range R_s [m].
    angle_min : float
        Bearing of the first beam in the sensor frame [rad].
    noise : str
        ``none`` or ``lms200``.
    range_min : float
        Nearer returns are not measured [m].
    no_return : str
        ``free``: a beam without return is free up to `range_max`; ``unknown``: nothing is known along it.
    drop_out : float
        Probability that a beam is lost.
    error_codes : bool
        Whether lost beams and beams without return carry the codes of the LMS-200 instead of NaN and infinity.
    ranges : tuple of float
        The recorded scan [m]; empty for a simulated device.
    range_cut : float or None
        Longer recorded ranges are free only up to this one [m].
    scan_period : float or None
        Time from scan to scan [s]; None for the sampling interval, see `Scene.scan_period`.
    scan_offset : float
        Time of the first scan [s].
    sees_robots : bool
        Mounted on the floor: the device sees robots too.
    faults : tuple of Fault
        Each meets what the one before it left.
    """

    id: str
    device: str
    position: Point
    heading: float
    field_of_view: float
    resolution: float
    range_max: float
    angle_min: float
    noise: str = "none"
    range_min: float = 0.0
    no_return: str = "free"
    drop_out: float = 0.0
    error_codes: bool = False
    ranges: tuple[float, ...] = ()
    range_cut: float | None = None
    scan_period: float | None = None
    scan_offset: float = 0.0
    sees_robots: bool = False
    faults: tuple[Fault, ...] = ()

    @property
    def pose(self) -> Pose2D:
        """Pose of the sensor [map]."""
        return Pose2D(self.position[0], self.position[1], self.heading)

    @property
    def all_round(self) -> bool:
        """Whether the field of view closes; then the last beam is one resolution before the first."""
        return self.field_of_view > 2.0 * math.pi - 1e-9

    @property
    def beams(self) -> int:
        """Number of beams of a scan."""
        return round(self.field_of_view / self.resolution) + (0 if self.all_round else 1)


@dataclass(frozen=True, slots=True)
class Retarget:
    """Another target [m, map] for a robot, from a time [s] on."""

    time: float
    target: Point


@dataclass(frozen=True, slots=True)
class RobotScene:
    """One robot: where it starts, where it shall go, what it can do.

    Parameters
    ----------
    id : str
    start : point
        [m, map].
    heading : float
        Heading at the start [rad, map].
    target : point
        [m, map].
    speed : float
        Travelling speed [m/s].
    max_turn_rate : float
        [rad/s].
    radius : float
        Radius of the disk that covers the robot [m].
    joins_at : float
        Put into the workspace at the first sampling instant from then on [s].
    leaves_at : float
        Taken out of it at the first sampling instant from then on [s].
    retargets : tuple of Retarget
        In order of time; each counts from the first sampling instant from its time on.
    """

    id: str
    start: Point
    heading: float
    target: Point
    speed: float
    max_turn_rate: float
    radius: float
    joins_at: float = 0.0
    leaves_at: float = math.inf
    retargets: tuple[Retarget, ...] = ()

    def target_at(self, time: float) -> Point:
        """Return where it shall go at a sampling instant [s]."""
        return next((r.target for r in reversed(self.retargets) if r.time <= time + _SAME_TIME), self.target)

    @property
    def last_target(self) -> Point:
        """Where it shall be in the end, should it not leave before."""
        return self.target_at(math.inf)

    @property
    def spec(self) -> RobotSpec:
        """What the navigator has to know of the robot."""
        return RobotSpec(self.id, self.radius, self.speed, self.max_turn_rate)

    @property
    def pose(self) -> Pose2D:
        """Pose at the start [map]."""
        return Pose2D(self.start[0], self.start[1], self.heading)


class _Measuring(Protocol):
    """A sensor, as far as its rate goes."""

    @property
    def scan_period(self) -> float | None: ...


class SampledScene:
    """What scenes in the plane and in space share: how sampling instants, control periods and scans go together."""

    name: str
    description: str
    seed: int
    sampling_interval: float
    control_period: float
    time_window: int
    boundary_speed: float
    safety_margin: float
    time_limit: float

    @property
    def ticks_per_sample(self) -> int:
        """Number of control periods in a sampling interval."""
        return round(self.sampling_interval / self.control_period)

    def scan_period(self, sensor: _Measuring) -> float:
        """Time from scan to scan (image to image) of a sensor [s]."""
        return self.sampling_interval if sensor.scan_period is None else sensor.scan_period


@dataclass(frozen=True)
class Scene(SampledScene):
    """A complete scene; see docs/scene-format.md for the meaning of every key.

    Parameters
    ----------
    name, description : str
    sampling_interval : float
        Delta, from one decision to the next [s].
    border : Polygon
        Border of the workspace, a wall.
    safety_margin : float
        d_s, from a robot's centre to any boundary [m].
    sensors, robots, obstacles, movers : tuple
    seed : int
        Of all randomness of a run.
    control_period : float
        [s]; a whole number of them make a sampling interval.
    time_window : int
        T, in sampling intervals.
    boundary_speed : float
        V_max [m/s].
    time_limit : float
        A run ends then [s].
    planner : str
        ``local``: a path that is safe whatever moves how, anew at every sampling instant (Ch. 3); ``global``: the
        shortest one among bodies in uniform motion, once (Ch. 2).
    """

    name: str
    sampling_interval: float
    border: Polygon
    safety_margin: float
    sensors: tuple[SensorScene, ...]
    robots: tuple[RobotScene, ...] = ()
    obstacles: tuple[Shape, ...] = ()
    movers: tuple[Mover, ...] = ()
    description: str = ""
    seed: int = 0
    control_period: float = 0.05
    time_window: int = 4
    boundary_speed: float = 0.0
    time_limit: float = 300.0
    planner: str = "local"
    _workspace: FloatArray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        workspace = self.border.points
        workspace.setflags(write=False)
        object.__setattr__(self, "_workspace", workspace)

    @property
    def workspace(self) -> FloatArray:
        """Vertices of the border [m, map], shape (N, 2)."""
        return self._workspace

    def instant(self, time: float) -> float:
        """Return the first sampling instant not before a time [s]."""
        if not math.isfinite(time):
            return time
        return round(math.ceil(time / self.sampling_interval - _SAME_TIME) * self.sampling_interval, 9)

    def is_present(self, robot: RobotScene, time: float) -> bool:
        """Whether a robot is in the workspace at a time [s]."""
        return self.instant(robot.joins_at) <= time + _SAME_TIME < self.instant(robot.leaves_at)

    def present(self, time: float) -> list[str]:
        """Names of the robots in the workspace at a time [s]."""
        return [robot.id for robot in self.robots if self.is_present(robot, time)]

    def changes_after(self, time: float) -> bool:
        """Whether a robot still joins, leaves or gets another target after a sampling instant [s]."""
        times = [
            time for r in self.robots for time in (r.joins_at, r.leaves_at, *(t.time for t in r.retargets))
        ]
        return any(time + _SAME_TIME < self.instant(when) < math.inf for when in times)

    @property
    def sees_robots(self) -> bool:
        """Whether any sensor stands on the floor and sees robots."""
        return any(sensor.sees_robots for sensor in self.sensors)

    @property
    def plans_globally(self) -> bool:
        """Whether robots follow the global planner in space-time."""
        return self.planner == "global"

    @property
    def recorded(self) -> bool:
        """Whether the true obstacles are unknown because the scans are recorded ones."""
        return any(sensor.device == "recorded" for sensor in self.sensors)
