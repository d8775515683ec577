"""The fusion node in real time, by hand-made scans, and its life cycle."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import OccupancyGrid
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan, PointCloud2
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

from snnav_ros.convert import (
    lost_from_message,
    nanoseconds_from_stamp,
    stamp_message,
)
from snnav_ros.nodes.fusion import FusionNode
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import LATCHED
from support.fusion_site import SECOND, SITE, Site, scan


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
    assert site.node.world.fusion.latest_stamp("north") == 0.3


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
