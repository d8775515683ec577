"""What a tracker remembers of the path that it follows, in the plane and in space alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Generic, Protocol, TypeVar

import numpy as np

from snnav_core.checks import check_positive
from snnav_core.errors import InvalidInput
from snnav_core.types import TIME_TOLERANCE, RobotSpec, TimedPath

__all__ = ["PathFollower", "check_law"]

_AT_END = 0.02  # share of the way of a control period that is no way any more
_WINDOW_LINKS = 2.0  # the closest point is sought so many (longest) links around the last one


class _Line(Protocol):
    """A spline or chain of known length."""

    @property
    def length(self) -> float: ...


_LineT = TypeVar("_LineT", bound=_Line)


def check_law(settings: object, law: str, names: Sequence[str]) -> None:
    """Check the settings of a tracker.

    Parameters
    ----------
    settings : object
        Its attributes `names` are positive numbers, or None where the tracker chooses.
    law : str
    names : sequence of str

    Raises
    ------
    InvalidInput
        If the law is unknown or a constant is not a positive number.
    """
    if law not in ("practical", "printed"):
        raise InvalidInput(f"tracking law is {law!r}, must be 'practical' or 'printed'")
    check_positive(settings, names, "tracker: ", optional=True)


class PathFollower(Generic[_LineT]):
    """Path, progress along it and validity; what a tracker in the plane and one in space have in common.

    Parameters
    ----------
    robot : RobotSpec
    control_period : float
        Time for which a command holds [s].
    everywhere : bool
        Whether the closest point is sought on the whole path, as printed, or near the last one.

    Raises
    ------
    InvalidInput
        If the period is not positive.
    """

    def __init__(self, robot: RobotSpec, control_period: float, everywhere: bool) -> None:
        if not (math.isfinite(control_period) and control_period > 0.0):
            raise InvalidInput(f"control period is {control_period} s, must be a positive number")
        self.robot = robot
        self.control_period = control_period
        self._everywhere = everywhere
        self.reset()

    def reset(self) -> None:
        """Forget the path; the command is to stand still until a new one comes."""
        self._path: TimedPath | None = None
        self._track: _LineT | None = None
        self._valid_until = math.inf
        self._window = 0.0
        self._last_position: Sequence[float] | None = None
        self._progress = 0.0
        self._finished = True

    @property
    def progress(self) -> float:
        """Length along the path of the point closest to the robot at the last command [m]."""
        return self._progress

    @property
    def finished(self) -> bool:
        """Whether there is nothing (more) to follow."""
        return self._finished

    def _follow(self, path: TimedPath, track: _LineT | None, valid_until: float | None) -> None:
        """Take up a path and the line through its points, None where it has no length."""
        links = np.linalg.norm(np.diff(path.points, axis=0), axis=1)
        self._window = _WINDOW_LINKS * float(links.max(initial=0.0))
        self._path = path
        self._track = track
        self._valid_until = math.inf if valid_until is None else valid_until
        self._finished = track is None

    def _lapsed(self, time: float) -> bool:
        """Tell whether a command from `time` on, which holds for a control period, would outlast the path."""
        return time + self.control_period > self._valid_until + TIME_TOLERANCE

    def _search_range(self, track: _LineT, position: Sequence[float], time: float) -> tuple[float, float]:
        """Return the lengths along the path [m] between which the point closest to the position is sought."""
        if self._everywhere or self._path is None:
            return 0.0, track.length
        if self._last_position is None:
            return 0.0, self._window + self.robot.speed * max(time - self._path.start_time, 0.0)
        moved = math.dist(self._last_position, position)
        return self._progress - self._window, self._progress + self._window + moved

    def _share_left(self, track: _LineT, distance: float) -> float:
        """Return which share of a control period the way from `distance` on takes: at most 1, 0 at the end.

        The last period ends at the end of the path, not beyond: what is behind it was not certified.
        """
        share = (track.length - distance) / (self.robot.speed * self.control_period)
        if share <= _AT_END:
            self._finished = True
            return 0.0
        return min(share, 1.0)
