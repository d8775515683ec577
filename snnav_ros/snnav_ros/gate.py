"""What a robot demands of a path before it follows it: nothing is taken on trust."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from snnav_core.errors import InvalidInput
from snnav_core.types import Certificate, TimedPath
from snnav_ros.convert import (
    Verdict,
    nanoseconds,
    path_from_message,
    seconds,
    seconds_from_stamp,
    verdict_from_message,
)
from snnav_ros.convert.seal import seal_of

__all__ = ["GateRules", "Order", "PathGate"]


@dataclass(frozen=True)
class GateRules:
    """How strict a gate is.

    Parameters
    ----------
    require_certificate : bool
        Follow a path only with an accepted, sealed certificate. Without, certificates are not heard, and a path is
        followed to its end.
    clock_tolerance : float
        How far a stamp may lie ahead of the robot's clock [s].
    pairing_patience : float
        How long a path may be without its certificate, or a certificate without its path [s].
    """

    require_certificate: bool = True
    clock_tolerance: float = 0.05
    pairing_patience: float = 0.5


@dataclass(frozen=True)
class Order:
    """What to do from now on.

    Parameters
    ----------
    path : TimedPath or None
        None for stop.
    valid_until : float
        The path must not be followed after this time [s].
    refusal : str
        Why the robot stops although something came: the value and what to do about it; empty if nothing is wrong.
    cause : str
        The kind of refusal in one word; the same as long as the same thing is wrong.
    """

    path: TimedPath | None
    valid_until: float = math.inf
    refusal: str = ""
    cause: str = ""


class _Refused(Exception):
    """Something that must not be followed."""

    def __init__(self, cause: str, text: str) -> None:
        super().__init__(text)
        self.cause = cause


@dataclass(frozen=True)
class _Offer:
    """One message that waits for its partner."""

    stamp: int
    arrived: int
    message: Any
    content: Any


class PathGate:
    """Pairs paths with their certificates, which come in any order, and refuses what is wrong with either.

    Parameters
    ----------
    robot_id : str
        Whose certificates are taken.
    rules : GateRules
    in_space : bool
        Whether paths are those of a flying robot.

    Notes
    -----
    All times are nanoseconds of the robot's clock. Every method that returns an order returns None when nothing
    changes. A refusal means: stop at once, until a good pair comes that is newer than all before. What is stamped
    ahead of the clock is not remembered, so it cannot make good paths look old.
    """

    def __init__(self, robot_id: str, rules: GateRules | None = None, *, in_space: bool = False) -> None:
        self._rules = rules or GateRules()
        self._in_space = in_space
        self._tolerance = nanoseconds(self._rules.clock_tolerance)
        self._robot = robot_id
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._path: _Offer | None = None
        self._certificate: _Offer | None = None
        self._settled = -1
        self._taken: tuple[Any, Any] | None = None  # messages of the pair that is followed
        self._overdue = False
        self.path_stamp = -1
        """Stamp of the newest path [ns]; -1 before the first."""
        self.verdict_stamp = -1
        """Stamp of the newest certificate [ns]; -1 before the first."""

    def complete(self, stamp: int) -> bool:
        """Whether everything stamped `stamp` [ns] that an order needs is there."""
        return self.path_stamp == stamp and (
            not self._rules.require_certificate or self.verdict_stamp == stamp
        )

    def offer_path(self, message: Any, now: int) -> Order | None:
        """Take a nav_msgs/Path and return an order if one follows."""
        topic = f"{self._robot}/path"
        stamp = nanoseconds(seconds_from_stamp(message.header.stamp))
        try:
            self._check_ahead(topic, stamp, now)
            self.path_stamp = max(self.path_stamp, stamp)
            path = path_from_message(message, topic, in_space=self._in_space)
            if path is not None and self._is_known(topic, stamp, self._path, message, 0):
                return None
            if path is None or not self._rules.require_certificate:
                return self._take_alone(topic, stamp, path, message, now)
            self._path = _Offer(stamp, now, message, path)
            return self._pair(now)
        except InvalidInput as error:
            return self._refuse(_Refused("malformed", str(error)), stamp, now)
        except _Refused as error:
            return self._refuse(error, stamp, now)

    def offer_certificate(self, message: Any, now: int) -> Order | None:
        """Take a certificate (diagnostic_msgs/DiagnosticStatus) and return an order if one follows."""
        if not self._rules.require_certificate:
            return None
        topic, stamp = f"{self._robot}/certificate", -1
        try:
            verdict = verdict_from_message(message, topic)
            stamp = nanoseconds(verdict.stamp)
            self._check_ahead(topic, stamp, now)
            self.verdict_stamp = max(self.verdict_stamp, stamp)
            if self._is_known(topic, stamp, self._certificate, message, 1):
                return None
            if verdict.certificate is not None:
                self._check_certificate(verdict, verdict.certificate, now)
            self._certificate = _Offer(stamp, now, message, verdict)
            return self._pair(now) or (Order(None) if verdict.certificate is None else None)
        except InvalidInput as error:
            return self._refuse(_Refused("malformed", str(error)), stamp, now)
        except _Refused as error:
            return self._refuse(error, stamp, now)

    def watch(self, now: int) -> Order | None:
        """Return a refusal once a path or a certificate has waited too long for its partner."""
        waiting = self._path or self._certificate
        if waiting is None or self._overdue:
            return None
        waited = seconds(now - waiting.arrived)
        if waited <= self._rules.pairing_patience:
            return None
        self._overdue = True
        has, lacks = ("path", "certificate") if self._path is not None else ("certificate", "path")
        text = (
            f"the {has} stamped {seconds(waiting.stamp):.3f} s has waited {waited:.2f} s for its {lacks}; "
            "check the planner and the network"
        )
        return self._refuse(_Refused("alone", text), -1, now)

    def _check_ahead(self, topic: str, stamp: int, now: int) -> None:
        if stamp - now > self._tolerance:
            raise _Refused(
                "ahead",
                f"{topic}: stamped {seconds(stamp - now):.3f} s ahead of this robot's clock, more than clock_tolerance "
                f"{self._rules.clock_tolerance:g} s; synchronise the clocks",
            )

    def _is_known(self, topic: str, stamp: int, waiting: _Offer | None, message: Any, index: int) -> bool:
        """Whether a message needs no answer: once more the same, or the partner of what was refused.

        Raises
        ------
        _Refused
            If it is older than one before it, or another one of the same instant.
        """
        newest = max(self._settled, -1 if waiting is None else waiting.stamp)
        if stamp < newest:
            raise _Refused(
                "older",
                f"{topic}: stamped {seconds(stamp):.3f} s, older than the last one of {seconds(newest):.3f} s; was the "
                "planner restarted or its clock set back? The next newer path is followed",
            )
        if stamp > newest:
            return False
        same = self._taken[index] if stamp == self._settled and self._taken is not None else None
        if stamp == self._settled and same is None:
            return True
        if waiting is not None and stamp == waiting.stamp:
            same = waiting.message
        if message != same:
            text = f"{topic}: two different messages stamped {seconds(stamp):.3f} s; stop the second planner"
            raise _Refused("twice", text)
        return True

    def _take_alone(self, topic: str, stamp: int, path: TimedPath | None, message: Any, now: int) -> Order:
        """Take a stop, which needs no certificate, or a path where none is demanded."""
        if path is None and stamp < self._settled:
            text = f"{topic}: a stop stamped {seconds(stamp):.3f} s, older than the last path; a newer path is followed"
            raise _Refused("older", text)
        if path is not None and not path.end_time > seconds(now):
            raise _Refused(
                "expired",
                f"{topic}: ends at {path.end_time:.3f} s, now is {seconds(now):.3f} s; is the planner too slow?",
            )
        self._settle(stamp, None if path is None else (message, None))
        return Order(path)

    def _check_certificate(self, verdict: Verdict, certificate: Certificate, now: int) -> None:
        """Find what is wrong with a certificate, whatever its path is."""
        topic = f"{self._robot}/certificate"
        names = {verdict.robot_id, certificate.robot_id}
        if names != {self._robot}:
            named = " and ".join(map(repr, sorted(names)))
            raise _Refused("robot", f"{topic}: is of robot {named}, not {self._robot!r}; check the topics")
        if not certificate.accepted:
            raise _Refused("rejected", f"the certificate is not accepted: {certificate.reason}")
        if not verdict.seal:
            raise _Refused("unsealed", f"{topic}: has no seal; send one as documented")
        until = certificate.valid_until
        if not (math.isfinite(until) and until > seconds(now)):
            raise _Refused(
                "expired",
                f"{topic}: valid until {until:.3f} s, now is {seconds(now):.3f} s; is the planner too slow, or its "
                "clock behind?",
            )

    def _pair(self, now: int) -> Order | None:
        """Return the order of path and certificate once both are there."""
        path, certificate = self._path, self._certificate
        if path is None or certificate is None:
            return None
        if path.stamp != certificate.stamp:
            if path.stamp < certificate.stamp:
                self._path = None
            else:
                self._certificate = None
            raise _Refused(
                "pair",
                f"the path stamped {seconds(path.stamp):.3f} s came with a certificate stamped "
                f"{seconds(certificate.stamp):.3f} s; check the planner and the network",
            )
        verdict: Verdict = certificate.content
        if verdict.certificate is None:
            raise _Refused("stop", "a path came together with the reason of a stop; check the planner")
        self._check_certificate(verdict, verdict.certificate, now)
        digest, seal = path.content.digest(), seal_of(path.message, certificate.message)
        if verdict.certificate.path_digest != digest:
            text = f"the certificate is of path {verdict.certificate.path_digest}, this one is {digest}"
            raise _Refused("digest", f"{text}; check the planner and the network")
        if verdict.seal != seal:
            text = f"path and certificate stamped {seconds(path.stamp):.3f} s are sealed {verdict.seal[:16]}..., "
            raise _Refused(
                "seal",
                f"{text}computed {seal[:16]}...: one was altered; check what lies between planner and robot",
            )
        self._settle(path.stamp, (path.message, certificate.message))
        return Order(path.content, verdict.certificate.valid_until)

    def _settle(self, stamp: int, taken: tuple[Any, Any] | None) -> None:
        """Note that all up to a stamp is decided; what waits is waited for no more, unless it is newer."""
        self._settled, self._taken, self._overdue = max(self._settled, stamp), taken, False
        if self._path is not None and self._path.stamp <= self._settled:
            self._path = None
        if self._certificate is not None and self._certificate.stamp <= self._settled:
            self._certificate = None

    def _refuse(self, refused: _Refused, stamp: int, now: int) -> Order:
        """Stop; what is refused, and is not from the future, is settled."""
        self._taken = None
        if refused.cause not in ("alone", "pair", "older") and stamp - now <= self._tolerance:
            self._settle(stamp, None)
        return Order(None, refusal=str(refused), cause=refused.cause)
