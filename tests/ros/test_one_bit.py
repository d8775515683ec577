"""One bit altered in a path, its stamp or its certificate, wherever it is: the robot does not follow."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
from diagnostic_msgs.msg import DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry, Path
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.types import Certificate, PathSource, PlannedPath, Pose2D, TimedPath
from snnav_ros.convert import (
    area_to_message,
    nanoseconds,
    odometry_to_message,
    path_to_message,
    stamp_message,
    verdict_to_message,
)
from snnav_ros.gate import Order, PathGate
from snnav_ros.nodes.planner import PlannerNode
from snnav_ros.qos import LATCHED

Pair = tuple[Any, Any]
SECOND = 10**9


class Robot:
    """A gate, and what its robot does by the orders so far."""

    def __init__(self) -> None:
        self.gate, self.order = PathGate("cart"), Order(None)

    def hear(self, message: Any, now: float) -> None:
        offer = self.gate.offer_path if hasattr(message, "poses") else self.gate.offer_certificate
        self.order = offer(message, nanoseconds(now)) or self.order

    @property
    def follows(self) -> float | None:
        """Start of the path that is followed."""
        return None if self.order.path is None else self.order.path.start_time

    def drive(self, messages: Pair) -> Robot:
        stamp = messages[0].header.stamp
        for message in messages:
            self.hear(message, stamp.sec + stamp.nanosec / SECOND)
        assert self.follows is not None
        return self


def fields(message: Any, where: str = "") -> list[tuple[str, Callable[[], Any], Callable[[Any], None]]]:
    """Return every plain field of a message with a reader and a writer."""
    found = []
    for name in message.get_fields_and_field_types():
        value, place = getattr(message, name), f"{where}.{name}"
        if hasattr(value, "get_fields_and_field_types"):
            found += fields(value, place)
        elif isinstance(value, list):
            for index, entry in enumerate(value):
                found += fields(entry, f"{place}[{index}]")
        else:
            read = lambda message=message, name=name: getattr(message, name)  # noqa: E731
            write = lambda new, message=message, name=name: setattr(message, name, new)  # noqa: E731
            found.append((place, read, write))
    return found


def flips(value: Any, kind: str) -> list[Any]:
    """Return a value with each of its bits altered in turn; of texts those that still are UTF-8."""
    if isinstance(value, float):
        bits = np.float64(value).view(np.uint64)
        return [float((bits ^ np.uint64(1 << bit)).view(np.float64)) for bit in range(64)]
    if isinstance(value, bytes):
        return [bytes([value[0] ^ (1 << bit)]) for bit in range(8)]
    if isinstance(value, int):
        if kind.endswith("nanosec"):
            return [value ^ (1 << bit) for bit in range(32)]
        return [int(np.int32(value) ^ np.int32(np.uint32(1 << bit).view(np.int32))) for bit in range(32)]
    altered = []
    for bit in range(8 * len(value.encode())):
        content = bytearray(value.encode())
        content[bit // 8] ^= 1 << (bit % 8)
        try:
            altered.append(content.decode())
        except UnicodeDecodeError:
            continue
    return altered


def planned(points: np.ndarray[Any, Any], start: float) -> tuple[Any, Any]:
    """Return a pair like one of the planner: ragged numbers, all keys."""
    of = TimedPath(start, 0.1, points)
    held = Certificate("cart", True, start + 1.75, 0.5031, math.inf, 1.4142135623730951, start, of.digest())
    plan = PlannedPath("cart", of, held, PathSource.TANGENT_GRAPH, 0.5123)
    message = path_to_message(of)
    return message, verdict_to_message(plan, nanoseconds(start), message)


WAY = np.cumsum(np.random.default_rng(3).uniform(0.01, 0.05, (4, 2)), axis=0)


@pytest.mark.parametrize("path_first", [True, False])
@pytest.mark.parametrize("index", [0, 1], ids=["path", "certificate"])
def test_one_bit_of_any_field_stops(index: int, path_first: bool) -> None:
    count = 0
    for place, read, _ in fields(planned(WAY, 1.7)[index]):
        for altered in flips(read(), place):
            robot = Robot().drive(planned(WAY, 1.2))
            messages = planned(WAY, 1.7)
            write = next(entry for entry in fields(messages[index]) if entry[0] == place)[2]
            write(altered)
            for message in messages if path_first else reversed(messages):
                robot.hear(message, 1.71)
            assert robot.follows is None, f"{place}: {read()!r} altered to {altered!r} is followed"
            assert robot.order.refusal, f"{place}: {read()!r} altered to {altered!r} stops without a word"
            count += 1
    assert count > 1500


@given(st.integers(2, 40), st.integers(0, 10**6), st.data())
def test_one_bit_of_any_path_stops(length: int, millis: int, data: st.DataObject) -> None:
    seed = data.draw(st.integers(0, 2**32 - 1))
    points = np.cumsum(np.random.default_rng(seed).uniform(-0.05, 0.05, (length, 2)), axis=0)
    start = (10_000 + millis) / 1e3
    messages = planned(points, start)
    good = copy.deepcopy(messages)
    entries = [entry for message in messages for entry in fields(message)]
    place, read, write = data.draw(st.sampled_from(entries))
    options = flips(read(), place)
    if not options:  # an empty text
        return
    write(data.draw(st.sampled_from(options)))
    robot = Robot()
    for message in good:
        robot.hear(message, start)
    assert robot.follows == start
    robot = Robot().drive(planned(points, start - 0.5))
    for message in data.draw(st.permutations(messages)):
        robot.hear(message, start)
    assert robot.follows is None, place


def real_pairs(graph: Any) -> tuple[Pair, Pair]:
    """Return two successive paths of a planner node with their certificates, stamped 1 s and 1.5 s."""
    paths, verdicts = graph.hear(Path, "cart/path"), graph.hear(DiagnosticStatus, "cart/certificate")
    robot = {"cart.radius": 0.3, "cart.speed": 0.5, "cart.max_turn_rate": 1.0, "cart.target": [6.0, 4.0]}
    settings = {"sampling_interval": 0.5, "safety_margin": 0.5, "boundary_speed": 0.1, "use_sim_time": True}
    graph.add(PlannerNode, robots=["cart"], **robot, **settings)
    areas = graph.speak(PointCloud2, "unoccupied_area", LATCHED)
    odometry, clock = graph.speak(Odometry, "cart/odom"), graph.speak(Clock, "/clock", 1)
    hall = shapely.MultiPolygon([shapely.box(0.0, 0.0, 9.0, 6.0) - shapely.Point(4.0, 3.0).buffer(0.4)])
    node = graph.nodes[-1]
    for count, (stamp, x) in enumerate([(SECOND, 1.5), (SECOND * 3 // 2, 1.75)], start=1):
        clock.publish(Clock(clock=stamp_message(stamp)))
        graph.until(lambda stamp=stamp: node.get_clock().now().nanoseconds == stamp)
        odometry.publish(odometry_to_message("cart", Pose2D(x, 2.5, 0.0), 0.5, 0.0, stamp))
        graph.until(lambda stamp=stamp: node._states.get("cart", (0,))[0] == stamp)
        areas.publish(area_to_message(UnoccupiedArea(stamp / SECOND, hall)))
        graph.until(lambda count=count: len(paths) == len(verdicts) == count, "a decision")
    return (paths[0], verdicts[0]), (paths[1], verdicts[1])


def test_one_bit_of_every_field_that_a_planner_published_stops(graph: Any) -> None:
    first, second = real_pairs(graph)
    assert len(second[0].poses) > 20
    followed = Robot().drive(first)
    for message in second:
        followed.hear(message, 1.55)
    assert followed.follows == 1.5
    randomness = np.random.default_rng(5)
    count = 0
    for message in second:
        for place, read, write in fields(message):
            good = read()
            options = flips(good, place)
            if not options:
                continue
            write(options[randomness.integers(len(options))])
            robot = Robot().drive(first)
            for one in second if randomness.integers(2) else reversed(second):
                robot.hear(one, 1.55)
            assert robot.follows is None, f"{place}: {good!r} altered to {read()!r} is followed"
            assert robot.order.refusal
            write(good)
            count += 1
    assert count > 10 * len(second[0].poses) + 20
