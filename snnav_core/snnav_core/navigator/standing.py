"""Robots that stand: the disks that ways lead around, and who of them is in the way."""

from __future__ import annotations

import numpy as np
import shapely

from snnav_core.navigator.attempt import Attempt
from snnav_core.navigator.context import Disks
from snnav_core.navigator.search import Route, shortest_way

__all__ = ["names_in_the_way", "standing"]

_NAMED = 4  # more names help nobody


def standing(attempt: Attempt, parked: bool) -> Disks:
    """Disks that candidates go around: standing robots, or only those that will not move again.

    With the margin and the reserve; never around this robot.
    """
    clearance = attempt.distances.least + attempt.distances.tolerance + attempt.distances.reserve
    crowd = attempt.crowd
    disks = []
    for index in np.flatnonzero(crowd.stands):
        other, gap = crowd[int(index)], float(crowd.gaps[index])
        if other.parked or not parked:
            x, y = other.path.points[-1, :2]
            # The removed polygon is up to 2 % larger than the disk.
            disks.append((float(x), float(y), min(other.radius + clearance, 0.98 * gap - 1e-3)))
    return tuple(disks)


def names_in_the_way(attempt: Attempt, route: Route) -> str:
    """Who stands on the shortest way of a route that knows no robots, the nearest first, as text.

    All who stand where none of them is on that way: together they close all ways.
    """
    crowd, disks = attempt.crowd, np.array(standing(attempt, parked=False)).reshape(-1, 3)
    who = np.flatnonzero(crowd.stands)
    way = shortest_way(attempt.context, route, attempt.pose)
    if way is not None:
        line = shapely.linestrings(way)
        on_it = shapely.distance(shapely.points(disks[:, :2]), line) <= disks[:, 2]
        who = who[on_it] if on_it.any() else who
    who = who[np.argsort(crowd.gaps[who], kind="stable")]
    names = list(dict.fromkeys(crowd[int(index)].id for index in who))
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more
