"""Plans of the global planner with their candidates as a MarkerArray."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from snnav_core.errors import InvalidInput
from snnav_core.planning.spacetime_problem import Candidate, CandidateOutcome, SpacetimePlan, TravelBound
from snnav_core.types import Certificate, FloatArray, TimedPath
from snnav_ros.convert import plans_from_message, plans_to_message

SECOND = 10**9
NUMBER = st.floats(-1e6, 1e6)
POINTS = st.lists(st.tuples(NUMBER, NUMBER), min_size=1, max_size=5).map(np.array)
BODY = st.sampled_from(("body_1", "unseen_2"))
CANDIDATE = st.builds(
    Candidate,
    POINTS,
    st.lists(st.tuples(BODY, st.sampled_from((1, -1))), max_size=3).map(tuple),
    st.sampled_from(CandidateOutcome),
    st.floats(0.0, math.inf),
    st.integers(0, 10**6),
    st.text(st.characters(blacklist_categories=("Cs", "Cc")), max_size=20),
)


def certificate(path: TimedPath) -> Certificate:
    return Certificate("cart", True, path.end_time, 0.61, math.inf, math.inf, 1.5, path.digest())


@st.composite
def plans(draw: st.DrawFn) -> SpacetimePlan:
    path = TimedPath(draw(st.integers(0, 10**12)) / SECOND, draw(st.floats(0.01, 1.0)), draw(POINTS))
    route = np.array(draw(st.lists(st.tuples(NUMBER, NUMBER, NUMBER), max_size=3))).reshape(-1, 3)
    bound = draw(st.none() | st.just(TravelBound(draw(st.floats(0.0, math.inf)), route, ("body_3",))))
    candidates = tuple(draw(st.lists(CANDIDATE, max_size=3)))
    return SpacetimePlan("cart", path, draw(st.floats(0.0, 1e3)), certificate(path), candidates, bound)


def through_the_wire(message: MarkerArray) -> MarkerArray:
    return deserialize_message(serialize_message(message), MarkerArray)


@given(plans())
def test_plans_survive_exactly(made: SpacetimePlan) -> None:
    message = through_the_wire(plans_to_message({"cart": (3 * SECOND, made)}, 5 * SECOND))
    assert (message.markers[0].action, message.markers[0].header.stamp.sec) == (Marker.DELETEALL, 5)
    found = plans_from_message(message)
    assert found.keys() == {"cart"}
    stamp, back = found["cart"]
    assert stamp == 3 * SECOND
    assert (back.robot_id, back.travel_time, back.certificate) == ("cart", made.travel_time, made.certificate)
    assert back.path.digest() == made.path.digest()
    assert (back.bound is None) == (made.bound is None)
    if made.bound is not None and back.bound is not None:
        assert (back.bound.time, back.bound.left_out) == (made.bound.time, made.bound.left_out)
        np.testing.assert_array_equal(back.bound.route, made.bound.route)
    for ours, theirs in zip(made.candidates, back.candidates, strict=True):
        np.testing.assert_array_equal(ours.points, theirs.points)
        for name in ("turns", "outcome", "travel_time", "passes", "reason"):
            assert getattr(ours, name) == getattr(theirs, name)


def one_plan(points: FloatArray) -> SpacetimePlan:
    path = TimedPath(1.0, 0.3, points)
    other = Candidate(points + 1.0, (("body_1", 1),), CandidateOutcome.DOMINATED)
    chosen = Candidate(points, (), CandidateOutcome.REACHED, 0.6, 12)
    return SpacetimePlan("cart", path, 0.6, certificate(path), (other, chosen))


def test_every_robot_has_its_own_lines_and_the_chosen_one_is_the_widest() -> None:
    points = np.array([[0.0, 0.0], [0.15, 0.0], [0.3, 0.0]])
    message = plans_to_message({"a": (1, one_plan(points)), "b": (2, one_plan(points + 5.0))}, 3)
    lines = message.markers[1:]
    assert [(line.ns, line.id) for line in lines] == [
        ("a", 0),
        ("a", 1),
        ("a", 2),
        ("b", 0),
        ("b", 1),
        ("b", 2),
    ]
    assert all(line.type == Marker.LINE_STRIP and line.header.frame_id == "map" for line in lines)
    assert max(line.scale.x for line in lines if line.id) < lines[0].scale.x == lines[3].scale.x
    assert lines[1].color != lines[2].color


def test_what_is_malformed_is_refused_by_name() -> None:
    def broken(index: int, **changes: object) -> MarkerArray:
        message = plans_to_message({"cart": (1, one_plan(np.zeros((2, 2))))}, 3)
        for name, value in changes.items():
            setattr(message.markers[index], name, value)
        return message

    other_frame = broken(1)
    other_frame.markers[1].header.frame_id = "odom"
    orphan = broken(1)
    orphan.markers = orphan.markers[2:]
    for message, text in [
        (other_frame, "frame_id is 'odom'"),
        (broken(1, type=Marker.SPHERE), "has type 2, expected LINE_STRIP"),
        (broken(1, text="green"), "marker 0 of 'cart'"),
        (broken(1, text="{}"), "plan of 'cart': KeyError"),
        (broken(1, points=[]), "plan of 'cart': .*shape"),
        (broken(2, text="[1]"), "marker 1 of 'cart'"),
        (orphan, "marker 1 of 'cart': KeyError"),
    ]:
        with pytest.raises(InvalidInput, match=f"candidates: .*{text}"):
            plans_from_message(message)
