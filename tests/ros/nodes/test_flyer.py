"""The robot node with a flying base: it hovers, follows certified paths in space, and hovers again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from snnav_ros.convert import stop_to_path
from snnav_ros.nodes.robot import RobotNode
from snnav_ros.parameters import ParameterError
from support.air_site import BEE, TICK, Bee

UP = np.linspace([1.0, 2.0, 1.5], [3.1, 2.0, 2.2], 32)  # 0.07 m from point to point


def test_it_hovers_until_a_path_comes_follows_it_and_hovers_at_its_end(graph: Any) -> None:
    bee = Bee(graph, heading_deg=90.0, pitch_deg=30.0)
    bee.run(4)
    np.testing.assert_array_equal(bee.state.position, BEE["start"])
    np.testing.assert_allclose(bee.state.direction, [0.0, np.sqrt(0.75), 0.5], atol=1e-9)
    assert bee.state.speed == 0.0
    bee.order(UP)
    bee.run(20)
    assert bee.state.speed == 0.7
    np.testing.assert_allclose(bee.state.position, UP[0] + 0.7 * 0.95 * bee.state.direction, atol=1e-6)
    bee.run(60)
    assert bee.state.speed == 0.0
    np.testing.assert_allclose(bee.state.position, UP[-1], atol=0.01)
    assert np.linalg.norm(bee.state.position - UP[0]) <= np.linalg.norm(UP[-1] - UP[0]) + 1e-3
    twist = bee.commands[-1]
    assert (twist.linear.x, twist.linear.y, twist.linear.z) == (0.0, 0.0, 0.0)


def test_it_hovers_from_the_end_of_the_window_on(graph: Any) -> None:
    bee = Bee(graph)
    bee.run(1)
    bee.order(UP, until=1.0)
    bee.run(19)
    assert bee.state.speed == 0.7
    bee.run(2)
    assert bee.now > 1.0
    assert bee.state.speed == 0.0
    assert np.linalg.norm(bee.state.position - UP[0]) <= 0.7 * 0.95 + 1e-9
    assert "the certificate ended at 1.000 s" in bee.node._refusal


def test_a_stop_makes_it_hover(graph: Any) -> None:
    bee = Bee(graph)
    bee.run(1)
    bee.order(UP)
    bee.run(4)
    bee.paths.publish(stop_to_path(bee.tick * TICK))
    graph.until(lambda: bee.node._gate.path_stamp == bee.tick * TICK)
    bee.run(2)
    assert bee.state.speed == 0.0


def test_a_path_that_passes_elsewhere_or_on_the_ground_is_refused(graph: Any) -> None:
    bee = Bee(graph)
    bee.run(1)
    bee.order(UP + np.array([0.0, 0.0, 0.5]))
    assert "the path passes 0.50 m from the robot" in bee.node._refusal
    bee.run(1)
    bee.order(UP[:, :2])
    assert "the path passes 1.50 m from the robot" in bee.node._refusal
    bee.run(2)
    assert bee.state.speed == 0.0


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"start": [1.0, 2.0]}, "start: value .* give 3 numbers"),
        ({"pitch_deg": 91.0}, "pitch_deg: value 91.0 lies outside"),
        ({"flight_tracker.law": "pid"}, "flight_tracker.law: value 'pid' must be one of"),
        ({"scene": "hello", "robot_id": "robot_1"}, "base: value 'flyer' does not go with scene hello"),
        (
            {"scene": "hello_flight", "base": "external", "start": [1.0, 2.0]},
            "does not go with scene hello_fl",
        ),
    ],
)
def test_mistakes_end_it_at_its_start(graph: Any, changes: dict[str, Any], text: str) -> None:
    with pytest.raises(ParameterError, match=text):
        graph.add(RobotNode, **{**BEE, **changes})
