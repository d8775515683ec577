"""What a scene in space holds: frozen values in SI units and radians, as read from a scene file."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from snnav_core.area.grid import Grid
from snnav_core.flight_types import FlyerState, direction_of
from snnav_core.sensing.depth import CameraModel, DepthCamera, equal_angle, looking_at
from snnav_core.types import FloatArray, RobotSpec
from snnav_sim.scene_types import Circle, Fault, Polygon, Retarget, SampledScene

__all__ = [
    "Body",
    "Box",
    "DepthSensor",
    "FlyerScene",
    "Mesh",
    "Point3",
    "Prism",
    "Solid",
    "SpaceMover",
    "SpaceScene",
]

Point3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Box:
    """An upright box by its lowest and highest corner [m], with holes that are boxes."""

    low: Point3
    high: Point3
    holes: tuple[tuple[Point3, Point3], ...] = ()


@dataclass(frozen=True, slots=True)
class Prism:
    """An upright prism or cylinder by its outline and the heights of bottom and top [m]."""

    outline: Polygon | Circle
    bottom: float
    top: float


@dataclass(frozen=True, slots=True)
class Mesh:
    """A closed surface of triangles in a file (STL, OBJ), in m."""

    file: str


Solid = Box | Prism | Mesh


@dataclass(frozen=True, slots=True)
class Body:
    """A body at rest; `known_static`: its place is known, and that it never moves (C4-2)."""

    solid: Solid
    known_static: bool = False


@dataclass(frozen=True, slots=True)
class SpaceMover:
    """A body that moves without turning along waypoints.

    Parameters
    ----------
    id : str
    solid : Box or Prism
        About the origin of the body [m].
    waypoints : tuple of points
        Corners of the way of the origin [m, map], at least two.
    speed : float
        Along the waypoints [m/s].
    loop : bool
        Turn back at the ends for ever, else stay at the last waypoint.
    """

    id: str
    solid: Box | Prism
    waypoints: tuple[Point3, ...]
    speed: float
    loop: bool = False

    def positions(self, times: float | FloatArray) -> FloatArray:
        """Return where the origin is at times [s], shape (N,) -> (N, 3) [m, map]."""
        corners = np.asarray(self.waypoints)
        marks = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))))
        way = np.maximum(np.atleast_1d(np.asarray(times, dtype=np.float64)), 0.0) * self.speed
        if self.loop:
            way = marks[-1] - np.abs(way % (2.0 * marks[-1]) - marks[-1])
        return np.stack([np.interp(way, marks, corners[:, axis]) for axis in range(3)], axis=-1)


@dataclass(frozen=True, slots=True)
class DepthSensor:
    """One range finder in space at a surveyed pose.

    Parameters
    ----------
    id : str
    device : str
        ``tof``: a camera that looks at `look_at`; ``spinning``: all round, level, its first column at `heading`.
    position : point
        [m, map]
    look_at : point or None
        [m, map]
    heading : float
        [rad, map]
    columns, rows : int
        Size of the image.
    width, height : float
        Field of view [rad], equal steps of angle from pixel to pixel (C4-20).
    range_min, range_max : float
        [m]
    noise : str
        ``none`` or ``tof``.
    wrap : float or None
        Ranges are measured modulo this one [m]; None: they are not ambiguous.
    no_return : str
        ``unknown``: nothing is known along a pixel without return; ``free``: it is free up to `range_max`.
    drop_out : float
        Probability that a pixel is lost.
    scan_period : float or None
        From image to image [s]; None for the sampling interval.
    scan_offset : float
        Time of the first image [s].
    faults : tuple of Fault
        Each meets what the one before it left.
    """

    id: str
    device: str
    position: Point3
    look_at: Point3 | None = None
    heading: float = 0.0
    columns: int = 128
    rows: int = 128
    width: float = math.radians(135.0)
    height: float = math.radians(135.0)
    range_min: float = 0.05
    range_max: float = 9.0
    noise: str = "none"
    wrap: float | None = None
    no_return: str = "unknown"
    drop_out: float = 0.0
    scan_period: float | None = None
    scan_offset: float = 0.0
    faults: tuple[Fault, ...] = ()

    @property
    def model(self) -> CameraModel:
        """Which direction every pixel looks in."""
        return equal_angle(self.columns, self.rows, self.width, self.height, self.range_min, self.range_max)

    @property
    def camera(self) -> DepthCamera:
        """The device as the fusion knows it."""
        place = np.array(self.position)
        ahead = place + direction_of(self.heading, 0.0) if self.look_at is None else np.array(self.look_at)
        return DepthCamera(
            self.id, place, looking_at(place, ahead), self.model, inf_is_free=self.no_return == "free"
        )


@dataclass(frozen=True, slots=True)
class FlyerScene:
    """One flying robot: where it starts, where it shall go, what it can do.

    Parameters
    ----------
    id : str
    start : point
        [m, map]; it hovers there first.
    heading, pitch : float
        Of its direction at the start [rad, map]; upwards positive.
    target : point
        [m, map]; the end of `curve` where one is given.
    speed : float
        [m/s]
    max_turn_rate : float
        U_M [rad/s]
    radius : float
        Of the sphere that covers it [m].
    curve : tuple of points
        A smooth curve through these points [m, map] is followed instead of a planned path; empty for planning.
    """

    id: str
    start: Point3
    heading: float
    pitch: float
    target: Point3
    speed: float
    max_turn_rate: float
    radius: float
    curve: tuple[Point3, ...] = ()

    joins_at: ClassVar[float] = 0.0  # robots in space are there from the start to the end and go to one place
    leaves_at: ClassVar[float] = math.inf
    retargets: ClassVar[tuple[Retarget, ...]] = ()

    @property
    def last_target(self) -> Point3:
        """Where it shall be in the end."""
        return self.target

    @property
    def spec(self) -> RobotSpec:
        """What the navigator has to know of the robot."""
        return RobotSpec(self.id, self.radius, self.speed, self.max_turn_rate)

    @property
    def state(self) -> FlyerState:
        """State at time 0: it hovers."""
        return FlyerState(self.id, np.array(self.start), direction_of(self.heading, self.pitch), 0.0)


@dataclass(frozen=True)
class SpaceScene(SampledScene):
    """A complete scene in space; see docs/scenes-in-space.md for the meaning of every key.

    Parameters
    ----------
    name, description : str
    sampling_interval : float
        Delta, from one decision to the next [s].
    low, high : point
        Corners of the workspace, a room [m, map].
    safety_margin : float
        d_s, from a robot's centre to any boundary and to other robots' spheres [m].
    sensors, robots, obstacles, movers : tuple
    known_border : bool
        Whether floor, walls and ceiling of the workspace are known never to move.
    grid_spacing : float
        Edge of a cell [m].
    seed : int
    control_period : float
        [s]; a whole number of them make a sampling interval.
    time_window : int
        T, in sampling intervals.
    boundary_speed : float
        V_max [m/s].
    time_limit : float
        [s]
    """

    name: str
    sampling_interval: float
    low: Point3
    high: Point3
    safety_margin: float
    sensors: tuple[DepthSensor, ...]
    robots: tuple[FlyerScene, ...] = ()
    obstacles: tuple[Body, ...] = ()
    movers: tuple[SpaceMover, ...] = ()
    known_border: bool = True
    grid_spacing: float = 0.1
    description: str = ""
    seed: int = 0
    control_period: float = 0.05
    time_window: int = 6
    boundary_speed: float = 0.0
    time_limit: float = 300.0

    plans_globally: ClassVar[bool] = False  # the global planner is one for the plane

    @property
    def planned(self) -> tuple[FlyerScene, ...]:
        """The robots that are planned for: those that do not follow a curve."""
        return tuple(robot for robot in self.robots if not robot.curve)

    @cached_property
    def grid(self) -> Grid:
        """Cells of the workspace."""
        return Grid.covering(np.array(self.low), np.array(self.high), self.grid_spacing)

    def instant(self, time: float) -> float:
        """Return the first sampling instant not before a time [s]; nothing happens at another time than 0 or never."""
        return time

    def is_present(self, robot: FlyerScene, time: float) -> bool:
        """Whether a robot is in the workspace at a time [s]: always."""
        return True

    def present(self, time: float) -> list[str]:
        """Names of the robots in the workspace at a time [s]: all."""
        return [robot.id for robot in self.robots]

    def changes_after(self, time: float) -> bool:
        """Whether a robot still joins, leaves or gets another target: never."""
        return False
