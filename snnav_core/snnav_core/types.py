"""Values that the floors of snnav hand to each other: poses, robots, timed paths, certificates."""

from __future__ import annotations

import hashlib
import math
import struct
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from snnav_core.errors import InvalidInput

__all__ = [
    "TIME_TOLERANCE",
    "Certificate",
    "FloatArray",
    "HeardPath",
    "PathSource",
    "PlannedPath",
    "Pose2D",
    "RobotSpec",
    "RobotState",
    "StepResult",
    "Stop",
    "StopReason",
    "TimedPath",
    "VelocityCommand",
    "wrap_angle",
]

FloatArray = NDArray[np.float64]

TIME_TOLERANCE = 1e-6
"""Times nearer to each other are the same [s]: seconds since 1970 are no finer than a quarter of a microsecond."""

_NANOSECONDS = 1_000_000_000
_TURN_RESOLUTION = 1e-6


def wrap_angle(angle: float) -> float:
    """Return the angle [rad] wrapped to (-pi, pi]."""
    wrapped = math.remainder(angle, 2.0 * math.pi)
    return math.pi if wrapped == -math.pi else wrapped


@dataclass(frozen=True, slots=True)
class Pose2D:
    """Position and heading in the plane.

    Parameters
    ----------
    x, y : float
        Position [m, map].
    heading : float
        Direction of travel [rad, map], counter-clockwise from the x axis.
    """

    x: float
    y: float
    heading: float

    @property
    def position(self) -> FloatArray:
        """Position [m, map], shape (2,)."""
        return np.array([self.x, self.y])


@dataclass(frozen=True, slots=True)
class RobotSpec:
    """What the navigator has to know of one robot (Ch. 3, robot model and Assumption "robot disk").

    Parameters
    ----------
    id : str
        Name of the robot.
    radius : float
        Radius of the disk that covers the robot [m].
    speed : float
        Constant travelling speed [m/s].
    max_turn_rate : float
        Largest turn rate u_M [rad/s].
    can_turn_in_place : bool
        Whether the base may turn at speed zero (a differential drive can).

    Raises
    ------
    InvalidInput
        If a number is not finite and positive.
    """

    id: str
    radius: float
    speed: float
    max_turn_rate: float
    can_turn_in_place: bool = True

    def __post_init__(self) -> None:
        for name in ("radius", "speed", "max_turn_rate"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise InvalidInput(f"robot {self.id!r}: {name} is {value}, must be a positive number")

    @property
    def min_turn_radius(self) -> float:
        """Smallest turning radius R_min = v / u_M [m]."""
        return self.speed / self.max_turn_rate


@dataclass(frozen=True, slots=True)
class RobotState:
    """Pose [map] and speed [m/s] of one robot, measured at `stamp` [s]."""

    id: str
    pose: Pose2D
    stamp: float
    speed: float = 0.0


@dataclass(frozen=True, slots=True)
class VelocityCommand:
    """Forward speed [m/s] and turn rate [rad/s, counter-clockwise positive] for a robot base."""

    speed: float
    turn_rate: float


@dataclass(frozen=True)
class TimedPath:
    """Points that a robot passes at known times; it stays at the last one.

    Parameters
    ----------
    start_time : float
        Time of the first point [s].
    step : float
        Time from one point to the next [s].
    points : array_like
        Positions [m, map], shape (N, 2) or (N, 3), N >= 1. The last link may be shorter than the others.
    turn_to : float or None
        Given for a turn in place: all points are equal and the robot turns to this heading [rad, map].
        Kept to 1e-6 rad, so that the digest survives a conversion to a quaternion and back.

    Raises
    ------
    InvalidInput
        If the points are not a finite (N, 2) or (N, 3) array, or the step is not positive.
    """

    start_time: float
    step: float
    points: FloatArray
    turn_to: float | None = None

    def __post_init__(self) -> None:
        points = np.array(self.points, dtype=np.float64)
        if points.ndim != 2 or points.shape[0] < 1 or points.shape[1] not in (2, 3):
            raise InvalidInput(
                f"path points have shape {points.shape}, expected (N, 2) or (N, 3) with N >= 1"
            )
        if not np.isfinite(points).all():
            raise InvalidInput("path points contain NaN or infinity")
        if not (math.isfinite(self.step) and self.step > 0.0):
            raise InvalidInput(f"path step is {self.step} s, must be positive")
        if not math.isfinite(self.start_time):
            raise InvalidInput(f"path start time is {self.start_time}, must be finite")
        points.setflags(write=False)
        object.__setattr__(self, "points", points)
        if self.turn_to is not None:
            quantised = round(wrap_angle(self.turn_to) / _TURN_RESOLUTION) * _TURN_RESOLUTION
            object.__setattr__(self, "turn_to", quantised)

    def __len__(self) -> int:
        return int(self.points.shape[0])

    @property
    def end_time(self) -> float:
        """Time of the last point [s]."""
        return self.start_time + (len(self) - 1) * self.step

    @property
    def length(self) -> float:
        """Length of the polygonal chain [m]."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    @property
    def headings(self) -> FloatArray:
        """Heading at every point [rad, map], shape (N,): direction to the next point, the last repeated."""
        if self.turn_to is not None or len(self) < 2:
            return np.full(len(self), 0.0 if self.turn_to is None else self.turn_to)
        delta = np.diff(self.points[:, :2], axis=0)
        heading = np.arctan2(delta[:, 1], delta[:, 0])
        return np.append(heading, heading[-1])

    def positions_at(self, times: FloatArray) -> FloatArray:
        """Interpolate the position at the given times [s], shape (M,) -> (M, D); held at both ends."""
        index = (np.asarray(times, dtype=np.float64) - self.start_time) / self.step
        knots = np.arange(len(self), dtype=np.float64)
        columns = [np.interp(index, knots, self.points[:, axis]) for axis in range(self.points.shape[1])]
        return np.stack(columns, axis=-1)

    def digest(self) -> str:
        """Return 16 hexadecimal digits that identify start time, step, points and turn exactly."""
        spatial = np.zeros((len(self), 3))
        spatial[:, : self.points.shape[1]] = self.points
        turn = -(2**62) if self.turn_to is None else round(self.turn_to / _TURN_RESOLUTION)
        start, step = round(self.start_time * _NANOSECONDS), round(self.step * _NANOSECONDS)
        content = struct.pack("<qqq", start, step, turn) + (spatial + 0.0).astype("<f8").tobytes()
        return hashlib.sha256(b"snnav-path-1" + content).hexdigest()[:16]


class PathSource(Enum):
    """Where a planned path comes from."""

    WARM_START = "warm_start"  # the last path, shifted and adjusted again
    TANGENT_GRAPH = "tangent_graph"  # the six rules of Ch. 3
    SHORTEST_PATH = "shortest_path"  # the complete fallback over the reduced area
    TURN_IN_PLACE = "turn_in_place"  # the robot stands and turns towards a path
    STRAIGHT_LEG = (
        "straight_leg"  # to the next bend of a way too tight for the turning radius, to stop and turn there
    )
    LAST_PATH = "last_path"  # the last certified path, followed inside its window
    EVASION = "evasion"  # out of the way of what comes nearer, while there is no safe way to the target
    ROADMAP = "roadmap"  # a way through samples of the free space (Ch. 4, A1-A7), adjusted
    YIELD = "yield"  # out of the way of another robot, to wait there until that one has passed
    SPACETIME = "spacetime"  # the global planner of Ch. 2


class StopReason(Enum):
    """Typed reasons why a robot gets no path."""

    ARRIVED = "arrived"
    NO_GOAL = "no_goal"
    NO_AREA = "no_area"
    NO_STATE = "no_state"
    START_BLOCKED = "start_blocked"
    GOAL_BLOCKED = "goal_blocked"
    GOAL_UNREACHABLE = "goal_unreachable"
    NO_PATH = "no_path"
    NO_PROGRESS = "no_progress"  # drove or turned for long without getting anywhere; it tries again later
    BLOCKED_BY_ROBOT = "blocked_by_robot"
    YIELDS = "yields"  # waits out of the way of another robot; the message says for whom
    NOT_TRACKED = "not_tracked"  # bodies were not measured often enough yet to know how they move


@dataclass(frozen=True, slots=True)
class Certificate:
    """Verdict of the independent check of one path.

    Parameters
    ----------
    robot_id : str
    accepted : bool
        Whether the path may be reported.
    valid_until : float
        The path is safe for times up to this one [s].
    least_clearance : float
        Least distance from the robot centre to the boundary of the unoccupied area along the window [m].
    least_separation : float
        Least distance from the robot centre to another robot's disk along the window [m]; inf without others.
    least_radius : float
        Least circumscribed radius of three successive points [m]; inf on a straight path.
    area_stamp : float
        Stamp of the unoccupied area that the check used [s].
    path_digest : str
        Digest of the checked path.
    reason : str
        Empty when accepted, else what is violated, where, by how much.
    """

    robot_id: str
    accepted: bool
    valid_until: float
    least_clearance: float
    least_separation: float
    least_radius: float
    area_stamp: float
    path_digest: str
    reason: str = ""


@dataclass(frozen=True)
class PlannedPath:
    """A path that its certificate accepted."""

    robot_id: str
    path: TimedPath
    certificate: Certificate
    source: PathSource
    planning_distance: float  # distance to the boundary that the path was planned for [m]


@dataclass(frozen=True, slots=True)
class Stop:
    """No path for a robot: it stops, for a typed reason and in words."""

    robot_id: str
    reason: StopReason
    message: str


@dataclass(frozen=True)
class HeardPath:
    """What another navigator promised last for one robot.

    Parameters
    ----------
    path : TimedPath or None
        Its last certified path; None when it was stopped.
    valid_until : float
        Time up to which it follows the path [s]; after it the robot stands.
    stop : StopReason or None
        Why it got no path at the instant before this one; None if it got one.
    answers : bool
        Whether the other navigator is at work, so that it can be expected to let the robot make room.
    """

    path: TimedPath | None
    valid_until: float = -math.inf
    stop: StopReason | None = None
    answers: bool = True


@dataclass(frozen=True)
class StepResult:
    """The outcome of one decision step.

    Parameters
    ----------
    time : float
        [s]
    decisions : dict
        For every robot that is served a path or a stop.
    stop_foreign : dict
        Robots that another navigator serves and whose promised path no longer agrees with what was decided here.
    """

    time: float
    decisions: dict[str, PlannedPath | Stop] = field(default_factory=dict)
    stop_foreign: dict[str, Stop] = field(default_factory=dict)
