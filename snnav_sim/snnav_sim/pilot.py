"""Who decides in a run without ROS: the navigator that the scene asks for."""

from __future__ import annotations

from collections.abc import Mapping

from snnav_core.area.fusion import AreaFusion
from snnav_core.area.planar import UnoccupiedArea
from snnav_core.area.tracks import ObstacleTracker
from snnav_core.navigator.global_ground import GlobalNavigator
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.planning.spacetime_problem import SpacetimePlan
from snnav_core.types import RobotState, StepResult
from snnav_sim.configure import global_settings, navigator_settings, tracker_settings
from snnav_sim.scene_types import Scene

__all__ = ["GlobalPilot", "LocalPilot", "Pilot", "pilot_of"]

Goals = Mapping[str, tuple[float, float]]


class LocalPilot:
    """The navigator of Ch. 3: needs the unoccupied area only."""

    def __init__(self, scene: Scene) -> None:
        self.navigator = GroundNavigator([], navigator_settings(scene))

    @property
    def plans(self) -> dict[str, SpacetimePlan]:
        """No plans in space-time."""
        return {}

    def decide(
        self,
        time: float,
        fusion: AreaFusion,
        area: UnoccupiedArea,
        states: Mapping[str, RobotState],
        goals: Goals,
    ) -> StepResult:
        """One step at a sampling instant [s]."""
        return self.navigator.step(time, area, states, goals)


class GlobalPilot:
    """The navigator of Ch. 2: needs bodies and their velocities."""

    def __init__(self, scene: Scene) -> None:
        self.tracker = ObstacleTracker(tracker_settings(scene))
        self.navigator = GlobalNavigator([], global_settings(scene))

    @property
    def plans(self) -> dict[str, SpacetimePlan]:
        """The plan that each robot follows."""
        return self.navigator.plans

    def decide(
        self,
        time: float,
        fusion: AreaFusion,
        area: UnoccupiedArea,
        states: Mapping[str, RobotState],
        goals: Goals,
    ) -> StepResult:
        """One step at a sampling instant [s]."""
        tracked = self.tracker.update(time, fusion.returns(time), area)
        return self.navigator.step(time, tracked, states, goals)


Pilot = LocalPilot | GlobalPilot


def pilot_of(scene: Scene) -> Pilot:
    """Return the pilot that a scene asks for."""
    return GlobalPilot(scene) if scene.plans_globally else LocalPilot(scene)
