"""Search among homotopy classes: all candidates in lockstep, two for every body that is hit (Ch. 2, C1-C3)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from snnav_core.planning.adjustment import AdjustmentSettings
from snnav_core.planning.prolonging import Chain, Event, prolong
from snnav_core.planning.spacetime_bodies import distance
from snnav_core.planning.spacetime_kernel import Gains
from snnav_core.planning.spacetime_problem import CandidateOutcome, SpacetimeSettings
from snnav_core.planning.spacetime_world import Layout
from snnav_core.types import TimedPath

__all__ = ["Found", "coarse_gains", "search"]

_COARSE = 0.1  # rest threshold while a chain grows, as a share of G_P
_MOST_PASSES = 60  # for a point, while a chain grows
_PATIENCE = 1.25  # others go on as long as they may arrive within so many times of the least travel time
_ROUNDS = 1.25  # perimeters of a body along which it is followed without getting past it
_SAME = 0.1  # of the link length: candidates nowhere farther apart than this are the same
_WORK, _ENOUGH_WORK = 6e6, 2e6  # passes times points of all candidates, at most, and once there is an answer


@dataclass(eq=False)
class Found:
    """A candidate of the search.

    Parameters
    ----------
    chain : Chain
    outcome : CandidateOutcome or None
        None as long as it is under way.
    reason : str
    path : TimedPath or None
        What it became, for one that has reached the target.
    travel_time : float
        [s]
    """

    chain: Chain
    outcome: CandidateOutcome | None = None
    reason: str = ""
    path: TimedPath | None = None
    travel_time: float = math.inf


def coarse_gains(link: float, settings: AdjustmentSettings) -> Gains:
    """Constants of the loop while a chain grows: springs that are shorter at rest (C0-3), a coarse threshold."""
    pull = settings.pull * link
    threshold = _COARSE * pull
    return Gains(
        link,
        pull,
        settings.interval_gain,
        settings.barrier_gain,
        settings.attenuation,
        threshold,
        threshold / (1.0 - settings.attenuation),
    )


def search(
    layout: Layout,
    settings: SpacetimeSettings,
    rng: np.random.Generator,
    arrive: Callable[[Found], float],
    best: float = math.inf,
) -> list[Found]:
    """Candidates that reach the target, and all others, in the order in which they were made.

    Parameters
    ----------
    layout : Layout
    settings : SpacetimeSettings
    rng : numpy.random.Generator
        Decides which direction a candidate keeps at a body when both lead equally well to the target.
    arrive : callable
        Told of a candidate that has reached the target: adjusts it to the end, sets its outcome and returns the travel
        time that others have to compare with [s], infinite as long as there is no answer.
    best : float
        That time at the beginning [s].

    Notes
    -----
    Deviations: the search goes on until all have reached the target or cannot come near the best (C2-8); at most
    `settings.candidates`, candidates with the same turns are dropped (C2-9); a body that was just left does not fork
    again (C2-4); a candidate ends when it has gone around the followed body, or has a length that none needs (C2-3).
    """
    return _Search(layout, settings, rng, arrive, best).run()


class _Search:
    def __init__(
        self,
        layout: Layout,
        settings: SpacetimeSettings,
        rng: np.random.Generator,
        arrive: Callable[[Found], float],
        best: float,
    ) -> None:
        self.layout, self.settings, self.rng, self.arrive = layout, settings, rng, arrive
        self.best = best / layout.step  # in links
        self.gains = coarse_gains(layout.link, settings.adjustment)
        self.found = [Found(Chain.begin(layout.world.ends[0], layout.most_points + 2))]
        self.seen: set[tuple[tuple[int, int], ...]] = {()}
        self.work = 0.0

    def run(self) -> list[Found]:
        """C2: one point for every candidate, again and again."""
        if math.dist(*self.layout.world.ends) < self.layout.link:
            self._arrived(self.found[0])
        while active := [one for one in self.found if one.outcome is None]:
            for one in active:
                self._advance(one)
            self._drop_same([one for one in active if one.outcome is None])
            for one in active:
                self._judge(one)
        return self.found

    def _arrived(self, one: Found) -> None:
        self.best = min(self.best, self.arrive(one) / self.layout.step)

    def _advance(self, one: Found) -> None:
        chain = one.chain
        before = chain.passes
        event, body = prolong(chain, self.layout.world, self.gains, self.settings.graze, _MOST_PASSES)
        self.work += float(chain.passes - before) * chain.n
        if event is Event.REACHED:
            self._arrived(one)
        elif event is Event.PINNED:
            one.outcome = CandidateOutcome.STRETCHED
            one.reason = "bodies overtake the candidate or hold it up: links far too long or short"
        elif event is Event.LEFT:
            chain.leave()
        elif event is Event.MET:
            self._turn(one, body, chain.side)
        elif event is Event.HIT and body == chain.left:
            chain.followed, chain.side, chain.since = body, chain.left_side, chain.n
        elif event is Event.HIT:
            self._fork(one, body)

    def _fork(self, one: Found, body: int) -> None:
        """R1 -> R2 in both directions, the one nearer to the direction of the target first."""
        chain = one.chain
        x, y = chain.points[chain.n]
        _, nx, ny = distance(self.layout.world, body, chain.n, x, y)
        gx, gy = self.layout.world.ends[1] - chain.points[chain.n]
        along = gx * ny - gy * nx
        if abs(along) > 1e-9 * math.hypot(gx, gy):
            side = 1 if along > 0.0 else -1
        else:
            side = 1 if self.rng.random() < 0.5 else -1
        if len(self.found) < self.settings.candidates:
            twin = Found(chain.copy())
            self.found.append(twin)
            self._turn(twin, body, -side)
        self._turn(one, body, side)

    def _turn(self, one: Found, body: int, side: int) -> None:
        one.chain.follow(body, side)
        if one.chain.turns in self.seen:
            one.outcome = CandidateOutcome.DUPLICATE
            one.reason = "another candidate makes the same turns around the same bodies"
        self.seen.add(one.chain.turns)

    def _drop_same(self, active: list[Found]) -> None:
        """Drop candidates that have come to the same chain by other turns (C2-9)."""
        if len(active) < 2:
            return
        near = _SAME * self.layout.link
        ends = np.array([one.chain.points[one.chain.n] for one in active])
        apart = np.abs(ends[:, None] - ends).max(axis=-1)
        for i, j in np.argwhere(np.triu(apart < near, 1)):
            first, second = active[i], active[j]
            if second.outcome is None and _is_same(first.chain, second.chain, near):
                second.outcome = CandidateOutcome.DUPLICATE
                second.reason = "another candidate has come to the same points"

    def _least_links(self, chain: Chain) -> float:
        gap = math.dist(chain.points[chain.n], self.layout.world.ends[1])
        return chain.n + gap / self.layout.link

    def _judge(self, one: Found) -> None:
        """End a candidate that has become too long, or too long beside another one."""
        if one.outcome is not None:
            return
        chain, layout = one.chain, self.layout
        length = chain.n * layout.link
        following = chain.followed >= 0 and chain.n - chain.since
        if self._least_links(chain) > _PATIENCE * self.best:
            one.outcome = CandidateOutcome.DOMINATED
            one.reason = f"after {length:.2f} m it cannot be as short as another one"
        elif following and following * layout.link > _ROUNDS * layout.perimeters[chain.followed]:
            one.outcome = CandidateOutcome.TOO_LONG
            one.reason = f"it has gone around {layout.names[chain.followed]} without getting past"
        elif self.work > (_WORK if math.isinf(self.best) else _ENOUGH_WORK):
            one.outcome = CandidateOutcome.DOMINATED if self.best < math.inf else CandidateOutcome.TOO_LONG
            one.reason = f"after {length:.2f} m all candidates together have taken as much work as they may"
        elif chain.n + 1 >= layout.most_points:
            one.outcome = CandidateOutcome.TOO_LONG
            one.reason = f"the target is not reached after {length:.2f} m"


def _is_same(one: Chain, other: Chain, near: float) -> bool:
    """Whether two chains of the same number of points are nowhere farther apart and in the same mode."""
    same_mode = one.followed == other.followed and (one.followed < 0 or one.side == other.side)
    return same_mode and bool(np.abs(one.chain - other.chain).max() < near)
