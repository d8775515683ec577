"""The decisions for one flying robot: the last path goes on, or a new one is sought, or it hovers and says why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from snnav_core.area.spatial import SpatialArea
from snnav_core.flight_types import FlyerState
from snnav_core.navigator.flight_settings import FlightDistances, FlightSettings
from snnav_core.planning.adjustment import adjust, resample
from snnav_core.planning.fields import Barrier, DiskBarrier
from snnav_core.planning.flight_certificate import certify_flight
from snnav_core.planning.flight_fields import RegionBarrier, TorusBarrier
from snnav_core.planning.flight_separation import OtherFlyer
from snnav_core.planning.roadmap import RoadmapSettings, build_roadmap, rough_path
from snnav_core.types import (
    Certificate,
    FloatArray,
    PathSource,
    PlannedPath,
    RobotSpec,
    Stop,
    StopReason,
    TimedPath,
)

__all__ = ["FlightPlanner"]

_SAME_GOAL = 1e-6  # [m]
_MOST_LENGTHS = 6.0  # a path is never longer than so many times the way that it began as


class FlightPlanner:
    """Plans for one robot, step by step.

    Parameters
    ----------
    robot : RobotSpec
    settings : FlightSettings
    index : int
        Number of the robot: its samples are its own.
    """

    def __init__(self, robot: RobotSpec, settings: FlightSettings, index: int) -> None:
        self.robot = robot
        self.settings = settings
        self.distances = FlightDistances(robot, settings)
        self._index = index
        self.reset()

    def reset(self) -> None:
        """Forget the last path."""
        self._last: PlannedPath | None = None
        self._goal: FloatArray | None = None
        self._age = self._index % self.settings.search_interval  # robots do not seek in the same step
        self._count = 0
        self._failures = 0

    def promised(self, time: float) -> TimedPath | None:
        """The path that the robot follows at a time [s], None when it hovers."""
        if self._last is None or self._last.certificate.valid_until < time:
            return None
        return self._last.path

    def decide(
        self,
        time: float,
        area: SpatialArea,
        state: FlyerState,
        goal: FloatArray,
        others: Sequence[OtherFlyer],
    ) -> PlannedPath | Stop:
        """Return a certified path, or why there is none."""
        name = self.robot.id
        if float(np.linalg.norm(goal - state.position)) <= self.distances.arrival:
            self.reset()
            return Stop(name, StopReason.ARRIVED, f"robot {name} is at its target")
        if self._goal is None or float(np.abs(goal - self._goal).max()) > _SAME_GOAL:
            self.reset()
        self._goal, self._count = goal.copy(), self._count + 1
        task = _Task(self, time, area, state, goal, others)
        kept = task.go_on(self._last) if self._last is not None else None
        self._age += 1
        chosen = kept
        if kept is None or self._age >= self.settings.search_interval:
            sought = task.seek((self.settings.seed, self._index, self._count), self._failures)
            self._failures = 0 if sought is not None or kept is not None else self._failures + 1
            self._age = 0
            if sought is not None and (kept is None or task.is_better(sought, kept)):
                chosen = sought
        if chosen is None and self._last is not None:
            chosen = task.rest_of(self._last)
        self._last = chosen
        return chosen if chosen is not None else task.explain()


class _Task:
    """What one decision is about."""

    def __init__(
        self,
        planner: FlightPlanner,
        time: float,
        area: SpatialArea,
        state: FlyerState,
        goal: FloatArray,
        others: Sequence[OtherFlyer],
    ) -> None:
        self.robot, self.settings, self.distances = planner.robot, planner.settings, planner.distances
        self.time, self.area, self.state, self.goal, self.others = time, area, state, goal, others
        self.since = max(time - area.stamp, 0.0)
        self.now = self.settings.boundary_speed * self.since
        half = area.grid.half_diagonal
        # The proved bound is below the interpolated one by up to half a diagonal; often by much less.
        self.reserves = (half, 0.5 * half)
        self.faults: list[str] = []

    def go_on(self, last: PlannedPath) -> PlannedPath | None:
        """The last path from where the robot is, adjusted to the present region."""
        passed = round((self.time - last.path.start_time) / last.path.step)
        ahead = last.path.points[passed + 1 :]
        if len(ahead) == 0:
            return None
        points = np.vstack((self.state.position, ahead))
        return self._adjusted(points, PathSource.WARM_START, self.settings.adjustment.warm_passes)

    def rest_of(self, last: PlannedPath) -> PlannedPath | None:
        """The last path as it is, where its window still holds: flown on, and checked again."""
        passed = round((self.time - last.path.start_time) / last.path.step)
        ahead = last.path.points[passed + 1 :]
        if last.certificate.valid_until <= self.time or len(ahead) == 0:
            return None
        path = TimedPath(self.time, last.path.step, np.vstack((self.state.position, ahead)))
        return self._certified(path, PathSource.LAST_PATH, last.planning_distance)

    def seek(self, seed: tuple[int, int, int], failures: int) -> PlannedPath | None:
        """A new path through a roadmap; two ways to ask in one decision, others and denser ones after failures."""
        rng = np.random.default_rng(seed)
        settings = self.settings.roadmap
        samples = settings.samples << min(failures // 2, settings.attempts - 1)
        denser = RoadmapSettings(samples, settings.neighbours, 1, narrow=failures > 0)
        asked = [(reserve, spheres) for spheres in self._crowds() for reserve in self.reserves]
        for index in range(2):
            reserve, spheres = asked[(2 * failures + index) % len(asked)]
            planned = self._through(denser, reserve, spheres, rng)
            if planned is not None:
                return planned
        return None

    def _crowds(self) -> list[FloatArray]:
        """Nobody, and all that are near enough to matter, as spheres that stay."""
        nobody = np.empty((0, 4))
        if not self.others:
            return [nobody]
        places = np.array([one.path.positions_at(np.array([self.time]))[0] for one in self.others])
        radii = np.array([one.radius for one in self.others]) + self.distances.planned(self.reserves[0])
        return [nobody, np.column_stack((places, radii))]

    def _through(
        self, settings: RoadmapSettings, reserve: float, spheres: FloatArray, rng: np.random.Generator
    ) -> PlannedPath | None:
        distances = self.distances
        distance = distances.planned(reserve) - 0.5 * reserve
        growth = self.settings.boundary_speed * (self.since + distances.window)
        bound = min(distance, float(self.area.clearance_at(self.goal[None], growth)[0]))
        if bound < self.settings.safety_margin:
            self.faults.append("target")
            return None
        roadmap = build_roadmap(self.area, bound, growth, settings, rng, spheres)
        start, prefix = self._departure()
        way = rough_path(self.area, roadmap, start, self.goal, distances.growth_per_metre, settings, spheres)
        if way is None:
            self.faults.append("no way")
            return None
        points = resample(np.vstack((prefix, way)), distances.link)
        return self._adjusted(points, PathSource.ROADMAP, self.settings.adjustment.cold_passes, reserve)

    def _departure(self) -> tuple[FloatArray, FloatArray]:
        """Where the rough path may turn, and what leads there: straight ahead in flight (C4-4)."""
        position = self.state.position
        if self.state.speed == 0.0:
            return position, position[None]
        ahead = position + 2.0 * self.distances.link * self.state.direction
        return ahead, position[None]

    def _adjusted(
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
            path = TimedPath(self.time, distances.step, chain)
            certified = self._certified(path, source, planned)
            conflict = self._conflict(chain)
            if conflict is not None:
                certified = self._aside(chain, conflict, source, passes, planned) or certified
            if certified is not None:
                return certified
        return None

    def _conflict(self, chain: FloatArray) -> tuple[int, float] | None:
        """Where a chain comes too near to another robot, at any time, and what it has to keep there [m]."""
        if not self.others or len(chain) < 4:
            return None
        times: FloatArray = self.time + self.distances.step * np.arange(len(chain), dtype=np.float64)
        places = np.stack([other.path.positions_at(times) for other in self.others])
        apart = np.array([self._apart(other) for other in self.others])
        lacking = apart[:, None] - np.linalg.norm(places - chain, axis=2)
        lacking[:, [0, 1, -2, -1]] = -np.inf  # where the robot is, and at its target, nothing can be bent
        leaving = np.array([other.leaves for other in self.others])
        lacking[np.ix_(leaving, times > self.time + self.distances.window)] = -np.inf
        which, where = np.unravel_index(int(np.argmax(lacking)), lacking.shape)
        return (int(where), float(apart[which])) if lacking[which, where] > 0.01 else None

    def _apart(self, other: OtherFlyer) -> float:
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
        for side in (left, -left, up, -up):
            bent = resample(chain + bump[:, None] * side, distances.link)
            most = int(_MOST_LENGTHS * len(bent)) + 20
            barriers = self._barriers(planned)
            result = adjust(bent, self.goal, distances.link, barriers, self.settings.adjustment, passes, most)
            path = TimedPath(self.time, distances.step, resample(result.points, distances.link))
            if len(path) < 2 or self._conflict(path.points) is not None:
                continue
            certified = self._certified(path, source, planned)
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
            apart = np.full(count, self._apart(other))
            apart[-1] *= not other.leaves
            barriers.append(DiskBarrier(other.path.positions_at(times), apart))
        if self.state.speed > 0.0:
            around = int(np.ceil(2.0 * np.pi * distances.torus / distances.link))
            barriers.append(TorusBarrier(self.state.position, self.state.direction, distances.torus, around))
        return barriers

    def _certified(self, path: TimedPath, source: PathSource, planned: float) -> PlannedPath | None:
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

    def explain(self) -> Stop:
        """Why there is no path, in words."""
        name, margin = self.robot.id, self.settings.safety_margin
        growth = self.settings.boundary_speed * (self.since + self.distances.window)
        present = float(self.area.clearance_at(self.state.position[None], self.now)[0])
        if present <= 0.0:
            where = np.round(self.state.position, 2).tolist()
            return Stop(
                name, StopReason.START_BLOCKED, f"robot {name} at {where} is where nothing is proved free"
            )
        at_goal = float(self.area.clearance_at(self.goal[None], growth)[0])
        if at_goal < margin:
            return Stop(
                name,
                StopReason.GOAL_BLOCKED,
                f"the target {np.round(self.goal, 2).tolist()} has a clearance of {at_goal:.2f} m over the window, "
                f"the margin is {margin:.2f} m",
            )
        blocking = self._blocking()
        if blocking:
            return Stop(name, StopReason.BLOCKED_BY_ROBOT, f"robot {name} waits for {blocking}")
        labels, _ = self.area.components(margin, growth)
        ends = [self._label(labels, point) for point in (self.state.position, self.goal)]
        if ends[0] != ends[1] or ends[1] == 0:
            return Stop(
                name,
                StopReason.GOAL_UNREACHABLE,
                f"no way to the target of robot {name} keeps {margin:.2f} m and what may move in the window",
            )
        reason = self.faults[-1] if self.faults else "no candidate"
        return Stop(name, StopReason.NO_PATH, f"no path of robot {name} was accepted: {reason}")

    def _blocking(self) -> str:
        """Other robots that stay at the target or were in the way, at most three."""
        named = " ".join(self.faults)
        found = []
        for other in self.others:
            if float(np.linalg.norm(other.path.points[-1] - self.goal)) < self._apart(other):
                found.append(f"{other.id} at its target")
            elif f"robot {other.id} " in named:
                found.append(other.id)
        return ", ".join(found[:3])

    def _label(self, labels: NDArray[np.int32], point: FloatArray) -> int:
        grid = self.area.grid
        cell = np.floor((point - grid.origin) / grid.spacing).astype(int)
        cell = np.clip(cell, 0, np.array(grid.shape) - 1)
        return int(labels[tuple(cell)])
