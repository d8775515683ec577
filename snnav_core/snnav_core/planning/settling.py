"""The last adjustment of a candidate: to rest, links of equal length, the end at the target."""

from __future__ import annotations

import math

import numpy as np

from snnav_core.planning.adjustment import AdjustmentSettings
from snnav_core.planning.prolonging import TARGET, Chain
from snnav_core.planning.spacetime_kernel import Gains, World, longest_and_shortest
from snnav_core.types import FloatArray

__all__ = ["fine_gains", "settle", "with_target"]

_PULL = 0.1  # G_P as a share of L
_DAMPING, _MOST_DAMPING = (
    2.0,
    0.02,
)  # 1 - G_N, per point and at most: long chains come to rest faster with less
_FINE = 0.003  # rest threshold as a share of G_P
_CORRECTION = 0.5  # of what a link is too long, per pass, as a share of 1 - G_N; below 1
_STIFFNESS = 0.1  # against bends below the turning radius; 4 G_I + 16 times this stays below 2 (1 + G_N)
_HOPELESS, _TORN = 1200, 1.08  # passes after which no link may be longer than this share of L
_PASSES = 40  # before the end is looked at
_TINY_END = 0.005  # of the link length: a shorter last link is left out


def fine_gains(link: float, radius: float, points: int, settings: AdjustmentSettings) -> Gains:
    """Constants of the last adjustment: all links come to the length L, no bend is below a radius [m].

    For a chain of so many points.
    """
    pull = _PULL * link
    damping = min(_DAMPING / max(points, 1), _MOST_DAMPING)
    threshold = _FINE * pull
    return Gains(
        link,
        pull,
        settings.interval_gain,
        settings.barrier_gain,
        1.0 - damping,
        threshold,
        threshold / damping,
        _CORRECTION * damping,
        _STIFFNESS,
        link * link / radius,
    )


def settle(chain: Chain, world: World, gains: Gains, settings: AdjustmentSettings, most: int) -> bool:
    """Adjust a chain to rest while points are added to its end or removed from it (A1-A3 with the rule of C0-13).

    Parameters
    ----------
    chain : Chain
        Changed in place.
    world : World
    gains : Gains
    settings : AdjustmentSettings
    most : int
        Passes.

    Returns
    -------
    bool
        Whether the points rest, the last one within L of the target.
    """
    chain.followed = TARGET
    chain.rest[:] = gains.link - gains.pull / gains.interval
    target = world.ends[1]
    limit, rests, gap = chain.passes + most, False, math.inf
    hopeless = chain.passes + _HOPELESS
    while chain.passes < limit and not rests:
        if chain.passes > hopeless and longest_and_shortest(chain.points, chain.n)[0] > _TORN * gains.link:
            return False
        rests = chain.relax(world, gains, _PASSES)
        gap = math.dist(chain.points[chain.n], target) / gains.link
        if gap > settings.longest_end and chain.n + 2 < len(chain.points):
            _add(chain, target, gains)
            rests = False
        elif gap < settings.shortest_end and chain.n > 1:
            chain.n -= 1
            rests = False
    if 1.0 < gap <= settings.longest_end:
        _add(chain, target, gains)
    return rests


def _add(chain: Chain, target: FloatArray, gains: Gains) -> None:
    last = chain.points[chain.n]
    gap = target - last
    chain.n += 1
    chain.points[chain.n] = last + gap * (gains.link / float(np.hypot(*gap)))
    chain.velocity[chain.n] = 0.0
    chain.rest[chain.n] = gains.link - gains.pull / gains.interval
    chain.memory[chain.n, 2:4] = -1.0


def with_target(chain: Chain, target: FloatArray, link: float) -> FloatArray:
    """The points of a settled chain and the target, shape (n + 2, 2); without p_n when it is the target already."""
    points: FloatArray = chain.chain.copy()
    if len(points) > 1 and math.dist(points[-1], target) <= _TINY_END * link:
        points[-1] = target
        return points
    return np.vstack((points, target))
