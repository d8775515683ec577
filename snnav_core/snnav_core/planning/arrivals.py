"""Candidates that have reached the target: adjusted to the end, told apart, and checked when they are the best."""

from __future__ import annotations

import math

import numpy as np

from snnav_core.planning.homotopy_search import Found
from snnav_core.planning.settling import fine_gains, settle, with_target
from snnav_core.planning.spacetime_certificate import certify_in_spacetime
from snnav_core.planning.spacetime_problem import CandidateOutcome, SpacetimeProblem, SpacetimeSettings
from snnav_core.planning.spacetime_world import RADIUS_RESERVE, Layout
from snnav_core.types import Certificate, FloatArray, TimedPath

__all__ = ["Arrivals"]

_SETTLING_PASSES = 6000  # for chains of up to 100 points, more for longer ones (C0-15)
_LATE = 0.5  # share of the tracking tolerance that may be lost to points that are early or late ...
_LEAST_LATE = 0.02  # ... and share of the link length that may be
_SAME = 0.2  # of the link length: candidates nowhere farther apart than this are the same path


class Arrivals:
    """What became of the candidates that have reached the target.

    Parameters
    ----------
    problem : SpacetimeProblem
    settings : SpacetimeSettings
    layout : Layout

    Attributes
    ----------
    best : Found or None
        The fastest one that the certificate accepted, and with it
    certificate : Certificate or None
    """

    def __init__(self, problem: SpacetimeProblem, settings: SpacetimeSettings, layout: Layout) -> None:
        self.problem, self.settings, self.layout = problem, settings, layout
        self.best: Found | None = None
        self.certificate: Certificate | None = None
        self._different: list[Found] = []
        self._raw: list[FloatArray] = []

    def add(self, one: Found) -> float:
        """Settle a candidate; travel time of the best that is accepted [s], infinite if there is none."""
        chain, layout, problem = one.chain, self.layout, self.problem
        if any(_near(chain.chain, other, layout.link) for other in self._raw):
            _drop(one)
            return self.least
        self._raw.append(chain.chain.copy())
        radius = RADIUS_RESERVE * problem.robot.min_turn_radius
        gains = fine_gains(layout.link, radius, chain.n, self.settings.adjustment)
        most = _SETTLING_PASSES * max(chain.n, 100) // 100
        rests = settle(chain, layout.world, gains, self.settings.adjustment, most)
        points = with_target(chain, layout.world.ends[1], layout.link)
        one.outcome, one.reason = _verdict(points[:-1], rests, layout.link, self.settings)
        one.path = TimedPath(problem.start_time, layout.step, points)
        if one.outcome is CandidateOutcome.REACHED:
            rest = math.dist(points[-2], points[-1])
            one.travel_time = (len(points) - 2) * layout.step + rest / problem.robot.speed
            self._compare(one, one.path)
        return self.least

    @property
    def least(self) -> float:
        """Travel time of the best [s], infinite as long as there is none."""
        return math.inf if self.best is None else self.best.travel_time

    def _compare(self, one: Found, path: TimedPath) -> None:
        """Drop what is there already; what is new and faster is asked of the certificate."""
        twin = next(
            (
                other
                for other in self._different
                if other.path is not None and _near(path.points, other.path.points, self.layout.link)
            ),
            None,
        )
        if twin is not None and (twin.chain.turns or not one.chain.turns):
            _drop(one)
            return
        self._different.append(one)
        best = math.inf if self.best is None or self.best is twin else self.best.travel_time
        if one.travel_time < best:
            certificate = certify_in_spacetime(path, self.problem, self.settings)
            if not certificate.accepted:
                one.outcome, one.reason = CandidateOutcome.REFUSED, certificate.reason
                return
            self.best, self.certificate = one, certificate
        if twin is not None:
            # The search has found what was given to it: it knows the turns.
            self._different.remove(twin)
            _drop(twin)


def _drop(one: Found) -> None:
    one.outcome, one.travel_time = CandidateOutcome.DUPLICATE, math.inf
    one.reason = "another candidate is adjusted to the same path"


def _verdict(
    points: FloatArray, rests: bool, link: float, settings: SpacetimeSettings
) -> tuple[CandidateOutcome, str]:
    """Whether a candidate may be asked of the certificate: spacing counts, not how still its points are (C0-15)."""
    if len(points) < 2:
        return CandidateOutcome.REACHED, ""
    links = np.hypot(*np.diff(points, axis=0).T)
    late = np.abs(np.cumsum(links - link)).max()
    longest, shortest = float(links.max()), float(links.min())
    if longest > settings.longest_link * link or shortest < (2.0 - settings.longest_link) * link:
        reason = f"links from {shortest:.3f} to {longest:.3f} m, demanded {link:.3f} m"
    elif late > max(_LATE * settings.tracking_tolerance, _LEAST_LATE * link):
        reason = f"points up to {late:.3f} m from where the robot is by then"
    else:
        return CandidateOutcome.REACHED, ""
    torn = rests or longest > settings.longest_link * link
    return (CandidateOutcome.STRETCHED if torn else CandidateOutcome.UNSETTLED), reason


def _near(points: FloatArray, other: FloatArray, link: float) -> bool:
    """Whether two chains are nowhere farther apart than the same path may be, the last point aside."""
    if abs(len(other) - len(points)) > 1:
        return False
    count = min(len(points), len(other))
    return float(np.abs(points[:count] - other[:count]).max()) < _SAME * link
