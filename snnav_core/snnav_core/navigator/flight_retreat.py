"""Robots that hover in each other's way: the last in order goes aside for a while (C4-11)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import ndimage

from snnav_core.area.spatial import SpatialArea
from snnav_core.flight_types import FlyerState
from snnav_core.navigator.flight_settings import FlightDistances
from snnav_core.types import FloatArray

__all__ = ["Retreats"]

_PLACES = 300  # that are compared
_WIDE = 2.0  # a place is no better for being farther than this from everybody and from their ways [m]
_NEAR = 0.6  # and it has to be so far from where the robot is, at least [m]
_DETOUR = 0.2  # m of distance from others that a metre of way has to bring
_LONGEST = 8.0  # [s] that a robot may take to get there, and that it does not go aside again
_NEAR_OTHERS = 3.0  # [m]; who is blocked farther from others than this is not in their way
_MOST_TIMES = 4  # on the way to one target: then it is told why it hovers


class Retreats:
    """Chooses who goes aside, and to where.

    Parameters
    ----------
    steps : int
        A robot that was blocked in so many steps in a row may be sent aside.
    seed : int
        Of the places that are compared.

    Notes
    -----
    Not in the thesis. Two robots that hover before the same hole wait for each other for ever, and hide from the
    cameras what is behind them. Only one of those that are blocked goes at a time, never the first in order unless it
    hovers where another one wants to.
    """

    def __init__(self, steps: int, seed: int) -> None:
        self._steps, self._seed = steps, seed
        self._places: dict[str, FloatArray] = {}
        self._until: dict[str, float] = {}  # when it has to be there, and does not go aside before
        self._times: dict[str, int] = {}  # that it went aside on the way to one target
        self._targets: dict[str, FloatArray] = {}

    def forget(self, name: str) -> None:
        """Let a robot go where it is meant to."""
        self._places.pop(name, None)
        self._until.pop(name, None)
        self._times.pop(name, None)

    def places(
        self,
        time: float,
        area: SpatialArea,
        order: Sequence[str],
        states: Mapping[str, FlyerState],
        goals: Mapping[str, FloatArray],
        blocked: Mapping[str, int],
        distances: Mapping[str, FlightDistances],
    ) -> dict[str, FloatArray]:
        """Return where robots that go aside are to go in this step, (3,) each [m, map].

        Parameters
        ----------
        time : float
            [s]
        area : SpatialArea
        order : sequence of str
            Names by precedence.
        states, goals : mapping
        blocked : mapping
            Number of steps in a row in which a robot hovered without a way.
        distances : mapping
        """
        for name in [*self._places]:
            known = name in states and name in goals
            gap = float(np.linalg.norm(states[name].position - self._places[name])) if known else 0.0
            if gap <= distances[name].arrival or time > self._until[name]:
                del self._places[name]
        for name, goal in goals.items():
            if not np.array_equal(goal, self._targets.get(name, goal)):
                self.forget(name)
        self._targets = {name: goal.copy() for name, goal in goals.items()}
        stuck = [name for name in order if blocked[name] >= self._steps and name in states and name in goals]
        together = [name for name in stuck if _nearest(name, stuck, states) < _NEAR_OTHERS]
        asked = _at_targets(stuck, states, goals, distances) or together[1:]
        free = [
            name
            for name in asked
            if time > self._until.get(name, -np.inf) and self._times.get(name, 0) < _MOST_TIMES
        ]
        if free:
            name = free[-1]
            place = self._choose(name, time, area, states, goals, distances[name])
            self._until[name] = time + _LONGEST
            self._times[name] = self._times.get(name, 0) + 1
            if place is not None:
                self._places[name] = place
        return dict(self._places)

    def _choose(
        self,
        name: str,
        time: float,
        area: SpatialArea,
        states: Mapping[str, FlyerState],
        goals: Mapping[str, FloatArray],
        distances: FlightDistances,
    ) -> FloatArray | None:
        """A place in the same part of the region, far from others, their targets and their ways, and not far away."""
        settings, here = distances.settings, states[name].position
        region = area.reduced(
            distances.planned(area.grid.half_diagonal), settings.boundary_speed * distances.window
        )
        labels, _ = ndimage.label(region, np.ones((3, 3, 3)))
        cells = np.flatnonzero(labels)
        if len(cells) == 0:
            return None
        chosen = cells[
            np.random.default_rng((self._seed, round(time * 1e3))).integers(len(cells), size=_PLACES)
        ]
        centres = area.grid.origin + area.grid.spacing * (
            np.stack(np.unravel_index(chosen, region.shape), axis=-1) + 0.5
        )
        away = np.linalg.norm(centres - here, axis=1)
        score = np.full(len(centres), _WIDE)
        for other, state in states.items():
            if other != name:
                np.minimum(score, _from_way(centres, state.position, goals.get(other)), out=score)
        score -= _DETOUR * away
        score[away < _NEAR] = -np.inf
        # The nearest of the places tells in which part of the region the robot is.
        score[labels.ravel()[chosen] != labels.ravel()[chosen[np.argmin(away)]]] = -np.inf
        best = int(np.argmax(score))
        return centres[best] if np.isfinite(score[best]) else None


def _from_way(points: FloatArray, start: FloatArray, goal: FloatArray | None) -> FloatArray:
    """Distance of points (N, 3) from the straight way of a robot to its target."""
    if goal is None or np.shape(goal) != (3,):
        return np.asarray(np.linalg.norm(points - start, axis=1))
    way = goal - start
    share = np.clip((points - start) @ way / max(float(way @ way), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - share[:, None] * way, axis=1))


def _nearest(name: str, names: Sequence[str], states: Mapping[str, FlyerState]) -> float:
    """Distance from a robot to the nearest other one of some [m]."""
    here = states[name].position
    gaps = [float(np.linalg.norm(states[other].position - here)) for other in names if other != name]
    return min(gaps, default=np.inf)


def _at_targets(
    stuck: Sequence[str],
    states: Mapping[str, FlyerState],
    goals: Mapping[str, FloatArray],
    distances: Mapping[str, FlightDistances],
) -> list[str]:
    """Robots that hover where others of those that are blocked want to."""
    found = []
    for name in stuck:
        apart = 2.0 * distances[name].settings.safety_margin
        gaps = [np.linalg.norm(states[name].position - goals[other]) for other in stuck if other != name]
        if min(gaps, default=np.inf) < apart:
            found.append(name)
    return found
