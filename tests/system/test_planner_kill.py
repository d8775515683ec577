"""Real processes over DDS: one of two planner nodes is killed in mid-run; nobody comes too near, all go on later.

Four robots cross a hall to and fro, two of each planner. Odometry of the simulated bases is ground truth; all is judged
by what was heard of it and by the windows that were certified.
"""

from __future__ import annotations

import itertools
import math
import signal
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path as FilePath

import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry

from snnav_core.types import StopReason
from snnav_ros.convert import nanoseconds_from_stamp, seconds, verdict_from_message
from snnav_ros.processes import ChildProcesses
from snnav_sim.scene import parse_scene
from support.process_site import ProcessSite, goal_at, processes

SCENE = """
name: crossing_hall
description: Four robots cross to and fro
sampling_interval: 0.6
safety_margin: 0.4
seed: 1
workspace: {polygon: [[0, 0], [14, 0], [14, 10], [0, 10]]}
sensors:
  - {id: west, device: lms200, position: [0.05, 5], heading_deg: 0, field_of_view_deg: 180, resolution_deg: 0.5,
     range_max: 20.0, noise: lms200}
robots:
  - {id: a, start: [2, 3.5], heading_deg: 0, target: [12, 6], speed: 0.8, max_turn_rate: 2.0, radius: 0.3}
  - {id: b, start: [4, 8.5], heading_deg: -90, target: [6, 1.5], speed: 0.8, max_turn_rate: 2.0, radius: 0.3}
  - {id: c, start: [12, 3.5], heading_deg: 180, target: [2, 6], speed: 0.8, max_turn_rate: 2.0, radius: 0.3}
  - {id: d, start: [10, 1.5], heading_deg: 90, target: [8, 8.5], speed: 0.8, max_turn_rate: 2.0, radius: 0.3}
"""
HALL = parse_scene(SCENE, "crossing_hall")
INTERVAL, WINDOW = HALL.sampling_interval, HALL.sampling_interval * HALL.time_window
SERVED = {"planner_1": ["a", "b"], "planner_2": ["c", "d"]}
STILL = 1e-3  # [m/s]
LATE = 0.15  # [s] that a certificate may come after its stamp, compared with odometry heard before it
LONGEST = 60.0  # [s]


class Site(ProcessSite):
    """All nodes as processes, and a node that notes where robots are and sends them to and fro."""

    def __init__(self, children: ChildProcesses, context: rclpy.Context, folder: FilePath) -> None:
        super().__init__(children, context, LONGEST)
        self.time = -1.0
        self.rows: dict[str, list[tuple[float, float, float, float]]] = {r.id: [] for r in HALL.robots}
        self.windows: dict[str, list[tuple[float, float]]] = {r.id: [] for r in HALL.robots}
        self.deaf: dict[str, list[tuple[float, float]]] = {r.id: [] for r in HALL.robots}
        self.paths = dict.fromkeys(self.rows, 0)
        self._goals, self._ends = {}, {}
        for robot in HALL.robots:
            name = robot.id
            self._goals[name] = self.node.create_publisher(PoseStamped, f"{name}/goal_pose", 1)
            self._ends[name] = [robot.start, robot.target]
            self.node.create_subscription(Odometry, f"{name}/odom", partial(self._on_odometry, name), 100)
            take = partial(self._on_certificate, name)
            self.node.create_subscription(DiagnosticStatus, f"{name}/certificate", take, 100)
        self.start(SCENE, folder, planners=2)

    def _on_odometry(self, name: str, message: Odometry) -> None:
        self.time = seconds(nanoseconds_from_stamp(message.header.stamp))
        place, twist = message.pose.pose.position, message.twist.twist
        self.rows[name].append((self.time, place.x, place.y, abs(twist.linear.x) + abs(twist.angular.z)))

    def _on_certificate(self, name: str, message: DiagnosticStatus) -> None:
        verdict = verdict_from_message(message)
        if verdict.certificate is not None:
            self.windows[name].append((verdict.stamp, verdict.certificate.valid_until))
            self.paths[name] += 1
        elif verdict.stop is not None and verdict.stop.reason is StopReason.ARRIVED:
            here = self.rows[name][-1][1:3]
            self._goals[name].publish(goal_at(*max(self._ends[name], key=lambda end: math.dist(end, here))))

    def work(self, duration: float) -> None:
        end = self.time + duration
        self.until(lambda: self.time >= end, "time")

    def driven(self, name: str, since: float) -> float:
        """Return how far a robot has come since a time [m]."""
        rows = np.array([row for row in self.rows[name] if row[0] >= since])
        return float(np.linalg.norm(np.diff(rows[:, 1:3], axis=0), axis=1).sum()) if len(rows) > 1 else 0.0

    def until_all_drive(self, what: str) -> None:
        begin = self.time
        self.until(lambda: all(self.driven(name, begin) > 0.8 for name in self.rows), what)

    def restart(self, planner: str) -> None:
        """Start a planner again and see all drive; it may find robots before it finds this test, deaf meanwhile."""
        begin, heard = self.time, {name: len(self.windows[name]) for name in SERVED[planner]}
        self.children.restart(planner)
        self.until_all_drive(f"all to go on after the restart of {planner}")
        for name, count in heard.items():
            self.deaf[name].append((begin, self.windows[name][count][0]))

    def moved_outside_windows(self, name: str) -> list[float]:
        """Return when a robot moved although no window that was certified held [s]."""
        windows = [*((begin - LATE, end) for begin, end in self.windows[name]), *self.deaf[name]]
        return [
            row[0]
            for row in self.rows[name]
            if row[3] > STILL and not any(begin <= row[0] <= end + 1e-6 for begin, end in windows)
        ]


@contextmanager
def site(folder: FilePath, domain: int) -> Iterator[Site]:
    with processes(folder, domain) as (children, context), closing(Site(children, context, folder)) as made:
        yield made


def least_separation(rows: dict[str, list[tuple[float, float, float, float]]]) -> float:
    """Return the least distance from the centre of a robot to the disk of another one, both at one time [m]."""
    tracks = {name: np.array(sorted(set(row))) for name, row in rows.items()}
    least = math.inf
    for one, other in itertools.combinations(tracks.values(), 2):
        times = np.arange(max(one[0, 0], other[0, 0]), min(one[-1, 0], other[-1, 0]), 0.01)
        there = [
            np.stack([np.interp(times, track[:, 0], track[:, axis]) for axis in (1, 2)], axis=-1)
            for track in (one, other)
        ]
        least = min(least, float(np.linalg.norm(there[0] - there[1], axis=1).min()))
    return least - HALL.robots[0].radius


@pytest.mark.slow
def test_one_of_two_planners_is_killed_and_comes_back(tmp_path: FilePath, ros_domain: int) -> None:
    with site(tmp_path, ros_domain) as hall:
        hall.until_all_drive("the start")
        for killed in ("planner_1", "planner_2"):
            own = SERVED[killed]
            hall.children.kill(killed, signal.SIGKILL)
            begin = hall.time
            hall.work(WINDOW + INTERVAL)
            stood = hall.time
            hall.work(2.0 * WINDOW)
            assert all(hall.driven(name, stood) < 1e-3 for name in own), "they stand once their windows ended"
            others = [name for name in hall.rows if name not in own]
            hall.until(
                lambda others=others, begin=begin: any(hall.driven(n, begin) > 2.0 for n in others), "others"
            )
            hall.restart(killed)
        least = least_separation(hall.rows)
        assert least >= HALL.safety_margin - 1e-3
        assert least < 4.0, "they met"
        for name in hall.rows:
            assert (outside := hall.moved_outside_windows(name)) == [], (
                outside,
                hall.windows[name],
                hall.deaf[name],
            )
            assert hall.paths[name] > 10
