"""The independent check of a path in space: nothing is reported to a flying robot that this module did not accept.

It shares no code with the planner: distances are the proved bounds of the area, taken along segments, not the
interpolated ones that the planner is led by.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from snnav_core.area.spatial import SpatialArea
from snnav_core.flight_types import FlyerState
from snnav_core.planning.certificate import CertificateSettings
from snnav_core.planning.flight_separation import OtherFlyer, separation
from snnav_core.types import Certificate, FloatArray, RobotSpec, TimedPath

__all__ = ["certify_flight"]

_PIECE = 0.25  # longest piece of a link that is checked as one, as a share of the cells of the area
_SAME_INTERVAL = 1e-6  # of an interval: times since 1970 are no finer than a quarter of a microsecond


def certify_flight(
    path: TimedPath,
    robot: RobotSpec,
    state: FlyerState,
    area: SpatialArea,
    others: Sequence[OtherFlyer],
    settings: CertificateSettings,
    least_window: int = 1,
) -> Certificate:
    """Check a path in space (Ch. 4, "temporarily safe path" and the constraint of the control input).

    Parameters
    ----------
    path : TimedPath
        Starts at the robot, at the stamp of the area or later.
    robot : RobotSpec
    state : FlyerState
        Present state of the robot.
    area : SpatialArea
    others : sequence of OtherFlyer
    settings : CertificateSettings
    least_window : int
        Smallest acceptable window in sampling intervals.

    Returns
    -------
    Certificate
        `accepted` only if for all times s up to `valid_until` the distance of the path, along its segments, to the
        boundary is at least d_s, grown by V_max since the stamp of the area where the boundary may move, plus the
        tracking tolerance; to every other robot's sphere at least d_s plus twice the tolerance, also should that robot
        stop before the next decision; the rest of the path keeps d_s from what is known now; all circumscribed radii,
        the first direction and the lengths of the links hold.

    Notes
    -----
    Deviations: segments instead of points (C0-7); a robot that stands nearer than is demanded may leave, if it comes
    no nearer (C3-13); others are compared exactly in time (C4-10); one that hovers leaves in any direction.
    """
    check = _Check(path, robot, state, area, settings)
    radius = check.least_radius()
    reason = check.shape_fault(radius)
    clear_until, clearance, clear_fault = check.clearance()
    apart_until, apart, apart_fault = separation(path, others, settings)
    window_end = path.start_time + settings.time_window * settings.sampling_interval
    until = max(path.start_time, min(clear_until, apart_until, window_end))
    window = math.floor((until - path.start_time) / settings.sampling_interval + _SAME_INTERVAL)
    if not reason and window < least_window:
        reason = clear_fault if clear_until <= apart_until else apart_fault
    if not reason:
        reason = check.tail_fault(window * settings.sampling_interval)
    return Certificate(
        robot_id=robot.id,
        accepted=not reason,
        valid_until=path.start_time + min(window, settings.time_window) * settings.sampling_interval,
        least_clearance=clearance,
        least_separation=apart,
        least_radius=radius,
        area_stamp=area.stamp,
        path_digest=path.digest(),
        reason=reason,
    )


class _Check:
    """One path under check."""

    def __init__(
        self,
        path: TimedPath,
        robot: RobotSpec,
        state: FlyerState,
        area: SpatialArea,
        settings: CertificateSettings,
    ) -> None:
        self.path, self.robot, self.state, self.area, self.settings = path, robot, state, area, settings
        self.points = np.asarray(path.points)
        links = max(len(path) - 1, 0)
        longest = float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).max(initial=0.0))
        parts = max(1, math.ceil(longest / (_PIECE * area.grid.spacing)))
        knots = np.arange(links * parts + 1) / parts
        self.times = knots[1:] * path.step  # end of every piece, from the start on
        self.knots = path.positions_at(path.start_time + knots * path.step)
        since = max(path.start_time - area.stamp, 0.0)
        self.distances = self._along(settings.boundary_speed * (since + self.times))
        self.present_distances = self._along(np.zeros(len(self.times)))
        self._grown = settings.boundary_speed * since
        self.present = float(area.clearance_at(self.points[:1], self._grown)[0])

    def _along(self, growth: FloatArray) -> FloatArray:
        """Least distance of every piece, (M,) [m].

        No point of it is nearer than half of both ends less its length; and along it the square of the distance less
        that of the way is concave, as told at `SpatialArea`.
        """
        if len(growth) == 0:
            return np.empty(0)
        begin = self.area.clearance_at(self.knots[:-1], growth)
        end = self.area.clearance_at(self.knots[1:], growth)
        step = np.diff(self.knots, axis=0)
        squared = np.maximum(np.einsum("ij,ij->i", step, step), 1e-18)
        near = np.minimum(np.minimum(begin, end), 0.5 * (begin + end - np.sqrt(squared)))
        first, last = np.maximum(begin, 0.0) ** 2, np.maximum(end, 0.0) ** 2
        share = np.clip(
            0.5 * (squared + first - last) / squared, 0.0, 1.0
        )  # of the way, to the least of the bound
        least = (1.0 - share) * first + share * last - share * (1.0 - share) * squared
        return np.asarray(np.maximum(near, np.where(least > 0.0, np.sqrt(np.maximum(least, 0.0)), -np.inf)))

    def least_radius(self) -> float:
        """Least circumscribed radius of three successive points [m]; 0 where the path turns back."""
        if len(self.points) < 3:
            return math.inf
        before, after = np.diff(self.points, axis=0)[:-1], np.diff(self.points, axis=0)[1:]
        doubled = np.linalg.norm(np.cross(before, after), axis=1)
        product = (
            np.linalg.norm(before, axis=1)
            * np.linalg.norm(after, axis=1)
            * np.linalg.norm(before + after, axis=1)
        )
        radius = np.where(doubled > 1e-12, product / (2.0 * np.maximum(doubled, 1e-300)), np.inf)
        radius[np.einsum("ij,ij->i", before, after) <= 0.0] = 0.0
        return float(radius.min())

    def shape_fault(self, least_radius: float) -> str:
        """Reason why the shape of the path cannot be flown, or an empty string."""
        if self.points.shape[1] != 3 or len(self.points) < 2:
            return f"the path has points of shape {self.points.shape}, needs at least two in space"
        offset = float(np.linalg.norm(self.points[0] - self.state.position))
        if not offset <= 1e-6:
            return f"the path starts {offset:.3f} m away from the robot"
        nominal, stretch = self.robot.speed * self.path.step, self.settings.stretch
        links = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        inner = float(links[:-1].min()) if len(links) > 1 else nominal
        if float(links.max()) > stretch * nominal + 1e-9 or inner < (1.92 - stretch) * nominal - 1e-9:
            return (
                f"links are {float(links.min()):.3f} to {float(links.max()):.3f} m long, "
                f"the robot covers {nominal:.3f} m in a step"
            )
        limit = self.settings.radius_factor * self.robot.min_turn_radius
        if self.state.speed > 0.0 and links[0] > 1e-9:
            along = float(np.clip(self.state.direction @ (self.points[1] - self.points[0]) / links[0], -1, 1))
            reach = float(links[0]) if len(links) > 1 else nominal
            allowed = math.asin(min(1.0, reach / (2.0 * limit)))
            if math.acos(along) > allowed + 1e-6:
                off, most = math.degrees(math.acos(along)), math.degrees(allowed)
                return f"the path starts {off:.1f} deg off the direction of flight, allowed {most:.1f} deg"
        if least_radius < limit - 1e-9:
            return f"the least radius of the path is {least_radius:.3f} m, the robot needs {limit:.3f} m"
        return ""

    def _demanded(self) -> FloatArray:
        """What every piece has to keep [m]; a robot that comes from nearer keeps what it has."""
        settings = self.settings
        ramp = np.minimum(1.0, self.times / settings.sampling_interval)
        full = settings.safety_margin + settings.tracking_tolerance * ramp
        if self.present >= settings.safety_margin:
            soon = self.times <= settings.sampling_interval + 1e-9
            full[soon] = np.minimum(full[soon], np.maximum(settings.safety_margin, self.present))
            return full
        reached = np.maximum.accumulate(self.distances >= full)
        # Whatever moves may come nearer meanwhile, walls do not: to what is there now it comes no nearer.
        now = self._along(np.full(len(self.times), self._grown))
        lost = np.where(np.isfinite(self.distances), now - self.distances, 0.0)
        return np.where(reached, full, np.minimum(full, self.present - lost - self._slack))

    @property
    def _slack(self) -> float:
        """What a piece that starts at the robot loses by its length alone [m]."""
        return 0.5 * _PIECE * self.area.grid.spacing + self.area.grid.half_diagonal * 0.05

    def clearance(self) -> tuple[float, float, str]:
        """Until when the margin to the boundary holds [s], the least distance until then [m], what fails then."""
        start = self.path.start_time
        if self.present <= 0.0 or len(self.distances) == 0:
            return -math.inf, min(self.present, 0.0), "the robot is where nothing is proved free"
        inside = self.times <= self.settings.time_window * self.settings.sampling_interval + 1e-9
        demanded = self._demanded()
        failing = np.flatnonzero(inside & (self.distances < demanded - 1e-9))
        until = int(failing[0]) if len(failing) else int(inside.sum())
        least = float(self.distances[: max(until, 1)].min())
        if len(failing) == 0:
            return math.inf, least, ""
        point = self.knots[until + 1]
        fault = (
            f"clearance {self.distances[until]:.3f} m at ({point[0]:.2f}, {point[1]:.2f}, {point[2]:.2f}) after "
            f"{self.times[until]:.2f} s, demanded {demanded[until]:.3f} m"
        )
        return start + (float(self.times[until - 1]) if until else 0.0), least, fault

    def tail_fault(self, window: float) -> str:
        """Whether the path beyond the proved window [s] at least keeps d_s from what is known now."""
        beyond = np.flatnonzero(self.times > window + 1e-9)
        if len(beyond) == 0:
            return ""
        margin = min(self.settings.safety_margin, max(self.present - self._slack, 0.0))
        worst = int(beyond[np.argmin(self.present_distances[beyond])])
        if self.present_distances[worst] >= margin - 1e-9:
            return ""
        return (
            f"beyond the window the path comes within {self.present_distances[worst]:.3f} m of the boundary, "
            f"margin {margin:.3f} m"
        )
