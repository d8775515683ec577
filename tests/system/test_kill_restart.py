"""Real processes over DDS: any node is killed, put to sleep or started afresh in mid-run, and the robot stays safe.

The robot's base is in the hands of this test: it does what `cart/cmd_vel` says, for at most 0.1 s after the stamp of
the last command. So what the robot node promises is judged by code that it does not share.

All is recorded, and judged by what the recording says. Messages are recorded with the time of their receipt on this
machine, a clock that nobody sets: simulated time stands still while `clock_node` is dead and begins anew with it, so
it cannot tell what came first. What was promised is compared in simulated time, that of headers and certificates
(`snnav_ros.bag.drives`). The moments of kills and restarts are in the bag on `events`. Beside the bag there is a
picture of every stop and recovery.
"""

from __future__ import annotations

import math
import signal
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import rclpy
import shapely
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from nav_msgs.msg import Path as PathMessage
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan, PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger

from snnav_core.types import Pose2D, StopReason, VelocityCommand
from snnav_ros.available import make_executor
from snnav_ros.bag.drives import EVENTS_TOPIC, Drive, Event, read_drive
from snnav_ros.bag.reader import BagReader
from snnav_ros.bag.run_windows import window_curves
from snnav_ros.bag.writer import BagWriter
from snnav_ros.bringup import plan_nodes
from snnav_ros.convert import (
    MAP_FRAME,
    Verdict,
    nanoseconds,
    nanoseconds_from_stamp,
    odometry_to_message,
    seconds,
    verdict_from_message,
)
from snnav_ros.processes import ChildProcesses
from snnav_ros.qos import LATCHED, RECORDED, SENSOR
from snnav_sim.devices.base import PioneerBase
from snnav_sim.report.window_figure import draw_window
from snnav_sim.scene import Scene, parse_scene
from snnav_sim.warm_up import warm_up

SCENE = """
name: corridor
description: A robot goes to and fro in a narrow corridor, most of which only one range finder sees
sampling_interval: 0.4
control_period: 0.05
time_window: 4
boundary_speed: 0.3
safety_margin: 0.4
seed: 1
workspace: {polygon: [[0, 0], [8, 0], [8, 2.2], [0, 2.2]]}
sensors:
  - {id: west, device: lms200, position: [0.05, 1.1], heading_deg: 0, field_of_view_deg: 180, resolution_deg: 0.5,
     range_max: 10.0, noise: lms200}
  - {id: east, device: lms200, position: [7.95, 1.1], heading_deg: 180, field_of_view_deg: 180, resolution_deg: 0.5,
     range_max: 1.5, noise: lms200}
robots:
  - {id: cart, start: [1.5, 1.1], heading_deg: 0, target: [5.5, 1.1], speed: 0.8, max_turn_rate: 2.5, radius: 0.3}
"""
INTERVAL = 0.4  # [s] from decision to decision, as in the scene
GOALS = [(5.5, 1.1), (1.5, 1.1)]
KINDS = {
    "lms200": "west",
    "fusion": "fusion_node",
    "planner": "planner_node",
    "robot": "cart",
    "clock": "clock_node",
}
NAP = 3.0 * INTERVAL
WATCHDOG = 0.1  # [s] after the last command the base stops by itself
STILL = 0.5  # [s] without any motion: it stands
STILL_STANDING = VelocityCommand(0.0, 0.0)
RESTART, RESET = "restart", "clock set back"  # events, besides names of signals
LONGEST = 40.0  # [s] that anything may take before a test fails


class Listener:
    """A node that records what it hears, as `ros2 bag record` would, and what it is told that was done."""

    TOPICS = (
        (Clock, "/clock", RECORDED),
        (Odometry, "cart/odom", RECORDED),
        (TwistStamped, "cart/cmd_vel", RECORDED),
        (PathMessage, "cart/path", RECORDED),
        (DiagnosticStatus, "cart/certificate", RECORDED),
        (PoseStamped, "cart/goal_pose", RECORDED),
        (DiagnosticArray, "/diagnostics", RECORDED),
        (PointCloud2, "unoccupied_area", LATCHED),
        (OccupancyGrid, "unoccupied_area/grid", LATCHED),
        (LaserScan, "sensors/west/scan", SENSOR),
        (LaserScan, "sensors/east/scan", SENSOR),
    )

    def __init__(self, context: Any, bag: BagWriter) -> None:
        self._bag = bag
        self._offset, self._last = time.time_ns() - time.monotonic_ns(), 0
        self.node = Node("listener", context=context, enable_rosout=False, start_parameter_services=False)
        for kind, topic, qos in self.TOPICS:
            self.node.create_subscription(kind, topic, partial(self._write, topic), qos)

    def note(self, text: str) -> None:
        """Record that something is done now."""
        self._write(EVENTS_TOPIC, String(data=text))

    def _write(self, topic: str, message: Any) -> None:
        self._last = max(self._last + 1, self._offset + time.monotonic_ns())  # no two at the same time
        self._bag.write(topic, message, self._last)


class Site:
    """The nodes of the scene as processes, and a node that is the robot's base and the person who gives goals."""

    def __init__(self, children: ChildProcesses, context: Any, folder: FilePath, bag: BagWriter) -> None:
        self.scene = parse_scene(SCENE, "corridor")
        assert self.scene.sampling_interval == INTERVAL
        self.children = children
        (robot,) = self.scene.robots
        self.base = PioneerBase(robot.pose, robot.spec)
        self.time, self.jumps, self.moved_at = -1.0, 0, {"wall": 0.0, "simulated": 0.0}
        self.steps: deque[float] = deque(maxlen=5)  # lengths of the last motions [m]
        self.texts: list[str] = []
        self._command, self._commanded, self._goal = STILL_STANDING, -math.inf, 0
        self.node = Node("site", context=context, enable_rosout=False, start_parameter_services=False)
        self.listener = Listener(context, bag)
        self.executor = make_executor(context)
        self.executor.add_node(self.node)
        self.executor.add_node(self.listener.node)
        self._odometry = self.node.create_publisher(Odometry, "cart/odom", 10)
        self._goals = self.node.create_publisher(PoseStamped, "cart/goal_pose", 1)
        for kind, topic, take in (
            (Clock, "/clock", self._on_clock),
            (TwistStamped, "cart/cmd_vel", self._on_command),
            (DiagnosticStatus, "cart/certificate", self._on_certificate),
            (DiagnosticArray, "/diagnostics", self._on_diagnostics),
        ):
            self.node.create_subscription(kind, topic, take, 100)
        file = folder / "scene.yaml"
        file.write_text(SCENE, encoding="utf-8")
        external = {"base": "external", "command_timeout": WATCHDOG, "stamped": True}
        for plan in plan_nodes(self.scene, file, realtime=True, processes=True, seed=1):
            parameters = {**plan.parameters, **(external if plan.name == "cart" else {})}
            children.start(plan.name, f"snnav_ros.nodes.{plan.module}_node", parameters)

    def _on_clock(self, message: Clock) -> None:
        now = seconds(nanoseconds_from_stamp(message.clock))
        if now < self.time:
            self.jumps += 1
            self._commanded = -math.inf
        elif now > self.time >= 0.0:
            self._move(now)
        self.time = now
        self._tell_pose(now)

    def _move(self, now: float) -> None:
        """Do what was commanded as long as that holds, then stand; the odometry tells both exactly."""
        before = self.base.pose
        rest = min(now, max(self.time, self._commanded + WATCHDOG))
        self.base.apply(self._command, rest - self.time)
        if self.base.pose != before:
            self.moved_at = {"wall": time.monotonic(), "simulated": now}
            self.steps.append(math.dist(_place(before), _place(self.base.pose)))
        if rest < now:
            if rest > self.time:
                self._tell_pose(rest)
            self.base.apply(STILL_STANDING, now - rest)

    def _tell_pose(self, stamp: float) -> None:
        driven = self.base.command
        pose = odometry_to_message("cart", self.base.pose, driven.speed, driven.turn_rate, nanoseconds(stamp))
        self._odometry.publish(pose)

    def _on_command(self, message: TwistStamped) -> None:
        stamp, twist = seconds(nanoseconds_from_stamp(message.header.stamp)), message.twist
        if stamp <= self.time + WATCHDOG:  # else it was given before time began anew
            self._command, self._commanded = VelocityCommand(twist.linear.x, twist.angular.z), stamp

    def _on_certificate(self, message: DiagnosticStatus) -> None:
        verdict: Verdict = verdict_from_message(message)
        if verdict.stop is not None and verdict.stop.reason is StopReason.ARRIVED:
            self._goal = min(range(len(GOALS)), key=lambda k: -math.dist(GOALS[k], _place(self.base.pose)))
            goal = PoseStamped()
            goal.header.frame_id = MAP_FRAME
            goal.pose.position.x, goal.pose.position.y = GOALS[self._goal]
            self._goals.publish(goal)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        self.texts += [f"{status.name}: {status.message}" for status in message.status]

    # what a test does

    def until(self, condition: Callable[[], bool], what: str, longest: float = LONGEST) -> None:
        end = time.monotonic() + longest
        while not condition():
            assert not (ended := self.children.ended()), ended
            assert time.monotonic() < end, f"waited {longest} s for {what}; last said {self.texts[-4:]}"
            self.executor.spin_once(timeout_sec=0.02)

    def until_it_drives(self) -> None:
        """Wait until the robot drives, and has some way to go."""
        self.steps.clear()

        def drives() -> bool:
            goal = GOALS[self._goal]
            return sum(self.steps) > 0.1 and 1.2 < math.dist(goal, _place(self.base.pose)) < 3.6

        self.until(drives, "a robot that drives")

    def clock_of(self, kind: str) -> tuple[str, Callable[[], float]]:
        """Return by which time an outage of a kind is measured: simulated time stands still without its clock.

        It was also seen to stand still for one or two seconds after the death or sleep of another node: then nothing
        moves, but the robot has not stopped.
        """
        return ("wall", time.monotonic) if kind == "clock" else ("simulated", lambda: self.time)

    def until_it_stands(self, kind: str) -> None:
        name, now = self.clock_of(kind)
        self.until(lambda: now() - self.moved_at[name] > STILL, "a robot that stands")

    def wait(self, kind: str, duration: float) -> None:
        _, now = self.clock_of(kind)
        end = now() + duration
        self.until(lambda: now() >= end, "the end of a while")

    def signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a node, and record it."""
        self.listener.note(f"{number.name} {name}")
        self.children.kill(name, number)

    def restart(self, name: str) -> None:
        """Start a node again, and record it."""
        self.listener.note(f"{RESTART} {name}")
        self.children.restart(name)


@contextmanager
def site(folder: FilePath, domain: int) -> Iterator[Site]:
    """Bring all up; what is recorded is in `folder / "bag"` afterwards, also when something failed."""
    warm_up()
    with ExitStack() as stack:
        context = rclpy.Context()
        rclpy.init(args=[], context=context, domain_id=domain)
        stack.callback(rclpy.try_shutdown, context=context)
        bag = BagWriter(folder / "bag")
        bag.open()
        stack.callback(bag.close)
        children = stack.enter_context(ChildProcesses(folder, domain))
        made = Site(children, context, folder, bag)
        stack.callback(made.node.destroy_node)
        stack.callback(made.listener.node.destroy_node)
        stack.callback(made.executor.shutdown)
        yield made
        made.until_it_drives()  # the recording shows that it goes on


def _place(pose: Pose2D) -> tuple[float, float]:
    return pose.x, pose.y


def kill_and_restart(site: Site, kind: str) -> None:
    """Kill the node of a kind while the robot drives, see it stop, start the node again and see it drive."""
    name = KINDS[kind]
    site.until_it_drives()
    said = len(site.texts)
    site.signal(name, signal.SIGKILL)
    if kind == "lms200":  # until what it saw is gone the robot may go to and fro
        reason = "sensor west is silent since"
        site.until(lambda: any(reason in text for text in site.texts[said:]), "the reason of a stop")
    site.until_it_stands(kind)
    site.restart(name)
    site.until_it_drives()


def nap(site: Site, kind: str) -> None:
    """Stop the process of a node for three sampling intervals while the robot drives, and see it drive again."""
    site.until_it_drives()
    site.signal(KINDS[kind], signal.SIGSTOP)
    site.wait(kind, NAP)
    site.signal(KINDS[kind], signal.SIGCONT)
    site.until_it_drives()


def set_back_the_clock(site: Site) -> None:
    """Let the clock begin anew while the robot drives."""
    site.until_it_drives()
    client = site.node.create_client(Trigger, "clock_node/reset")
    site.until(client.service_is_ready, "the service")
    site.listener.note(RESET)
    answer = client.call_async(Trigger.Request())
    site.until(answer.done, "the answer")
    site.until(lambda: site.jumps == 1, "a jump")
    site.until_it_drives()


# what the recording says


@dataclass(frozen=True)
class Outage:
    """What was done to a node, and that it was undone; the next outage begins at a log time `until` [s]."""

    kind: str
    begin: Event
    end: Event
    until: float

    @property
    def lasted(self) -> float:
        """How long [s]: in log time for the clock, without which simulated time stands still, else in that."""
        return self.end.log - self.begin.log if self.kind == "clock" else self.end.now - self.begin.now


@dataclass(frozen=True)
class Stop:
    """What an outage led to: the robot moved for so long after its begin, and might have for so long [s].

    It moved again so long after its end [s].
    """

    kind: str
    moved: float
    promised: float
    to_recovery: float


def is_begin(event: Event) -> bool:
    return event.text.split()[0] not in (RESTART, "SIGCONT")


def outages(drive: Drive) -> list[Outage]:
    """Return what was done to the nodes; a clock that is set back is no outage."""
    kinds = {name: kind for kind, name in KINDS.items()}
    done = [event for event in drive.events if event.text != RESET]
    begins = [event.log for event in drive.events if is_begin(event)]
    last = float(drive.poses[-1, 0])
    return [
        Outage(
            kinds[begin.text.split()[1]], begin, end, min((t for t in begins if t > end.log), default=last)
        )
        for begin, end in zip(done[::2], done[1::2], strict=True)
    ]


def stop_of(drive: Drive, outage: Outage) -> Stop:
    """Return what the recording says of an outage."""
    motions, begin, end = drive.motions(), outage.begin, outage.end
    during = (motions.log > begin.log) & (motions.log < end.log)
    after = motions.log[(motions.log > end.log) & (motions.log < outage.until)]
    times = motions.log - begin.log if outage.kind == "clock" else motions.end - begin.now
    # Without a scanner the planner goes on certifying; of the others one decision may have been under way.
    latest = math.inf if outage.kind == "lms200" else begin.now + INTERVAL
    return Stop(
        outage.kind,
        float(times[during].max(initial=0.0)),
        drive.window_end(end.log, latest) - begin.now,
        float(after.min(initial=math.inf)) - end.log,
    )


def judge_kill(drive: Drive, outage: Outage) -> Stop:
    """See that the robot drove, stood inside its window and until the restart, and drove again."""
    stop, motions = stop_of(drive, outage), drive.motions()
    before = np.flatnonzero(motions.log <= outage.begin.log)[-6:]
    assert 0.0 <= outage.begin.now - motions.end[before[-1]] < STILL, outage
    assert np.hypot(*(motions.after - motions.before)[before].T).sum() > 0.1, outage
    assert stop.moved <= stop.promised, stop
    assert stop.moved <= outage.lasted - 0.5 * STILL, (stop, outage)
    judge_recovery(drive, outage)
    return stop


def judge_recovery(drive: Drive, outage: Outage) -> None:
    """See that the robot drove after the end of an outage."""
    assert drive.distance(outage.end.log, outage.until) > 0.1, outage


def judge_drive(drive: Drive, scene: Scene) -> None:
    """See that no motion was without a window, none too near to a wall, and none while time began anew."""
    motions = drive.motions()
    assert len(motions.log) > 20
    assert len(motions.outside()) == 0, f"outside windows by {motions.outside()} s"
    ways = shapely.linestrings(np.stack((motions.before, motions.after), axis=1))
    walls = shapely.Polygon(scene.border.vertices).boundary
    assert shapely.distance(ways, walls).min() >= scene.safety_margin
    assert (drive.restarts() < 1e-9).all()


def read_and_draw(folder: FilePath) -> Drive:
    """Read the recording back, see that it is whole, and draw beside it what happened after every event."""
    with BagReader(folder / "bag") as bag:
        assert bag.topics.keys() == {f"/{topic.strip('/')}" for _, topic, _ in Listener.TOPICS} | {"/events"}
    drive = read_drive(folder / "bag", "cart")
    last = float(drive.poses[-1, 0])
    stops = {outage.begin: stop_of(drive, outage) for outage in outages(drive)}
    begins = [event for event in drive.events if is_begin(event)]
    ends = [event.log for event in begins[1:]] + [last]
    for number, (event, end) in enumerate(zip(begins, ends, strict=True), start=1):
        title = f"0 s: {event.text}, {event.log:.2f} s from the start of the recording"
        if event in stops:
            stop = stops[event]
            title += f"; moved for {stop.moved:.2f} s, was certified for {stop.promised:.2f} s"
        curves = window_curves(drive, max(0.0, event.log - 3.0), min(end + 1.0, last), zero=event.log)
        draw_window(title, curves, folder / f"{number:02}_{event.text.replace(' ', '_')}.png")
    return drive


def test_kill_of_any_node_stops_the_robot_inside_its_window_and_a_restart_lets_it_go_on(
    tmp_path: FilePath, ros_domain: int
) -> None:
    with site(tmp_path, ros_domain) as here:
        for kind in KINDS:
            kill_and_restart(here, kind)
    drive = read_and_draw(tmp_path)
    judge_drive(drive, here.scene)
    assert [outage.kind for outage in outages(drive)] == list(KINDS)
    for outage in outages(drive):
        judge_kill(drive, outage)
    assert len(drive.jumps) == 1  # the clock began anew
    said = {remark.text for remark in drive.remarks}
    assert any(text.startswith("tracker cart: the certificate ended at") for text in said)
    assert any(text.startswith("robot cart: the unoccupied area is") for text in said)


def test_nodes_that_sleep_and_wake_and_a_clock_that_is_set_back(tmp_path: FilePath, ros_domain: int) -> None:
    with site(tmp_path, ros_domain) as here:
        for kind in KINDS:
            nap(here, kind)
        set_back_the_clock(here)
    drive = read_and_draw(tmp_path)
    judge_drive(drive, here.scene)
    naps = outages(drive)
    assert [outage.kind for outage in naps] == list(KINDS)
    for outage in naps:
        assert outage.lasted > 0.9 * NAP, outage
        judge_recovery(drive, outage)
    (jump,) = drive.jumps  # by hand, and none because of a nap
    reset = drive.events[-1]
    assert reset.text == RESET
    assert reset.log < jump
    said = {remark.text for remark in drive.remarks if remark.log > jump}
    assert any("tracker cart: the clock jumped back" in text for text in said)
    assert drive.distance(float(jump), float(drive.poses[-1, 0])) > 0.1


@pytest.mark.nightly
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", KINDS)
def test_series_of_kills(
    tmp_path: FilePath, ros_domain: int, kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with site(tmp_path, ros_domain) as here:
        for _ in range(20):
            kill_and_restart(here, kind)
    drive = read_and_draw(tmp_path)
    judge_drive(drive, here.scene)
    stops = [judge_kill(drive, outage) for outage in outages(drive)]
    assert len(stops) == 20
    times = np.array([[stop.moved, stop.promised, stop.to_recovery] for stop in stops])
    p50, p99 = np.percentile(times, [50, 99], axis=0)
    with capfd.disabled():
        print(
            f"\n{kind}: {len(stops)} kills, to standstill p50 {p50[0]:.2f} p99 {p99[0]:.2f} s, promised p50 "
            f"{p50[1]:.2f} least {times[:, 1].min():.2f} s, least left {(times[:, 1] - times[:, 0]).min():.2f} s; "
            f"restart to driving p50 {p50[2]:.2f} p99 {p99[2]:.2f} s; bag and pictures in {tmp_path}"
        )
