"""What stays provably free although it is no longer seen (deviation C3-5)."""

from __future__ import annotations

import math

import shapely
from shapely.geometry import MultiPolygon
from shapely.geometry.base import BaseGeometry

from snnav_core.area.overlay import union
from snnav_core.area.planar import as_multipolygon, shrink
from snnav_core.errors import InvalidInput

__all__ = ["remember"]

# With more vertices than this many times those of the current region, plus some, the remembered part is simplified.
_VERTEX_FACTOR = 2
_VERTEX_BASE = 2000
_FIRST_TOLERANCE = (
    0.125  # of elapsed * boundary_speed; taken four times larger until the vertices are few enough
)


def remember(
    previous_region: BaseGeometry, current_region: BaseGeometry, elapsed: float, boundary_speed: float
) -> MultiPolygon:
    """Unite what is seen free now with what was free before and cannot have been reached since.

    A_mem(t) = A(t) united with R[A_mem(t - elapsed), elapsed * boundary_speed].

    Parameters
    ----------
    previous_region : shapely geometry
        What was known to be free [m, map], `elapsed` ago.
    current_region : shapely geometry
        What is seen to be free now [m, map].
    elapsed : float
        Time since the previous region [s].
    boundary_speed : float
        V_max: no obstacle is faster [m/s]. At 0 everything is kept.

    Returns
    -------
    shapely.MultiPolygon
        Holds the current region; every other point of it lies at least elapsed * boundary_speed inside the previous
        one (and up to 1.1 % more: arcs are replaced by chords on the safe side).

    Raises
    ------
    InvalidInput
        If the elapsed time or the speed is negative or not finite. After a jump of time start from the current region.

    Notes
    -----
    Deviation (C3-5): Ch. 3 uses A(t) alone and assumes that its boundary moves at most at V_max. A bound on the speed
    of obstacles does not bound the shadow behind them; with this memory it does.

    Noise on the ranges leaves thin remembered strips along every wall, which pile up when elapsed * boundary_speed is
    below the noise. Beyond a number of vertices the remembered part is simplified inwards: less free space, never more.
    """
    for name, value, unit in (("elapsed", elapsed, "s"), ("boundary_speed", boundary_speed, "m/s")):
        if not (math.isfinite(value) and value >= 0.0):
            raise InvalidInput(
                f"{name} is {value} {unit}, must be a number >= 0; reset the memory after a jump of time"
            )
    reach = elapsed * boundary_speed
    united = as_multipolygon(union(current_region, shrink(previous_region, reach)))
    limit = _VERTEX_FACTOR * shapely.get_num_coordinates(current_region) + _VERTEX_BASE
    tolerance = _FIRST_TOLERANCE * reach
    while tolerance > 0.0 and shapely.get_num_coordinates(united) > limit:
        # simplification moves the outline by up to twice its tolerance (at the start of a ring)
        kept = shapely.simplify(shrink(previous_region, reach + 2.0 * tolerance), tolerance)
        united = as_multipolygon(union(current_region, kept))
        tolerance *= 4.0
    return united
