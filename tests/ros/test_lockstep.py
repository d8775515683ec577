"""The protocol of lockstep: clock and participants, without any other node."""

from __future__ import annotations

from typing import Any

import pytest
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger

from snnav_ros.convert import nanoseconds_from_stamp
from snnav_ros.lockstep import DONE_TOPIC, Participant
from snnav_ros.nodes.clock import ClockNode
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import LOCKSTEP

PERIOD = 100_000_000
PARAMETERS = {"lockstep": True, "control_period": 0.1, "sampling_interval": 0.3}


class Worker:
    """A participant that says when it is done by hand or at once."""

    def __init__(self, graph: Any, name: str, period: int, at_once: bool = True) -> None:
        self.node = Node(name, context=graph.context, enable_rosout=False, start_parameter_services=False)
        self.ticks: list[int] = []
        self.resets = 0
        self._at_once = at_once
        self.participant = Participant(self.node, period, self._on_tick, self._on_reset)
        graph.executor.add_node(self.node)
        graph.nodes.append(self.node)

    def _on_tick(self, tick: int) -> None:
        self.ticks.append(tick // PERIOD)
        if self._at_once:
            self.participant.done()

    def _on_reset(self) -> None:
        self.resets += 1


def test_everybody_hears_exactly_the_ticks_that_are_due(graph: Any) -> None:
    fast, slow = Worker(graph, "fast", PERIOD), Worker(graph, "slow", 3 * PERIOD)
    clock = graph.add(ClockNode, every_tick=["fast"], every_sample=["slow"], **PARAMETERS)
    graph.until(lambda: clock.time >= 10.0)
    assert fast.ticks[:100] == list(range(100))
    assert slow.ticks[:30] == list(range(0, 90, 3))


def test_time_stands_until_the_slowest_is_done(graph: Any) -> None:
    fast, slow = Worker(graph, "fast", PERIOD), Worker(graph, "slow", 3 * PERIOD, at_once=False)
    clock = graph.add(ClockNode, every_tick=["fast"], every_sample=["slow"], **PARAMETERS)
    graph.until(lambda: fast.ticks == [0] and slow.ticks == [0])
    graph.work(0.3)
    assert clock.time == 0.0
    slow.participant.done()
    graph.until(lambda: slow.ticks == [0, 3])
    graph.work(0.2)
    assert fast.ticks == [0, 1, 2, 3]


def test_who_comes_late_gets_the_tick_that_waits_for_it(graph: Any) -> None:
    clock = graph.add(ClockNode, every_tick=["fast", "late"], **PARAMETERS)
    fast = Worker(graph, "fast", PERIOD)
    graph.until(lambda: fast.ticks == [0])
    graph.work(0.2)
    assert clock.time == 0.0
    late = Worker(graph, "late", PERIOD)
    graph.until(lambda: clock.time >= 1.0)
    assert late.ticks[:10] == fast.ticks[:10] == list(range(10))


def test_data_published_before_a_listener_exists_reach_it(graph: Any) -> None:
    publisher = graph.probe.create_publisher(Header, "early", LOCKSTEP)
    publisher.publish(Header(frame_id="first"))
    heard = graph.hear(Header, "early", LOCKSTEP)
    graph.until(lambda: bool(heard))
    assert heard[0].frame_id == "first"


def test_words_about_other_ticks_and_by_strangers_do_not_count(graph: Any) -> None:
    worker = Worker(graph, "fast", PERIOD, at_once=False)
    clock = graph.add(ClockNode, every_tick=["fast"], **PARAMETERS)
    mouth = graph.speak(Header, DONE_TOPIC, LOCKSTEP)
    graph.until(lambda: worker.ticks == [0])
    mouth.publish(Header(frame_id="stranger"))
    late = Header(frame_id="fast")
    late.stamp.sec = 5
    mouth.publish(late)
    graph.work(0.2)
    assert clock.time == 0.0


def test_reset_starts_afresh_and_pause_holds(graph: Any) -> None:
    worker = Worker(graph, "fast", PERIOD)
    clock = graph.add(ClockNode, lean=False, every_tick=["fast"], **PARAMETERS)
    graph.until(lambda: clock.time >= 1.0)
    assert graph.call(SetBool, "clock_node/pause", SetBool.Request(data=True)).success
    graph.work(0.1)
    halted = clock.time
    graph.work(0.1)
    assert clock.time == halted
    count = len(worker.ticks)
    graph.call(SetBool, "clock_node/pause", SetBool.Request(data=False))
    graph.until(lambda: len(worker.ticks) > count + 5)
    assert worker.ticks == list(range(len(worker.ticks)))
    graph.call(SetBool, "clock_node/pause", SetBool.Request(data=True))
    graph.work(0.1)
    assert graph.call(Trigger, "clock_node/reset", Trigger.Request()).success
    graph.until(lambda: worker.ticks[-1] == 0)
    assert worker.resets == 1


def test_names_of_who_is_missing_are_said(
    graph: Any, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("snnav_ros.waiting._PERIOD", 0.2)
    Worker(graph, "fast", PERIOD)
    graph.add(ClockNode, every_tick=["fast", "robot_7"], every_sample=["fusion_node"], **PARAMETERS)
    graph.work(0.5)
    lines = [line for line in capfd.readouterr().err.splitlines() if "waiting for" in line]
    assert lines[-1].endswith("waiting for: fusion_node, robot_7")


def test_free_running_time_goes_by_the_rate(graph: Any) -> None:
    heard = graph.hear(Clock, "/clock", 1)
    clock = graph.add(ClockNode, rate=100.0, control_period=0.1, sampling_interval=0.3)
    graph.until(lambda: clock.time >= 5.0)
    stamps = [nanoseconds_from_stamp(message.clock) for message in heard]
    assert stamps == sorted(stamps)
    assert all(stamp % PERIOD == 0 for stamp in stamps)


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"lockstep": True}, "every_tick: is empty"),
        ({"control_period": 0.3, "sampling_interval": 1.0}, "control_period: value 0.3 does not divide"),
        ({"rate": 0.0}, "rate: value 0.0 lies outside"),
        ({"scene": "nowhere"}, "scene: nowhere: no scene of this name"),
    ],
)
def test_mistakes_end_the_clock_at_its_start(graph: Any, parameters: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        graph.add(ClockNode, **parameters)
