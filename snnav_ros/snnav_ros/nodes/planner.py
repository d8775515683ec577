"""The node that decides for all robots: a certified path, or a stop with its reason."""

from __future__ import annotations

import time as clock
from dataclasses import MISSING, dataclass, fields
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from snnav_core.area.planar import LostPart, UnoccupiedArea
from snnav_core.errors import InvalidInput
from snnav_core.navigator.ground import GroundNavigator
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.types import PlannedPath, RobotState, StepResult, Stop, StopReason
from snnav_ros.convert import (
    MAP_FRAME,
    area_from_message,
    goal_from_message,
    lost_from_message,
    nanoseconds,
    nanoseconds_from_stamp,
    path_to_message,
    seconds,
    state_from_message,
    stop_to_path,
    verdict_to_message,
)
from snnav_ros.lockstep import Participant
from snnav_ros.nodes.base import ManagedNode, NodeOptions, diagnostics, serve, status
from snnav_ros.nodes.node_time import has_time, now_of, watch_time
from snnav_ros.nodes.robots import read_robots
from snnav_ros.qos import COMMAND, DIAGNOSTICS, LATCHED, ODOMETRY_INPUT, for_mode
from snnav_ros.scenes import read_scene
from snnav_sim.configure import navigator_settings

__all__ = ["PlannerNode", "PlannerParameters"]

_AREA, _LOST = "unoccupied_area", "unoccupied_area/lost"


@dataclass(frozen=True)
class PlannerParameters:
    """Parameters of the node besides those of the navigator and of the robots.

    Parameters
    ----------
    max_area_age : float or None
        All robots are stopped when the unoccupied area is older, also when it comes so late [s]; two sampling
        intervals when left out.
    clock_tolerance : float
        How far stamps of the area and of odometry may lie ahead of the planner's clock [s]; what lies farther ahead is
        not used. Not in lockstep, where time waits.
    odometry_frames : tuple of str
        Frames of odometry that coincide with the map; `{robot}` stands for the id of the robot.
    """

    max_area_age: float | None = None
    clock_tolerance: float = 0.05
    odometry_frames: tuple[str, ...] = (MAP_FRAME,)


class PlannerNode(ManagedNode):
    """Hears the area, odometry and goals; publishes `<robot>/path` and `<robot>/certificate`.

    One step for every unoccupied area that comes. When none comes for `max_area_age`, all robots are stopped.

    The time of a step is the stamp of the area or, in real time, that of the newest odometry if this is later: what
    the boundary may have moved in between is then taken off the area.
    """

    def __init__(self, options: NodeOptions | None = None) -> None:
        super().__init__("planner_node", options or NodeOptions())
        scene = read_scene(self.reader)
        self.robots = {robot.spec.id: robot for robot in read_robots(self.reader, scene)}
        self.settings = self.reader.settings(PlannerParameters)
        base: dict[str, Any] = {"boundary_speed": MISSING}  # how fast things move, a person has to say
        if scene is not None:
            held = navigator_settings(scene)
            base = {field.name: getattr(held, field.name) for field in fields(held)}
        self.navigator_settings = self.reader.settings(NavigatorSettings, **base)
        self.reader.finish()
        self._max_area_age = self.settings.max_area_age or 2.0 * self.navigator_settings.sampling_interval
        try:
            self._navigator = GroundNavigator(
                [robot.spec for robot in self.robots.values()], self.navigator_settings
            )
        except InvalidInput as error:
            self.reader.fail("robots", str(error))
        if not self.lockstep:
            self._jump = watch_time(self, self.reset)
        switches = {f"{name}/enable": partial(self._enable, name) for name in self.robots}
        serve(self, self.options, self.reset, switches)
        self.autostart()

    def configure(self) -> None:
        """Make the publishers."""
        self._goals = {name: robot.target for name, robot in self.robots.items() if robot.target is not None}
        self._enabled = dict.fromkeys(self.robots, True)
        self._area: UnoccupiedArea | None = None
        self._area_stamp = -1
        self._lost: tuple[LostPart, ...] = ()
        self._lost_stamp = self._decided = -1
        self._states: dict[str, tuple[int, RobotState]] = {}
        self._problems: dict[str, str] = {}
        self._reasons: dict[str, StopReason | None] = {}
        self._misses = 0
        command = for_mode(self.lockstep, COMMAND)
        self._paths = {name: self.publisher(Path, f"{name}/path", command) for name in self.robots}
        self._verdicts = {
            name: self.publisher(DiagnosticStatus, f"{name}/certificate", command) for name in self.robots
        }
        self._diagnostics = self.publisher(
            DiagnosticArray, "/diagnostics", for_mode(self.lockstep, DIAGNOSTICS)
        )

    def start(self) -> None:
        """Listen; in real time watch the age of the area."""
        latched = for_mode(self.lockstep, LATCHED)
        self.listen(MarkerArray, _LOST, self._on_lost, latched)
        self.listen(PointCloud2, _AREA, self._on_area, latched)
        for name in self.robots:
            odometry = for_mode(self.lockstep, ODOMETRY_INPUT)
            self.listen(Odometry, f"{name}/odom", partial(self._on_odometry, name), odometry)
            self.listen(PoseStamped, f"{name}/goal_pose", partial(self._on_goal, name), COMMAND)
        self._participant: Participant | None = None
        if self.lockstep:
            period = nanoseconds(self.navigator_settings.sampling_interval)
            self._participant = self.participate(period, self._on_tick, self.reset)
        else:
            self.every(self.navigator_settings.sampling_interval, self._watch_area)
        self._waiting = self.report_waiting(self._inputs)

    def reset(self) -> None:
        """Forget paths, area and states; goals stay."""
        self._navigator.reset()
        if not self.lockstep:  # in lockstep data of the new time may be here before their tick
            self._area, self._area_stamp = None, -1
            self._lost, self._lost_stamp = (), -1
            self._decided = -1
            self._states = {}

    def _inputs(self) -> list[str]:
        missing_goals = [f"{name}/goal_pose" for name in self.robots if name not in self._goals]
        return [_AREA, *(f"{name}/odom" for name in self.robots), *missing_goals]

    def _enable(self, name: str, enabled: bool) -> None:
        self._enabled[name] = enabled
        self.get_logger().info(f"robot {name} is {'planned for again' if enabled else 'stopped'}")

    def _on_goal(self, name: str, message: PoseStamped) -> None:
        topic = f"{name}/goal_pose"
        self._waiting.heard(topic)
        try:
            self._goals[name] = goal_from_message(message, topic)
        except InvalidInput as error:
            self.get_logger().warning(f"goal not taken: {error}")
        else:
            self.get_logger().info(
                f"robot {name} goes to ({self._goals[name][0]:.2f}, {self._goals[name][1]:.2f})"
            )

    def _on_odometry(self, name: str, message: Odometry) -> None:
        topic = f"{name}/odom"
        self._waiting.heard(topic)
        if not (self.lockstep or has_time(self)):
            return
        frames = [frame.replace("{robot}", name) for frame in self.settings.odometry_frames]
        try:
            state = state_from_message(message, name, topic, frames)
            self._check_ahead(topic, nanoseconds_from_stamp(message.header.stamp))
        except InvalidInput as error:
            self._complain(topic, error)
            return
        self._problems.pop(topic, None)
        self._states[name] = (nanoseconds_from_stamp(message.header.stamp), state)
        self._step_when_complete()

    def _on_area(self, message: PointCloud2) -> None:
        self._waiting.heard(_AREA)
        if not (self.lockstep or has_time(self)):
            return
        stamp = nanoseconds_from_stamp(message.header.stamp)
        try:
            area = area_from_message(message, _AREA)
            self._check_ahead(_AREA, stamp)
        except InvalidInput as error:
            self._complain(_AREA, error)
            return
        self._problems.pop(_AREA, None)
        self._area, self._area_stamp = area, stamp
        if self._participant is not None:
            self._step_when_complete()
        elif not self._watch_area():
            # Whoever was measured after the area held passes the points of its path later by as much.
            newest = max([stamp, *(when for when, _ in self._states.values())])
            if newest > self._decided:
                self._step(newest, area)

    def _on_lost(self, message: MarkerArray) -> None:
        """Take what silent sensors saw last: it explains refusals, and changes no path."""
        try:
            self._lost_stamp, self._lost = lost_from_message(message, _LOST)
        except InvalidInput as error:
            self._complain(_LOST, error)
            return
        self._problems.pop(_LOST, None)
        self._step_when_complete()

    def _check_ahead(self, topic: str, stamp: int) -> None:
        """Refuse what is stamped in the future: later it would pass for fresh. In lockstep time waits for its data."""
        ahead = 0.0 if self.lockstep else seconds(stamp - now_of(self))
        if ahead > self.settings.clock_tolerance:
            raise InvalidInput(
                f"{topic}: stamped {ahead:.3f} s ahead of the planner's clock, more than clock_tolerance "
                f"{self.settings.clock_tolerance:g} s; synchronise the clocks"
            )

    def _complain(self, topic: str, error: InvalidInput) -> None:
        if topic not in self._problems:
            self.get_logger().warning(f"message not used: {error}")
        self._problems[topic] = str(error)

    def _on_tick(self, _: int) -> None:
        self._step_when_complete()

    def _step_when_complete(self) -> None:
        """In lockstep: go on once area, lost parts and odometry of the present tick are there."""
        if self._participant is None or self._participant.due is None or self._area is None:
            return
        tick = self._participant.due
        stamps = [
            self._area_stamp,
            self._lost_stamp,
            *(self._states.get(name, (-1,))[0] for name in self.robots),
        ]
        if all(stamp == tick for stamp in stamps):
            self._step(tick, self._area)
            self._participant.done()

    def _watch_area(self) -> bool:
        """Stop all robots when the area is too old; return whether it is."""
        now = now_of(self)
        if self._area is None or now - self._area_stamp <= nanoseconds(self._max_area_age):
            return False
        age = seconds(now - self._area_stamp)
        message = f"the unoccupied area is {age:.1f} s old; check the fusion node"
        decisions = {name: Stop(name, StopReason.NO_AREA, message) for name in self.robots}
        self._publish(now, StepResult(seconds(now), dict(decisions)), 0.0)
        return True

    def _step(self, now: int, area: UnoccupiedArea) -> None:
        begin = clock.perf_counter()
        states = {name: state for name, (_, state) in self._states.items()}
        goals = {name: goal for name, goal in self._goals.items() if self._enabled[name]}
        if self._lost:
            area = area.restamped(area.stamp, lost=self._lost)
        result = self._navigator.step(seconds(now), area, states, goals)
        duration = clock.perf_counter() - begin
        self._misses += duration > self.navigator_settings.sampling_interval
        self._publish(now, result, duration)

    def _publish(self, now: int, result: StepResult, duration: float) -> None:
        self._decided = now
        statuses = []
        for name, decision in result.decisions.items():
            path = stop_to_path(now) if isinstance(decision, Stop) else path_to_message(decision.path)
            self._paths[name].publish(path)
            self._verdicts[name].publish(verdict_to_message(decision, now, path))
            self._tell(name, decision)
            statuses.append(self._robot_status(now, name, decision))
        problem = "; ".join(self._problems.values())
        values = {"step_ms": f"{1e3 * duration:.4f}", "deadline_misses": self._misses}
        statuses.append(status("planner", self.get_name(), problem, values))
        self._diagnostics.publish(diagnostics(now, statuses))

    def _tell(self, name: str, decision: PlannedPath | Stop) -> None:
        """Say once why a robot stops, and that it drives again."""
        reason = decision.reason if isinstance(decision, Stop) else None
        before = self._reasons.get(name)
        self._reasons[name] = reason
        if reason is before:
            return
        if not isinstance(decision, Stop):
            self.get_logger().info(f"robot {name} drives again")
        elif reason in (StopReason.ARRIVED, StopReason.NO_GOAL, StopReason.YIELDS):
            self.get_logger().info(f"robot {name} stops ({decision.reason.value}): {decision.message}")
        else:
            self.get_logger().warning(f"robot {name} stops ({decision.reason.value}): {decision.message}")

    def _robot_status(self, now: int, name: str, decision: PlannedPath | Stop) -> Any:
        stamp = self._states.get(name, (None,))[0]
        values: dict[str, object] = {"age": "none" if stamp is None else f"{seconds(now - stamp):.3f}"}
        if isinstance(decision, Stop):
            arrived = decision.reason is StopReason.ARRIVED
            return status(
                f"robot {name}",
                name,
                "" if arrived else decision.message,
                values | {"stop": decision.reason.value},
            )
        values |= {"source": decision.source.value, "length": f"{decision.path.length:.3f}"}
        return status(f"robot {name}", name, "", values)
