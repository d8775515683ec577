"""What happened in a run: ground truth of the robots, published paths and stops, times of the steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely.geometry import MultiPolygon

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.planning.spacetime_problem import SpacetimePlan
from snnav_core.types import FloatArray, PlannedPath, Pose2D, Stop, TimedPath, VelocityCommand

__all__ = ["Decision", "RunRecord"]


@dataclass(frozen=True)
class Decision:
    """A published path or stop.

    Parameters
    ----------
    time : float
        Sampling instant [s].
    robot : str
    path : TimedPath or None
        None for a stop.
    reason : str
        Why the robot stops, as the value of a StopReason; empty for a path.
    message : str
        The same in words; empty for a path.
    planning_distance : float or None
        Distance to the boundary that the path was planned for [m], where known.
    source : str
        Where the path comes from, where known.
    valid_until : float or None
        The certificate holds up to this time [s]; None for a stop, or where not known.
    least_clearance : float or None
        Least distance to the boundary along the window by the certificate [m], where known.
    """

    time: float
    robot: str
    path: TimedPath | None
    reason: str = ""
    message: str = ""
    planning_distance: float | None = None
    source: str = ""
    valid_until: float | None = None
    least_clearance: float | None = None

    @classmethod
    def of(cls, time: float, decision: PlannedPath | Stop) -> Decision:
        """Return what a navigator decided at a sampling instant [s]."""
        if isinstance(decision, Stop):
            return cls(time, decision.robot_id, None, decision.reason.value, decision.message)
        return cls(
            time,
            decision.robot_id,
            decision.path,
            planning_distance=decision.planning_distance,
            source=decision.source.value,
            valid_until=decision.certificate.valid_until,
            least_clearance=decision.certificate.least_clearance,
        )


@dataclass
class RunRecord:
    """Filled while a run goes on, by the closed loop without ROS or from the topics of the nodes.

    Parameters
    ----------
    seed : int
        The seed that was used.
    samples : dict
        Robot id -> rows (time, x, y, heading, speed, turn_rate): ground truth, one per control period, with the
        motion that begins at that time [s, m, rad, m/s, rad/s].
    decisions : list of Decision
        In order of publication.
    areas : list of (float, MultiPolygon)
        Sampling instant and unoccupied area as published [s; m, map].
    plans : list of (float, SpacetimePlan)
        Plans of the global planner with the sampling instant at which they were made [s]; where known.
    planner_seconds, fusion_seconds : list of float
        Duration of every step [s].
    rejected : dict
        Sensor id -> how many of its scans the fusion refused, and why the last of them.
    reason : str
        Why the run ended.
    versions : dict
        Versions beyond those of the core, such as the middleware.
    """

    seed: int
    samples: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)
    decisions: list[Decision] = field(default_factory=list)
    areas: list[tuple[float, MultiPolygon]] = field(default_factory=list)
    plans: list[tuple[float, SpacetimePlan]] = field(default_factory=list)
    planner_seconds: list[float] = field(default_factory=list)
    fusion_seconds: list[float] = field(default_factory=list)
    rejected: dict[str, tuple[int, str]] = field(default_factory=dict)
    reason: str = ""
    versions: dict[str, str] = field(default_factory=dict)

    def add_sample(self, robot: str, time: float, pose: Pose2D, motion: VelocityCommand) -> None:
        """Note where a robot is at a time [s] and how it moves from there."""
        row = (time, pose.x, pose.y, pose.heading, motion.speed, motion.turn_rate)
        self.samples.setdefault(robot, []).append(row)

    def add_rejection(self, sensor: str, message: str) -> None:
        """Note that a scan was refused, and why."""
        self.rejected[sensor] = (self.rejected.get(sensor, (0, ""))[0] + 1, message)

    def add_area(self, area: UnoccupiedArea) -> None:
        """Note the unoccupied area as published; equal ones are kept once."""
        region = area.region
        if self.areas and shapely.equals_exact(region, self.areas[-1][1]):
            region = self.areas[-1][1]
        self.areas.append((area.stamp, region))

    def add_plans(self, time: float, plans: Mapping[str, SpacetimePlan]) -> None:
        """Note plans in force at a time [s]; one that is already noted is not noted again."""
        for plan in plans.values():
            if not any(plan is noted for _, noted in self.plans):
                self.plans.append((time, plan))

    def plans_of(self, robot: str) -> list[tuple[float, SpacetimePlan]]:
        """Return the plans of one robot with the times at which they were made [s]."""
        return [(time, plan) for time, plan in self.plans if plan.robot_id == robot]

    @property
    def end(self) -> float:
        """Time of the last sample of any robot [s]; 0 without any."""
        return max((rows[-1][0] for rows in self.samples.values() if rows), default=0.0)

    def trajectory(self, robot: str) -> FloatArray:
        """Return the rows of a robot, shape (N, 6): time, x, y, heading, speed, turn_rate."""
        return np.array(self.samples.get(robot, []), dtype=np.float64).reshape(-1, 6)

    def decisions_of(self, robot: str) -> list[Decision]:
        """Return the paths and stops of one robot in order."""
        return [decision for decision in self.decisions if decision.robot == robot]

    def digests(self) -> list[str]:
        """Return one line per decision: time, robot, digest of the path or the reason of the stop."""
        return [
            f"{decision.time:.9f} {decision.robot} {decision.path.digest() if decision.path else decision.reason}"
            for decision in self.decisions
        ]
