"""The planner node in space: it plans in the world of the area that it hears."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from std_srvs.srv import Trigger

from snnav_core.area.planar import UnoccupiedArea
from snnav_core.types import StopReason
from snnav_ros.convert import area_to_message, path_from_message
from snnav_ros.convert.spatial_area import spatial_area_to_message
from snnav_ros.nodes.planner import PlannerNode
from snnav_ros.parameters import ParameterError
from support.air_site import PLANNER, ROOM, SAMPLE, AirSite, room

NEAR = 0.21  # [m]; as near to the target as adjusted paths end: 1.5 links (C0-13)


def test_an_area_in_space_gives_a_certified_path_in_space(graph: Any) -> None:
    site = AirSite(graph)
    site.fly_to(5.0, 3.0, 2.2)  # before it is known that there is a height
    site.hover(SAMPLE, 1.0, 1.0, 1.0)
    message, verdict = site.step(SAMPLE)
    path = path_from_message(message, in_space=True)
    assert path is not None
    assert verdict.certificate.accepted
    assert verdict.certificate.path_digest == path.digest()
    assert verdict.certificate.area_stamp == 0.2
    np.testing.assert_allclose(path.points[0], [1.0, 1.0, 1.0])
    assert np.linalg.norm(path.points[-1] - [5.0, 3.0, 2.2]) <= NEAR
    assert np.minimum(path.points - ROOM[0], ROOM[1] - path.points).min() >= 0.4


def test_a_goal_that_is_replaced_or_blocked_and_a_robot_that_is_removed(graph: Any) -> None:
    site = AirSite(graph, **{"bee.target": [5.0, 3.0, 2.2]})
    site.hover(SAMPLE, 1.0, 1.0, 1.0)
    site.fly_to(4.0, 1.0, 2.0)
    message, _ = site.step(SAMPLE)
    path = path_from_message(message, in_space=True)
    assert path is not None
    assert np.linalg.norm(path.points[-1] - [4.0, 1.0, 2.0]) <= NEAR
    site.fly_to(5.0, 3.0, 0.1)
    site.hover(2 * SAMPLE, 1.0, 1.0, 1.0)
    message, verdict = site.step(2 * SAMPLE)
    assert not message.poses
    assert verdict.stop.reason is StopReason.GOAL_BLOCKED
    count = len(site.paths)
    assert graph.call(Trigger, "planner_node/bee/remove", Trigger.Request()).success
    graph.until(lambda: len(site.paths) > count)
    assert not site.paths[-1].poses
    assert not site.node.robots


def test_it_goes_where_the_area_is_and_back(graph: Any) -> None:
    site = AirSite(graph)
    site.fly_to(5.0, 3.0, 2.0)
    site.hover(SAMPLE, 1.0, 1.0, 1.0)
    floor = UnoccupiedArea(0.2, shapely.MultiPolygon([shapely.box(0.0, 0.0, 6.0, 4.0)]))
    site.area.publish(area_to_message(floor))
    graph.until(lambda: bool(site.paths), "a decision in the plane")
    on_the_floor = path_from_message(site.paths[-1])
    assert on_the_floor is not None
    assert np.linalg.norm(on_the_floor.points[-1] - [5.0, 3.0]) <= 1e-3
    site.hover(2 * SAMPLE, 1.0, 1.0, 1.0)
    message, _ = site.step(2 * SAMPLE)
    in_the_air = path_from_message(message, in_space=True)
    assert in_the_air is not None
    assert np.linalg.norm(in_the_air.points[-1] - [5.0, 3.0, 2.0]) <= NEAR


def test_an_area_that_the_robots_do_not_fit_into_is_not_used(graph: Any) -> None:
    site = AirSite(graph, **{"bee.max_turn_rate": 1.0})  # turns on 0.7 m, the margin is 0.4 m
    site.hover(SAMPLE, 1.0, 1.0, 1.0)
    site.area.publish(spatial_area_to_message(room(SAMPLE)))
    graph.until(lambda: "unoccupied_area" in site.node._problems)
    assert not site.paths
    assert (
        "is of space; safety_margin 0.4 m is below the turning radius"
        in site.node._problems["unoccupied_area"]
    )


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"bee.target": [1.0, 2.0, 3.0], "bee.max_turn_rate": 1.0}, "below the turning radius"),
        (
            {"scene": "hello_flight", "bee.target": [1.0, 2.0]},
            r"bee.target: .* give three numbers \[x, y, z\]",
        ),
        (
            {"bee.target": [1.0, 2.0, 3.0], "planners": ["planner_node", "other"]},
            "in space one planner serves all",
        ),
        ({"flight.roadmap.samples": 0}, "flight.roadmap.samples: value 0 lies outside"),
    ],
)
def test_mistakes_end_it_at_its_start(graph: Any, changes: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        graph.add(PlannerNode, **{**PLANNER, **changes})
