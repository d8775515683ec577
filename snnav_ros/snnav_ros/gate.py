"""What a robot demands of a path before it follows it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from snnav_core.types import TimedPath
from snnav_ros.convert.verdict import Verdict

__all__ = ["Order", "PathGate"]


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
        Why the robot stops although a path came; empty if none was refused.
    """

    path: TimedPath | None
    valid_until: float = math.inf
    refusal: str = ""


class PathGate:
    """Pairs paths with their certificates; the two come in any order.

    Parameters
    ----------
    require_certificate : bool
        Follow a path only with an accepted certificate that bears its digest. Without, a path is followed to its end.

    Notes
    -----
    A path older than the last one is not taken. An empty path stops the robot at once. A certificate of the same
    instant that was not accepted, or bears another digest, stops the robot.
    """

    def __init__(self, require_certificate: bool = True) -> None:
        self._require = require_certificate
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._path: tuple[int, TimedPath | None] | None = None
        self._verdict: tuple[int, Verdict] | None = None
        self._taken = -1

    @property
    def path_stamp(self) -> int:
        """Stamp of the newest path [ns]; -1 before the first."""
        return -1 if self._path is None else self._path[0]

    @property
    def verdict_stamp(self) -> int:
        """Stamp of the newest certificate [ns]; -1 before the first."""
        return -1 if self._verdict is None else self._verdict[0]

    def complete(self, stamp: int) -> bool:
        """Whether everything stamped `stamp` [ns] that an order needs is there."""
        return self.path_stamp == stamp and (not self._require or self.verdict_stamp == stamp)

    def offer_path(self, stamp: int, path: TimedPath | None) -> Order | None:
        """Take a path (None: the message means stop) and return an order if one follows.

        Parameters
        ----------
        stamp : int
            Of the header [ns].
        path : TimedPath or None
        """
        if stamp < self.path_stamp:
            return None
        self._path = (stamp, path)
        return self._order()

    def offer_verdict(self, stamp: int, verdict: Verdict) -> Order | None:
        """Take a certificate or the reason of a stop, and return an order if one follows."""
        if stamp < self.verdict_stamp:
            return None
        self._verdict = (stamp, verdict)
        return self._order()

    def _order(self) -> Order | None:
        if self._path is None or self._taken >= self._path[0]:
            return None
        stamp, path = self._path
        if path is None or not self._require:
            self._taken = stamp
            return Order(path)
        if self._verdict is None or self._verdict[0] != stamp:
            return None
        self._taken = stamp
        certificate = self._verdict[1].certificate
        if certificate is None:
            return Order(None, refusal="a path came together with the reason of a stop")
        if not certificate.accepted:
            return Order(None, refusal=f"the certificate is not accepted: {certificate.reason}")
        digest = path.digest()
        if certificate.path_digest != digest:
            return Order(
                None, refusal=f"the certificate is of path {certificate.path_digest}, this one is {digest}"
            )
        return Order(path, certificate.valid_until)
