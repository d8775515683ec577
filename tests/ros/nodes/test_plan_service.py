"""The service of the global planner node: what a path would be, or why there is none."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlan

from snnav_core.types import Pose2D
from snnav_ros.convert import (
    path_from_message,
    stamp_message,
)
from snnav_sim.warm_up import warm_up
from support.global_site import SECOND, Site, posed, started


@pytest.fixture(autouse=True, scope="module")
def _kernels() -> None:
    warm_up()


def test_plan_by_hand_is_a_path_and_moves_nobody(graph: Any) -> None:
    site = Site(graph)
    site.stand(SECOND, Pose2D(2.0, 4.0, 0.0))
    site.step(SECOND)
    published = len(site.paths)
    start = posed(1.5, 2.0)
    start.header.stamp = stamp_message(4 * SECOND)
    path = path_from_message(site.ask(posed(10.0, 2.0), start))
    assert path is not None
    assert path.start_time == 4.0
    assert path.points[0] == pytest.approx([1.5, 2.0])
    assert path.points[-1] == pytest.approx([10.0, 2.0], abs=1e-6)
    from_here = path_from_message(site.ask(posed(10.0, 2.0)))
    assert from_here is not None
    assert from_here.start_time == 1.0
    assert from_here.points[0] == pytest.approx([2.0, 4.0])
    own = graph.call(GetPlan, "cart/plan", GetPlan.Request(goal=posed(10.0, 2.0))).plan
    assert own == site.ask(posed(10.0, 2.0))
    assert len(site.paths) == published
    values = {pair.key: pair.value for pair in site.status("plan service").values}
    assert (values["outcome"], values["robot"]) == ("planned", "cart")
    assert float(values["travel_time"]) > 16.0


def test_tolerance_moves_a_target_that_is_blocked(graph: Any) -> None:
    site = started(graph)
    site.step(SECOND)
    assert not site.ask(posed(7.0, 4.0)).poses
    path = path_from_message(site.ask(posed(7.0, 4.0), tolerance=0.8))
    assert path is not None
    assert np.hypot(*(path.points[-1] - [7.0, 4.0])) <= 0.8 + 1e-6


@pytest.mark.parametrize(
    ("start", "goal", "tolerance", "outcome", "text"),
    [
        (posed(2.0, 4.0), posed(6.0, 4.0), 0.0, "goal_blocked", "from body_1"),
        (posed(5.3, 4.0), posed(10.0, 4.0), 0.0, "start_blocked", "from body_1"),
        (posed(2.0, 4.0), posed(30.0, 4.0), 0.0, "goal_blocked", "from workspace"),
        (posed(2.0, 4.0), posed(10.0, 4.0, "odom"), 0.0, "invalid_request", "plan: goal: frame_id is 'odom'"),
        (posed(np.nan, 4.0), posed(10.0, 4.0), 0.0, "invalid_request", "plan: start: position .* not finite"),
        (posed(2.0, 4.0), posed(10.0, 4.0), -1.0, "invalid_request", "tolerance is -1.0"),
    ],
)
def test_no_plan_is_an_empty_path_and_a_typed_reason(
    graph: Any,
    capfd: pytest.CaptureFixture[str],
    start: PoseStamped,
    goal: PoseStamped,
    tolerance: float,
    outcome: str,
    text: str,
) -> None:
    site = started(graph)
    site.step(SECOND)
    answer = site.ask(goal, start, tolerance)
    assert not answer.poses
    assert answer.header.frame_id == "map"
    status = site.status("plan service")
    assert {pair.key: pair.value for pair in status.values}["outcome"] == outcome
    assert status.level == DiagnosticStatus.WARN
    assert re.search(text, status.message), status.message
    assert f"no plan ({outcome})" in capfd.readouterr().err


def test_question_before_there_are_bodies_is_answered(graph: Any) -> None:
    site = Site(graph)
    assert not site.ask(posed(10.0, 4.0)).poses
    assert "were not heard yet" in site.status("plan service").message
