"""Prolonging of one candidate, point by point, with the modes R1 and R2 of its end (Ch. 2, B1-B3)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numba
import numpy as np

from snnav_core.planning.spacetime_bodies import cuts, demanded, distance, touched
from snnav_core.planning.spacetime_kernel import Gains, World, longest_and_shortest, relax
from snnav_core.types import FloatArray

__all__ = ["TARGET", "Chain", "Event", "prolong"]

TARGET = -1
"""What is followed in mode R1: no body but the target."""

_CONTACT = 0.02  # of the link length: nearer than this a body is touched
_INTO = 0.1  # sine of the angle at which following one body leads into another one
_LONG, _SHORT, _STRIKES = 1.25, 0.4, 5  # links beyond these shares of L for so many points: pinned, held up


class Event(IntEnum):
    """What happened when a point was added."""

    NOTHING = 0
    HIT = 1  # R1: a body is between the end and the target
    LEFT = 2  # R2: the followed body no longer is
    MET = 3  # R2: following the body leads into another one
    REACHED = 4  # B3
    PINNED = 5  # what moves stretches links more and more, or holds the end up (C0-11)


@dataclass
class Chain:
    """A candidate under way: points p_0 .. p_n with their velocities, and the mode of its end.

    Parameters
    ----------
    points : ndarray, shape (room, 2)
        The first n + 1 are in use [m, map].
    n : int
    velocity : ndarray, shape (room, 2)
    rest : ndarray, shape (room,)
        Rest length of the link that ends at each point [m].
    followed, side : int
        Number of the body that is followed in R2 (`TARGET` in R1), and gamma.
    left, left_side : int
        The body followed last, as long as the end has not gone clear of it, and its gamma.
    turns : tuple of (int, int)
        Body and gamma of every R1 -> R2.
    since : int
        n when R2 began.
    strikes, passes : int
        Points in a row with a link far too long or short, passes so far.
    """

    points: FloatArray
    n: int
    velocity: FloatArray
    rest: FloatArray
    followed: int = TARGET
    side: int = 1
    left: int = TARGET
    left_side: int = 1
    turns: tuple[tuple[int, int], ...] = ()
    since: int = 0
    strikes: int = 0
    passes: int = 0
    memory: FloatArray = field(init=False)
    force: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.memory = np.full((len(self.points), 5), -1.0)
        self.force = np.empty_like(self.points)

    @classmethod
    def begin(cls, start: FloatArray, room: int) -> Chain:
        """A chain of a single point (B1, C1)."""
        points = np.zeros((room, 2))
        points[0] = start
        return cls(points, 0, np.zeros((room, 2)), np.zeros(room))

    @classmethod
    def along(cls, points: FloatArray, rest_length: float, spare: int) -> Chain:
        """A chain through given points (n + 1, 2), with room for so many more."""
        room = len(points) + spare
        filled = np.zeros((room, 2))
        filled[: len(points)] = points
        return cls(filled, len(points) - 1, np.zeros((room, 2)), np.full(room, rest_length))

    @property
    def chain(self) -> FloatArray:
        """p_0 .. p_n, shape (n + 1, 2) [m, map]."""
        return self.points[: self.n + 1]

    def copy(self) -> Chain:
        """A second candidate with the same points (C2.1)."""
        return Chain(
            self.points.copy(),
            self.n,
            self.velocity.copy(),
            self.rest.copy(),
            self.followed,
            self.side,
            self.left,
            self.left_side,
            self.turns,
            self.since,
            self.strikes,
            self.passes,
        )

    def follow(self, body: int, side: int) -> None:
        """R1 -> R2."""
        self.followed, self.side, self.since = body, side, self.n
        self.turns = (*self.turns, (body, side))

    def leave(self) -> None:
        """R2 -> R1."""
        self.left, self.left_side = self.followed, self.side
        self.followed = TARGET

    def relax(self, world: World, gains: Gains, most: int, first: int = 1) -> bool:
        """A1-A3; whether the points rest."""
        passes, rests = relax(
            world,
            first,
            self.n,
            self.points,
            self.velocity,
            self.force,
            self.rest,
            self.memory,
            self.followed,
            self.side,
            gains,
            most,
        )
        self.passes += int(passes)
        return bool(rests)


def prolong(chain: Chain, world: World, gains: Gains, graze: float, most: int) -> tuple[Event, int]:
    """Add one point, adjust, and see whether the mode has to change (Ch. 2, B2.1-B3).

    Parameters
    ----------
    chain : Chain
        Changed in place; its mode is left to the caller, who knows of the other candidates. It must have room.
    world : World
    gains : Gains
    graze : float
        eps of C2-4 and C2-5 as a share of the planning distance.
    most : int
        Passes for this point. A chain that does not rest until then goes on: it has to rest at the end.

    Returns
    -------
    event : Event
    body : int
        The body that was hit or met; else -1.

    Notes
    -----
    Deviations: in R2 the new point is put ahead along the body and not towards the target, into the body; a body is
    hit only when it is between the end and the target (C2-4), and left as soon as it is not (C2-5), both up to
    `graze`; where margins overlap, the way along a body goes on along the next one, in the same direction.
    """
    event, body, passes, left, strikes = _prolong(
        world,
        chain.n,
        chain.points,
        chain.velocity,
        chain.force,
        chain.rest,
        chain.memory,
        (chain.followed, chain.side, chain.left, chain.strikes),
        gains,
        graze,
        most,
    )
    chain.n += 1
    chain.passes += int(passes)
    chain.left, chain.strikes = int(left), int(strikes)
    return Event(event), int(body)


@numba.njit(cache=True, nogil=True)
def _prolong(world, n, p, velocity, force, rest, memory, mode, gains, graze, most):  # type: ignore[no-untyped-def]
    followed, side, left, strikes = mode
    n = _add_point(world, n, p, velocity, rest, memory, followed, side, gains)
    passes, _ = relax(world, 1, n, p, velocity, force, rest, memory, followed, side, gains, most)
    x, y = p[n, 0], p[n, 1]
    tx, ty = world.ends[1, 0], world.ends[1, 1]
    longest, shortest = longest_and_shortest(p, n)
    uneven = longest > _LONG * gains.link or shortest < _SHORT * gains.link
    strikes = strikes + 1 if uneven else 0
    if strikes >= _STRIKES:
        return 5, -1, passes, left, strikes
    if (x - tx) * (x - tx) + (y - ty) * (y - ty) < gains.link * gains.link:
        return 4, -1, passes, left, strikes
    if left >= 0:
        rho, _, _ = distance(world, left, n, x, y)
        if rho > demanded(world.kept, world.ends, left, x, y) + gains.link:
            left = -1
    contact = _CONTACT * gains.link
    if followed < 0:
        body = touched(world, n, x, y, contact, -1)
        if body >= 0 and cuts(world, body, n, x, y, tx, ty, graze):
            return 1, body, passes, left, strikes
        return 0, -1, passes, left, strikes
    body = touched(world, n, x, y, contact, followed)
    if not cuts(world, followed, n, x, y, tx, ty, graze):
        if body >= 0 and cuts(world, body, n, x, y, tx, ty, graze):
            return 3, body, passes, left, strikes
        return 2, -1, passes, left, strikes
    if body >= 0:
        _, nx, ny = distance(world, followed, n, x, y)
        _, mx, my = distance(world, body, n, x, y)
        if side * (ny * mx - nx * my) < -_INTO:
            return 3, body, passes, left, strikes
    return 0, -1, passes, left, strikes


@numba.njit(cache=True, nogil=True)
def _add_point(world, n, p, velocity, rest, memory, followed, side, gains):  # type: ignore[no-untyped-def]
    """B2.1: the next point, L ahead; returns its number."""
    x, y = p[n, 0], p[n, 1]
    dx, dy = world.ends[1, 0] - x, world.ends[1, 1] - y
    if followed >= 0:
        _, nx, ny = distance(world, followed, n, x, y)
        dx, dy = side * ny, -side * nx
    scale = gains.link / max(math.sqrt(dx * dx + dy * dy), 1e-12)
    n += 1
    p[n, 0], p[n, 1] = x + scale * dx, y + scale * dy
    velocity[n, 0], velocity[n, 1] = 0.0, 0.0
    rest[n] = gains.link - gains.pull / gains.interval
    memory[n, 2], memory[n, 3] = -1.0, -1.0
    return n
