"""What the navigator knows of who goes first and who makes room: precedence, ways and orders, from step to step."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from snnav_core.navigator.context import AreaContext
from snnav_core.navigator.plans import NONE_CERTIFIED
from snnav_core.navigator.precedence import Precedence
from snnav_core.navigator.settings import NavigatorSettings
from snnav_core.navigator.ways import Party, Ways
from snnav_core.navigator.yielding import Yielding
from snnav_core.types import PathSource, PlannedPath, Pose2D, Stop, StopReason

__all__ = ["RightOfWay"]

_TURNS, _RESTS = 20, 40  # decisions in which a robot that does not get away turns, and then rests
_STILL = 0.02  # [m] that a robot moves less in a decision when it stands
_STUCK = (
    4  # decisions in a row without moving, besides those for a whole turn, after which it counts as blocked
)


class RightOfWay:
    """Precedence and yielding of all robots of one navigator.

    Parameters
    ----------
    settings : NavigatorSettings
    """

    def __init__(self, settings: NavigatorSettings) -> None:
        self._settings = settings
        self.precedence = Precedence()
        self._yielding = Yielding()
        self._poses: dict[str, Pose2D] = {}
        self._still: dict[str, int] = {}
        self._goals: dict[str, tuple[float, float]] = {}
        self._near = 0.0
        self._hindered: set[str] = set()

    @property
    def sought(self) -> int:
        """For how many robots a place to wait was looked for in this step."""
        return self._yielding.sought

    def remove(self, name: str) -> None:
        """Forget a robot."""
        self.precedence.remove(name)
        self._yielding.forget(name)
        for known in (self._poses, self._still, self._goals):
            known.pop(name, None)

    def update(
        self, context: AreaContext, parties: Mapping[str, Party], goals: Mapping[str, tuple[float, float]]
    ) -> None:
        """Decide who makes room in this step, before any path is decided.

        Parameters
        ----------
        context : AreaContext
        parties : mapping
            Robot id -> Party, of all robots that are heard of.
        goals : mapping
            Robot id -> target [m, map].
        """
        speeds = [party.robot.speed for party in parties.values()]
        self._near = (
            2.0 * self._settings.safety_margin
            + 2.0 * max(speeds, default=0.0) * self._settings.sampling_interval
        )
        for name, party in parties.items():
            self.precedence.add(name)
            self._watch(name, party)
            if self._goals.get(name) != goals.get(name):
                self._yielding.forget(name)
        self._goals = dict(goals)
        if len(parties) < 2:
            self._yielding.clear()
        if len(parties) < 2 or context.area.is_empty:
            return
        blocked = {
            name: max(self.precedence.blocked(name), self._still[name])
            for name in parties
            if name in self._hindered and not self._yielding.rests(name)
        }
        self._yielding.update(Ways(context, self._settings, parties), self.precedence, blocked)

    def _watch(self, name: str, party: Party) -> None:
        """Count for how many decisions a robot has not moved, beyond what a turn on the spot takes."""
        last, pose = self._poses.get(name), party.pose
        self._poses[name] = pose
        moved = last is None or math.dist((last.x, last.y), (pose.x, pose.y)) >= _STILL
        if moved or name not in self._hindered:
            turn = 2.0 * math.pi / party.robot.max_turn_rate / self._settings.sampling_interval
            self._still[name] = -_STUCK - math.ceil(turn)
        else:
            self._still[name] += 1

    def sequence(self) -> list[str]:
        """All robots that were heard of, in the order in which they are decided."""
        return self.precedence.sequence(self._yielding.waits_for)

    def goal(self, name: str, goal: tuple[float, float]) -> tuple[bool, tuple[float, float]]:
        """Whether a robot makes room now, and where it goes: out of the way of another one, or to its goal [m, map]."""
        order = self._yielding.orders.get(name)
        return (False, goal) if order is None else (True, (float(order.place[0]), float(order.place[1])))

    def waits(self, name: str, pose: Pose2D, arrival: float) -> Stop | None:
        """The stop of a robot that is where it waits for another one; None for all the others."""
        order = self._yielding.orders.get(name)
        if order is None:
            return None
        away = float(np.linalg.norm(order.place - pose.position))
        if away > arrival and not (order.reached and away < 1.5 * arrival):
            return None
        self._yielding.reach(name)
        for_whom = " and ".join(order.whom)
        return Stop(
            name,
            StopReason.YIELDS,
            f"robot {name} waits at ({pose.x:.2f}, {pose.y:.2f}) until robot {for_whom} has passed",
        )

    def labelled(self, name: str, decision: PlannedPath | Stop) -> PlannedPath | Stop:
        """A decision with the name of what it is for: making room for another robot, or blocked by one and by whom."""
        order = self._yielding.orders.get(name)
        if isinstance(decision, PlannedPath):
            if decision.path.turn_to is not None and self._is_idle(name):
                nearest = self._nearest(name)[1]
                message = f"robot {name} waits: it turned to and fro and found no way past robot {nearest}"
                return Stop(name, StopReason.BLOCKED_BY_ROBOT, message)
            return decision if order is None else replace(decision, source=PathSource.YIELD)
        if order is not None and decision.reason is not StopReason.NO_AREA:
            if decision.reason is not StopReason.BLOCKED_BY_ROBOT:
                self._yielding.forget(name)
            message = f"robot {name} shall make room for robot {order.whom[0]}; {decision.message}"
            return replace(decision, reason=StopReason.BLOCKED_BY_ROBOT, message=message)
        text = self._yielding.text(name)
        if text and decision.reason in (StopReason.BLOCKED_BY_ROBOT, StopReason.NO_PATH):
            by_robot = decision.reason is StopReason.BLOCKED_BY_ROBOT
            message = f"{decision.message}; {text}" if by_robot else f"robot {name} waits: {text}"
            return Stop(name, StopReason.BLOCKED_BY_ROBOT, message)
        if NONE_CERTIFIED in decision.message and self._by_robot(decision):
            message = (
                f"robot {name} waits for robot {self._nearest(name)[1]}, which is near; {decision.message}"
            )
            return replace(decision, reason=StopReason.BLOCKED_BY_ROBOT, message=message)
        return decision

    def _is_idle(self, name: str) -> bool:
        """Whether a robot among others has turned for long without driving; now and then it may try again."""
        standing = self._still.get(name, 0)
        return standing > 0 and standing % (_TURNS + _RESTS) > _TURNS and self._is_near_others(name)

    def note(self, decisions: Mapping[str, PlannedPath | Stop]) -> None:
        """Remember who is blocked by others, or may be."""
        hindering = (StopReason.BLOCKED_BY_ROBOT, StopReason.NO_PATH)
        self._hindered = {
            name
            for name, decision in decisions.items()
            if isinstance(decision, PlannedPath) or decision.reason in hindering
        }
        self.precedence.note(
            {
                name: isinstance(decision, Stop) and self._by_robot(decision)
                for name, decision in decisions.items()
            }
        )

    def _by_robot(self, stop: Stop) -> bool:
        """Whether a robot waits because of others: somebody is near who bends its path until it cannot be driven."""
        if stop.reason is StopReason.NO_PATH:
            return self._is_near_others(stop.robot_id)
        return stop.reason is StopReason.BLOCKED_BY_ROBOT

    def _is_near_others(self, name: str) -> bool:
        return self._nearest(name)[0] < self._near

    def _nearest(self, name: str) -> tuple[float, str]:
        """Distance to the nearest other robot [m], inf without any, and its id."""
        pose = self._poses.get(name)
        if pose is None:
            return math.inf, ""
        gaps = [
            (math.dist((pose.x, pose.y), (other.x, other.y)), another)
            for another, other in self._poses.items()
            if another != name
        ]
        return min(gaps, default=(math.inf, ""))
