"""The node that plans once for every robot through space-time, and gives out what holds of it at every instant."""

from __future__ import annotations

import math
import time as clock
from dataclasses import MISSING, dataclass, fields
from functools import partial
from typing import Any

from nav_msgs.srv import GetPlan
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from snnav_core.area.tracks import TrackedScene
from snnav_core.errors import InvalidInput, SnnavError
from snnav_core.navigator.global_ground import GlobalNavigator
from snnav_core.navigator.global_settings import GlobalSettings
from snnav_core.planning.spacetime_problem import SpacetimePlan, SpacetimeSettings
from snnav_core.types import Stop, StopReason
from snnav_ros.convert import (
    MAP_FRAME,
    nanoseconds,
    nanoseconds_from_stamp,
    obstacles_from_message,
    path_to_message,
    plans_to_message,
    rings_from_message,
    seconds,
    stop_to_path,
)
from snnav_ros.nodes.base import NodeOptions, diagnostics, status
from snnav_ros.nodes.deciding import DecidingNode
from snnav_ros.nodes.node_time import has_time, now_of
from snnav_ros.nodes.plan_query import PlanQuery, query_plan, reason_of
from snnav_ros.nodes.robots import read_robots
from snnav_ros.nodes.tracker import OBSTACLES, WORKSPACE
from snnav_ros.parameters import ParameterReader
from snnav_ros.qos import LATCHED, for_mode
from snnav_ros.scenes import read_planar_scene
from snnav_sim.configure import global_settings
from snnav_sim.scene_types import Scene

__all__ = ["GlobalPlannerNode", "GlobalPlannerParameters"]

_LEAD = 1.0  # [s] that computing a path may take in real time


@dataclass(frozen=True)
class GlobalPlannerParameters:
    """Parameters of the node besides those of the navigator and of the robots.

    Parameters
    ----------
    max_obstacles_age : float or None
        All robots are stopped when the obstacles are older, also when they come so late [s]; two sampling intervals
        when left out.
    clock_tolerance : float
        How far stamps of obstacles and of odometry may lie ahead of the planner's clock [s]; what lies farther ahead
        is not used. Not in lockstep, where time waits.
    odometry_frames : tuple of str
        Frames of odometry that coincide with the map; `{robot}` stands for the id of the robot.
    accept_robots : bool
        Whether robots may join by announcing themselves on `robots`.
    """

    max_obstacles_age: float | None = None
    clock_tolerance: float = 0.05
    odometry_frames: tuple[str, ...] = (MAP_FRAME,)
    accept_robots: bool = True


class GlobalPlannerNode(DecidingNode):
    """Hears bodies, odometry and goals; publishes `<robot>/path` and `<robot>/certificate`, and all candidates.

    One step for every message on `obstacles` and the workspace of the same stamp. When none comes for
    `max_obstacles_age`, all robots are stopped. The service `plan` answers what a path would be, for the first robot;
    `<robot>/plan` for each.
    """

    def __init__(self, options: NodeOptions | None = None) -> None:
        super().__init__("global_planner_node", options or NodeOptions())
        scene = read_planar_scene(self.reader)
        self.settings = self.reader.settings(GlobalPlannerParameters)
        robots = read_robots(self.reader, scene, may_be_none=self.settings.accept_robots)
        self.navigator_settings = _read_settings(self.reader, scene, self.lockstep)
        self.reader.finish()
        interval = self.navigator_settings.interval
        self._max_age = nanoseconds(self.settings.max_obstacles_age or 2.0 * interval)
        try:
            self._navigator = GlobalNavigator([robot.spec for robot in robots], self.navigator_settings)
        except InvalidInput as error:
            self.reader.fail("robots", str(error))
        window = self.navigator_settings.time_window * interval
        self.know(scene, robots, self.settings, self._navigator, interval, window)

    def configure(self) -> None:
        """Make the publishers and offer the service."""
        self._queries: set[str] = set()
        super().configure()
        self.forget()
        self._candidates = self.publisher(MarkerArray, "candidates", for_mode(self.lockstep, LATCHED))
        if not self.options.lean:
            self.offer(GetPlan, "plan", partial(self._on_query, None))

    def start(self) -> None:
        """Listen; in real time watch the age of the obstacles."""
        latched = for_mode(self.lockstep, LATCHED)
        self.listen(PointCloud2, WORKSPACE, self._on_workspace, latched)
        self.listen(PointCloud2, OBSTACLES, self._on_obstacles, latched)
        super().start()
        if not self.lockstep:
            self.every(self.navigator_settings.interval, self._watch)

    def forget(self) -> None:
        """Forget bodies and workspace."""
        self._bodies: tuple[int, Any] | None = None
        self._workspace: tuple[int, Any] | None = None
        self._scene: TrackedScene | None = None
        self._scene_stamp = self._decided = -1
        self._plans: dict[str, tuple[int, SpacetimePlan]] = {}

    def reset(self) -> None:
        """Forget plans, bodies and states; goals stay."""
        super().reset()
        self._plans, self._decided = {}, -1

    def robot_heard(self, name: str) -> None:
        """Offer the service `<robot>/plan`; it stays when the robot leaves: one of them may be at work then."""
        if not self.options.lean and name not in self._queries:
            self._queries.add(name)
            self.offer(GetPlan, f"{name}/plan", partial(self._on_query, name))

    # what comes in

    def inputs(self) -> list[str]:
        """Topics that it waits for besides those of the robots."""
        return [OBSTACLES, WORKSPACE]

    def is_complete(self, tick: int) -> bool:
        """In lockstep: whether the bodies of a tick [ns] are there."""
        return self._scene is not None and self._scene_stamp == tick

    def decide(self, tick: int) -> None:
        """In lockstep: decide for a tick [ns] of which everything is there."""
        assert self._participant is not None
        assert self._scene is not None
        self._step(tick, self._scene)
        self._participant.done()

    def _on_obstacles(self, message: PointCloud2) -> None:
        if (stamp := self._usable(OBSTACLES, message, self._bodies)) is not None:
            try:
                self._bodies = stamp, obstacles_from_message(message, OBSTACLES)
            except InvalidInput as error:
                self.complain(OBSTACLES, error)
            else:
                self._problems.pop(OBSTACLES, None)
                self._compose()

    def _on_workspace(self, message: PointCloud2) -> None:
        if (stamp := self._usable(WORKSPACE, message, self._workspace)) is not None:
            try:
                self._workspace = stamp, _exteriors(rings_from_message(message, WORKSPACE))
            except InvalidInput as error:
                self.complain(WORKSPACE, error)
            else:
                self._problems.pop(WORKSPACE, None)
                self._compose()

    def _usable(self, topic: str, message: PointCloud2, last: tuple[int, Any] | None) -> int | None:
        """Return the stamp [ns] of a message if it can be true; else say what is wrong with it."""
        self._waiting.heard(topic)
        if not (self.lockstep or has_time(self)):
            return None
        stamp = nanoseconds_from_stamp(message.header.stamp)
        try:
            self.check_ahead(topic, stamp)
            if last is not None and stamp < last[0] and not self.lockstep:
                raise InvalidInput(
                    f"{topic}: stamped {seconds(stamp):.3f} s, after one stamped {seconds(last[0]):.3f} s; is there "
                    "another tracker?"
                )
        except InvalidInput as error:
            self.complain(topic, error)
            return None
        return stamp

    def _compose(self) -> None:
        """Go on once bodies and workspace of one stamp are there."""
        if self._bodies is None or self._workspace is None or self._bodies[0] != self._workspace[0]:
            return
        stamp = self._bodies[0]
        if stamp == self._scene_stamp and not self.lockstep:
            return  # the same messages twice
        self._scene = TrackedScene(seconds(stamp), self._bodies[1], self._workspace[1])
        self._scene_stamp = stamp
        if self.lockstep:
            self.go_on()
        elif not self._watch():
            newest = max([stamp, *(when for when, _ in self._states.values())])
            if newest <= self._decided:
                return
            if self.refrain(newest):
                self._decided = newest
                self.publish_status("planner", newest, [], 0.0)
            else:
                self._step(newest, self._scene)

    def _watch(self) -> bool:
        """Stop all robots when the obstacles are too old; return whether they are."""
        now = now_of(self)
        if self._scene is None or now - self._scene_stamp <= self._max_age:
            return False
        age = seconds(now - self._scene_stamp)
        message = f"the obstacles are {age:.1f} s old; check the tracker node"
        if problem := self._problems.get(OBSTACLES) or self._problems.get(WORKSPACE):
            message = f"the obstacles are {age:.1f} s old: {problem}"
        self._publish(now, {name: Stop(name, StopReason.NO_AREA, message) for name in self.robots}, 0.0)
        return True

    # what goes out

    def _step(self, now: int, scene: TrackedScene) -> None:
        begin = clock.perf_counter()
        states = {name: state for name, (_, state) in self._states.items()}
        goals = {name: (goal[0], goal[1]) for name, goal in self.goals().items()}
        result = self._navigator.step(seconds(now), scene, states, goals)
        duration = clock.perf_counter() - begin
        self._misses += duration > self.navigator_settings.interval
        self.go_ahead()
        self._show_plans(now)
        self._publish(now, result.decisions, duration)

    def _show_plans(self, now: int) -> None:
        """Publish all candidates when any robot has another plan."""
        plans = self._navigator.plans
        known = {name: plan for name, (_, plan) in self._plans.items()}
        if plans.keys() == known.keys() and all(plan is known[name] for name, plan in plans.items()):
            return
        self._plans = {
            name: self._plans[name] if known.get(name) is plan else (now, plan)
            for name, plan in plans.items()
        }
        self._shown = now
        self._candidates.publish(plans_to_message(self._plans, now))

    def _publish(self, now: int, decisions: dict[str, Any], duration: float) -> None:
        self._decided = now
        more: dict[str, object] = {}
        if self._plans:
            more["candidates_stamp"] = repr(seconds(self._shown))
        for name, (_, plan) in self._plans.items():
            more[f"{name} candidates"] = len(plan.candidates)
            if not math.isnan(plan.gap):
                more[f"{name} gap"] = f"{plan.gap:.4f}"
        self.publish_status("planner", now, self.publish_decisions(now, decisions), duration, more)

    # questions by hand

    def _on_query(self, name: str | None, request: Any, response: Any) -> Any:
        """Answer a GetPlan request; there is an empty path, a warning and a diagnostic status where there is none."""
        now = max(self._scene_stamp, 0)
        values: dict[str, object] = {"robot": name or ""}
        begin, problem = clock.perf_counter(), ""
        response.plan = stop_to_path(now)
        try:
            robot = name or next(iter(self.robots), "")
            values["robot"] = robot
            plan = self._ask(robot, request)
        except SnnavError as error:
            problem, values["outcome"] = str(error), reason_of(error)
            self.get_logger().warning(f"no plan ({reason_of(error)}): {error}")
        else:
            response.plan = path_to_message(plan.path)
            values |= {"outcome": "planned", "travel_time": f"{plan.travel_time:.3f}"}
            values["candidates"] = len(plan.candidates)
        values["query_ms"] = f"{1e3 * (clock.perf_counter() - begin):.1f}"
        own = status("plan service", self.get_name(), problem, values)
        self._diagnostics.publish(diagnostics(now, [own]))
        return response

    def _ask(self, robot: str, request: Any) -> SpacetimePlan:
        if robot not in self.robots:
            raise InvalidInput(f"plan: robot {robot or '(the first one)'} is not there")
        if self._scene is None:
            raise InvalidInput(
                f"plan: {OBSTACLES} and {WORKSPACE} of one stamp were not heard yet; start the tracker"
            )
        states = {name: state for name, (_, state) in self._states.items()}
        query = PlanQuery.of(request, states.get(robot), self._scene.stamp)
        return query_plan(query, robot, self._navigator, self._scene, states)


def _read_settings(reader: ParameterReader, scene: Scene | None, lockstep: bool) -> GlobalSettings:
    """Declare the settings of planner and navigator, all in one group."""
    inner: dict[str, Any] = {"sampling_interval": MISSING, "safety_margin": MISSING}
    outer: dict[str, Any] = {}
    if scene is not None:
        held = global_settings(scene)
        inner = {field.name: getattr(held.spacetime, field.name) for field in fields(held.spacetime)}
        outer = {field.name: getattr(held, field.name) for field in fields(held)}
    spacetime = reader.settings(SpacetimeSettings, **inner)
    if not lockstep:  # in lockstep computing takes no time
        outer["lead"] = math.ceil(_LEAD / spacetime.sampling_interval)
    return reader.settings(GlobalSettings, known={"spacetime": spacetime}, **outer)


def _exteriors(rings: tuple[Any, ...]) -> tuple[Any, ...]:
    for index, ring in enumerate(rings):
        if len(ring) < 3 or not bool((abs(ring) < math.inf).all()):
            raise InvalidInput(
                f"{WORKSPACE}: ring {index} has {len(ring)} vertices or is not finite; give three or more points"
            )
    return rings
