"""Choose starts and targets of robots at random inside a connected component of the reduced area."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from snnav_core.types import FloatArray
from snnav_ros.bag.errors import NetworkError
from snnav_ros.bag.settings import NetworkSettings
from snnav_sim.scene import RobotScene

__all__ = ["LEAST_ROUTE", "Route", "pick_routes", "robots_on_routes"]

LEAST_ROUTE = 10.0
"""Start and target lie at least this far apart when the component allows it [m]."""

_BATCH = 256
_BATCHES = 40


@dataclass(frozen=True, slots=True)
class Route:
    """Start [m, map], heading there [rad, map] and target [m, map] of one robot."""

    start: tuple[float, float]
    heading: float
    target: tuple[float, float]

    @property
    def distance(self) -> float:
        """Straight distance from start to target [m]."""
        return math.dist(self.start, self.target)


def pick_routes(
    component: shapely.Polygon, count: int, generator: np.random.Generator, separation: float
) -> list[Route]:
    """Choose routes at random.

    Parameters
    ----------
    component : shapely.Polygon
        Where a robot's centre may be [m, map].
    count : int
        Number of robots.
    generator : numpy.random.Generator
    separation : float
        Least distance between any two starts, and between any two targets [m].

    Returns
    -------
    list of Route
        Coordinates in whole mm, inside the component; the heading at the start is random.

    Raises
    ------
    NetworkError
        If the component has no room for so many robots.
    """
    starts: list[tuple[float, float]] = []
    targets: list[tuple[float, float]] = []
    routes = []
    for index in range(count):
        start, target = _pair(component, generator, starts, targets, separation, index)
        starts.append(start)
        targets.append(target)
        heading = math.radians(round(generator.uniform(-180.0, 180.0), 1))
        routes.append(Route(start, heading, target))
    return routes


def robots_on_routes(routes: Sequence[Route], settings: NetworkSettings) -> tuple[RobotScene, ...]:
    """Return one robot for every route."""
    return tuple(
        RobotScene(
            id=f"robot_{index}",
            start=route.start,
            heading=route.heading,
            target=route.target,
            speed=settings.speed,
            max_turn_rate=settings.max_turn_rate,
            radius=settings.radius,
        )
        for index, route in enumerate(routes, start=1)
    )


def _pair(
    component: shapely.Polygon,
    generator: np.random.Generator,
    starts: list[tuple[float, float]],
    targets: list[tuple[float, float]],
    separation: float,
    index: int,
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the first pair far enough apart, or the farthest of all tried."""
    best: tuple[float, tuple[float, float], tuple[float, float]] | None = None
    for _ in range(_BATCHES):
        points = _inside(component, generator)
        half = len(points) // 2
        for start, target in zip(points[:half].tolist(), points[half : 2 * half].tolist(), strict=True):
            if not (_clear(start, starts, separation) and _clear(target, targets, separation)):
                continue
            distance = math.dist(start, target)
            if best is None or distance > best[0]:
                best = (distance, (start[0], start[1]), (target[0], target[1]))
            if best[0] >= LEAST_ROUTE:
                return best[1], best[2]
    if best is None:
        raise NetworkError(
            f"no room for robot {index + 1} in the largest part of the reduced area ({component.area:.1f} m2); "
            "ask for fewer robots or a smaller safety margin"
        )
    return best[1], best[2]


def _inside(component: shapely.Polygon, generator: np.random.Generator) -> FloatArray:
    """Return random points of the component in whole mm, shape (N, 2), N <= _BATCH."""
    low, high = np.array(component.bounds[:2]), np.array(component.bounds[2:])
    points = np.round(generator.uniform(low, high, size=(_BATCH, 2)), 3)
    inside: NDArray[np.bool_] = shapely.contains_xy(component, points)
    return points[inside]


def _clear(point: Sequence[float], others: list[tuple[float, float]], separation: float) -> bool:
    return all(math.dist(point, other) >= separation for other in others)
