"""The tracker node: bodies from areas and returns by hand."""

from __future__ import annotations

import array
import re
from typing import Any

import numpy as np
import pytest
import shapely
import shapely.ops
from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import Marker, MarkerArray

from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.area.returns import FusedReturns
from snnav_core.area.tracks import ObstacleTracker
from snnav_ros.convert import (
    area_to_message,
    obstacles_from_message,
    returns_to_message,
    rings_from_message,
    stamp_message,
)
from snnav_ros.nodes.tracker import TrackerNode
from snnav_ros.parameters import ParameterError
from snnav_ros.qos import LATCHED

SECOND = 10**9
INTERVAL = 3 * SECOND // 10
HALL = shapely.box(0.0, 0.0, 12.0, 8.0)
PILLAR = shapely.box(8.0, 3.0, 9.0, 4.0)


def measured(stamp: int, speed: float = 0.4) -> tuple[UnoccupiedArea, FusedReturns]:
    """Return what a scanner in the corner measures of a disk that moves and of a pillar."""
    time = stamp / SECOND
    disk = shapely.Point(3.0 + speed * time, 4.0).buffer(0.4, quad_segs=16)
    area = UnoccupiedArea(time, as_multipolygon(HALL - disk - PILLAR))
    angles = np.arange(0.005, 1.565, 0.005)
    ends = np.column_stack((np.cos(angles), np.sin(angles))) * 20.0
    surface = shapely.union_all(
        [disk.exterior, PILLAR.exterior, HALL.exterior - shapely.Point(0, 0).buffer(0.1)]
    )
    origin = shapely.Point(0.0, 0.0)
    rays = shapely.linestrings(np.stack((np.zeros_like(ends), ends), axis=1))
    hits = [shapely.ops.nearest_points(shapely.intersection(ray, surface), origin)[0] for ray in rays]
    points = np.array([(hit.x, hit.y) for hit in hits])
    count = len(points)
    sensors, beams = np.zeros(count, dtype=np.int64), np.arange(count)
    return area, FusedReturns(
        points, np.full(count, time), sensors, beams, np.zeros((1, 2)), np.array([0.005])
    )


class Site:
    """A tracker, and what fusion would say."""

    def __init__(self, graph: Any, **parameters: Any) -> None:
        self.graph = graph
        self.bodies = graph.hear(PointCloud2, "obstacles", LATCHED)
        self.workspaces = graph.hear(PointCloud2, "obstacles/workspace", LATCHED)
        self.markers = graph.hear(MarkerArray, "obstacles/markers", LATCHED)
        self.diagnostics = graph.hear(DiagnosticArray, "/diagnostics")
        self.node = graph.add(TrackerNode, sampling_interval=0.3, use_sim_time=True, **parameters)
        self.area = graph.speak(PointCloud2, "unoccupied_area", LATCHED)
        self.returns = graph.speak(PointCloud2, "unoccupied_area/returns", LATCHED)
        self.clock = graph.speak(Clock, "/clock", 1)

    def at(self, stamp: int) -> None:
        self.clock.publish(Clock(clock=stamp_message(stamp)))
        self.graph.until(lambda: self.node.get_clock().now().nanoseconds == stamp, "the clock")

    def measure(self, stamp: int) -> Any:
        """Publish what is measured at a stamp; return the bodies that come of it."""
        self.at(stamp)
        count = len(self.bodies)
        area, returns = measured(stamp)
        self.returns.publish(returns_to_message(returns, stamp))
        self.area.publish(area_to_message(area))
        self.graph.until(lambda: len(self.bodies) > count and len(self.workspaces) > count, "bodies")
        return obstacles_from_message(self.bodies[-1])

    def refuse(self, area: PointCloud2 | None, returns: PointCloud2 | None) -> str:
        """Publish what cannot be used; return what is said about it."""
        count = len(self.bodies)
        if returns is not None:
            self.returns.publish(returns)
        if area is not None:
            self.area.publish(area)
        self.graph.until(lambda: bool(self.node._problems), "a refusal")
        self.graph.work(0.1)
        assert len(self.bodies) == count
        (problem,) = self.node._problems.values()
        return str(problem)

    def status(self) -> Any:
        (status,) = self.diagnostics[-1].status
        return status


def test_bodies_are_those_of_the_core(graph: Any) -> None:
    site, alone = Site(graph), ObstacleTracker()
    for stamp in range(INTERVAL, 6 * INTERVAL, INTERVAL):
        bodies = site.measure(stamp)
        scene = alone.update(stamp / SECOND, *reversed(measured(stamp)))
        assert [body.id for body in bodies] == [body.id for body in scene.obstacles]
        for ours, theirs in zip(bodies, scene.obstacles, strict=True):
            np.testing.assert_array_equal(ours.outline, theirs.outline)
            np.testing.assert_array_equal(ours.velocity, theirs.velocity)
            assert ours.velocity_deviation == theirs.velocity_deviation
        rings = rings_from_message(site.workspaces[-1], "obstacles/workspace")
        for ring, exterior in zip(rings, scene.workspace, strict=True):
            np.testing.assert_array_equal(ring, exterior)
    (moving,) = [body for body in bodies if body.speed > 0.0]
    assert moving.velocity == pytest.approx([0.4, 0.0], abs=0.05)
    graph.until(lambda: len(site.diagnostics) == len(site.markers) == 5, "diagnostics and markers")
    values = {pair.key: pair.value for pair in site.status().values}
    assert (values["bodies"], values["moving"]) == (str(len(bodies)), "1")
    assert float(values["fastest"]) == pytest.approx(0.4, abs=0.05)
    shown = site.markers[-1].markers
    assert shown[0].action == Marker.DELETEALL
    assert len(shown) == 2 + len(bodies)
    (arrow,) = [marker for marker in shown[1:] if marker.type == Marker.ARROW]
    assert arrow.points[1].x - arrow.points[0].x == pytest.approx(moving.velocity[0])


def corrupted(message: PointCloud2, offset: int, value: float) -> PointCloud2:
    data = bytearray(message.data)
    data[offset : offset + 8] = np.float64(value).tobytes()
    message.data = array.array("B", bytes(data))
    return message


def test_what_cannot_be_used_is_refused_and_said(graph: Any, capfd: pytest.CaptureFixture[str]) -> None:
    site = Site(graph)
    site.measure(INTERVAL)
    site.at(2 * INTERVAL)
    area, returns = measured(2 * INTERVAL)
    good = area_to_message(area)
    other_frame = returns_to_message(returns, 2 * INTERVAL)
    other_frame.header.frame_id = "laser"
    late = area_to_message(measured(SECOND // 10)[0])
    early = returns_to_message(returns, 3 * INTERVAL)
    for scans, text in [
        (corrupted(returns_to_message(returns, 2 * INTERVAL), 0, np.nan), "unoccupied_area/returns: .*NaN"),
        (other_frame, "unoccupied_area/returns: frame_id is 'laser'"),
        (early, "unoccupied_area/returns: stamped 0.300 s ahead of the clock"),
        (area_to_message(area), "unoccupied_area/returns: fields are"),
    ]:
        assert re.search(text, site.refuse(good, scans))
        site.node._problems.clear()
    assert "after one stamped 0.600 s; is there another fusion node?" in site.refuse(late, None)
    site.node._problems.clear()
    assert "unoccupied_area: ring 0" in site.refuse(corrupted(area_to_message(area), 0, np.nan), None)
    assert capfd.readouterr().err.count("message not used") == 6
    site.measure(3 * INTERVAL)
    assert not site.node._problems


def test_silent_fusion_is_said(graph: Any) -> None:
    site = Site(graph)
    site.measure(INTERVAL)
    graph.until(lambda: len(site.diagnostics) == 1, "diagnostics")
    for stamp in range(2 * INTERVAL, 6 * INTERVAL, INTERVAL):
        site.at(stamp)
        graph.work(0.02)
    graph.until(lambda: site.status().message != "ok", "a problem")
    assert "check the fusion node" in site.status().message
    site.measure(6 * INTERVAL)
    graph.until(lambda: site.status().message == "ok", "no problem")


def test_time_that_jumps_back_starts_afresh(graph: Any) -> None:
    site = Site(graph)
    for stamp in range(5 * INTERVAL, 10 * INTERVAL, INTERVAL):
        bodies = site.measure(stamp)
    assert any(body.speed > 0.0 for body in bodies)
    bodies = site.measure(INTERVAL)
    fresh = ObstacleTracker().update(INTERVAL / SECOND, *reversed(measured(INTERVAL)))
    assert [body.id for body in bodies] == [body.id for body in fresh.obstacles]
    assert all(body.speed == 0.0 for body in bodies)


def test_mistakes_end_the_tracker_at_its_start(graph: Any) -> None:
    for parameters, text in [
        ({"least_samples": 1}, "least_samples: value 1 lies outside"),
        ({"top_sped": 1.0}, "did you mean top_speed"),
        ({"scene": "nowhere"}, "no scene of this name"),
    ]:
        with pytest.raises(ParameterError, match=text):
            graph.add(TrackerNode, **parameters)
