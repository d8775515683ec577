"""Why a robot gets no path, in words: the place that blocks it, and the silent sensor that used to watch that place."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from snnav_core.area.overlay import difference, intersection, union_all
from snnav_core.area.planar import LostPart, UnoccupiedArea, as_multipolygon
from snnav_core.errors import PlanningError
from snnav_core.navigator.attempt import Attempt
from snnav_core.navigator.context import AreaContext
from snnav_core.navigator.search import Route, find_route
from snnav_core.types import FloatArray, Stop, StopReason

__all__ = ["Explainer"]

_EXPLAINED = (
    StopReason.NO_AREA,
    StopReason.START_BLOCKED,
    StopReason.GOAL_BLOCKED,
    StopReason.GOAL_UNREACHABLE,
    StopReason.NO_PATH,
)
_LEAST_AREA = 1e-4  # [m^2]; less of a lost part beside the way explains nothing


@dataclass(frozen=True)
class _Explanation:
    """What was said of a robot, in which situation, and for how many steps it has been repeated."""

    situation: tuple[object, ...]
    text: str
    repeated: int = 0


class Explainer:
    """Adds to refusals what blocks the way; looks again only when the situation changes or has lasted.

    Parameters
    ----------
    patience : int
        A text is repeated for so many steps before the place is looked up again.

    Notes
    -----
    It decides nothing: a refusal stays one. What silent sensors saw last is taken for free once more; when there is a
    way then, the parts that lie beside it are what is missing.
    """

    def __init__(self, patience: int) -> None:
        self._patience = patience
        self._said: dict[str, _Explanation] = {}
        self._restored: tuple[bytes, tuple[LostPart, ...], AreaContext] | None = None

    def forget(self, robot_id: str) -> None:
        """Forget what was said of a robot that has a path again."""
        self._said.pop(robot_id, None)

    def explain(self, stop: Stop, attempt: Attempt, goal: tuple[float, float]) -> Stop:
        """Return the stop with the explanation added to its message.

        Parameters
        ----------
        stop : Stop
        attempt : Attempt
            Area, robot, pose and distances of the step that refused.
        goal : tuple of float
            [m, map]
        """
        if stop.reason not in _EXPLAINED:
            return stop
        lost = attempt.context.area.lost
        situation = (stop.reason, goal, tuple((part.sensor_id, part.stamp) for part in lost))
        said = self._said.get(stop.robot_id)
        if said is None or said.situation != situation or said.repeated >= self._patience:
            said = _Explanation(situation, self._text(stop, attempt, np.array(goal), lost))
        self._said[stop.robot_id] = replace(said, repeated=said.repeated + 1)
        return replace(stop, message=f"{stop.message}; {said.text}") if said.text else stop

    def _text(self, stop: Stop, attempt: Attempt, goal: FloatArray, lost: tuple[LostPart, ...]) -> str:
        missing = self._missing(stop, attempt, goal, lost)
        never = [part.sensor_id for part in lost if part.stamp is None]
        place = None if stop.reason is StopReason.NO_AREA else _place(stop, attempt, goal)
        texts = []
        if place is not None:
            unseen = "" if missing else ": something is there, or no sensor sees it"
            texts.append(f"blocked at ({place[0]:.2f}, {place[1]:.2f}){unseen}")
        texts.extend(
            f"sensor {part.sensor_id} is silent since {part.stamp:.2f} s, the way needs what it saw"
            for part in missing
        )
        if never:
            texts.append(f"nothing was ever heard of sensor {', '.join(never)}")
        return "; ".join(texts)

    def _missing(
        self, stop: Stop, attempt: Attempt, goal: FloatArray, lost: tuple[LostPart, ...]
    ) -> list[LostPart]:
        """The lost parts without which there is no way."""
        seen = [part for part in lost if part.stamp is not None and not part.region.is_empty]
        if not seen:
            return []
        if stop.reason is StopReason.NO_AREA:
            return seen
        context = self._context(attempt.context, lost)
        try:
            route = find_route(
                context, attempt.robot, attempt.pose, goal, attempt.distances, attempt.settings, ()
            )
        except PlanningError:
            return []
        way = _way(context, route, attempt.pose.position)
        if way is None:
            return seen
        width = route.distance
        if stop.reason is StopReason.NO_PATH:
            width = max(width, float(attempt.distances.demanded()[-1]))
        beside = difference(shapely.buffer(way, width), attempt.context.area.region)
        return [part for part in seen if intersection(beside, part.region).area > _LEAST_AREA]

    def _context(self, present: AreaContext, lost: tuple[LostPart, ...]) -> AreaContext:
        """The area as if silent sensors still saw what they saw last; kept for the robots of one step."""
        if self._restored is None or self._restored[0] != present.digest or self._restored[1] != lost:
            region = union_all([present.area.region, *(part.region for part in lost)])
            area = UnoccupiedArea(present.area.stamp, as_multipolygon(region))
            self._restored = (present.digest, lost, AreaContext(area, present.simplification))
        return self._restored[2]


def _way(context: AreaContext, route: Route, start: FloatArray) -> BaseGeometry | None:
    """Shortest way of a route from the robot (2,) to the target, whatever the heading."""
    entry = start if route.start_inside else route.curves.nearest(start)
    chain = context.goal_tree(route.curves, route.target).from_point(entry)
    return None if chain is None else shapely.linestrings(np.vstack((start, chain)))


def _place(stop: Stop, attempt: Attempt, goal: FloatArray) -> FloatArray | None:
    """Where it is blocked (2,) [m, map]; None when no single place is to blame."""
    region = attempt.context.area.region
    if stop.reason is StopReason.START_BLOCKED:
        return _nearest(shapely.boundary(region), attempt.pose.position)
    if stop.reason is StopReason.GOAL_BLOCKED:
        inside = shapely.intersects_xy(region, goal[0], goal[1])
        return _nearest(shapely.boundary(region), goal) if inside else goal
    parts = shapely.get_parts(attempt.context.region(attempt.distances.tightest, ()))
    if len(parts) < 2:
        return None
    start_part, goal_part = (
        parts[int(np.argmin(shapely.distance(parts, shapely.points(point))))]
        for point in (attempt.pose.position, goal)
    )
    if start_part is goal_part:
        return None
    ends = shapely.get_coordinates(shapely.shortest_line(start_part, goal_part))
    return np.asarray(ends.mean(axis=0))


def _nearest(geometry: BaseGeometry, point: FloatArray) -> FloatArray | None:
    if geometry.is_empty:
        return None
    return np.asarray(shapely.get_coordinates(shapely.shortest_line(geometry, shapely.points(point)))[0])
