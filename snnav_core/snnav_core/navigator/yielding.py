"""Who makes room for whom, and where it waits."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely

from snnav_core.navigator.places import Claim, Place, PlaceSearch
from snnav_core.navigator.precedence import Precedence
from snnav_core.navigator.ways import Party, Way, Ways
from snnav_core.types import FloatArray

__all__ = ["Order", "Yielding"]

_LATE = 1.0  # [s] that a robot may be later than its way says when one is asked to wait
_PASSED = 3.0  # [s] that it may be later before one that waits goes on
_SLACK = 0.05  # [m] that a place to wait is farther from a way than it must be, beyond how exact arrival is
_SOONER = 4  # ticks; who is so much sooner at a narrow place goes first, else who has precedence
_PREFERRED = 3.0  # [m] of detour that are worth keeping precedence
_BLOCKED = 2  # decisions in a row after which a blocked robot makes others move
_RETRY = 6  # decisions after which somebody who found no place looks again
_ATTEMPTS = 3  # places farther and farther off the claim
_SEARCHES = 1  # places that are looked for in one step in a crowd; others are asked in the next one
_NEAR = 2.0  # times the distance to keep; within it somebody who is blocked looks for who blocks it


@dataclass(frozen=True)
class Order:
    """One robot makes room for others.

    Parameters
    ----------
    whom : tuple of str
        Who shall pass; the first is the one that asked.
    place : ndarray, shape (2,)
        Where it waits [m, map].
    anywhere : bool
        It was in the way, not only to meet somebody at a narrow place later.
    reached : bool
        It has been there.
    attempt : int
        Places tried before this one.
    """

    whom: tuple[str, ...]
    place: FloatArray
    anywhere: bool
    reached: bool = False
    attempt: int = 0


class Yielding:
    """Keeps who waits for whom from step to step."""

    def __init__(self) -> None:
        self.orders: dict[str, Order] = {}
        self._refused: dict[tuple[str, str], int] = {}
        self._texts: dict[str, str] = {}
        self._ways: Ways
        self.sought = 0  # places that were looked for in this step

    @property
    def waits_for(self) -> dict[str, tuple[str, ...]]:
        """Robot id -> those that it lets pass."""
        return {name: order.whom for name, order in self.orders.items()}

    def text(self, name: str) -> str:
        """Why a blocked robot cannot be helped; empty when nothing is known."""
        return self._texts.get(name, "")

    def rests(self, name: str) -> bool:
        """Whether a robot is where it waits."""
        return name in self.orders and self.orders[name].reached

    def forget(self, name: str) -> None:
        """Take back what was asked of a robot."""
        self.orders.pop(name, None)

    def clear(self) -> None:
        """Take back everything that was asked."""
        self.orders.clear()
        self._texts.clear()

    def reach(self, name: str) -> None:
        """Note that a robot is where it waits."""
        self.orders[name] = replace(self.orders[name], reached=True)

    def update(self, ways: Ways, precedence: Precedence, blocked: Mapping[str, int]) -> None:
        """Decide who makes room in this step.

        Parameters
        ----------
        ways : Ways
        precedence : Precedence
        blocked : mapping
            Robot id -> decisions in a row in which it could not go on.
        """
        self._ways = ways
        self._texts.clear()
        self.sought = 0
        self._refused = {pair: left - 1 for pair, left in self._refused.items() if left > 1}
        self._release()
        names = [name for name in precedence.order if name in ways.parties]
        self._meet(names)
        self._untie(names, precedence, blocked)

    # -- going on ---------------------------------------------------------------------------------------------------

    def _release(self) -> None:
        """Let go on who need not wait any longer."""
        for name in list(self.orders):
            order, party = self.orders[name], self._ways.parties.get(name)
            if party is None or party.goal is None:
                self.forget(name)
                continue
            whom = tuple(other for other in order.whom if self._comes(other, name, order))
            if whom:
                self.orders[name] = replace(order, whom=whom)
            else:
                self.forget(name)

    def _comes(self, other: str, name: str, order: Order) -> bool:
        """Whether a robot still has to pass one that waits for it."""
        party, waiting = self._ways.parties.get(other), self._ways.parties[name]
        if party is None or party.goal is None or (party.arrived and other not in self.orders):
            return False
        way, own = self._next(other), self._ways.shortest(name, _goal(waiting))
        if way is None or own is None:
            return False
        if order.anywhere:
            gaps = np.linalg.norm(way.points - own.points[-1], axis=1)
            if len(own) < len(way) and gaps[len(own) :].min() < self._ways.need(other, name):
                return True
        return self._ways.meeting((other, way), (name, own), _PASSED, order.anywhere) is not None

    def _next(self, name: str) -> Way | None:
        """Where a robot goes now: to its place, or to its goal."""
        if name in self.orders:
            return self._ways.shortest(name, self.orders[name].place)
        return self._ways.to_goal(name)

    # -- in time ----------------------------------------------------------------------------------------------------

    def _meet(self, names: list[str]) -> None:
        """Two that will meet where there is no room for both: one waits before it gets there."""
        ways: dict[str, Way] = {}
        for name in names:
            party = self._ways.parties[name]
            if name in self.orders or party.goal is None or party.arrived:
                continue
            way = self._ways.to_goal(name)
            if way is not None:
                ways[name] = way
        for first, second, meeting in self._ways.meetings(ways, _LATE):
            if self._is_spent():
                break
            if first not in self.orders and second not in self.orders:
                self._give_way(first, ways[first], meeting.first, second, ways[second], meeting.second)

    def _give_way(self, first: str, one: Way, here: int, second: str, other: Way, there: int) -> None:
        """Ask one of two who will meet to wait; `first` has precedence."""
        begin, _ = one.stretch(here)
        start, _ = other.stretch(there)
        inside_first = begin == 0 and bool(one.narrow[0])
        inside_second = start == 0 and bool(other.narrow[0])
        if inside_second and not inside_first:
            later = (first, second)
        elif inside_first and not inside_second:
            later = (second, first)
        else:
            later = (first, second) if start + _SOONER < begin else (second, first)
        options = []
        for rank, name in enumerate(later):
            whom = first if name == second else second
            way, entry, against = (one, begin, other) if name == first else (other, start, one)
            place = self._wait_on_way(name, way, entry, whom, against.points)
            found = Place(place, 0.0) if place is not None else self._place(name, (whom,))
            if found is not None:
                options.append((found.cost + rank * _PREFERRED, rank, name, whom, found.point))
        if options:
            _, _, name, whom, place = min(options, key=lambda option: option[:2])
            self.orders[name] = Order((whom,), place, anywhere=False)

    def _wait_on_way(
        self, name: str, way: Way, entry: int, whom: str, against: FloatArray
    ) -> FloatArray | None:
        """The last point of a way before it enters what another one needs, (2,) [m, map]; None without any."""
        party = self._ways.parties[name]
        if not party.served:
            return None
        need = self._ways.need(name, whom) + party.distances.arrival + _SLACK
        gaps = np.linalg.norm(way.points[: entry + 1, None] - against[None], axis=2).min(axis=1)
        taken = np.flatnonzero(gaps < need)
        last = int(taken[0]) - 1 if len(taken) else entry
        clearance = self._ways.context.area.clearance(way.points[: last + 1])
        for tick in range(last, -1, -1):
            point = way.points[tick]
            enough = clearance[tick] >= 1.012 * party.distances.tightest or tick == 0
            if enough and self._is_free(name, point):
                return np.asarray(point)
        return None

    def _is_free(self, name: str, point: FloatArray) -> bool:
        """Whether nobody else stands or will wait at a place."""
        for other, party in self._ways.parties.items():
            if other == name:
                continue
            need = self._ways.need(name, other)
            spots = [self.orders[other].place] if other in self.orders else []
            if other in self.orders or party.goal is None or party.arrived:
                spots.append(party.position)
            if any(float(np.linalg.norm(spot - point)) < need + _SLACK for spot in spots):
                return False
        return True

    # -- in the way -------------------------------------------------------------------------------------------------

    def _untie(self, names: list[str], precedence: Precedence, blocked: Mapping[str, int]) -> None:
        """Find who blocks whom, and make somebody move where all wait for each other."""
        blockers = {name: self._blocker(name) for name in names if blocked.get(name, 0) >= _BLOCKED}
        for name in names:
            if self._is_spent():
                break
            if blockers.get(name) is None:
                continue
            chain = [name]
            while True:
                following = self._waits(chain[-1], blockers)
                if following is None or following in chain:
                    break
                chain.append(following)
            last = chain[-1]
            if following is not None:
                chain = [*chain[chain.index(following) :], following]
            elif not self._stands(last):
                continue
            edges = [(one, other) for one, other in itertools.pairwise(chain) if blockers.get(one) == other]
            if following is None:
                edges = edges[-1:]
            edges.sort(key=lambda edge: precedence.rank(edge[0]))
            if not any(self._ask(other, one, anywhere=True) for one, other in edges):
                for one, other in edges:
                    self._texts[one] = self._explain(one, other)

    def _is_spent(self) -> bool:
        """Whether as many places were looked for in this step as in a crowd there may be."""
        return self._ways.context.grain > 0.0 and self.sought >= _SEARCHES

    def _waits(self, name: str, blockers: Mapping[str, str | None]) -> str | None:
        """For whom a robot waits now; None for one that moves or waits for nobody."""
        blocker = blockers.get(name)
        if blocker is not None:
            return blocker
        order = self.orders.get(name)
        return order.whom[0] if order is not None and order.reached else None

    def _stands(self, name: str) -> bool:
        """Whether a robot does not want to move, or has no way to its goal."""
        party = self._ways.parties[name]
        if party.goal is None or (party.arrived and name not in self.orders):
            return True
        return party.plan is None and self._ways.to_goal(name) is None

    def _blocker(self, name: str) -> str | None:
        """Who stands or drives first in the way of a robot."""
        way = self._next(name)
        party = self._ways.parties[name]
        found: list[tuple[int, float, str]] = []
        for other, another in self._ways.parties.items():
            if other == name:
                continue
            need = self._ways.need(name, other)
            if way is not None:
                gaps = np.linalg.norm(way.points - another.position, axis=1)
                near = np.flatnonzero(gaps < need + 2.0 * _SLACK)
                if len(near):
                    found.append((int(near[0]), float(gaps[0]), other))
                    continue
            gap = float(np.linalg.norm(another.position - party.position))
            if gap < _NEAR * need:
                found.append((10**6, gap, other))
        return min(found)[2] if found else None

    def _ask(self, name: str, whom: str, anywhere: bool) -> bool:
        """Make a robot go out of the way of another one; whether it finds a place."""
        party = self._ways.parties[name]
        if party.goal is None or not party.served or (name, whom) in self._refused:
            return False
        if party.arrived and self._wants_same(name, whom):
            return False
        order = self.orders.get(name)
        attempt = 0
        if order is not None and whom in order.whom:
            if not order.reached and anywhere == order.anywhere:
                return False
            attempt = order.attempt + 1
            if attempt > _ATTEMPTS:
                self.forget(name)
                self._refused[name, whom] = _RETRY
                return False
        asking = [whom, *(self.orders[whom].whom if whom in self.orders else ())]
        asking += list(order.whom) if order is not None else []
        everybody = tuple(dict.fromkeys(other for other in asking if other != name))
        place = self._place(name, everybody, 1 + attempt)
        if place is None:
            self._refused[name, whom] = _RETRY
            return False
        self.orders[name] = Order(everybody, place.point, anywhere, attempt=attempt)
        return True

    def _place(self, name: str, whom: tuple[str, ...], farther: int = 1) -> Place | None:
        """The nearest place off the ways of others."""
        ways, party = self._ways, self._ways.parties[name]
        if not party.served:
            return None
        slack = farther * (party.distances.arrival + _SLACK)
        claims, avoid, fixed, later = [], [], [], []
        for other, another in ways.parties.items():
            if other == name:
                continue
            need = ways.need(name, other)
            spot = shapely.points(another.position)
            way = self._next(other)
            if other in whom:
                claims.append(Claim(spot if way is None else way.line, need + slack))
                if another.goal is not None and not self._wants_same(name, other):
                    later.append((*another.goal.tolist(), need))
            elif other in self.orders:
                claims.append(Claim(shapely.points(self.orders[other].place), need + slack))
            elif way is not None and not another.arrived:
                avoid.append(Claim(way.line, need))
            if other in whom or another.goal is None or not another.served:
                gap = float(np.linalg.norm(another.position - party.position))
                fixed.append((*another.position.tolist(), min(need, 0.98 * gap - 1e-3)))
            else:
                avoid.append(Claim(spot, need))
        self.sought += 1
        search = PlaceSearch(ways.context, party.position, party.distances, _goal(party))
        return search.nearest(tuple(fixed), tuple(later), claims, avoid)

    def _wants_same(self, name: str, whom: str) -> bool:
        """Whether two robots cannot both be at their goals."""
        parties = self._ways.parties
        gap = float(np.linalg.norm(_goal(parties[name]) - _goal(parties[whom])))
        reached = parties[name].distances.arrival + parties[whom].distances.arrival
        return gap < self._ways.need(name, whom) - reached

    def _explain(self, name: str, by: str) -> str:
        party = self._ways.parties[by]
        x, y = party.position.tolist()
        if party.goal is None:
            return f"robot {by} stands in its way at ({x:.2f}, {y:.2f}) and has no goal; give it one"
        if party.arrived and self._wants_same(by, name):
            return (
                f"robot {by} has arrived at ({x:.2f}, {y:.2f}), too near to the target of robot {name}; "
                "give one of them another"
            )
        return f"robot {by} stands in its way at ({x:.2f}, {y:.2f}) and finds no place to make room"


def _goal(party: Party) -> FloatArray:
    assert party.goal is not None
    return party.goal
