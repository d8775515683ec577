"""Networks made of posed scans: geometry kept, nodes evenly chosen, starts and targets where a robot may be."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from snnav_core.errors import InvalidInput
from snnav_core.sensing.scan import PlanarScan
from snnav_core.types import Pose2D
from snnav_ros.bag.carmen import read_carmen
from snnav_ros.bag.carmen_import import write_carmen_bag
from snnav_ros.bag.errors import BagError, NetworkError
from snnav_ros.bag.messages import laser_scan, pose_stamped
from snnav_ros.bag.network import PosedScan, build_network, choose_evenly, read_posed_scans
from snnav_ros.bag.routes import LEAST_ROUTE, pick_routes, robots_on_routes
from snnav_ros.bag.settings import NetworkSettings
from snnav_ros.bag.writer import BagWriter
from snnav_sim.scene import dump_scene, parse_scene

LOGS = Path(__file__).parents[3].parent / "shared" / "data" / "carmen_corrected"
WIDTH, HEIGHT = 24.0, 9.0  # of the room in which the synthetic scans are taken


def room_scan(pose: Pose2D, beams: int = 181) -> PlanarScan:
    """Return the noise-free half-circle scan of a rectangular room with a corner at the origin."""
    step = math.pi / (beams - 1)
    angles = pose.heading - 0.5 * math.pi + step * np.arange(beams)
    with np.errstate(divide="ignore"):
        across = np.where(np.cos(angles) > 0, (WIDTH - pose.x) / np.cos(angles), -pose.x / np.cos(angles))
        along = np.where(np.sin(angles) > 0, (HEIGHT - pose.y) / np.sin(angles), -pose.y / np.sin(angles))
    return PlanarScan(0.0, np.minimum(across, along), -0.5 * math.pi, step, 0.0, 80.0)


def room_scans() -> list[PosedScan]:
    poses = [Pose2D(x, y, h) for x in (4.0, 12.0, 20.0) for y in (3.0, 6.0) for h in (0.3, 0.3 + math.pi)]
    return [PosedScan(k, pose, room_scan(pose)) for k, pose in enumerate(poses)]


def room_bag(directory: Path) -> Path:
    with BagWriter(directory) as bag:
        for k, posed in enumerate(room_scans()):
            stamp, scan = k * 10**9, posed.scan
            message = laser_scan(stamp, "laser", scan.ranges, scan.angle_min, scan.angle_increment, 80.0)
            bag.write("scan", message, stamp)
            bag.write("pose", pose_stamped(stamp, "map", posed.pose), stamp)
    return directory


def test_scans_find_their_poses(tmp_path: Path) -> None:
    scans, left_out = read_posed_scans(room_bag(tmp_path / "bag"), "scan", "/pose")
    assert left_out == 0
    for read, written in zip(scans, room_scans(), strict=True):
        assert (read.pose.x, read.pose.y) == (written.pose.x, written.pose.y)
        assert math.remainder(read.pose.heading - written.pose.heading, 2 * math.pi) == pytest.approx(0.0)
        np.testing.assert_allclose(read.scan.ranges, written.scan.ranges, rtol=1e-6)


def test_scans_without_usable_pose_are_left_out(tmp_path: Path) -> None:
    scan = laser_scan(0, "laser", [1.0, 2.0, 3.0], 0.0, 0.1, 10.0)
    with BagWriter(tmp_path / "bag") as bag:
        for k, pose in enumerate([Pose2D(0, 0, 0), Pose2D(math.nan, 0, 0), Pose2D(1, 1, 1)]):
            bag.write("scan", replace_stamp(scan, k * 10**9), k * 10**9)
            late = 30_000_000 if k == 2 else 10_000_000
            bag.write("pose", pose_stamped(k * 10**9 + late, "map", pose), k * 10**9)
        broken = pose_stamped(5 * 10**9, "map", Pose2D(0, 0, 0))
        broken.pose.orientation.w = 0.0
        bag.write("pose", broken, 5 * 10**9)
        bag.write("scan", replace_stamp(scan, 5 * 10**9), 5 * 10**9)
    scans, left_out = read_posed_scans(tmp_path / "bag", "scan", "pose")
    assert ([posed.stamp_ns for posed in scans], left_out) == ([0], 3)


def replace_stamp(message, stamp_ns: int):
    return laser_scan(stamp_ns, "laser", message.ranges, message.angle_min, message.angle_increment, 10.0)


def test_wrong_bags_are_named(tmp_path: Path) -> None:
    path = room_bag(tmp_path / "bag")
    for topics, text in (
        (("scans", "pose"), "no topic 'scans'"),
        (("scan", "poses"), "no topic 'poses'"),
        (("pose", "pose"), "'pose' is a geometry_msgs/msg/PoseStamped, expected sensor_msgs/msg/LaserScan"),
        (("scan", "scan"), "'scan' is a sensor_msgs/msg/LaserScan, expected geometry_msgs/msg/PoseStamped"),
    ):
        with pytest.raises(BagError, match=text):
            read_posed_scans(path, *topics)
    with BagWriter(tmp_path / "apart") as bag:
        bag.write("scan", laser_scan(0, "laser", [1.0, 2.0], 0.0, 0.1, 10.0), 0)
        bag.write("pose", pose_stamped(10**9, "map", Pose2D(0, 0, 0)), 10**9)
    with pytest.raises(NetworkError, match="no scan of 'scan' has a pose on 'pose' within 20 ms"):
        read_posed_scans(tmp_path / "apart", "scan", "pose")
    with BagWriter(tmp_path / "odd") as bag:
        bag.write("scan", laser_scan(0, "laser", [1.0, 2.0], 0.0, 0.0, 10.0), 0)
        bag.write("pose", pose_stamped(0, "map", Pose2D(0, 0, 0)), 0)
    with pytest.raises(NetworkError, match=r"scan stamped 0.000 s cannot be used: angle_increment is 0.0"):
        read_posed_scans(tmp_path / "odd", "scan", "pose")


def test_a_scanner_that_turns_clockwise_shows_the_same_room(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        for k, posed in enumerate(room_scans()):
            scan = posed.scan
            last = scan.angle_min + (len(scan.ranges) - 1) * scan.angle_increment
            message = laser_scan(k, "laser", scan.ranges[::-1], last, -scan.angle_increment, 80.0)
            bag.write("scan", message, k)
            bag.write("pose", pose_stamped(k, "map", posed.pose), k)
    scans, _ = read_posed_scans(tmp_path / "bag", "scan", "pose")
    network = build_network(scans, "room", "clockwise", NetworkSettings(range_cut=30.0))
    straight = build_network(room_scans(), "room", "as it was", NetworkSettings(range_cut=30.0))
    difference = network.area.region.symmetric_difference(straight.area.region)
    assert difference.area < 1e-3 * straight.area.region.area


@given(count=st.integers(1, 5000), share=st.floats(0.001, 1.0))
def test_nodes_are_spread_evenly(count: int, share: float) -> None:
    nodes = max(1, int(share * count))
    chosen = choose_evenly(count, nodes=nodes)
    assert len(chosen) == nodes
    assert chosen[0] == 0
    assert chosen[-1] == (count - 1 if nodes > 1 else 0)
    steps = np.diff(chosen)
    assert nodes == 1 or (steps.min() >= 1 and steps.max() - steps.min() <= 1)
    np.testing.assert_array_equal(choose_evenly(count, every=nodes), np.arange(count)[::nodes])


def test_more_nodes_than_scans_are_refused() -> None:
    with pytest.raises(NetworkError, match="41 nodes wanted of 40 posed scans"):
        choose_evenly(40, nodes=41)


def test_the_scene_holds_the_scans_and_round_trips() -> None:
    scans = room_scans()
    network = build_network(scans, "room", "a room", NetworkSettings(range_cut=10.0, seed=7))
    scene = network.scene
    assert parse_scene(dump_scene(scene), "room.yaml") == scene
    assert (scene.boundary_speed, scene.seed, scene.safety_margin, len(scene.sensors)) == (0.0, 7, 0.4, 12)
    for sensor, posed in zip(scene.sensors, scans, strict=True):
        assert (sensor.device, sensor.no_return, sensor.range_cut, sensor.range_max) == (
            "recorded",
            "unknown",
            10.0,
            80.0,
        )
        assert sensor.position == (posed.pose.x, posed.pose.y)
        assert sensor.heading == pytest.approx(math.remainder(posed.pose.heading, 2 * math.pi), abs=1e-8)
        assert (sensor.angle_min, sensor.resolution) == pytest.approx((-math.pi / 2, math.pi / 180))
        assert max(abs(np.array(sensor.ranges) - posed.scan.ranges)) <= 0.0005 + 1e-9
    room = shapely.box(0, 0, WIDTH, HEIGHT)
    assert network.area.region.difference(room.buffer(0.002)).is_empty
    assert network.area.region.area > 0.97 * room.area
    assert shapely.Polygon(scene.workspace).contains(room.buffer(1.9))
    assert network.contradiction_share == 0.0


def test_strange_readings_stay_unknown() -> None:
    scan = room_scan(Pose2D(12.0, 4.0, 0.0))
    ranges = scan.ranges.copy()
    ranges[:8] = [math.nan, math.inf, -math.inf, 0.0, 90.0, -3.0, 0.0, math.nan]
    posed = PosedScan(0, Pose2D(12.0, 4.0, 0.0), replace(scan, ranges=ranges))
    (sensor,) = build_network([posed], "room", "one node", NetworkSettings()).scene.sensors
    np.testing.assert_array_equal(
        sensor.ranges[:8], [math.nan, math.inf, math.nan, 0.0, 90.0, math.nan, 0.0, math.nan]
    )


def test_a_network_that_sees_nothing_is_refused() -> None:
    blind = PosedScan(0, Pose2D(0, 0, 0), PlanarScan(0.0, np.full(5, np.inf), 0.0, 0.1, 0.0, 80.0))
    with pytest.raises(NetworkError, match="the 1 nodes see no free area"):
        build_network([blind], "dark", "no light", NetworkSettings())
    narrow = build_network(room_scans(), "room", "wide robot", NetworkSettings(safety_margin=6.0, radius=1.0))
    with pytest.raises(NetworkError, match="no place is 6 m from everything seen"):
        _ = narrow.largest_component


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 4))
@settings(max_examples=25, deadline=None)
def test_routes_lie_in_the_component_and_apart(seed: int, count: int) -> None:
    component = shapely.Polygon([(0, 0), (20, 0), (20, 3), (3, 3), (3, 9), (0, 9)])
    routes = pick_routes(component, count, np.random.default_rng(seed), separation=1.0)
    again = pick_routes(component, count, np.random.default_rng(seed), separation=1.0)
    assert routes == again
    for route in routes:
        assert component.contains(shapely.Point(route.start))
        assert component.contains(shapely.Point(route.target))
        assert route.distance >= LEAST_ROUTE
        assert -math.pi <= route.heading <= math.pi
    for ends in ([r.start for r in routes], [r.target for r in routes]):
        gaps = [math.dist(a, b) for i, a in enumerate(ends) for b in ends[:i]]
        assert min(gaps, default=1.0) >= 1.0


def test_short_and_full_components() -> None:
    small = shapely.box(0, 0, 2, 2)
    (route,) = pick_routes(small, 1, np.random.default_rng(1), separation=1.0)
    assert 2.0 < route.distance < LEAST_ROUTE
    with pytest.raises(NetworkError, match="no room for robot 2"):
        pick_routes(small, 3, np.random.default_rng(1), separation=5.0)
    robots = robots_on_routes([route], NetworkSettings(speed=0.7))
    assert [(r.id, r.start, r.target, r.speed) for r in robots] == [
        ("robot_1", route.start, route.target, 0.7)
    ]
    with pytest.raises(InvalidInput):
        _ = replace(robots[0], speed=-1.0).spec


@pytest.mark.skipif(not LOGS.is_dir(), reason="recordings of shared/data are not there")
def test_a_real_building_becomes_a_scene(tmp_path: Path) -> None:
    write_carmen_bag(read_carmen(LOGS / "intel-corrected.log.gz"), tmp_path / "bag")
    scans, left_out = read_posed_scans(tmp_path / "bag", "scan", "pose")
    assert (len(scans), left_out) == (910, 0)
    network = build_network(
        [scans[k] for k in choose_evenly(len(scans), 40)], "intel", "40 of 910 scans", NetworkSettings()
    )
    assert 300.0 < network.area.region.area < 380.0
    assert network.largest_component.area > 0.8 * sum(part.area for part in network.components)
    assert 0.0 < network.contradiction_share < 0.13
    (route,) = pick_routes(network.largest_component, 1, np.random.default_rng(3), 1.0)
    scene = replace(network.scene, robots=robots_on_routes([route], NetworkSettings()))
    assert repr(parse_scene(dump_scene(scene), "intel.yaml")) == repr(scene)  # NaN is not equal to itself
    ends = shapely.points([route.start, route.target])
    assert (shapely.distance(shapely.boundary(network.area.region), ends) >= 0.4).all()
