"""What the planner node plans in: the plane or space, each with its navigator and the values of its messages."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from typing import Any, Protocol

import numpy as np

from snnav_core.area.planar import LostPart, UnoccupiedArea
from snnav_core.area.spatial import SpatialArea
from snnav_core.errors import InvalidInput
from snnav_core.flight_types import FlyerState
from snnav_core.navigator.flight import FlightNavigator
from snnav_core.navigator.flight_settings import FlightSettings
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.types import HeardPath, RobotSpec, RobotState, StepResult
from snnav_ros.convert import area_from_message, flyer_state_from_message, state_from_message
from snnav_ros.convert.spatial_area import is_spatial_area, spatial_area_from_message
from snnav_ros.parameters import ParameterReader
from snnav_sim.configure import navigator_settings
from snnav_sim.configure_flight import flight_settings
from snnav_sim.scene import AnyScene, SpaceScene

__all__ = ["Area", "Crew", "Goals", "PlanningSettings", "State", "read_planning"]

Area = UnoccupiedArea | SpatialArea
State = RobotState | FlyerState
Goals = Mapping[str, tuple[float, ...]]

_SHARED = ("sampling_interval", "safety_margin", "time_window", "boundary_speed")


@dataclass(frozen=True)
class PlanningSettings:
    """How the planner plans in either world.

    Parameters
    ----------
    plane : NavigatorSettings
    space : FlightSettings
        Intervals, margin, window and boundary speed are those of the plane.
    """

    plane: NavigatorSettings
    space: FlightSettings


def read_planning(reader: ParameterReader, scene: AnyScene | None) -> PlanningSettings:
    """Declare the parameters of both navigators: those that both have, and `flight.*` for space alone.

    Raises
    ------
    ParameterError
        If a value is missing or wrong.
    """
    base: dict[str, Any] = {"boundary_speed": MISSING}  # how fast things move, a person has to say
    air: dict[str, Any] = {}
    if isinstance(scene, SpaceScene):
        held = flight_settings(scene, scene.seed)
        base = {name: getattr(held, name) for name in _SHARED}
        air = {field.name: getattr(held, field.name) for field in fields(held)}
    elif scene is not None:
        known = navigator_settings(scene)
        base = {field.name: getattr(known, field.name) for field in fields(known)}
    plane = reader.settings(NavigatorSettings, **base)
    shared = {name: getattr(plane, name) for name in _SHARED}
    return PlanningSettings(plane, reader.settings(FlightSettings, "flight", shared, **air))


class _World(Protocol):
    """Navigator and messages of one world."""

    @property
    def served(self) -> Collection[str]:
        """Names of the robots that are decided for."""
        ...

    navigator: GroundNavigator | FlightNavigator

    def area(self, message: Any, topic: str) -> Area: ...

    def state(self, message: Any, name: str, topic: str, frames: Collection[str]) -> State: ...

    def step(
        self,
        time: float,
        area: Any,
        states: Mapping[str, Any],
        goals: Goals,
        lost: Sequence[LostPart],
        heard: Mapping[str, HeardPath],
    ) -> StepResult: ...


class _Plane:
    def __init__(
        self, robots: Sequence[RobotSpec], settings: PlanningSettings, serves: Sequence[str]
    ) -> None:
        self.navigator = GroundNavigator(robots, settings.plane, serves or None)

    @property
    def served(self) -> Collection[str]:
        return self.navigator.served

    def area(self, message: Any, topic: str) -> UnoccupiedArea:
        return area_from_message(message, topic)

    def state(self, message: Any, name: str, topic: str, frames: Collection[str]) -> RobotState:
        return state_from_message(message, name, topic, frames)

    def step(
        self,
        time: float,
        area: UnoccupiedArea,
        states: Mapping[str, RobotState],
        goals: Goals,
        lost: Sequence[LostPart],
        heard: Mapping[str, HeardPath],
    ) -> StepResult:
        if lost:
            area = area.restamped(area.stamp, lost=tuple(lost))
        targets = {name: (goal[0], goal[1]) for name, goal in goals.items()}
        return self.navigator.step(time, area, states, targets, heard)


class _Space:
    def __init__(
        self, robots: Sequence[RobotSpec], settings: PlanningSettings, serves: Sequence[str]
    ) -> None:
        if serves:
            raise InvalidInput("in space one planner serves all robots; leave serves and planners out")
        self.navigator = FlightNavigator(robots, settings.space)

    @property
    def served(self) -> Collection[str]:
        return self.navigator.robots

    def area(self, message: Any, topic: str) -> SpatialArea:
        return spatial_area_from_message(message, topic)

    def state(self, message: Any, name: str, topic: str, frames: Collection[str]) -> FlyerState:
        return flyer_state_from_message(message, name, topic, frames)

    def step(
        self,
        time: float,
        area: SpatialArea,
        states: Mapping[str, FlyerState],
        goals: Goals,
        lost: Sequence[LostPart],
        heard: Mapping[str, HeardPath],
    ) -> StepResult:
        return self.navigator.step(time, area, states, {name: np.array(goal) for name, goal in goals.items()})


class Crew:
    """The robots that are planned for, in the world of the area that came last.

    Parameters
    ----------
    robots : sequence of RobotSpec
        By precedence.
    settings : PlanningSettings
    serves : sequence of str
        Ids of the robots that are decided for; all when empty.
    in_space : bool
        The world before any area came.

    Raises
    ------
    InvalidInput
        If a robot does not fit the settings.
    """

    def __init__(
        self,
        robots: Sequence[RobotSpec],
        settings: PlanningSettings,
        serves: Sequence[str],
        *,
        in_space: bool,
    ) -> None:
        self._specs = {spec.id: spec for spec in robots}
        self._settings, self._serves, self.in_space = settings, tuple(serves), in_space
        self._world = self._made(robots, in_space)

    def _made(self, robots: Sequence[RobotSpec], in_space: bool) -> _World:
        return (_Space if in_space else _Plane)(robots, self._settings, self._serves)

    @property
    def served(self) -> Collection[str]:
        """Names of the robots that are decided for."""
        return self._world.served

    def add_robot(self, robot: RobotSpec) -> None:
        """Plan for one more robot, at the end of the order."""
        self._world.navigator.add_robot(robot)
        self._specs[robot.id] = robot

    def remove_robot(self, robot_id: str) -> None:
        """Forget a robot that is no longer in the workspace."""
        self._world.navigator.remove_robot(robot_id)
        self._specs.pop(robot_id, None)

    def reset(self) -> None:
        """Forget all paths."""
        self._world.navigator.reset()

    def withdraw(self) -> None:
        """Forget the decisions of the last step, which were not issued; several planners are in the plane only."""
        if isinstance(self._world.navigator, GroundNavigator):
            self._world.navigator.withdraw()

    def enter(self, message: Any, topic: str) -> bool:
        """Go where an area belongs; return whether that is another world than before, with other states of robots.

        Raises
        ------
        InvalidInput
            If the robots that are there do not fit in.
        """
        in_space = is_spatial_area(message)
        if in_space == self.in_space:
            return False
        try:
            world = self._made(list(self._specs.values()), in_space)
        except InvalidInput as error:
            raise InvalidInput(f"{topic}: is of {'space' if in_space else 'the plane'}; {error}") from None
        self._world, self.in_space = world, in_space
        return True

    def area(self, message: Any, topic: str) -> Area:
        """Return the area of a message of this world; InvalidInput says what is wrong with it."""
        return self._world.area(message, topic)

    def state(self, message: Any, name: str, topic: str, frames: Collection[str]) -> State:
        """Return the state of a robot by its odometry; InvalidInput says what is wrong with it."""
        return self._world.state(message, name, topic, frames)

    def step(
        self,
        time: float,
        area: Area,
        states: Mapping[str, State],
        goals: Goals,
        lost: Sequence[LostPart] = (),
        heard: Mapping[str, HeardPath] | None = None,
    ) -> StepResult:
        """Decide for all robots at a time [s]."""
        return self._world.step(time, area, states, goals, lost, heard or {})
