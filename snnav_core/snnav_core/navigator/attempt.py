"""One attempt: adjust a chain of points to a path and have it certified."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from snnav_core.navigator.context import AreaContext
from snnav_core.navigator.crowd import Crowd, Turns
from snnav_core.navigator.forecast import Forecast
from snnav_core.navigator.settings import NavigatorSettings, RobotDistances
from snnav_core.planning.adjustment import adjust, resample
from snnav_core.planning.certificate import certify
from snnav_core.planning.fields import Barrier, BoundaryBarrier, CircleBarrier
from snnav_core.planning.separation import OtherRobot
from snnav_core.planning.shortest import initial_circles
from snnav_core.types import Certificate, FloatArray, PathSource, PlannedPath, Pose2D, RobotSpec, TimedPath

__all__ = ["Attempt", "margin_profiles"]


def margin_profiles(
    distances: RobotDistances,
    settings: NavigatorSettings,
    robot: RobotSpec,
    route_distance: float,
    present: float,
) -> list[FloatArray]:
    """Distances to plan for at p_1, p_2, ... [m], the preferred profile first; the last value holds beyond.

    1. The same distance everywhere. A distance that grows along the path lets the near points cut a corner that the
       far ones have to round, and the path kinks where they meet.
    2. The distance that the certificate demands, growing with V_max over the window, and the planned turning radius.
    3. The second, never more than the way to the target allows; the certificate then tells the shorter window.

    A robot that stands nearer than demanded is led away, not torn away (C3-13).
    """
    demanded = np.append(distances.demanded(), route_distance)
    growing = np.maximum(demanded, min(distances.turn_radius, route_distance))
    constant = np.maximum(demanded, route_distance)
    slope = min(1.0, settings.boundary_speed / robot.speed + 0.3)
    climb = present + slope * distances.link * np.arange(1, len(demanded) + 1)
    profiles: list[FloatArray] = []
    for profile in (constant, growing, np.minimum(growing, route_distance)):
        limited = np.minimum(profile, np.maximum(climb, 0.0))
        if not any(np.array_equal(limited, other) for other in profiles):
            profiles.append(limited)
    return profiles


@dataclass(frozen=True)
class Attempt:
    """All that adjusting and certifying a path of one robot needs in one step."""

    context: AreaContext
    robot: RobotSpec
    pose: Pose2D
    target: FloatArray
    time: float
    others: Sequence[OtherRobot]
    distances: RobotDistances
    settings: NavigatorSettings
    planning_distance: float
    previous: AreaContext | None = None
    """The area of the step before, when it was another one."""
    forecast: Forecast | None = None
    """What comes nearer, where that looks farther ahead than the window."""
    turns: Turns = field(default_factory=lambda: Turns(1))
    """Who seeks new ways in this step."""

    def __post_init__(self) -> None:
        crowd = self.others
        if not isinstance(crowd, Crowd) or crowd.pose is not self.pose or crowd.time != self.time:
            crowd = Crowd(crowd, self.pose, self.time, self.distances, self.settings)
            object.__setattr__(self, "others", crowd)

    def adjusted(
        self, points: FloatArray, rotation: int, margins: FloatArray, max_passes: int, source: PathSource
    ) -> PlannedPath:
        """Adjust points (N, 2) [m, map] that start at the robot; the certificate tells whether the path is any good."""
        link = self.distances.link
        longest = 3 * len(points) + 200
        result = adjust(
            points,
            self.target,
            link,
            self._barriers(points, rotation, margins),
            self.settings.adjustment,
            max_passes,
            longest,
        )
        chain = self._evenly(np.vstack((result.points, self.target)))
        return self.planned(TimedPath(self.time, self.distances.step, chain), source)

    def _evenly(self, chain: FloatArray) -> FloatArray:
        """Points at the link length along a chain, and its end; as they are when they lie so within 0.5 %."""
        links, link = np.linalg.norm(np.diff(chain, axis=0), axis=1), self.distances.link
        if len(links) > 1 and np.abs(links[:-1] - link).max() <= 0.005 * link and 1e-3 < links[-1] <= link:
            return chain
        points = resample(chain, link)
        if float(np.linalg.norm(points[-1] - chain[-1])) > 1e-3 or len(points) < 2:
            points = np.vstack((points, chain[-1]))
        return points

    def _barriers(self, points: FloatArray, rotation: int, margins: FloatArray) -> list[Barrier]:
        radius, link = self.distances.circle_radius, self.distances.link
        left, right = initial_circles(self.pose, radius)
        own, opposite = (left, right) if rotation > 0 else (right, left)
        around = math.ceil(2.0 * math.pi * radius / link)
        return [
            BoundaryBarrier(self.context.area.clearance_field, margins),
            *self.crowd.barriers(points),
            CircleBarrier(opposite.centre, opposite.radius, math.ceil(around / 4)),
            CircleBarrier(own.centre, own.radius, around),
        ]

    @property
    def crowd(self) -> Crowd:
        """The other robots as this one sees them; shared by all attempts of one robot in one step."""
        assert isinstance(self.others, Crowd)
        return self.others

    def along(self, chain: FloatArray, source: PathSource) -> PlannedPath:
        """A path along a chain (N, 2) [m, map] that starts at the robot, as it is."""
        return self.planned(TimedPath(self.time, self.distances.step, self._evenly(chain)), source)

    def planned(self, path: TimedPath, source: PathSource) -> PlannedPath:
        """Attach the certificate to a path."""
        return PlannedPath(self.robot.id, path, self.certificate(path), source, self.planning_distance)

    def certificate(self, path: TimedPath) -> Certificate:
        """Independent check against the present area and the other robots."""
        return certify(
            path,
            self.robot,
            self.pose,
            self.context.boundary,
            self.context.area.stamp,
            self.others,
            self.distances.certificate,
        )

    def is_full(self, plan: PlannedPath) -> bool:
        """Whether a plan is certified for the whole time window, or to its end."""
        window = self.settings.time_window * self.settings.sampling_interval
        whole = (
            self.time + window
            if plan.path.turn_to is not None
            else min(self.time + window, plan.path.end_time)
        )
        return plan.certificate.accepted and plan.certificate.valid_until >= whole - 1e-6

    @property
    def in_company(self) -> bool:
        """Whether another robot is so near that it may be in the way."""
        reach = self.crowd.own_reach + self.distances.tightest
        return len(self.others) > 0 and bool(self.crowd.gaps.min() <= reach)

    def is_lasting(self, plan: PlannedPath) -> bool:
        """Whether a plan is certified for two sampling intervals at least, or to its end."""
        soon = self.time + 2.0 * self.settings.sampling_interval
        return plan.certificate.valid_until >= min(soon, plan.path.end_time) - 1e-6

    def is_whole(self, plan: PlannedPath) -> bool:
        """Whether a plan is certified for the whole time window, standing at its end included."""
        window = self.settings.time_window * self.settings.sampling_interval
        return plan.certificate.accepted and plan.certificate.valid_until >= self.time + window - 1e-6
