"""What one decision for one flying robot is about: paths from where it is, adjusted and certified."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from snnav_core.area.spatial import SpatialArea
from snnav_core.flight_types import FlyerState
from snnav_core.navigator.flight_settings import FlightDistances
from snnav_core.planning.adjustment import adjust, resample
from snnav_core.planning.fields import Barrier, DiskBarrier
from snnav_core.planning.flight_certificate import certify_flight
from snnav_core.planning.flight_fields import RegionBarrier, TorusBarrier
from snnav_core.planning.flight_separation import OtherFlyer
from snnav_core.types import Certificate, FloatArray, PathSource, PlannedPath, RobotSpec, TimedPath

__all__ = ["FlightTask"]

_SOON = 3.0  # windows ahead in which a path is bent around others: farther ahead they will have moved
_MOST_LENGTHS = 6.0  # a path is never longer than so many times the way that it began as


class FlightTask:
    """One robot at one sampling instant.

    Parameters
    ----------
    robot : RobotSpec
    distances : FlightDistances
    time : float
        [s]
    area : SpatialArea
    state : FlyerState
    goal : ndarray, shape (3,)
        [m, map]
    others : sequence of OtherFlyer
    """

    def __init__(
        self,
        robot: RobotSpec,
        distances: FlightDistances,
        time: float,
        area: SpatialArea,
        state: FlyerState,
        goal: FloatArray,
        others: Sequence[OtherFlyer],
    ) -> None:
        self.robot, self.settings, self.distances = robot, distances.settings, distances
        self.time, self.area, self.state, self.goal, self.others = time, area, state, goal, others
        self.since = max(time - area.stamp, 0.0)
        self.now = self.settings.boundary_speed * self.since
        half = area.grid.half_diagonal
        # What is proved is below what is interpolated, by no more than the last of these, h^2 being 4/3 half^2.
        self.reserves = (half, 0.5 * half, 0.5 * half * half / self.settings.safety_margin)
        self.faults: list[str] = []
        self.reachable: bool | None = None  # not known yet

    @property
    def growth(self) -> float:
        """How far what may move can have come nearer when the window ends [m]."""
        return self.settings.boundary_speed * (self.since + self.distances.window)

    def go_on(self, last: PlannedPath) -> PlannedPath | None:
        """The last path from where the robot is, adjusted to the present region."""
        passed = round((self.time - last.path.start_time) / last.path.step)
        ahead = last.path.points[passed + 1 :]
        if len(ahead) == 0:
            return None
        points = np.vstack((self.state.position, ahead))
        return self.adjusted(points, PathSource.WARM_START, self.settings.adjustment.warm_passes)

    def rest_of(self, last: PlannedPath) -> PlannedPath | None:
        """The last path as it is, where its window still holds: flown on, and checked again."""
        passed = round((self.time - last.path.start_time) / last.path.step)
        ahead = last.path.points[passed + 1 :]
        if last.certificate.valid_until <= self.time or len(ahead) == 0:
            return None
        path = TimedPath(self.time, last.path.step, np.vstack((self.state.position, ahead)))
        return self.certified(path, PathSource.LAST_PATH, last.planning_distance)

    def departure(self) -> tuple[FloatArray, FloatArray]:
        """Where the rough path may turn, and what leads there: straight ahead in flight (C4-4)."""
        position = self.state.position
        if self.state.speed == 0.0:
            return position, position[None]
        ahead = position + 2.0 * self.distances.link * self.state.direction
        return ahead, position[None]

    def adjusted(
        self, points: FloatArray, source: PathSource, passes: int, reserve: float | None = None
    ) -> PlannedPath | None:
        """Adjust a chain, and let the certificate decide."""
        distances = self.distances
        for kept in self.reserves if reserve is None else (reserve,):
            planned = distances.planned(kept)
            most = int(_MOST_LENGTHS * len(points)) + 20
            barriers = self._barriers(planned)
            result = adjust(
                points, self.goal, distances.link, barriers, self.settings.adjustment, passes, most
            )
            chain = resample(result.points, distances.link) if len(result.points) > 1 else result.points
            if len(chain) < 2:
                gap = self.goal - self.state.position
                share = min(1.0, distances.link / float(np.linalg.norm(gap)))
                chain = np.vstack((self.state.position, self.state.position + share * gap))
            if not self._leads_on(chain):
                self.faults.append("what can be flown ends beside the target, no nearer than the robot is")
                continue
            path = TimedPath(self.time, distances.step, chain)
            certified = self.certified(path, source, planned)
            conflict = self._conflict(chain)
            if conflict is not None:
                return self._aside(chain, conflict, source, passes, planned) or certified
            if certified is not None:
                return certified
        return None

    def _leads_on(self, chain: FloatArray) -> bool:
        """Whether a chain ends at the target, or nearer to it than it begins, by half a link at least.

        Barriers push the end of a chain off a target that is nearer to the boundary than paths are planned; from there
        the next chain may lead back.
        """
        begin, end = np.linalg.norm(chain[[0, -1]] - self.goal, axis=1)
        return bool(end <= max(self.distances.arrival, begin - 0.5 * self.distances.link))

    def _conflict(self, chain: FloatArray) -> tuple[int, float] | None:
        """Where a chain comes too near to another robot soon, and what it has to keep there [m]."""
        if not self.others or len(chain) < 4:
            return None
        times: FloatArray = self.time + self.distances.step * np.arange(len(chain), dtype=np.float64)
        places = np.stack([other.path.positions_at(times) for other in self.others])
        apart = np.array([self.apart(other) for other in self.others])
        lacking = apart[:, None] - np.linalg.norm(places - chain, axis=2)
        lacking[:, [0, 1, -2, -1]] = -np.inf  # where the robot is, and at its target, nothing can be bent
        leaving = np.array([other.leaves for other in self.others])
        lacking[np.ix_(leaving, times > self.time + self.distances.window)] = -np.inf
        lacking[:, times > self.time + _SOON * self.distances.window] = -np.inf
        which, where = np.unravel_index(int(np.argmax(lacking)), lacking.shape)
        return (int(where), float(apart[which])) if lacking[which, where] > 0.01 else None

    def apart(self, other: OtherFlyer) -> float:
        """Distance to the centre of another robot that points are planned for [m]: between two points both move."""
        margin = self.settings.safety_margin + 2.0 * self.settings.tracking_tolerance
        return margin + other.radius + 0.5 * self.distances.link

    def _aside(
        self,
        chain: FloatArray,
        conflict: tuple[int, float],
        source: PathSource,
        passes: int,
        planned: float,
    ) -> PlannedPath | None:
        """The same chain bent to the left, right, up and down where it comes nearest to another robot.

        Fields push along the line between two robots that meet head on, which leads neither past the other.
        """
        distances = self.distances
        where, apart = conflict
        before, after = chain[where - 1], chain[where + 1]
        along = (after - before) / max(float(np.linalg.norm(after - before)), 1e-9)
        left = np.cross((0.0, 0.0, 1.0), along)
        left = left / np.linalg.norm(left) if np.linalg.norm(left) > 1e-6 else np.array([0.0, 1.0, 0.0])
        up = np.cross(along, left)
        width = 1.5 * apart / distances.link
        bump = 1.1 * apart * np.exp(-(((np.arange(len(chain)) - where) / width) ** 2))
        bump[0] = 0.0
        passes = min(passes, self.settings.adjustment.warm_passes)
        for side in (left, -left, up, -up):
            bent = resample(chain + bump[:, None] * side, distances.link)
            most = int(_MOST_LENGTHS * len(bent)) + 20
            barriers = self._barriers(planned)
            result = adjust(bent, self.goal, distances.link, barriers, self.settings.adjustment, passes, most)
            path = TimedPath(self.time, distances.step, resample(result.points, distances.link))
            if len(path) < 2 or self._conflict(path.points) is not None:
                continue
            certified = self.certified(path, source, planned)
            if certified is not None:
                return certified
        return None

    def _barriers(self, planned: float) -> list[Barrier]:
        distances = self.distances
        barriers: list[Barrier] = [RegionBarrier(self.area, planned, distances.growth(self.since))]
        for other in self.others:
            ahead = max(other.path.end_time - self.time, 0.0)
            count = 2 + int(max(ahead, distances.window if other.leaves else 0.0) / distances.step)
            times: FloatArray = self.time + distances.step * np.arange(1, count + 1, dtype=np.float64)
            apart = np.full(count, self.apart(other))
            apart[-1] *= not other.leaves
            barriers.append(DiskBarrier(other.path.positions_at(times), apart))
        if self.state.speed > 0.0:
            around = int(np.ceil(2.0 * np.pi * distances.torus / distances.link))
            barriers.append(TorusBarrier(self.state.position, self.state.direction, distances.torus, around))
        return barriers

    def certified(self, path: TimedPath, source: PathSource, planned: float) -> PlannedPath | None:
        """The path with its certificate; None, and a fault, when that does not accept it."""
        certificate = self._certificate(path)
        if not certificate.accepted:
            self.faults.append(certificate.reason)
            return None
        return PlannedPath(self.robot.id, path, certificate, source, planned)

    def _certificate(self, path: TimedPath) -> Certificate:
        return certify_flight(
            path, self.robot, self.state, self.area, self.others, self.distances.certificate
        )

    def is_better(self, new: PlannedPath, old: PlannedPath) -> bool:
        """Whether a new path is worth a change (C4-7)."""
        return new.path.length < (1.0 - self.settings.switch_gain) * old.path.length
