"""What a robot demands of a path, in whatever order path and certificate come."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from snnav_core.types import Certificate, PathSource, PlannedPath, Stop, StopReason, TimedPath
from snnav_ros.convert import (
    nanoseconds,
    path_to_message,
    stop_to_path,
    verdict_to_message,
)
from snnav_ros.convert.seal import seal_of
from snnav_ros.gate import GateRules, Order, PathGate

SECOND = 10**9


def path(time: float, shift: float = 0.0) -> TimedPath:
    return TimedPath(time, 0.5, np.array([[shift, 0.0], [1.0, 0.0], [2.0, 0.0]]))


def pair(of: TimedPath, **changes: Any) -> tuple[Any, Any]:
    """Return the messages of a certified path."""
    held = Certificate("cart", True, of.start_time + 2.0, 1.0, 1.0, 1.0, 0.0, of.digest())
    plan = PlannedPath("cart", of, replace(held, **changes), PathSource.WARM_START, 1.0)
    message = path_to_message(of)
    return message, verdict_to_message(plan, nanoseconds(of.start_time), message)


def stop_pair(stamp: int) -> tuple[Any, Any]:
    message = stop_to_path(stamp)
    return message, verdict_to_message(Stop("cart", StopReason.NO_PATH, "none"), stamp, message)


def value_of(message: Any, key: str) -> Any:
    return next(entry for entry in message.values if entry.key == key)


class Robot:
    """A gate, and what its robot does by the orders so far."""

    def __init__(self, **rules: Any) -> None:
        self.gate = PathGate("cart", GateRules(**rules))
        self.order = Order(None)

    def hear(self, message: Any, now: float) -> Order | None:
        kind = self.gate.offer_path if hasattr(message, "poses") else self.gate.offer_certificate
        return self._obey(kind(message, nanoseconds(now)))

    def watch(self, now: float) -> Order | None:
        return self._obey(self.gate.watch(nanoseconds(now)))

    def _obey(self, order: Order | None) -> Order | None:
        self.order = order or self.order
        return order

    @property
    def follows(self) -> float | None:
        """Start of the path that is followed."""
        return None if self.order.path is None else self.order.path.start_time

    def drive(self, time: float = 1.0) -> Robot:
        for message in pair(path(time)):
            self.hear(message, time)
        assert self.follows == time
        return self

    def resumes(self, time: float) -> bool:
        """Whether a good newer pair is followed, without a refusal."""
        for message in pair(path(time)):
            self.hear(message, time)
        return self.follows == time and not self.order.refusal


@pytest.mark.parametrize("path_first", [True, False])
def test_path_is_followed_when_its_certificate_is_there(path_first: bool) -> None:
    robot = Robot()
    first, second = pair(path(1.0)) if path_first else reversed(pair(path(1.0)))
    assert robot.hear(first, 1.0) is None
    assert not robot.gate.complete(SECOND)
    order = robot.hear(second, 1.0)
    assert robot.gate.complete(SECOND)
    assert order is not None
    assert order.path is not None
    assert order.path.digest() == path(1.0).digest()
    assert order.valid_until == 3.0
    assert not order.refusal


def test_the_same_pair_once_more_changes_nothing() -> None:
    robot = Robot().drive()
    for message in pair(path(1.0)):
        assert robot.hear(message, 1.2) is None


def test_path_waits_for_a_certificate_of_its_own_instant() -> None:
    robot = Robot().drive()
    message, certificate = pair(path(2.0))
    assert robot.hear(message, 2.0) is None
    assert not robot.gate.complete(2 * SECOND)
    assert robot.follows == 1.0
    order = robot.hear(certificate, 2.1)
    assert order is not None
    assert order.valid_until == 4.0


def resealed(change: Callable[[Any, Any], None]) -> tuple[Any, Any, float]:
    """Return a pair that its planner sealed as it is."""
    message, certificate = pair(path(2.0))
    change(message, certificate)
    value_of(certificate, "seal").value = seal_of(message, certificate)
    return message, certificate, 2.0


def altered(change: Callable[[Any], object]) -> tuple[Any, Any, float]:
    """Return a pair whose certificate was altered after it was sealed."""
    message, certificate = pair(path(2.0))
    change(certificate)
    return message, certificate, 2.0


def unseal(certificate: Any) -> None:
    certificate.values = [entry for entry in certificate.values if entry.key != "seal"]


def with_reason_of_a_stop() -> tuple[Any, Any, float]:
    message = path_to_message(path(2.0))
    return message, verdict_to_message(Stop("cart", StopReason.NO_PATH, "none"), 2 * SECOND, message), 2.0


BROKEN: dict[str, Callable[[], tuple[Any, Any, float]]] = {
    "digest": lambda: (*pair(path(2.0), path_digest="0123456789abcdef"), 2.0),
    "other path": lambda: (path_to_message(path(2.0, shift=1e-12)), pair(path(2.0))[1], 2.0),
    "seal": lambda: altered(lambda one: setattr(value_of(one, "seal"), "value", "0" * 64)),
    "unsealed": lambda: altered(unseal),
    "sealed twice": lambda: altered(lambda one: one.values.append(value_of(one, "seal"))),
    "rejected": lambda: (*pair(path(2.0), accepted=False, reason="too near"), 2.0),
    "expired": lambda: (*pair(path(2.0)), 4.0),
    "without end": lambda: (*pair(path(2.0), valid_until=math.inf), 2.0),
    "other robot": lambda: (*pair(path(2.0), robot_id="truck"), 2.0),
    "other hardware": lambda: resealed(lambda _, one: setattr(one, "hardware_id", "truck")),
    "frame": lambda: resealed(lambda one, _: setattr(one.header, "frame_id", "odom")),
    "frame of a pose": lambda: resealed(lambda one, _: setattr(one.poses[1].header, "frame_id", "odom")),
    "reason of a stop": with_reason_of_a_stop,
    "ahead": lambda: (*pair(path(2.2)), 2.1),
    "older": lambda: (*pair(path(0.9)), 1.1),
}
"""What must not be followed by a robot that follows a path stamped 1 s, and when it comes."""

REFUSALS = {
    "digest": "the certificate is of path 0123456789abcdef, this one is",
    "other path": f"the certificate is of path {path(2.0).digest()}",
    "seal": "sealed 0000000000000000..., computed",
    "unsealed": "cart/certificate: has no seal; send one",
    "sealed twice": "a key is there twice",
    "rejected": "not accepted: too near",
    "expired": "valid until 4.000 s, now is 4.000 s",
    "without end": "valid until inf s",
    "other robot": "is of robot 'cart' and 'truck', not 'cart'; check the topics",
    "other hardware": "is of robot 'cart' and 'truck', not 'cart'",
    "frame": "frame_id is 'odom', expected 'map'",
    "frame of a pose": "poses have frame_id 'odom', expected 'map'",
    "reason of a stop": "a path came together with the reason of a stop",
    "ahead": "stamped 0.100 s ahead of this robot's clock, more than clock_tolerance 0.05 s",
    "older": "stamped 0.900 s, older than the last one of 1.000 s; was the planner restarted",
}


@pytest.mark.parametrize("path_first", [True, False])
@pytest.mark.parametrize("kind", REFUSALS)
def test_what_is_wrong_stops_a_robot_that_drives_until_a_good_pair_comes(kind: str, path_first: bool) -> None:
    robot = Robot().drive()
    message, certificate, now = BROKEN[kind]()
    refusals = []
    for one in (message, certificate) if path_first else (certificate, message):
        order = robot.hear(one, now)
        refusals.append("" if order is None else order.refusal)
    assert robot.follows is None
    assert any(REFUSALS[kind] in refusal for refusal in refusals), refusals
    assert robot.resumes(round(now + 0.2, 3))


@pytest.mark.parametrize("cause", ["ahead", "older", "expired"])
def test_a_refused_stamp_is_not_remembered(cause: str) -> None:
    robot = Robot().drive()
    message, certificate, now = BROKEN[cause]()
    robot.hear(message, now)
    robot.hear(certificate, now)
    assert robot.follows is None
    later = max(now, 2.0) + 0.05
    assert robot.resumes(later)


def test_a_stamp_far_ahead_does_not_make_good_paths_look_old() -> None:
    robot = Robot().drive()
    for message in pair(path(1e6)):
        robot.hear(message, 1.5)
    assert robot.follows is None
    assert "ahead" in robot.order.refusal
    assert robot.resumes(2.0)


def test_stamp_within_the_tolerance_is_taken() -> None:
    robot = Robot()
    for message in pair(path(1.04)):
        robot.hear(message, 1.0)
    assert robot.follows == 1.04
    robot = Robot(clock_tolerance=0.0)
    for message in pair(path(1.04)):
        robot.hear(message, 1.0)
    assert robot.follows is None


@pytest.mark.parametrize("path_comes", [True, False])
def test_partner_that_does_not_come_stops(path_comes: bool) -> None:
    robot = Robot(pairing_patience=0.25).drive()
    message, certificate = pair(path(2.0))
    robot.hear(message if path_comes else certificate, 2.0)
    assert robot.watch(2.25) is None
    order = robot.watch(2.26)
    assert order is not None
    assert order.path is None
    has, lacks = ("path", "certificate") if path_comes else ("certificate", "path")
    assert f"the {has} stamped 2.000 s has waited 0.26 s for its {lacks}" in order.refusal
    assert robot.watch(2.5) is None  # said once
    late = robot.hear(certificate if path_comes else message, 2.6)  # late, but good
    assert late is not None
    assert robot.follows == 2.0


@pytest.mark.parametrize("path_first", [True, False])
def test_path_and_certificate_of_two_instants_stop_at_once(path_first: bool) -> None:
    robot = Robot().drive()
    messages = [pair(path(2.0))[0], pair(path(2.01))[1]]
    for message in messages if path_first else reversed(messages):
        robot.hear(message, 2.0)
    assert robot.follows is None
    assert "came with a certificate stamped 2.010 s" in robot.order.refusal
    assert robot.resumes(2.5)


def test_two_different_paths_of_one_instant_stop() -> None:
    robot = Robot().drive()
    order = robot.hear(path_to_message(path(1.0, shift=0.1)), 1.1)
    assert order is not None
    assert order.path is None
    assert "two different messages stamped 1.000 s; stop the second planner" in order.refusal
    assert robot.resumes(2.0)


def test_empty_path_stops_at_once_and_its_reason_needs_no_path() -> None:
    robot = Robot().drive()
    message, certificate = stop_pair(2 * SECOND)
    order = robot.hear(message, 2.0)
    assert order == Order(None)
    assert robot.hear(certificate, 2.0) is None
    assert robot.gate.complete(2 * SECOND)
    assert robot.watch(9.0) is None
    robot = Robot().drive()
    assert robot.hear(certificate, 2.0) == Order(None)
    assert robot.hear(message, 2.0) == Order(None)
    assert robot.watch(9.0) is None
    assert robot.resumes(9.0)


def test_old_stop_stops_all_the_same() -> None:
    robot = Robot().drive()
    order = robot.hear(stop_pair(SECOND // 2)[0], 1.1)
    assert order is not None
    assert order.path is None


def test_path_that_was_decided_too_late_is_expired() -> None:
    robot = Robot().drive()
    for message in pair(path(2.0)):  # valid until 4 s
        robot.hear(message, 4.5)
    assert robot.follows is None
    assert "is the planner too slow" in robot.order.refusal


def test_certificate_that_expires_while_it_waits_for_its_path_is_not_followed() -> None:
    robot = Robot()
    message, certificate = pair(path(2.0))
    robot.hear(certificate, 3.9)
    robot.hear(message, 4.0)
    assert robot.follows is None


class TestWithoutDemand:
    def test_a_path_needs_no_certificate(self) -> None:
        robot = Robot(require_certificate=False)
        order = robot.hear(path_to_message(path(1.0)), 1.0)
        assert order is not None
        assert order.path is not None
        assert robot.gate.complete(SECOND)
        for message in pair(path(1.0), accepted=False):
            assert robot.hear(message, 1.0) is None

    @pytest.mark.parametrize(
        ("message", "now", "text"),
        [
            (path_to_message(path(0.9)), 1.1, "older than the last one"),
            (path_to_message(path(1.1)), 2.1, "ends at 2.100 s, now is 2.100 s"),
            (path_to_message(path(2.0)), 1.9, "ahead of this robot's clock"),
        ],
    )
    def test_other_demands_stay(self, message: Any, now: float, text: str) -> None:
        robot = Robot(require_certificate=False)
        robot.hear(path_to_message(path(1.0)), 1.0)
        order = robot.hear(message, now)
        assert order is not None
        assert order.path is None
        assert text in order.refusal
        robot.hear(path_to_message(path(2.5)), 2.5)
        assert robot.follows == 2.5


def test_reset_forgets_the_future() -> None:
    robot = Robot().drive(9.0)
    robot.gate.reset()
    assert robot.resumes(1.0)


def test_stamps_of_the_clock_on_the_wall_pair_though_seconds_are_coarser_than_nanoseconds() -> None:
    stamp = 1_763_800_000_123_456_789
    message, certificate = stop_pair(stamp)
    robot = Robot()
    robot.hear(certificate, stamp / SECOND)
    robot.hear(message, stamp / SECOND)
    assert robot.gate.path_stamp == robot.gate.verdict_stamp
    assert robot.watch((stamp + 9 * SECOND) / SECOND) is None
