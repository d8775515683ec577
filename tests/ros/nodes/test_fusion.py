"""The fusion node in real time, by hand-made scans, and its life cycle."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import OccupancyGrid, Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan, PointCloud2
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

from snnav_core.sensing.scan import PlanarScan
from snnav_core.types import Pose2D
from snnav_ros.convert import (
    area_from_message,
    lost_from_message,
    nanoseconds_from_stamp,
    nothing_to_message,
    odometry_to_message,
    scan_to_message,
    stamp_message,
)
from snnav_ros.lockstep import DONE_TOPIC
from snnav_ros.nodes.fusion import FusionNode
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import LATCHED, LOCKSTEP

SECOND = 10**9
SITE = {
    "sampling_interval": 0.5,
    "max_scan_age": 1.0,
    "boundary_speed": 0.0,
    "sensors": ["north", "south"],
    "north.position": [0.0, 9.0],
    "north.heading_deg": -90.0,
    "south.position": [0.0, 1.0],
    "south.heading_deg": 90.0,
    "south.frame": "laser",
    "use_sim_time": True,
}


def scan(frame: str, stamp: int, length: float = 3.0, beams: int = 181, noise: float = 1e-4) -> LaserScan:
    ranges = length + noise * np.random.default_rng(stamp).uniform(size=beams)
    values = PlanarScan(stamp / SECOND, ranges, -np.pi / 2, np.pi / (beams - 1), 0.0, 8.0)
    return scan_to_message(values, frame, stamp)


class Site:
    """A fusion node of two sensors, its scans and time in the hands of the test."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.areas = graph.hear(PointCloud2, "unoccupied_area", LATCHED)
        self.diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
        self.node = graph.add(FusionNode, lean=False, **{**SITE, **changes})
        self.north = graph.speak(LaserScan, "sensors/north/scan")
        self.south = graph.speak(LaserScan, "sensors/south/scan")
        self.clock = graph.speak(Clock, "/clock", 1)

    def at(self, stamp: int) -> None:
        self.clock.publish(Clock(clock=stamp_message(stamp)))
        self.graph.until(lambda: self.node.get_clock().now().nanoseconds == stamp, "the clock")

    def send(self, publisher: Any, message: LaserScan) -> None:
        """Let time go to the stamp of a scan and send it."""
        stamp = nanoseconds_from_stamp(message.header.stamp)
        if stamp > self.node.get_clock().now().nanoseconds:
            self.at(stamp)
        count = sum(self.node._received.values()) + sum(self.node._rejected.values())
        publisher.publish(message)
        self.graph.until(
            lambda: sum(self.node._received.values()) + sum(self.node._rejected.values()) > count, "the scan"
        )

    def area(self, stamp: int) -> Any:
        """Let time go to a sampling instant and return the area of it."""
        count = len(self.areas)
        self.at(stamp)
        self.graph.until(lambda: len(self.areas) > count, "an area")
        return area_from_message(self.areas[-1])

    def status(self, name: str) -> DiagnosticStatus:
        stamp = self.areas[-1].header.stamp
        self.graph.until(
            lambda: self.diagnostics and self.diagnostics[-1].header.stamp == stamp, "diagnostics"
        )
        return next(one for one in self.diagnostics[-1].status if one.name == name)


def test_latest_scans_make_the_area_of_the_sampling_instant(graph: Any) -> None:
    site = Site(graph)
    site.at(100)
    graph.work(0.2)
    assert not site.areas  # nothing is known yet, and nothing is said
    site.send(site.north, scan("north", 200_000_000))
    site.send(site.south, scan("laser", 300_000_000, length=4.0))
    area = site.area(500_000_000)
    assert area.stamp == 0.5
    # half disks of 3 m and 4 m, their flat sides on y = 9 and y = 1
    assert area.region.area == pytest.approx(np.pi / 2 * (9 + 16), rel=0.02)
    assert area.region.bounds[1::2] == pytest.approx((1.0, 9.0), abs=0.01)
    assert site.status("sensor north").level == DiagnosticStatus.OK
    assert float(next(v.value for v in site.status("fusion").values if v.key == "step_ms")) > 0.0


def test_grid_is_published_to_who_listens(graph: Any) -> None:
    grids = graph.hear(OccupancyGrid, "unoccupied_area/grid", LATCHED)
    site = Site(graph, grid_resolution=0.5)
    site.at(100)
    site.send(site.north, scan("north", 200_000_000))
    site.area(500_000_000)
    graph.until(lambda: bool(grids))
    assert 0 in grids[0].data
    assert grids[0].info.resolution == 0.5


def test_old_scans_and_silent_sensors_do_not_count(graph: Any) -> None:
    site = Site(graph)
    site.at(100)
    site.send(site.north, scan("north", 200_000_000))
    site.send(site.south, scan("laser", 200_000_000))
    assert not site.area(500_000_000).is_empty
    site.send(site.south, scan("laser", 900_000_000))
    half = site.area(2 * SECOND - 500_000_000)
    assert half.region.bounds[3] < 5.0  # north, 1.3 s old, is gone
    assert "no scan young enough" in site.status("sensor north").message
    assert site.area(3 * SECOND).is_empty
    assert site.status("fusion").message == "nothing is free"


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (scan("map", 200_000_000), "frame_id is 'map', expected 'north'"),
        (LaserScan(), "frame_id"),
        (scan("north", 200_000_000, beams=100), "100 beams, expected 181"),
    ],
)
def test_scans_that_lie_are_named_and_not_used(graph: Any, message: LaserScan, text: str) -> None:
    site = Site(graph, **{"north.expected_beams": 181})
    site.at(100)
    site.send(site.north, message)
    site.send(site.south, scan("laser", 200_000_000))
    area = site.area(500_000_000)
    assert area.region.bounds[3] < 5.0
    entry = site.status("sensor north")
    assert entry.level == DiagnosticStatus.WARN
    assert text in entry.message


def test_time_that_jumps_back_starts_afresh(graph: Any) -> None:
    site = Site(graph, boundary_speed=0.1)
    site.at(100 * SECOND)
    site.send(site.north, scan("north", 100 * SECOND))
    assert not site.area(100 * SECOND + 500_000_000).is_empty
    site.at(SECOND)
    site.send(site.south, scan("laser", SECOND + 100_000_000))
    area = site.area(2 * SECOND)
    assert area.stamp == 2.0
    assert area.region.bounds[3] < 5.0  # nothing of north, which is in the future, and no memory of it


def test_services_reset_and_switch_a_sensor_off(graph: Any) -> None:
    site = Site(graph)
    site.at(100)
    site.send(site.north, scan("north", 200_000_000))
    site.send(site.south, scan("laser", 200_000_000))
    site.area(500_000_000)
    assert graph.call(Trigger, "fusion_node/reset", Trigger.Request()).success
    assert graph.call(SetBool, "fusion_node/north/enable", SetBool.Request(data=False)).success
    site.send(site.north, scan("north", 600_000_000))
    site.send(site.south, scan("laser", 600_000_000))
    assert site.area(1 * SECOND).region.bounds[3] < 5.0


def test_life_cycle(graph: Any) -> None:
    node = graph.add(FusionNode, lean=False, **{**SITE, "autostart": False})
    areas = graph.hear(PointCloud2, "unoccupied_area", LATCHED)

    def change(transition: int) -> bool:
        request = ChangeState.Request()
        request.transition.id = transition
        return bool(graph.call(ChangeState, "fusion_node/change_state", request).success)

    def state() -> int:
        return int(graph.call(GetState, "fusion_node/get_state", GetState.Request()).current_state.id)

    assert state() == State.PRIMARY_STATE_UNCONFIGURED
    for _ in range(2):  # twice round: nothing is left over from the first time
        assert change(Transition.TRANSITION_CONFIGURE)
        assert graph.probe.count_subscribers("sensors/north/scan") == 0
        assert change(Transition.TRANSITION_ACTIVATE)
        assert state() == State.PRIMARY_STATE_ACTIVE
        north = graph.speak(LaserScan, "sensors/north/scan")
        clock = graph.speak(Clock, "/clock", 1)
        before = len(areas)
        clock.publish(Clock(clock=stamp_message(SECOND)))
        graph.until(lambda: node.get_clock().now().nanoseconds == SECOND)
        north.publish(scan("north", SECOND))
        graph.until(lambda: node._received["north"] > 0)
        clock.publish(Clock(clock=stamp_message(2 * SECOND)))
        graph.until(lambda before=before: len(areas) > before)
        assert change(Transition.TRANSITION_DEACTIVATE)
        assert change(Transition.TRANSITION_CLEANUP)
        assert state() == State.PRIMARY_STATE_UNCONFIGURED
        graph.probe.destroy_publisher(north)
        graph.probe.destroy_publisher(clock)
    assert change(Transition.TRANSITION_UNCONFIGURED_SHUTDOWN)


def test_says_which_scans_are_missing(
    graph: Any, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("snnav_ros.waiting._PERIOD", 0.2)
    site = Site(graph)
    assert "waiting for: sensors/north/scan, sensors/south/scan" in capfd.readouterr().err
    site.north.publish(scan("north", 100))
    graph.until(lambda: site.node._received["north"] > 0)
    capfd.readouterr()
    graph.work(0.3)
    assert "waiting for: sensors/south/scan" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"sensors": ["north", "north"]}, "names a sensor twice"),
        ({"north.position": [1.0]}, r"north.position: value \[1.0\] is no point"),
        ({"north.heading_deg": "left"}, "north.heading_deg: value 'left' is no number"),
        ({"max_scan_age": 0.0}, "max_scan_age: value 0.0 lies outside"),
        ({"boundary_speed": -1.0}, "boundary_speed: value -1.0 lies outside"),
        ({"west.position": [0.0, 0.0]}, "west.position: is unknown"),
        ({"north.range_cut": -2.0}, "north.range_cut: value -2.0 lies outside"),
    ],
)
def test_mistakes_end_it_at_its_start(graph: Any, changes: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        graph.add(FusionNode, **{**SITE, **changes})


def test_without_sensors_or_scene_it_says_what_to_give(graph: Any) -> None:
    with pytest.raises(
        ParameterError, match="sensors: is empty; list the ids of the sensors, or give `scene`"
    ):
        graph.add(FusionNode)
    with pytest.raises(ParameterError, match=r"a.position: is not given"):
        graph.add(FusionNode, sensors=["a"])
    with pytest.raises(ParameterError, match="boundary_speed: is not given"):
        graph.add(FusionNode, **{"sensors": ["a"], "a.position": [0.0, 0.0], "a.heading_deg": 0.0})


def test_a_frozen_scanner_and_a_wrong_clock_are_told_in_words_and_their_parts_age(graph: Any) -> None:
    site = Site(graph)
    site.at(100)
    site.send(site.north, scan("north", 200_000_000, noise=0.0))
    site.send(site.south, scan("laser", 200_000_000))
    assert not site.area(500_000_000).is_empty
    site.send(site.north, scan("north", 900_000_000, noise=0.0))
    site.south.publish(scan("laser", 2 * SECOND))  # ahead of the clock at its arrival, though not at the step
    count = site.node._received["south"]
    graph.until(lambda: site.node._received["south"] > count)
    assert site.area(2 * SECOND).is_empty
    assert "stamped 0.900 s is frozen" in site.status("sensor north").message
    assert "2.000 s is 1.100 s ahead of the clock (0.900 s)" in site.status("sensor south").message
    values = {one.key: one.value for one in site.status("sensor north").values}
    assert values["rejected"] == "1"
    site.send(site.north, scan("north", 2_100_000_000))
    site.area(2_500_000_000)
    assert site.status("sensor north").message == "ok"


def test_a_device_without_noise_may_repeat_itself_where_the_parameter_says_so(graph: Any) -> None:
    site = Site(graph, **{"north.never_repeats": False})
    site.at(100)
    for stamp in (200_000_000, 900_000_000):
        site.send(site.north, scan("north", stamp, noise=0.0))
        site.area(stamp + 300_000_000)
    assert site.status("sensor north").message == "ok"


def test_all_scans_since_the_last_step_are_taken_in_the_order_of_arrival(graph: Any) -> None:
    site = Site(graph)
    site.at(100)
    for stamp in (200_000_000, 300_000_000, 250_000_000):
        site.send(site.north, scan("north", stamp))
    site.area(500_000_000)
    assert "0.250 s is older than its last (0.300 s)" in site.status("sensor north").message
    assert site.node._fusion.latest_stamp("north") == 0.3


def test_what_silent_sensors_saw_comes_before_the_area_of_the_same_stamp(graph: Any) -> None:
    order: list[tuple[str, int]] = []
    lost = []

    def note(kind: str, stamp: Any) -> None:
        order.append((kind, nanoseconds_from_stamp(stamp)))

    site = Site(graph)

    def on_lost(message: MarkerArray) -> None:
        lost.append(lost_from_message(message))
        note("lost", message.markers[0].header.stamp)

    graph.probe.create_subscription(MarkerArray, "unoccupied_area/lost", on_lost, LATCHED)
    graph.probe.create_subscription(
        PointCloud2, "unoccupied_area", lambda m: note("area", m.header.stamp), LATCHED
    )
    site.at(100)
    site.send(site.north, scan("north", 200_000_000))
    site.area(500_000_000)
    site.send(site.south, scan("laser", 900_000_000))
    site.area(1_500_000_000)
    graph.until(lambda: len(order) >= 4)
    assert set(order) == {
        (kind, stamp) for kind in ("lost", "area") for stamp in (500_000_000, 1_500_000_000)
    }
    assert [part.sensor_id for part in lost[0][1]] == ["south"]
    assert lost[0][1][0].stamp is None
    (north,) = lost[1][1]
    assert (north.sensor_id, north.stamp) == ("north", 0.2)
    assert north.region.area == pytest.approx(np.pi / 2 * 9, rel=0.02)


def test_who_saw_what_last_is_published_to_who_listens(graph: Any) -> None:
    seen = graph.hear(PointCloud2, "unoccupied_area/seen", LATCHED)
    site = Site(graph)
    site.at(100)
    site.send(site.north, scan("north", 200_000_000))
    site.send(site.south, scan("laser", 300_000_000))
    site.area(500_000_000)
    graph.until(lambda: bool(seen))
    values = np.frombuffer(
        bytes(seen[0].data),
        dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("sensor", "<i4"), ("age", "<f4")],
    )
    north, south = values[values["sensor"] == 0], values[values["sensor"] == 1]
    assert len(north) + len(south) == len(values)
    assert north["y"].min() > 5.0 > south["y"].max()
    np.testing.assert_allclose(north["age"], 0.3, rtol=1e-5)
    np.testing.assert_allclose(south["age"], 0.2, rtol=1e-5)


FLOOR = {
    "north.sees_robots": True,
    "robots": ["cart"],
    "cart.radius": 0.3,
    "cart.speed": 0.5,
    "cart.max_turn_rate": 1.0,
}


def in_front_of_north(stamp: int, distance: float) -> LaserScan:
    """A scan with something round of 0.3 m in front of the wall, `distance` from the scanner to its middle."""
    message = scan("north", stamp)
    bearing = np.linspace(-np.pi / 2, np.pi / 2, 181)
    across = distance * np.sin(bearing)
    hit = np.abs(across) < 0.3
    ranges = np.array(message.ranges)
    ranges[hit] = distance * np.cos(bearing[hit]) - np.sqrt(0.09 - across[hit] ** 2)
    message.ranges = ranges.astype(np.float32).tolist()
    return message


def test_a_robot_that_a_floor_level_scanner_sees_is_no_obstacle_where_its_odometry_says(graph: Any) -> None:
    site = Site(graph, **FLOOR)
    odometry = graph.speak(Odometry, "cart/odom")
    middle = np.array([[0.0, 7.0]])
    site.at(100)
    site.send(site.north, in_front_of_north(200_000_000, 2.0))
    assert site.area(500_000_000).clearance(middle)[0] < 0.0
    for stamp, at in ((SECOND, (0.0, 7.0)), (1_500_000_000, (3.0, 7.0))):
        site.at(stamp - 200_000_000)
        odometry.publish(odometry_to_message("cart", Pose2D(*at, 0.0), 0.0, 0.0, stamp - 200_000_000))
        graph.until(lambda: bool(site.node._odometry["cart"]))
        site.send(site.north, in_front_of_north(stamp - 100_000_000, 2.0))
        free = site.area(stamp).clearance(middle)[0] > 0.25
        assert free == (at[0] == 0.0), "a robot somewhere else is not what was seen"
    odometry.publish(odometry_to_message("cart", Pose2D(0.0, 7.0, 0.0), 0.0, 0.0, 9 * SECOND))
    graph.until(lambda: bool(site.node._odometry["cart"]))
    site.area(2 * SECOND)
    assert "ahead of the clock" in site.status("robot cart as seen").message


def test_without_floor_level_scanners_no_odometry_is_heard(graph: Any) -> None:
    Site(graph)
    assert graph.probe.count_subscribers("cart/odom") == 0


class Steps:
    """A fusion node in lockstep, its ticks and data in the hands of the test."""

    def __init__(self, graph: Any, **changes: Any) -> None:
        self.graph = graph
        self.areas = graph.hear(PointCloud2, "unoccupied_area", LOCKSTEP)
        self.done = graph.hear(Header, DONE_TOPIC, LOCKSTEP)
        self.node = graph.add(FusionNode, **{**SITE, "lockstep": True, "use_sim_time": False, **changes})
        self.north = graph.speak(LaserScan, "sensors/north/scan", LOCKSTEP)
        self.south = graph.speak(LaserScan, "sensors/south/scan", LOCKSTEP)
        self.clock = graph.speak(Clock, "/clock", LOCKSTEP)

    def tick(self, stamp: int) -> None:
        self.clock.publish(Clock(clock=stamp_message(stamp)))

    def is_done(self, stamp: int) -> bool:
        return any(nanoseconds_from_stamp(one.stamp) == stamp for one in self.done)


def test_in_lockstep_it_waits_for_the_word_that_nothing_more_comes(graph: Any) -> None:
    steps = Steps(graph)
    steps.tick(500_000_000)
    steps.south.publish(scan("laser", 500_000_000))
    for stamp in (200_000_000, 400_000_000):
        steps.north.publish(scan("north", stamp))
    graph.work(0.2)
    assert not steps.areas
    steps.north.publish(nothing_to_message("north", 500_000_000))
    graph.until(lambda: steps.is_done(500_000_000))
    graph.until(lambda: bool(steps.areas))
    assert steps.node._fusion.latest_stamp("north") == 0.4
    assert steps.node._rejected == {"north": 0, "south": 0}
    steps.tick(SECOND)
    steps.south.publish(scan("laser", SECOND))
    steps.north.publish(scan("north", 1_500_000_000))  # from the future, whose tick would be the next
    steps.north.publish(nothing_to_message("north", SECOND))
    graph.until(lambda: steps.is_done(SECOND))
    assert steps.node._rejected["north"] == 1
    steps.tick(1_500_000_000)
    steps.south.publish(scan("laser", 1_500_000_000))
    graph.work(0.2)
    assert not steps.is_done(1_500_000_000), "what came before does not stand for the next tick"
    steps.north.publish(nothing_to_message("north", 1_500_000_000))
    graph.until(lambda: steps.is_done(1_500_000_000))


def test_in_lockstep_it_waits_for_the_odometry_of_robots_that_are_seen_also_after_a_reset(graph: Any) -> None:
    steps = Steps(graph, **FLOOR)
    odometry = graph.speak(Odometry, "cart/odom", LOCKSTEP)
    for stamp in (500_000_000, SECOND, 500_000_000):  # at last time goes back
        done = len(steps.done)
        if stamp == 500_000_000:  # data may be here before their tick
            odometry.publish(odometry_to_message("cart", Pose2D(0.0, 7.0, 0.0), 0.0, 0.0, stamp))
            graph.until(lambda: bool(steps.node._odometry["cart"]))
        steps.tick(stamp)
        steps.south.publish(scan("laser", stamp))
        steps.north.publish(in_front_of_north(stamp, 2.0))
        if stamp == SECOND:
            graph.work(0.2)
            assert len(steps.done) == done
            odometry.publish(odometry_to_message("cart", Pose2D(0.0, 7.0, 0.0), 0.0, 0.0, stamp))
        graph.until(lambda done=done: len(steps.done) > done, f"the tick {stamp}")
        graph.until(
            lambda stamp=stamp: nanoseconds_from_stamp(steps.areas[-1].header.stamp) == stamp, "the area"
        )
        area = area_from_message(steps.areas[-1])
        assert area.clearance(np.array([[0.0, 7.0]]))[0] > 0.35


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"robots": ["cart", "cart"]}, "names a robot twice"),
        ({"robots": [], "accept_robots": False}, "robots: is empty, but sensor north sees robots"),
        ({"north.sees_robots": False}, "no sensor sees robots; set <sensor>.sees_robots"),
        ({"cart.radius": 0.0}, "cart.radius: value 0.0 lies outside"),
        ({"robot_tolerance": -1.0}, "robot_tolerance: value -1.0 lies outside"),
    ],
)
def test_mistakes_about_robots_end_it_at_its_start(graph: Any, changes: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        graph.add(FusionNode, **{**SITE, **FLOOR, **changes})


def test_in_lockstep_no_scan_of_a_fast_scanner_is_left_out(graph: Any) -> None:
    steps = Steps(graph)
    steps.tick(500_000_000)
    for index in range(50):
        steps.north.publish(scan("north", 10_000_000 * index))
    steps.north.publish(nothing_to_message("north", 500_000_000))
    steps.south.publish(scan("laser", 500_000_000))
    graph.until(lambda: steps.is_done(500_000_000))
    assert steps.node._rejected["north"] == 0
    points = np.array([[0.0, 7.0]])
    for index in range(30, 50):  # the last twenty are known to the fusion
        sensor, stamps = steps.node._fusion.last_seen(points, 0.01 * index + 0.001)
        assert (sensor[0], stamps[0]) == (0, pytest.approx(0.01 * index))
