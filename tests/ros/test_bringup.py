"""Whole scenes through the nodes: the same paths twice, without ROS, and as processes; every end is clean."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from snnav_core.types import StopReason
from snnav_ros.available import make_executor
from snnav_ros.bag.reader import BagReader
from snnav_ros.bringup import BringupError, run_scene
from snnav_ros.domain import free_domain
from snnav_ros.processes import ChildProcesses
from snnav_sim.report.record import RunRecord
from snnav_sim.scene import Circle, Fault, Mover, Scene, find_scene, load_scene
from snnav_sim.simulation import simulate
from support.waiting import until

HELLO = load_scene(find_scene("hello"))


def two_robots() -> Scene:
    """Two robots that meet: what is decided for one depends on the other."""
    (first,) = HELLO.robots
    first = replace(first, start=(1.2, 4.6), target=(8.8, 4.6))
    second = replace(first, id="robot_2", start=(8.6, 1.0), target=(1.2, 4.0), heading=np.pi)
    return replace(HELLO, robots=(first, second))


def shaky() -> Scene:
    """Somebody walks by, scanners on the floor at rates of their own, each with faults."""
    west, east = HELLO.sensors
    faults = (
        Fault("delay", 1.0, 5.0, 0.5, seconds=0.2, jitter=0.7),
        Fault("nan", 2.0, 3.0, share=0.1),
        Fault("duplicate", probability=0.3),
        Fault("reorder", 4.0, probability=0.5),
    )
    others = (
        Fault("drop_out", 1.5, 2.6),
        Fault("frozen", 4.0, 5.0),
        Fault("beam_count", 6.0, 7.0, change=-7),
        Fault("clock_offset", 7.0, 8.0, seconds=0.8),
        Fault("zero", 8.0, 9.0, share=0.1),
    )
    sensors = (
        replace(west, scan_period=0.3, scan_offset=0.02, sees_robots=True, faults=faults),
        replace(east, scan_period=0.23, sees_robots=True, faults=others),
    )
    walker = Mover("walker", Circle(0.0, 0.0, 0.2), ((1.5, 5.5), (8.5, 5.5)), 0.1, True)
    return replace(
        HELLO, sensors=sensors, movers=(walker,), obstacles=(), boundary_speed=0.1, time_limit=12.0
    )


def same_run(one: RunRecord, other: RunRecord) -> bool:
    same_ways = all(np.array_equal(one.trajectory(name), other.trajectory(name)) for name in other.samples)
    same_areas = one.areas == other.areas and len(one.areas) == len(one.fusion_seconds)
    same_robots = one.samples.keys() == other.samples.keys()
    return one.digests() == other.digests() and same_robots and same_ways and same_areas


@pytest.mark.parametrize("scene", [HELLO, two_robots()], ids=["hello", "two robots"])
def test_same_seed_same_paths_with_and_without_ros(scene: Scene) -> None:
    first, second = run_scene(scene), run_scene(scene)
    assert first.reason == "all robots arrived"
    assert same_run(first, second)
    assert same_run(first, simulate(scene))
    assert len(first.planner_seconds) == len(first.fusion_seconds) == len(first.decisions) / len(scene.robots)
    assert first.versions["rmw"].startswith("rmw_")


@pytest.mark.parametrize("processes", [False, True])
def test_faulty_scanners_give_the_same_paths_with_and_without_ros(processes: bool) -> None:
    scene = shaky()
    alone = simulate(scene)
    assert sum(decision.path is not None for decision in alone.decisions) > 5
    assert set(alone.rejected) == {"lms_west", "lms_east"}
    through_nodes = run_scene(scene, processes=processes)
    assert same_run(through_nodes, alone)
    assert [time for time, _ in through_nodes.areas] == [time for time, _ in alone.areas]
    for (_, one), (_, other) in zip(through_nodes.areas, alone.areas, strict=True):
        assert one.equals(other)


def test_other_executor_gives_the_same_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = replace(HELLO, time_limit=3.0)
    first = run_scene(scene)
    monkeypatch.setattr("rclpy.experimental.EventsExecutor", None)
    monkeypatch.delattr("rclpy.experimental.EventsExecutor")
    made = []
    monkeypatch.setattr(
        "snnav_ros.bringup.make_executor", lambda context: made.append(make_executor(context)) or made[-1]
    )
    assert same_run(run_scene(scene), first)
    assert type(made[0]).__name__ == "SingleThreadedExecutor"


def test_another_seed_gives_other_paths() -> None:
    first, second = run_scene(HELLO), run_scene(HELLO, seed=HELLO.seed + 1)
    assert (first.seed, second.seed) == (1, 2)
    assert first.digests() != second.digests()
    assert second.reason == "all robots arrived"


def test_separate_processes_give_the_same_paths() -> None:
    scene = two_robots()
    assert same_run(run_scene(scene, processes=True), run_scene(scene))


def test_real_time_goes_by_the_wall_and_arrives(tmp_path: Path) -> None:
    (robot,) = HELLO.robots
    scene = replace(HELLO, robots=(replace(robot, target=(3.2, 3.0)),))
    begin = time.monotonic()
    record = run_scene(scene, realtime=True, bag=tmp_path / "bag")
    assert record.reason == "all robots arrived"
    end = record.trajectory("robot_1")[-1]
    assert time.monotonic() - begin >= end[0] - 0.1
    assert np.hypot(end[1] - 3.2, end[2] - 3.0) < 0.4
    assert any(decision.path is not None for decision in record.decisions)
    with BagReader(tmp_path / "bag") as bag:
        assert {
            "/clock",
            "/robot_1/cmd_vel",
            "/sensors/lms_west/scan",
            "/unoccupied_area",
        } <= bag.topics.keys()


def test_bag_holds_every_topic(tmp_path: Path) -> None:
    record = run_scene(HELLO, bag=tmp_path / "bag")
    ticks = len(record.samples["robot_1"])
    samples = len(record.decisions)
    counts: dict[str, int] = {}
    stamps: dict[str, list[int]] = {}
    with BagReader(tmp_path / "bag") as bag:
        for entry in bag.messages():
            counts[entry.topic] = counts.get(entry.topic, 0) + 1
            stamps.setdefault(entry.topic, []).append(entry.stamp_ns)
    assert counts == {
        "/clock": ticks,
        "/robot_1/odom": ticks,
        "/robot_1/cmd_vel": ticks,
        "/robot_1/path": samples,
        "/robot_1/certificate": samples,
        "/robot_1/goal_pose": 1,
        "/sensors/lms_west/scan": samples,
        "/sensors/lms_east/scan": samples,
        "/unoccupied_area": samples,
        "/unoccupied_area/grid": samples,
        "/diagnostics": 3 * samples,
        "/robots": 1,
    }
    assert stamps["/robot_1/cmd_vel"] == stamps["/robot_1/odom"] == [50_000_000 * k for k in range(ticks)]
    assert stamps["/unoccupied_area"] == [500_000_000 * k for k in range(samples)]


def test_run_ends_when_nothing_will_change() -> None:
    (robot,) = HELLO.robots
    scene = replace(HELLO, robots=(replace(robot, target=(5.0, 2.6)),))  # inside the pillar
    record = run_scene(scene)
    assert "goal_blocked" in record.reason
    assert {decision.reason for decision in record.decisions} == {StopReason.GOAL_BLOCKED.value}


def test_run_ends_at_the_time_limit() -> None:
    record = run_scene(replace(HELLO, time_limit=2.0))
    assert record.reason == "time limit of 2 s"
    assert record.trajectory("robot_1")[-1, 0] == 2.0


def test_progress_is_told_every_sampling_interval() -> None:
    told: list[tuple[float, float]] = []

    def progress(now: float, record: RunRecord) -> None:
        told.append((now, record.samples["robot_1"][-1][1] if record.samples else 0.0))

    run_scene(replace(HELLO, time_limit=3.0), progress=progress)
    assert [now for now, _ in told] == [0.5 * k for k in range(7)]
    assert told[-1][1] > 2.0


@pytest.mark.parametrize(
    ("number", "processes"), [(signal.SIGINT, False), (signal.SIGTERM, False), (signal.SIGINT, True)]
)
def test_signal_ends_a_run_and_leaves_nothing(number: int, processes: bool, tmp_path: Path) -> None:
    def interrupt(now: float, _: RunRecord) -> None:
        if now >= 1.0:
            os.kill(os.getpid(), number)

    before, children = signal.getsignal(number), children_of(os.getpid())
    with pytest.raises(KeyboardInterrupt):
        run_scene(HELLO, processes=processes, bag=tmp_path / "bag", progress=interrupt)
    assert signal.getsignal(number) is before
    assert not list(tmp_path.iterdir())
    assert children_of(os.getpid()) == children


def children_of(parent: int) -> list[int]:
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            words = status.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(words[1]) == parent and words[0] != "Z":
            found.append(int(status.parent.name))
    return found


def test_process_that_ends_is_named_with_its_last_words(tmp_path: Path, ros_domain: int) -> None:
    with ChildProcesses(tmp_path, ros_domain) as children:
        children.start("lms_9", "snnav_ros.nodes.lms200_node", {"scene": "hello", "sensor_id": "lms_9"})
        until(children.ended, "the end of a process")
        assert children.ended().startswith(
            "lms_9 ended with status 2: /lms_9: parameter sensor_id: value 'lms_9'"
        )


def test_run_with_a_process_that_dies_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    start = ChildProcesses.start

    def broken(self: ChildProcesses, name: str, module: str, parameters: dict[str, object]) -> None:
        start(
            self,
            name,
            module,
            {**parameters, "sampling_intervall": 1.0} if name == "fusion_node" else parameters,
        )

    monkeypatch.setattr(ChildProcesses, "start", broken)
    children = children_of(os.getpid())
    with pytest.raises(
        BringupError, match=r"fusion_node ended with status 2: .*did you mean sampling_interval"
    ):
        run_scene(HELLO, processes=True)
    assert children_of(os.getpid()) == children


def test_domains_are_held_and_given_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_DOMAIN_ID")
    with free_domain() as one, free_domain() as other:
        assert one != other
        assert {one, other} <= set(range(1, 101))
    with free_domain() as again:
        assert again == one
    monkeypatch.setenv("ROS_DOMAIN_ID", "42")
    with free_domain() as given:
        assert given == 42
    for wrong in ("-1", "300", "x"):
        monkeypatch.setenv("ROS_DOMAIN_ID", wrong)
        with pytest.raises(Exception, match="ROS_DOMAIN_ID is"), free_domain():
            pass
