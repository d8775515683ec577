"""When a run is over."""

from __future__ import annotations

from collections.abc import Mapping

from snnav_core.types import StopReason
from snnav_sim.scene_types import Scene
from snnav_sim.space_types import SpaceScene

__all__ = ["EndWatch"]

_PATIENCE_STATIC = 30  # sampling intervals
_PATIENCE_MOVING = 120


class EndWatch:
    """Watches the decisions of a run for its end.

    Parameters
    ----------
    scene : Scene or SpaceScene

    Notes
    -----
    A run ends when all robots in the workspace have arrived, at the time limit, or when every robot that has not
    arrived was stopped for 30 sampling intervals in a row (120 with moving bodies, which may clear the way): nothing
    will change. Before the time limit it never ends while a robot is still to join, to leave or to be re-targeted.
    """

    def __init__(self, scene: Scene | SpaceScene) -> None:
        self._scene = scene
        self._patience = _PATIENCE_MOVING if scene.movers else _PATIENCE_STATIC
        self._idle = 0

    def update(self, time: float, stops: Mapping[str, str]) -> str:
        """Return why the run is over, or an empty string.

        Parameters
        ----------
        time : float
            The sampling instant [s].
        stops : mapping
            Robot id -> value of the StopReason, for the robots without a path at this instant.
        """
        scene = self._scene
        robots = scene.present(time)
        changes = scene.changes_after(time)
        under_way = [robot for robot in robots if stops.get(robot) != StopReason.ARRIVED.value]
        if not (under_way or changes):
            gone = " or left" if len(robots) < len(scene.robots) else ""
            return f"all robots arrived{gone}" if scene.robots else "no robots in the scene"
        self._idle = self._idle + 1 if not changes and all(robot in stops for robot in under_way) else 0
        if self._idle >= self._patience:
            named = ", ".join(f"{robot}: {stops[robot]}" for robot in under_way)
            return f"no way on for {self._patience} sampling intervals ({named})"
        if time >= scene.time_limit - 1e-9:
            return f"time limit of {self._scene.time_limit:g} s"
        return ""
