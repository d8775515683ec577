"""Odometry, goals, certificates and stops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, Quaternion
from hypothesis import given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message

from snnav_core.errors import InvalidInput
from snnav_core.types import (
    Certificate,
    PathSource,
    PlannedPath,
    Pose2D,
    RobotState,
    Stop,
    StopReason,
    TimedPath,
)
from snnav_ros.convert import (
    goal_from_message,
    odometry_to_message,
    path_to_message,
    state_from_message,
    stop_to_path,
    verdict_from_message,
    verdict_to_message,
    yaw_from_message,
    yaw_to_message,
)
from snnav_ros.convert.seal import SEAL_KEY

NUMBER = st.floats(-1e6, 1e6)
HEADING = st.floats(math.nextafter(-math.pi, 0.0), math.pi).filter(lambda x: x == 0.0 or abs(x) > 1e-300)
ANY = st.floats(allow_nan=False)


@given(HEADING)
def test_heading_survives_to_the_last_bit(heading: float) -> None:
    quaternion = yaw_to_message(heading)
    assert yaw_from_message(quaternion) == heading
    size = math.hypot(quaternion.z, quaternion.w)
    assert size == pytest.approx(1.0, abs=1e-14)


@given(HEADING, st.floats(0.01, 100.0), st.booleans())
def test_length_and_sign_of_a_quaternion_do_not_matter(heading: float, size: float, turned: bool) -> None:
    factor = -size if turned else size
    one = yaw_to_message(heading)
    other = Quaternion(x=0.0, y=0.0, z=factor * one.z, w=factor * one.w)
    assert math.remainder(yaw_from_message(other) - heading, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_tilted_quaternion_gives_its_yaw() -> None:
    roll, yaw = 0.3, 1.1
    z, w = math.sin(yaw / 2), math.cos(yaw / 2)
    s, c = math.sin(roll / 2), math.cos(roll / 2)
    tilted = Quaternion(x=w * s, y=z * s, z=z * c, w=w * c)
    assert yaw_from_message(tilted) == pytest.approx(yaw)


@given(NUMBER, NUMBER, HEADING, st.floats(-5.0, 5.0), st.integers(0, 10**15))
def test_odometry_survives_exactly(x: float, y: float, heading: float, speed: float, stamp: int) -> None:
    sent = odometry_to_message("robot_1", Pose2D(x, y, heading), speed, 0.25, stamp)
    received = deserialize_message(serialize_message(sent), Odometry)
    assert state_from_message(received, "robot_1") == RobotState(
        "robot_1", Pose2D(x, y, heading), stamp / 10**9, speed
    )
    assert (received.header.frame_id, received.child_frame_id) == ("map", "robot_1/base_link")
    assert received.twist.twist.angular.z == 0.25


def test_odometry_that_lies_is_refused() -> None:
    def message() -> Odometry:
        return odometry_to_message("r", Pose2D(0.0, 0.0, 0.0), 0.0, 0.0, 0)

    frame, place, speed, turn = (message() for _ in range(4))
    frame.header.frame_id = "r/odom"
    place.pose.pose.position.x = math.nan
    speed.twist.twist.linear.x = math.inf
    turn.pose.pose.orientation.w = 0.0
    for broken, text in [
        (frame, "r/odom.*expected 'map'"),
        (place, "not finite"),
        (speed, "not finite"),
        (turn, "no rotation"),
    ]:
        with pytest.raises(InvalidInput, match=text):
            state_from_message(broken, "r")
    assert state_from_message(frame, "r", frames=("map", "r/odom")).pose.x == 0.0


def test_goal_is_a_point_of_the_map() -> None:
    message = PoseStamped()
    message.pose.position.x, message.pose.position.y = 3.0, -4.0
    with pytest.raises(InvalidInput, match="frame_id is ''"):
        goal_from_message(message)
    message.header.frame_id = "map"
    assert goal_from_message(message) == (3.0, -4.0)
    message.pose.position.y = math.inf
    with pytest.raises(InvalidInput, match="not finite"):
        goal_from_message(message)


@given(
    st.booleans(), ANY, ANY, ANY, ANY, ANY, st.text("0123456789abcdef", min_size=16, max_size=16),
    st.sampled_from(PathSource), st.integers(0, 10**15),
)  # fmt: skip
def test_certificate_survives_exactly(
    accepted: bool, until: float, clearance: float, separation: float, radius: float, stamp: float,
    digest: str, source: PathSource, time: int,
) -> None:  # fmt: skip
    reason = "" if accepted else "clearance 0.3 m at k = 4, demanded 0.5 m"
    certificate = Certificate(
        "robot_1", accepted, until, clearance, separation, radius, stamp, digest, reason
    )
    path = TimedPath(0.0, 1.0, np.array([[0.0, 0.0], [1.0, 0.0]]))
    plan = PlannedPath("robot_1", path, certificate, source, clearance)
    sent = verdict_to_message(plan, time, path_to_message(path))
    verdict = verdict_from_message(deserialize_message(serialize_message(sent), DiagnosticStatus))
    assert verdict.certificate == certificate
    assert (verdict.source, verdict.planning_distance, verdict.stop) == (source, clearance, None)
    assert verdict.stamp == time / 10**9
    assert sent.level == (DiagnosticStatus.OK if accepted else DiagnosticStatus.ERROR)


@given(st.sampled_from(StopReason), st.integers(0, 10**15))
def test_stop_survives_exactly(reason: StopReason, time: int) -> None:
    stop = Stop("robot_1", reason, "the target (3, 4) lies outside; choose another")
    sent = verdict_to_message(stop, time, stop_to_path(time))
    verdict = verdict_from_message(deserialize_message(serialize_message(sent), DiagnosticStatus))
    assert verdict.stop == stop
    assert verdict.certificate is None
    assert (sent.level == DiagnosticStatus.OK) == (reason is StopReason.ARRIVED)


def test_certificate_with_a_missing_or_unreadable_key_is_refused() -> None:
    def message() -> DiagnosticStatus:
        path = TimedPath(0.0, 1.0, np.array([[0.0, 0.0], [1.0, 0.0]]))
        certificate = Certificate("r", True, 1.0, 1.0, 1.0, 1.0, 0.0, path.digest())
        plan = PlannedPath("r", path, certificate, PathSource.WARM_START, 1.0)
        return verdict_to_message(plan, 0, path_to_message(path))

    assert message().values[-1].key == SEAL_KEY
    for index in range(len(message().values) - 1):
        less, worse = message(), message()
        key = less.values[index].key
        del less.values[index]
        with pytest.raises(InvalidInput, match=f"key '{key}' is missing"):
            verdict_from_message(less)
        worse.values[index].value = "rubbish"
        twice = message()
        twice.values.append(message().values[index])
        with pytest.raises(InvalidInput, match="there twice"):
            verdict_from_message(twice)
        if key not in ("robot_id", "path_digest", "reason"):
            with pytest.raises(InvalidInput, match="rubbish"):
                verdict_from_message(worse)
