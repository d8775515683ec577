"""Robots that floor-level sensors see are no obstacles, and nothing behind them is seen (deviation C3-6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from snnav_core.area.robots import RobotTrack
from snnav_core.errors import InvalidInput
from snnav_core.sensing.scan import DetectedArea
from snnav_core.sensing.star import BeamFan
from snnav_core.types import FloatArray, RobotSpec, RobotState

__all__ = ["RobotHiding"]

_Place = tuple[float, float, float, float]  # x, y, radius of the disk [m], slack [m]


@dataclass(frozen=True)
class _Hidden:
    """What was seen, where the robots were, and what is left of it."""

    part: DetectedArea
    places: tuple[_Place, ...]
    result: DetectedArea


class RobotHiding:
    """Takes the robots out of what sensors saw.

    Parameters
    ----------
    robots : sequence of RobotSpec
    tolerance : float
        A return this far or less outside of a robot's disk is the robot's [m].
    keeps_lengths : bool
        For a workspace in which nothing moves: a beam that ends on a robot stays free as far as it was before.

    Raises
    ------
    InvalidInput
        If two robots have the same name.

    Notes
    -----
    Deviation (C3-6): the thesis mounts sensors "higher than any robot" but puts them on the floor in its experiments.
    Where a robot's place is unknown at the time of a scan, its returns stay obstacles.
    """

    def __init__(self, robots: Sequence[RobotSpec], tolerance: float, keeps_lengths: bool) -> None:
        self._tracks = {robot.id: RobotTrack(robot) for robot in robots}
        if len(self._tracks) != len(robots):
            raise InvalidInput(f"robots {[robot.id for robot in robots]}: need different ids")
        self._tolerance, self._keeps_lengths = tolerance, keeps_lengths
        self._hidden: dict[str, _Hidden] = {}
        self._kept: dict[str, BeamFan] = {}
        self._disks: tuple[tuple[_Place, ...], list[shapely.Polygon]] = ((), [])

    def add_robot(self, robot: RobotSpec) -> None:
        """Know one more robot.

        Raises
        ------
        InvalidInput
            If there is one of this name.
        """
        if robot.id in self._tracks:
            raise InvalidInput(f"robot {robot.id} is known already; robot ids must be different")
        self._tracks[robot.id] = RobotTrack(robot)

    def remove_robot(self, robot_id: str) -> None:
        """Forget a robot; a name that is not known is no fault."""
        self._tracks.pop(robot_id, None)

    def clear(self) -> None:
        """Forget where the robots were, and lengths of beams."""
        for track in self._tracks.values():
            track.clear()
        self._hidden.clear()
        self._kept.clear()

    def add(self, state: RobotState) -> None:
        """Take the state of a robot.

        Raises
        ------
        InvalidInput
            If the robot is unknown, a number is not finite, or the state is older than the last one.
        """
        if state.id not in self._tracks:
            raise InvalidInput(f"state of unknown robot {state.id!r}; known: {sorted(self._tracks)}")
        self._tracks[state.id].add(state.stamp, state.pose, state.speed)

    def disks(self, time: float) -> list[shapely.Polygon]:
        """Polygons inside of the disks in which nothing but a robot fits at a time [s]; the same objects if unmoved."""
        places = self._places(time)
        if places != self._disks[0]:
            polygons = [
                shapely.Point(x, y).buffer(radius - slack, quad_segs=16)
                for x, y, radius, slack in places
                if radius > slack
            ]
            self._disks = (places, polygons)
        return self._disks[1]

    def without_robots(self, part: DetectedArea, stamp: float) -> DetectedArea:
        """What a sensor saw at `stamp` [s], without the returns on robots; the same object for the same question."""
        places = self._places(stamp)
        last = self._hidden.get(part.sensor_id)
        if last is None or last.part is not part or last.places != places:
            last = _Hidden(part, places, self._hide(part, places))
            self._hidden[part.sensor_id] = last
        return last.result

    def _places(self, stamp: float) -> tuple[_Place, ...]:
        places = []
        for track in self._tracks.values():
            place = track.place(stamp)
            if place is not None:
                (x, y), slack = place
                places.append((float(x), float(y), track.robot.radius + self._tolerance, slack))
        return tuple(places)

    def _hide(self, part: DetectedArea, places: tuple[_Place, ...]) -> DetectedArea:
        on_robot = np.zeros(len(part.returns), dtype=np.bool_)
        for x, y, radius, slack in places:
            on_robot |= np.hypot(part.returns[:, 0] - x, part.returns[:, 1] - y) <= radius + slack
        fan = part.fan
        if self._keeps_lengths:
            fan = self._lengthened(part, part.return_beam[on_robot])
            if len(places) == len(self._tracks):  # else a beam may end on a robot unnoticed
                self._kept[part.sensor_id] = fan
        if not on_robot.any():
            return part
        others = ~on_robot
        return replace(part, returns=part.returns[others], return_beam=part.return_beam[others], fan=fan)

    def _lengthened(self, part: DetectedArea, beams: np.ndarray) -> BeamFan:
        """The fan of a part with the lengths that some beams had before a robot was in their way."""
        fan, kept = part.fan, self._kept.get(part.sensor_id)
        if kept is None or not _same_beams(fan, kept) or len(beams) == 0:
            return fan
        longer = beams[kept.free[beams] > fan.free[beams]]
        free: FloatArray = fan.free.copy()
        free[longer] = kept.free[longer]
        if fan.surface is None or kept.surface is None:
            return replace(fan, free=free)
        surface: FloatArray = fan.surface.copy()
        surface[longer] = kept.surface[longer]
        return replace(fan, free=free, surface=surface)


def _same_beams(first: BeamFan, second: BeamFan) -> bool:
    return (first.free.size, first.angle_min, first.angle_increment) == (
        second.free.size,
        second.angle_min,
        second.angle_increment,
    )
