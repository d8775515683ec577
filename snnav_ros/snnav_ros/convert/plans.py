"""Plans of the global planner with all their candidates as a visualization_msgs/MarkerArray, to look at and to keep.

The first marker of `candidates` deletes all others. Then come, for every robot, LINE_STRIPs in the namespace of its
name: number 0 the path that was chosen, stamped when it was planned, and one for every candidate. The `text` of each is
JSON with what the line does not say; reading gives the same numbers.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from snnav_core.errors import InvalidInput
from snnav_core.planning.spacetime_problem import Candidate, CandidateOutcome, SpacetimePlan, TravelBound
from snnav_core.types import Certificate, FloatArray, TimedPath
from snnav_ros.available import new_message
from snnav_ros.convert.frames import check_frame
from snnav_ros.convert.markers import delete_all, line_strip
from snnav_ros.convert.stamps import nanoseconds_from_stamp

__all__ = ["plans_from_message", "plans_to_message"]

_CHOSEN = (0.1, 0.6, 0.2, 1.0)
_COLOURS = {
    CandidateOutcome.REACHED: (0.2, 0.4, 0.8, 0.9),
    CandidateOutcome.REFUSED: (0.85, 0.15, 0.15, 0.8),
}
_OTHERS = (0.6, 0.6, 0.6, 0.6)
_WIDTH_CHOSEN, _WIDTH = 0.08, 0.03  # [m]
_DELETE_ALL, _LINE_STRIP = 3, 4  # visualization_msgs/Marker

Plans = dict[str, tuple[int, SpacetimePlan]]
"""Robot id -> when it was planned [ns], and the plan."""


def plans_to_message(plans: Mapping[str, tuple[int, SpacetimePlan]], stamp_ns: int) -> Any:
    """Return the MarkerArray of plans.

    Parameters
    ----------
    plans : mapping
        Robot id -> when it was planned [ns], and the plan.
    stamp_ns : int
        Now [ns].
    """
    markers = [delete_all(stamp_ns)]
    for name, (made, plan) in plans.items():
        markers.append(_path(made, name, plan))
        markers += [_candidate(made, name, index, one) for index, one in enumerate(plan.candidates, start=1)]
    return new_message("visualization_msgs/MarkerArray", markers=markers)


def _path(made: int, name: str, plan: SpacetimePlan) -> Any:
    marker = line_strip(made, name, 0, plan.path.points, _CHOSEN, _WIDTH_CHOSEN)
    bound = plan.bound
    if bound is not None:
        bound = {"time": bound.time, "route": bound.route.tolist(), "left_out": bound.left_out}
    content = {
        "start_time": plan.path.start_time,
        "step": plan.path.step,
        "travel_time": plan.travel_time,
        "certificate": asdict(plan.certificate),
        "bound": bound,
    }
    marker.text = json.dumps(content)
    return marker


def _candidate(made: int, name: str, index: int, candidate: Candidate) -> Any:
    colour = _COLOURS.get(candidate.outcome, _OTHERS)
    marker = line_strip(made, name, index, candidate.points, colour, _WIDTH)
    content = {
        "outcome": candidate.outcome.value,
        "turns": candidate.turns,
        "travel_time": candidate.travel_time,
        "passes": candidate.passes,
        "reason": candidate.reason,
    }
    marker.text = json.dumps(content)
    return marker


def plans_from_message(message: Any, topic: str = "candidates") -> Plans:
    """Return the plans of a MarkerArray.

    Raises
    ------
    InvalidInput
        If a marker is no line of the map, its text is not as it must be, or candidates come without their plan.
    """
    found: dict[str, tuple[int, FloatArray, dict[str, Any], list[Candidate]]] = {}
    for marker in message.markers:
        if int(marker.action) == _DELETE_ALL:
            continue
        check_frame(marker, topic)
        if int(marker.type) != _LINE_STRIP:
            raise InvalidInput(
                f"{topic}: marker of {marker.ns!r} has type {marker.type}, expected LINE_STRIP (4)"
            )
        points = np.array([(point.x, point.y) for point in marker.points], dtype=np.float64).reshape(-1, 2)
        try:
            content = json.loads(marker.text)
            if int(marker.id) == 0:
                found[marker.ns] = nanoseconds_from_stamp(marker.header.stamp), points, content, []
            else:
                found[marker.ns][3].append(_candidate_of(points, content))
        except (ValueError, KeyError, TypeError) as error:
            raise InvalidInput(f"{topic}: marker {marker.id} of {marker.ns!r}: {error!r}") from None
    return {name: (entry[0], _plan_of(name, entry, topic)) for name, entry in found.items()}


def _candidate_of(points: FloatArray, content: dict[str, Any]) -> Candidate:
    turns = tuple((str(body), int(side)) for body, side in content["turns"])
    outcome = CandidateOutcome(content["outcome"])
    return Candidate(points, turns, outcome, content["travel_time"], content["passes"], content["reason"])


def _plan_of(
    name: str, entry: tuple[int, FloatArray, dict[str, Any], list[Candidate]], topic: str
) -> SpacetimePlan:
    _, points, content, candidates = entry
    try:
        path = TimedPath(content["start_time"], content["step"], points)
        bound = content["bound"]
        if bound is not None:
            route = np.array(bound["route"], dtype=np.float64).reshape(-1, 3)
            bound = TravelBound(bound["time"], route, tuple(bound["left_out"]))
        certificate = Certificate(**content["certificate"])
        return SpacetimePlan(name, path, content["travel_time"], certificate, tuple(candidates), bound)
    except (ValueError, KeyError, TypeError) as error:
        raise InvalidInput(f"{topic}: plan of {name!r}: {error!r}") from None
