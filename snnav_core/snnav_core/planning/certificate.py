"""The independent check of a path: nothing is reported to a robot that this module did not accept.

It shares no code with the planner: distances come from shapely, not from the planner's clearance field.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from snnav_core.errors import InvalidInput
from snnav_core.planning.boundary_index import BoundaryIndex
from snnav_core.planning.separation import OtherRobot, separation
from snnav_core.types import Certificate, FloatArray, Pose2D, RobotSpec, TimedPath

__all__ = [
    "PIECES_PER_LINK",
    "CertificateSettings",
    "certify",
]

PIECES_PER_LINK = 8
"""So many pieces of a link are checked each when the boundary moves; a planner has to keep what the boundary moves in
the time of one piece as a reserve."""

_SAME_INTERVAL = 1e-6  # of an interval: times since 1970 are no finer than a quarter of a microsecond


@dataclass(frozen=True, slots=True)
class CertificateSettings:
    """What a path must keep.

    Parameters
    ----------
    safety_margin : float
        d_s, from the robot centre to the boundary of the unoccupied area and to other robots' disks [m].
    boundary_speed : float
        V_max [m/s].
    sampling_interval : float
        delta [s].
    time_window : int
        T, in sampling intervals.
    tracking_tolerance : float
        Demanded beyond the margin for tracking errors, in full from the first sampling interval on: the path starts
        at the robot itself [m]. Twice as much towards other robots, which may be off their paths as well.
    radius_factor : float
        Smallest circumscribed radius as a share of R_min (C0-9).
    stretch : float
        Largest and smallest link as shares of speed x step are `stretch` and 2 - `stretch` - 0.08 (C0-11).
    """

    safety_margin: float
    boundary_speed: float
    sampling_interval: float
    time_window: int
    tracking_tolerance: float = 0.01
    radius_factor: float = 0.95
    stretch: float = 1.02

    def __post_init__(self) -> None:
        if not self.safety_margin > 0.0 or not self.sampling_interval > 0.0:
            raise InvalidInput(
                f"safety_margin {self.safety_margin} and sampling_interval {self.sampling_interval} must be positive"
            )
        if self.time_window < 1 or not self.boundary_speed >= 0.0 or not self.tracking_tolerance >= 0.0:
            raise InvalidInput(
                f"time_window {self.time_window} must be >= 1, boundary_speed {self.boundary_speed} and "
                f"tracking_tolerance {self.tracking_tolerance} >= 0"
            )


def certify(
    path: TimedPath,
    robot: RobotSpec,
    pose: Pose2D,
    boundary: BoundaryIndex,
    area_stamp: float,
    others: Sequence[OtherRobot],
    settings: CertificateSettings,
    least_window: int = 1,
) -> Certificate:
    """Check a path (Ch. 3, "temporarily safe path" and the non-holonomic constraint).

    Parameters
    ----------
    path : TimedPath
        Starts at the robot.
    robot : RobotSpec
    pose : Pose2D
        Present pose of the robot [map].
    boundary : BoundaryIndex
        Of the unoccupied area at the start time of the path.
    area_stamp : float
        Stamp of that area [s].
    others : sequence of OtherRobot
    settings : CertificateSettings
    least_window : int
        Smallest acceptable window in sampling intervals. When the margin holds for fewer than T but at least so many,
        the certificate is accepted with the shorter window (`valid_until`).

    Returns
    -------
    Certificate
        `accepted` only if for all times s up to `valid_until` the distance of the path, along its segments, to the
        boundary is >= d_s + s V_max (plus the tracking tolerance), to every other robot's disk >= d_s (plus twice the
        tolerance), in the first interval also should that robot stop, the rest of the path keeps d_s, all
        circumscribed radii, the first heading and the link lengths hold.

    Notes
    -----
    Deviations: segments instead of points (C0-7). When the robot itself stands closer than d_s (C3-13), the demand is
    lowered to its present distance: the path must lead away, never closer, and what it has gained it keeps. In the
    first interval it is lowered so for every robot: what comes no nearer is as safe as stopping, and must be allowed.
    """
    check = _Check(path, robot, pose, boundary, others, settings)
    radius = check.least_radius()
    reason = check.geometry_fault(radius)
    if reason:
        # Distances of what cannot be driven are of no use: a crowd asks for hundreds of certificates in a step.
        digest = path.digest()
        return Certificate(robot.id, False, path.start_time, 0.0, 0.0, radius, area_stamp, digest, reason)
    clearance_until, clearance, clearance_fault = check.clearance()
    separation_until, separation, separation_fault = check.separation()
    safe_until = max(path.start_time, min(clearance_until, separation_until, check.window_end))
    whole = math.floor((safe_until - path.start_time) / settings.sampling_interval + _SAME_INTERVAL)
    window = min(settings.time_window, whole)
    if window < least_window:
        reason = clearance_fault if clearance_until <= separation_until else separation_fault
    if not reason:
        reason = check.tail_fault(window * settings.sampling_interval)
    return Certificate(
        robot_id=robot.id,
        accepted=not reason,
        valid_until=min(path.start_time + window * settings.sampling_interval, check.stands_until()),
        least_clearance=clearance,
        least_separation=separation,
        least_radius=radius,
        area_stamp=area_stamp,
        path_digest=path.digest(),
        reason=reason,
    )


class _Check:
    """One path under check."""

    def __init__(
        self,
        path: TimedPath,
        robot: RobotSpec,
        pose: Pose2D,
        boundary: BoundaryIndex,
        others: Sequence[OtherRobot],
        settings: CertificateSettings,
    ) -> None:
        self.path, self.robot, self.pose = path, robot, pose
        self.others, self.settings, self.boundary = others, settings, boundary
        self.points = np.asarray(path.points)
        self.window_end = path.start_time + settings.time_window * settings.sampling_interval

    @property
    def times(self) -> FloatArray:
        """End time of every piece relative to the start [s], shape (M,)."""
        return self._pieces[0]

    @property
    def pieces(self) -> FloatArray:
        """Ends of the pieces (M, 2, 2) [m, map]."""
        return self._pieces[1]

    @cached_property
    def distances(self) -> FloatArray:
        """Distances of the pieces to the boundary [m]; infinite for those that keep all that may be demanded."""
        return self.boundary.distances_below(self.pieces, self._ever_demanded() + 1e-6)

    @cached_property
    def _ends(self) -> FloatArray:
        return self.boundary.distances(self.points[[[0, 0], [-1, -1]]])

    @property
    def present(self) -> float:
        """Present distance of the robot to the boundary [m]."""
        return float(self._ends[0])

    @cached_property
    def _pieces(self) -> tuple[FloatArray, FloatArray]:
        """Cut the path into pieces short in time: end time of each relative to the start (M,), ends (M, 2, 2).

        Links within the window are cut when the boundary moves: a piece has to keep what is demanded at its end.
        """
        parts = PIECES_PER_LINK if self.settings.boundary_speed > 0.0 else 1
        links = len(self.path) - 1
        window = self.settings.time_window * self.settings.sampling_interval
        if self.path.turn_to is not None or links == 0:
            # The robot stands: as many pieces as a path over the whole window has.
            count = max(1, round(window / self.path.step)) * parts
            standing: FloatArray = np.tile(self.points[0], (count, 2, 1))
            return np.linspace(window / count, window, count), standing
        inner = min(links, math.ceil(window / self.path.step - 1e-9))
        knots: FloatArray = np.concatenate((np.arange(inner * parts) / parts, np.arange(inner, links + 1)))
        index = np.minimum(knots.astype(np.int64), links - 1)
        share = (knots - index)[:, None]
        times: FloatArray = knots[1:] * self.path.step
        points = self.points[index] * (1.0 - share) + self.points[index + 1] * share
        return times, np.stack((points[:-1], points[1:]), axis=1)

    def least_radius(self) -> float:
        """Least circumscribed radius abc / (4 area) of three successive points [m]."""
        if len(self.path) < 3 or self.path.turn_to is not None:
            return math.inf
        first, middle, last = self.points[:-2], self.points[1:-1], self.points[2:]
        a = np.linalg.norm(middle - first, axis=1)
        b = np.linalg.norm(last - middle, axis=1)
        c = np.linalg.norm(last - first, axis=1)
        doubled = np.abs(
            (middle - first)[:, 0] * (last - first)[:, 1] - (middle - first)[:, 1] * (last - first)[:, 0]
        )
        reversal = np.einsum("ij,ij->i", middle - first, last - middle) <= 0.0
        with np.errstate(divide="ignore"):
            radius = np.where(doubled > 1e-12, a * b * c / (2.0 * np.maximum(doubled, 1e-300)), np.inf)
        radius[reversal] = 0.0
        return float(radius.min())

    def geometry_fault(self, least_radius: float) -> str:
        """Reason why the shape of the path cannot be driven, or an empty string."""
        offset = float(np.linalg.norm(self.points[0] - self.pose.position))
        if not offset <= 1e-6:
            return f"the path starts {offset:.3f} m away from the robot"
        if self.path.turn_to is not None:
            moved = float(np.abs(self.points - self.points[0]).max())
            if moved > 0.0:
                return f"a turn in place moves by {moved:.3f} m"
            return "" if self.robot.can_turn_in_place else f"robot {self.robot.id} cannot turn in place"
        if len(self.path) < 2:
            return "the path has a single point"
        return self._link_fault() or self._heading_fault() or self._radius_fault(least_radius)

    def _link_fault(self) -> str:
        nominal = self.robot.speed * self.path.step
        links = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        longest, stretch = float(links.max()), self.settings.stretch
        if longest > stretch * nominal + 1e-9:
            return f"a link is {longest:.3f} m long, the robot covers {nominal:.3f} m in a step"
        shortest = float(links[:-1].min()) if len(links) > 1 else nominal
        if shortest < (1.92 - stretch) * nominal - 1e-9:
            return f"a link is only {shortest:.3f} m long, the robot covers {nominal:.3f} m in a step"
        return ""

    def _heading_fault(self) -> str:
        direction = self.points[1] - self.points[0]
        length = float(np.linalg.norm(direction))
        if length < 1e-9:
            return "the first link has no length"
        angle = abs(math.remainder(math.atan2(direction[1], direction[0]) - self.pose.heading, 2.0 * math.pi))
        radius = self.settings.radius_factor * self.robot.min_turn_radius
        # A path of one short link ends before its direction matters.
        reach = length if len(self.path) > 2 else max(length, self.robot.speed * self.path.step)
        limit = math.asin(min(1.0, reach / (2.0 * radius)))
        if not angle <= limit + 1e-6:
            off, allowed = math.degrees(angle), math.degrees(limit)
            return f"the path starts {off:.1f} deg off the heading, allowed {allowed:.1f} deg"
        return ""

    def _radius_fault(self, least_radius: float) -> str:
        limit = self.settings.radius_factor * self.robot.min_turn_radius
        if least_radius < limit - 1e-9:
            return f"the least radius of the path is {least_radius:.3f} m, the robot needs {limit:.3f} m"
        return ""

    @cached_property
    def _inside(self) -> NDArray[np.bool_]:
        """Pieces within the window."""
        return np.asarray(self.times <= self.settings.time_window * self.settings.sampling_interval + 1e-9)

    def _tolerance(self) -> FloatArray:
        settings = self.settings
        return settings.tracking_tolerance * np.minimum(1.0, self.times / settings.sampling_interval)

    def _ever_demanded(self) -> FloatArray:
        """Most that is demanded of every piece, whatever the robot comes from [m]: beyond the window d_s."""
        settings = self.settings
        # The piece ends at `times`; up to then the boundary has come closer by at most this.
        within = settings.safety_margin + settings.boundary_speed * self.times + self._tolerance()
        return np.where(self._inside, within, settings.safety_margin)

    def _demanded(self) -> FloatArray:
        """Demanded distance of every piece [m]: d_s + growth until its end + tracking tolerance."""
        settings, tolerance = self.settings, self._tolerance()
        demanded, present = self._ever_demanded(), self.present
        if present < settings.safety_margin:
            reached = np.maximum.accumulate(self.distances >= demanded)
            demanded = np.where(reached, demanded, np.minimum(demanded, self._least()))
        soon = self.times <= settings.sampling_interval + 1e-9
        demanded[soon] = np.minimum(demanded[soon], present)
        # The first piece starts at the robot itself, which no path can change.
        first = settings.boundary_speed * self.times[0] + tolerance[0]
        demanded[0] = min(demanded[0], max(settings.safety_margin, present - first))
        return demanded

    def _least(self) -> FloatArray:
        """What every piece keeps whatever the boundary does [m]: d_s, or less for a robot that comes from nearer."""
        margin = self.settings.safety_margin
        reached = np.maximum.accumulate(self.distances) >= margin
        return np.where(reached, margin, min(margin, self.present))

    def clearance(self) -> tuple[float, float, str]:
        """Until when the margin to the boundary holds [s], the least distance until then [m], what fails then."""
        if len(self.distances) == 0 or self.present <= 0.0:
            return -math.inf, 0.0, "the robot is outside the unoccupied area"
        demanded = self._demanded()
        failing = np.flatnonzero(self._inside & (self.distances < demanded - 1e-9))
        least = self._least_distance()
        if len(failing) == 0:
            return math.inf, least, ""
        first = int(failing[0])
        before = float(self.times[first - 1]) if first else 0.0
        point = self.pieces[first].mean(axis=0)
        fault = (
            f"clearance {self.distances[first]:.3f} m at ({point[0]:.2f}, {point[1]:.2f}) after "
            f"{self.times[first]:.2f} s, demanded {demanded[first]:.3f} m"
        )
        return self.path.start_time + before, least, fault

    def _least_distance(self) -> float:
        """Least distance within the window [m]."""
        count = max(int(self._inside.sum()), 1)
        if (self.distances[:count] == 0.0).any():
            return 0.0
        links = min(len(self.path) - 1, math.ceil(self.times[count - 1] / self.path.step - 1e-9))
        chain = self.points[: links + 1] if links > 0 else self.points[[0, 0]]
        return self.boundary.least_distance(chain)

    def stands_until(self) -> float:
        """Until when the robot may stand at the end of the path while the boundary comes nearer [s]."""
        settings = self.settings
        if settings.boundary_speed == 0.0 or self.path.turn_to is not None:
            return math.inf
        reserve = float(self._ends[1]) - settings.safety_margin
        return max(self.path.end_time, self.path.start_time + reserve / settings.boundary_speed)

    def tail_fault(self, window: float) -> str:
        """Whether the path beyond the proved window [s] at least keeps d_s from what is known now."""
        deficit = np.where(self.times > window + 1e-9, self._least() - self.distances, -math.inf)
        worst = int(np.argmax(deficit)) if len(deficit) else -1
        if worst < 0 or deficit[worst] <= 1e-9:
            return ""
        return (
            f"beyond the window the path comes within {self.distances[worst]:.3f} m of the boundary, "
            f"margin {self.distances[worst] + deficit[worst]:.3f} m"
        )

    def separation(self) -> tuple[float, float, str]:
        """Until when the margin to other robots holds [s], the least distance to their disks [m], what fails then."""
        settings = self.settings
        # Both may be off their paths.
        margin = settings.safety_margin + 2.0 * settings.tracking_tolerance
        return separation(self.path, self.others, self.window_end, margin, settings.sampling_interval)
