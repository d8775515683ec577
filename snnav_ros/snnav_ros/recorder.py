"""What happened in a run of nodes: from their messages to a RunRecord and a bag."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from snnav_core.types import StopReason, TimedPath
from snnav_ros.bag.writer import BagWriter
from snnav_ros.casting import is_unplanned
from snnav_ros.convert import (
    Verdict,
    Word,
    announcement_from_message,
    area_from_message,
    nanoseconds,
    nanoseconds_from_stamp,
    path_from_message,
    plans_from_message,
    seconds,
    verdict_from_message,
    word_from_message,
)
from snnav_ros.traces import FlightTrace, GroundTrace, Trace
from snnav_sim.ending import EndWatch
from snnav_sim.report.flight_record import FlightRecord
from snnav_sim.report.record import Decision, RunRecord
from snnav_sim.scene import AnyScene, RobotScene, SpaceScene
from snnav_sim.space_types import FlyerScene

__all__ = ["RunCollector", "RunProgress", "record_of"]

RunProgress = Callable[[float, RunRecord], None]
"""Called once per sampling interval with the simulated time [s] and what is recorded up to then."""


@dataclass
class _Robot:
    """What is known of one robot, and messages that wait for their partners."""

    begin: int
    end: float
    trace: Trace
    on_curve: bool = False  # nobody plans for it
    begun: bool = False  # it has said what that curve is
    stamp: int = -1
    tracked: int = -1
    commands: int = 0
    paths: dict[int, TimedPath | None] = field(default_factory=dict)
    verdicts: dict[int, Verdict] = field(default_factory=dict)


def record_of(scene: AnyScene, seed: int) -> RunRecord:
    """Return the empty record of a run."""
    return FlightRecord(seed) if isinstance(scene, SpaceScene) else RunRecord(seed)


def _robot_of(scene: AnyScene, robot: RobotScene | FlyerScene) -> _Robot:
    begin, end = scene.instant(robot.joins_at), scene.instant(robot.leaves_at)
    last = nanoseconds(end) if math.isfinite(end) else math.inf
    if isinstance(robot, FlyerScene):
        trace = FlightTrace(robot, scene.control_period)
        return _Robot(nanoseconds(begin), last, trace, on_curve=bool(robot.curve))
    return _Robot(nanoseconds(begin), last, GroundTrace(robot.id))


class RunCollector:
    """Takes every message of a run, in the order of each topic, and knows what is complete.

    Parameters
    ----------
    scene : Scene or SpaceScene
    record : RunRecord
        Is filled; one by `record_of`.
    bag : BagWriter or None
        Gets every message, stamped with its simulated time.
    lockstep : bool
        Whether nothing is ever lost: then the run is finished when all of its last instant is there.
    progress : callable, optional
    planners : sequence of str
        Names of all planner nodes if there are several.
    """

    def __init__(
        self,
        scene: AnyScene,
        record: RunRecord,
        bag: BagWriter | None,
        lockstep: bool,
        progress: RunProgress | None = None,
        planners: Sequence[str] = (),
    ) -> None:
        self.record = record
        self.messages = 0
        """How many came; a run is alive while this grows."""
        self._bag, self._lockstep, self._progress = bag, lockstep, progress
        self._words: dict[str, dict[int, Word]] = {name: {} for name in planners}
        planner = [f"planner {name}" for name in planners] or ["planner"]
        self._steps = {"fusion": record.fusion_seconds} | dict.fromkeys(planner, record.planner_seconds)
        self._control_ns = nanoseconds(scene.control_period)
        self._sample_ns = nanoseconds(scene.sampling_interval)
        self._in_space = isinstance(scene, SpaceScene)
        self._robots = {robot.id: _robot_of(scene, robot) for robot in scene.robots}
        self._order = sorted(self._robots, key=lambda name: self._robots[name].begin)
        self._latest: dict[str, int] = {}
        if not is_unplanned(scene):
            self._latest |= dict.fromkeys([sensor.id for sensor in scene.sensors], -1)
            self._latest |= dict.fromkeys(("area", "grid", *self._steps), -1)
        if scene.plans_globally:
            self._latest |= dict.fromkeys(("obstacles", "workspace"), -1)
        self._plans: set[tuple[str, int]] = set()  # by robot and when it was planned [ns]
        self._shown, self._announced = (
            -1,
            -1,
        )  # stamps of the last candidates that came, and that were published [ns]
        self._watch = EndWatch(scene)
        self._decided = -1

    @property
    def ended(self) -> bool:
        """Whether the decisions of the last instant are known."""
        return bool(self.record.reason)

    @property
    def finished(self) -> bool:
        """Whether the run has ended and, in lockstep, all of its last instant is recorded."""
        return self.ended and (not self._lockstep or self.complete(self._decided, True))

    def complete(self, tick: int, sampled: bool) -> bool:
        """Whether everything of a tick [ns] is there; at a sampling instant also scans, area and decisions."""
        return next(self._lacking(tick, sampled), None) is None

    def missing(self, tick: int, sampled: bool) -> list[str]:
        """Return what of a tick [ns] is not there yet."""
        return list(self._lacking(tick, sampled))

    def _lacking(self, tick: int, sampled: bool) -> Iterator[str]:
        """Name what is not there yet; whether there is anything is known from the first."""
        if sampled and self._decided < tick:
            yield "paths and certificates"
        present = self._present(tick)
        for name in present:
            robot = self._robots[name]
            if robot.stamp < tick:
                yield f"{name}/odom"
            if robot.begin + (robot.commands - 1) * self._control_ns < tick:
                yield f"{name}/cmd_vel"
            if sampled and robot.tracked < tick:
                yield f"tracker {name}"
        if sampled:
            yield from (key for key, stamp in self._latest.items() if stamp < tick)
            if self._shown < self._announced:
                yield "candidates"

    def _present(self, tick: int) -> list[str]:
        """Ids of the robots in the workspace at a tick [ns], those that joined later last."""
        return [name for name in self._order if self._robots[name].begin <= tick < self._robots[name].end]

    def take_announcement(self, topic: str, message: Any) -> None:
        """Take what a robot says of itself; one that leaves without the scene saying so is waited for no more."""
        announcement = announcement_from_message(message, topic)
        self.write(topic, message, announcement.stamp)
        if announcement.id in self._robots and announcement.spec is None:
            robot = self._robots[announcement.id]
            robot.end = min(robot.end, announcement.stamp)

    def take_word(self, topic: str, message: Any) -> None:
        """Take the word of a planner, which says whom it stopped besides."""
        word = word_from_message(message, topic)
        self.write(topic, message, word.stamp)
        if word.planner in self._words:
            self._words[word.planner][word.stamp] = word
            self._decide(word.stamp)

    def close(self) -> None:
        """Note where the robots are at the end."""
        for robot in self._robots.values():
            self._note(robot)

    def write(self, topic: str, message: Any, stamp: int) -> None:
        """Put a message into the bag only."""
        self.messages += 1
        if self._bag is not None:
            self._bag.write(topic, message, stamp)

    def take_data(self, key: str, topic: str, message: Any) -> None:
        """Take a scan, the grid of the area, bodies or workspace; the key is the id of the sensor, or `grid` etc."""
        stamp = nanoseconds_from_stamp(message.header.stamp)
        self.write(topic, message, stamp)
        self._latest[key] = max(self._latest[key], stamp)

    def take_area(self, topic: str, message: Any) -> None:
        """Take the unoccupied area."""
        self.take_data("area", topic, message)
        if self._in_space:  # they are in the bag; figures show none
            return
        # That of the last instant may be heard after its decisions, which come from another process.
        if not self.ended or nanoseconds_from_stamp(message.header.stamp) <= self._decided:
            self.record.add_area(area_from_message(message, topic))

    def take_plans(self, topic: str, message: Any) -> None:
        """Take the plans of the global planner with all candidates."""
        stamp = nanoseconds_from_stamp(message.markers[0].header.stamp)
        self.write(topic, message, stamp)
        self._shown = max(self._shown, stamp)
        for name, (made, plan) in plans_from_message(message, topic).items():
            if (name, made) not in self._plans:
                self._plans.add((name, made))
                self.record.plans.append((seconds(made), plan))

    def take_diagnostics(self, topic: str, message: Any) -> None:
        """Take diagnostics: they tell how long fusion and planner worked."""
        stamp = nanoseconds_from_stamp(message.header.stamp)
        self.write(topic, message, stamp)
        for status in message.status:
            kind, _, name = status.name.partition(" ")
            if kind == "tracker" and name in self._robots:
                self._robots[name].tracked = max(self._robots[name].tracked, stamp)
            elif status.name in self._latest:
                self._latest[status.name] = max(self._latest[status.name], stamp)
            if status.name in self._steps:
                values = {pair.key: pair.value for pair in status.values}
                steps = self._steps[status.name]
                steps.append(1e-3 * float(values["step_ms"]))
                self._announced = max(
                    self._announced, nanoseconds(float(values.get("candidates_stamp", "-1")))
                )

    def take_odometry(self, name: str, topic: str, message: Any) -> None:
        """Take the pose of a robot; its speeds are those it drove with since the last pose."""
        robot, stamp = self._robots[name], nanoseconds_from_stamp(message.header.stamp)
        self.write(topic, message, stamp)
        robot.trace.driven(message)
        self._note(robot)
        robot.trace.odometry(message, topic)
        robot.stamp = stamp
        if robot.on_curve and stamp % self._sample_ns == 0:
            self._decide(stamp)

    def take_command(self, name: str, topic: str, message: Any) -> None:
        """Take the command of a robot; it has no stamp: in lockstep the n-th is the one of the n-th tick."""
        robot = self._robots[name]
        stamp = robot.begin + robot.commands * self._control_ns if self._lockstep else max(robot.stamp, 0)
        robot.commands += 1
        robot.trace.command(message)
        self.write(topic, message, stamp)

    def _note(self, robot: _Robot) -> None:
        if not self.ended or robot.stamp <= self._decided:
            robot.trace.note(self.record, seconds(robot.stamp))

    def take_path(self, name: str, topic: str, message: Any) -> None:
        """Take a path or a stop."""
        stamp = nanoseconds_from_stamp(message.header.stamp)
        self.write(topic, message, stamp)
        path = path_from_message(message, topic, in_space=self._in_space)
        paths = self._robots[name].paths
        paths[stamp] = None if paths.get(stamp, path) is None else path
        self._decide(stamp)

    def take_verdict(self, name: str, topic: str, message: Any) -> None:
        """Take the certificate of a path or the reason of a stop."""
        verdict = verdict_from_message(message, topic)
        stamp = nanoseconds(verdict.stamp)
        self.write(topic, message, stamp)
        self._robots[name].verdicts[stamp] = verdict
        self._decide(stamp)

    def _decide(self, stamp: int) -> None:
        """Note the decisions of an instant when those of all robots are there."""
        present = self._present(stamp)
        if self.ended or stamp <= self._decided or not all(self._has_decision(n, stamp) for n in present):
            return
        if not all(stamp in words for words in self._words.values()):
            return
        halted = {name: why for words in self._words.values() for name, why in words.pop(stamp).stops}
        stops: dict[str, str] = {}
        decisions = [self._take_decision(name, stamp, halted) for name in present]
        for decision in decisions:
            if decision is None:
                continue
            self._robots[decision.robot].trace.follow(decision)
            self.record.decisions.append(decision)
            if decision.path is None:
                stops[decision.robot] = decision.reason
        self._decided = stamp
        self.record.reason = self._watch.update(seconds(stamp), stops)
        if self._progress is not None:
            self._progress(seconds(stamp), self.record)

    def _has_decision(self, name: str, stamp: int) -> bool:
        """Whether it is known what a robot follows from an instant [ns] on."""
        robot = self._robots[name]
        if robot.on_curve:
            return (robot.begun or bool(robot.paths)) and (robot.stamp >= stamp or not self._lockstep)
        return stamp in robot.paths and stamp in robot.verdicts

    def _take_decision(self, name: str, stamp: int, halted: Mapping[str, str]) -> Decision | None:
        """Return what was decided for a robot at an instant [ns]; None for one that is under way on its curve."""
        robot, time = self._robots[name], seconds(stamp)
        if robot.on_curve:
            if not robot.begun:
                robot.begun = True
                return Decision(time, name, robot.paths.popitem()[1], source="curve")
            if not robot.trace.hovers:
                return None
            text = f"robot {name} is at the end of its curve"
            return Decision(time, name, None, StopReason.ARRIVED.value, text)
        path, verdict = robot.paths.pop(stamp), robot.verdicts.pop(stamp)
        if name in halted:
            return Decision(time, name, None, StopReason.BLOCKED_BY_ROBOT.value, halted[name])
        return _decision(time, name, path, verdict)


def _decision(time: float, name: str, path: TimedPath | None, verdict: Verdict) -> Decision:
    if path is None:
        reason = "" if verdict.stop is None else verdict.stop.reason.value
        return Decision(time, name, None, reason, "" if verdict.stop is None else verdict.stop.message)
    source = "" if verdict.source is None else verdict.source.value
    certificate = verdict.certificate
    return Decision(
        time,
        name,
        path,
        planning_distance=verdict.planning_distance,
        source=source,
        valid_until=None if certificate is None else certificate.valid_until,
        least_clearance=None if certificate is None else certificate.least_clearance,
    )
