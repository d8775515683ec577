"""The fusion node in space, by hand-made clouds in real time."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import OccupancyGrid, Odometry
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import SetBool, Trigger

from snnav_core.area.camera_network import CameraNetwork
from snnav_core.types import RobotSpec
from snnav_ros.convert import Announcement, announcement_to_message
from snnav_ros.nodes.fusion import FusionNode
from snnav_ros.nodes.roster import ROBOTS_TOPIC
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import LATCHED
from support.camera_site import (
    BEE,
    EYES,
    FUSION,
    MIDDLE,
    SECOND,
    SITE,
    Site,
    cloud,
    inner,
    odometry,
    seen,
    state,
)

MILLI = 10**6
AHEAD = np.array([1.0, 0.0, 0.0])


def test_images_make_the_area_of_the_sampling_instant(graph: Any) -> None:
    site = Site(graph)
    site.at(100)
    graph.work(0.2)
    assert not site.areas  # nothing is known yet, and nothing is said
    core = CameraNetwork(list(EYES.values()), FUSION, [BEE])
    for stamp, name in ((200 * MILLI, "low"), (300 * MILLI, "high"), (400 * MILLI, "low")):
        site.send(name, cloud(name, stamp, MIDDLE))
        core.add_image(name, seen(name, stamp, MIDDLE))
    for stamp in range(100 * MILLI, 451 * MILLI, 50 * MILLI):
        site.tell(odometry(stamp, MIDDLE + 0.01))
        core.add_state(state(stamp, MIDDLE + 0.01))
    area, expected = site.area(500 * MILLI), core.area(0.5)
    assert area.stamp == 0.5
    np.testing.assert_allclose(area.moving, expected.moving, rtol=0.0, atol=1e-5)  # look_at by angles
    np.testing.assert_array_equal(area.static, expected.static)
    assert inner(area) > 0.5
    assert site.status("sensor low").level == DiagnosticStatus.OK
    values = {one.key: one.value for one in site.status("fusion").values}
    assert float(values["step_ms"]) > 0.0
    assert 15.0 < float(values["coverage"]) < 24.0
    assert int(values["free_cells"]) == int((area.moving > 0.0).sum())
    values = {one.key: one.value for one in site.status("sensor low").values}
    assert values == {
        "age": "0.100",
        "rate": "4.00",
        "rejected": "0",
        "contradictions": "0",
        "enabled": "True",
    }


def test_grid_is_published_to_who_listens(graph: Any) -> None:
    grids = graph.hear(OccupancyGrid, "unoccupied_area/grid", LATCHED)
    site = Site(graph)
    site.at(100)
    site.look(200 * MILLI)
    site.area(500 * MILLI)
    graph.until(lambda: bool(grids))
    assert (grids[0].info.width, grids[0].info.height) == (40, 30 * 20)
    assert {0, -1} <= set(grids[0].data)


def test_what_a_silent_camera_saw_shrinks_and_its_status_tells(graph: Any) -> None:
    site = Site(graph)
    site.at(100)
    site.send("low", cloud("low", 400 * MILLI))
    first = site.area(500 * MILLI)
    assert "no image young enough" in site.status("sensor high").message
    later = site.area(2 * SECOND)
    np.testing.assert_allclose(later.moving, np.maximum(first.moving - 0.15, 0.0), atol=1e-6)
    assert "no image young enough" in site.status("sensor low").message
    assert not (site.area(60 * SECOND).moving > 0.0).any()
    assert site.status("fusion").message == "nothing is free"


def with_frame(message: PointCloud2) -> PointCloud2:
    message.header.frame_id = "map"
    return message


def one_row(message: PointCloud2) -> PointCloud2:
    message.width, message.height, message.row_step = 1920, 1, 1920 * 16
    return message


def shifted(message: PointCloud2) -> PointCloud2:
    values = np.frombuffer(bytes(message.data), "<f4").reshape(40, 48, 4)
    message.data = np.roll(values, 3, axis=1).tobytes()
    return message


def without_z(message: PointCloud2) -> PointCloud2:
    del message.fields[2]
    return message


def endless(message: PointCloud2) -> PointCloud2:
    values = np.frombuffer(bytes(message.data), "<f4").reshape(40, 48, 4).copy()
    values[3, 4, 0] = np.inf
    message.data = values.tobytes()
    return message


@pytest.mark.parametrize(
    ("lie", "said"),
    [
        (lambda: with_frame(cloud("low", 900 * MILLI)), "frame_id is 'map', expected 'low'"),
        (lambda: PointCloud2(), "frame_id is ''"),
        (lambda: one_row(cloud("low", 900 * MILLI)), "cloud has 1920 x 1 points, expected 48 x 40"),
        (lambda: shifted(cloud("low", 900 * MILLI)), "off the rays of their pixels"),
        (lambda: without_z(cloud("low", 900 * MILLI)), "expected little-endian x, y and z"),
        (lambda: endless(cloud("low", 900 * MILLI)), "infinite coordinate"),
        (lambda: cloud("low", 300 * MILLI), r"stamped 0\.300 s is older than its last \(0\.400 s\)"),
        (lambda: cloud("low", 400 * MILLI, MIDDLE), "differs from its last, which has the same stamp"),
        (lambda: cloud("low", 1_200 * MILLI), r"1\.200 s is 0\.400 s ahead of the clock"),
    ],
)
def test_clouds_that_lie_are_named_and_not_used(
    graph: Any, lie: Callable[[], PointCloud2], said: str
) -> None:
    site = Site(graph)
    site.at(100)
    site.look(400 * MILLI)
    first = site.area(500 * MILLI)
    site.at(800 * MILLI)
    message = lie()
    site.send_now("low", message)
    second = site.area(SECOND)
    np.testing.assert_allclose(second.moving, np.maximum(first.moving - 0.05, 0.0), atol=1e-6)
    entry = site.status("sensor low")
    assert entry.level == DiagnosticStatus.WARN
    assert re.search(said, entry.message), entry.message
    assert {one.key: one.value for one in entry.values}["rejected"] == "1"
    site.send("low", cloud("low", 1_300 * MILLI))
    site.area(1_500 * MILLI)
    assert site.status("sensor low").message == "ok"


def test_an_image_of_nan_shows_nothing_and_is_no_fault(graph: Any) -> None:
    site = Site(graph)
    site.at(100)
    message = cloud("low", 400 * MILLI)
    message.data = np.full(4 * 48 * 40, np.nan, dtype="<f4").tobytes()
    site.send("low", message)
    assert not (site.area(500 * MILLI).moving > 0.0).any()
    assert site.status("sensor low").message == "ok"


def test_a_frozen_camera_is_told_unless_it_has_no_noise(graph: Any) -> None:
    site = Site(graph, **{"high.never_repeats": False})
    site.at(100)
    for stamp in (300 * MILLI, 800 * MILLI):
        for name in EYES:
            site.send(name, cloud(name, stamp, noise=0.0))
        site.send("low", cloud("low", stamp, noise=0.0))  # the same once more is no fault
        site.area(stamp + 200 * MILLI)
        assert (site.status("sensor low").message == "ok") == (stamp == 300 * MILLI)
    assert "stamped 0.800 s is frozen" in site.status("sensor low").message
    assert site.status("sensor high").message == "ok"


def test_a_robot_is_no_obstacle_where_its_odometry_says(graph: Any) -> None:
    site = Site(graph)
    site.at(100)
    site.look(200 * MILLI, MIDDLE)
    assert inner(site.area(500 * MILLI)) <= 0.0
    for stamp, place in ((SECOND, MIDDLE), (1_500 * MILLI, MIDDLE + AHEAD)):
        site.at(stamp - 200 * MILLI)
        site.tell(odometry(stamp - 200 * MILLI, place))
        site.look(stamp - 100 * MILLI, MIDDLE)
        free = inner(site.area(stamp)) > 0.4
        assert free or place is not MIDDLE
    site.at(1_600 * MILLI)
    site.odom.publish(odometry(9 * SECOND))
    graph.until(lambda: bool(site.node._odometry["bee"]))
    site.area(2 * SECOND)
    assert "ahead of the clock" in site.status("robot bee as seen").message


def test_robots_join_and_leave_by_their_words(graph: Any) -> None:
    site = Site(graph, robots=["bee"])
    words = graph.speak(DiagnosticStatus, ROBOTS_TOPIC, LATCHED)
    fly = RobotSpec("fly", 0.2, 0.7, 2.0)
    words.publish(announcement_to_message(Announcement("fly", 100, fly)))
    graph.until(lambda: "fly" in site.node.robots)
    odom = graph.speak(Odometry, "fly/odom")
    site.at(300 * MILLI)
    odom.publish(odometry(300 * MILLI))
    graph.until(lambda: bool(site.node._odometry["fly"]))
    site.look(400 * MILLI, MIDDLE)
    assert inner(site.area(500 * MILLI)) > 0.4
    words.publish(announcement_to_message(Announcement("fly", 600 * MILLI, None)))
    graph.until(lambda: "fly" not in site.node.robots)
    site.area(SECOND)


def test_time_that_jumps_back_starts_afresh_and_services_reset_and_switch(graph: Any) -> None:
    site = Site(graph)
    site.at(100 * SECOND)
    site.look(100 * SECOND + MILLI)
    assert inner(site.area(100 * SECOND + 500 * MILLI)) > 0.3
    site.at(SECOND)
    assert graph.call(SetBool, "fusion_node/high/enable", SetBool.Request(data=False)).success
    site.send("high", cloud("high", SECOND + 100 * MILLI))
    site.send("low", cloud("low", SECOND + 100 * MILLI))
    area = site.area(2 * SECOND)
    assert area.stamp == 2.0
    core = CameraNetwork([EYES["low"]], FUSION)
    core.add_image("low", seen("low", SECOND + 100 * MILLI))
    np.testing.assert_allclose(area.moving, core.area(2.0).moving, atol=1e-6)
    assert graph.call(Trigger, "fusion_node/reset", Trigger.Request()).success
    assert site.node.world.fusion.latest_stamp("low") is None


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"sensors": []}, "sensors: is empty; list the ids of the cameras"),
        ({"sensors": ["low", "low"]}, "names a sensor twice"),
        ({"workspace": [0.0, 0.0, 0.0, 1.0]}, r"workspace: value \[.*\] is no box; give two corners"),
        ({"workspace": [0.0, 0.0, 0.0, 1.0, -1.0, 1.0]}, "is no box"),
        ({"workspace": [0.0, 0.0, 0.0, 0.05, 1.0, 1.0]}, "workspace: .* holds no cell"),
        ({"scene": "hello"}, "workspace: is given, but hello is a scene in the plane; leave it out"),
        ({"low.position": [1.0, 2.0]}, r"low.position: value \[1.0, 2.0\] is no point in space"),
        ({"low.look_at": [0.1, 0.1, 0.3]}, "low.look_at: .*cannot look at its own position"),
        ({"low.orientation_deg": [0.0, 0.0, 0.0]}, "low.look_at: is given, and so is low.orientation_deg"),
        ({"low.columns": 1}, "low.columns: value 1 lies outside"),
        ({"low.projection": "fisheye"}, "low.projection: value 'fisheye'"),
        ({"low.projection": "pinhole"}, r"parameter low: focal_length is \[\]; give two numbers"),
        ({"low.field_of_view_deg": [400.0, 90.0]}, "parameter low: .*covers 400.0 x 90.0 degrees"),
        ({"low.range_min": 9.0}, "parameter low: .*range_min is 9.0"),
        ({"low.heading_deg": 1.0}, "low.heading_deg: is unknown"),
        ({"boundary_speed": -1.0}, "boundary_speed: value -1.0 lies outside"),
        ({"grid_spacing": 0.0}, "grid_spacing: value 0.0 lies outside"),
        ({"bee.radius": 0.0}, "bee.radius: value 0.0 lies outside"),
        ({"robots": ["bee", "bee"]}, "names a robot twice"),
        ({"grid_resolution": 0.1}, "grid_resolution: is unknown"),
    ],
)
def test_mistakes_end_it_at_its_start(graph: Any, changes: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        graph.add(FusionNode, **{**SITE, **changes})


def test_what_is_missing_is_named(graph: Any) -> None:
    for missing, text in (
        ("low.position", "low.position: is not given"),
        ("low.look_at", "low.look_at: is not given; give it or low.orientation_deg"),
        ("boundary_speed", "boundary_speed: is not given"),
    ):
        with pytest.raises(ParameterError, match=text):
            graph.add(FusionNode, **{key: value for key, value in SITE.items() if key != missing})
    with pytest.raises(ParameterError, match="workspace: and grid_spacing are those of the scene"):
        graph.add(FusionNode, scene="hello_flight", grid_spacing=0.2)
