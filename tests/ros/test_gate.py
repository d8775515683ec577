"""What a robot demands of a path, in whatever order path and certificate come."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from snnav_core.types import Certificate, Stop, StopReason, TimedPath
from snnav_ros.convert import Verdict
from snnav_ros.gate import PathGate

SECOND = 10**9


def path(time: float, shift: float = 0.0) -> TimedPath:
    return TimedPath(time, 0.5, np.array([[shift, 0.0], [1.0, 0.0], [2.0, 0.0]]))


def verdict(of: TimedPath, accepted: bool = True, until: float = 9.0) -> Verdict:
    certificate = Certificate(
        "r", accepted, until, 1.0, 1.0, 1.0, 0.0, of.digest(), "" if accepted else "too near"
    )
    return Verdict(of.start_time, "r", certificate)


@pytest.mark.parametrize("path_first", [True, False])
def test_path_is_followed_when_its_certificate_is_there(path_first: bool) -> None:
    gate = PathGate()
    steps = [
        lambda: gate.offer_path(SECOND, path(1.0)),
        lambda: gate.offer_verdict(SECOND, verdict(path(1.0))),
    ]
    first, second = steps if path_first else reversed(steps)
    assert first() is None
    assert not gate.complete(SECOND)
    order = second()
    assert gate.complete(SECOND)
    assert order is not None
    assert order.path is not None
    assert order.path.digest() == path(1.0).digest()
    assert order.valid_until == 9.0
    assert not order.refusal


def test_path_waits_for_a_certificate_of_its_own_instant() -> None:
    gate = PathGate()
    gate.offer_verdict(SECOND, verdict(path(1.0)))
    gate.offer_path(SECOND, path(1.0))
    assert gate.offer_path(2 * SECOND, path(2.0)) is None
    assert not gate.complete(2 * SECOND)
    order = gate.offer_verdict(2 * SECOND, verdict(path(2.0), until=11.0))
    assert order is not None
    assert order.valid_until == 11.0


@pytest.mark.parametrize("path_first", [True, False])
def test_other_digest_stops(path_first: bool) -> None:
    gate = PathGate()
    steps = [
        lambda: gate.offer_path(SECOND, path(1.0, shift=1e-12)),
        lambda: gate.offer_verdict(SECOND, verdict(path(1.0))),
    ]
    first, second = steps if path_first else reversed(steps)
    first()
    order = second()
    assert order is not None
    assert order.path is None
    assert path(1.0).digest() in order.refusal


def test_certificate_that_is_not_accepted_stops() -> None:
    gate = PathGate()
    gate.offer_path(SECOND, path(1.0))
    order = gate.offer_verdict(SECOND, verdict(path(1.0), accepted=False))
    assert order is not None
    assert order.path is None
    assert "too near" in order.refusal


def test_path_with_the_reason_of_a_stop_stops() -> None:
    gate = PathGate()
    gate.offer_path(SECOND, path(1.0))
    stop = Verdict(1.0, "r", stop=Stop("r", StopReason.NO_PATH, "none"))
    order = gate.offer_verdict(SECOND, stop)
    assert order is not None
    assert order.path is None
    assert order.refusal


def test_empty_path_stops_at_once() -> None:
    gate = PathGate()
    order = gate.offer_path(SECOND, None)
    assert order is not None
    assert order.path is None
    assert not order.refusal


def test_older_path_is_not_taken() -> None:
    gate = PathGate(require_certificate=False)
    assert gate.offer_path(2 * SECOND, path(2.0)) is not None
    assert gate.offer_path(SECOND, path(1.0)) is None
    assert gate.path_stamp == 2 * SECOND


def test_older_certificate_is_not_taken() -> None:
    gate = PathGate()
    gate.offer_path(2 * SECOND, path(2.0))
    gate.offer_verdict(2 * SECOND, verdict(path(2.0)))
    assert gate.offer_verdict(SECOND, verdict(path(1.0))) is None
    assert gate.verdict_stamp == 2 * SECOND


def test_without_demand_a_path_needs_no_certificate() -> None:
    gate = PathGate(require_certificate=False)
    order = gate.offer_path(SECOND, path(1.0))
    assert order is not None
    assert order.path is not None
    assert gate.complete(SECOND)


def test_reset_forgets_the_future() -> None:
    gate = PathGate()
    gate.offer_path(9 * SECOND, path(9.0))
    gate.offer_verdict(9 * SECOND, verdict(path(9.0)))
    gate.reset()
    gate.offer_path(SECOND, path(1.0))
    order = gate.offer_verdict(SECOND, replace(verdict(path(1.0))))
    assert order is not None
    assert order.path is not None
