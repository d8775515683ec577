"""What the other planner nodes promised for their robots, and whether it is enough to decide upon."""

from __future__ import annotations

import time as clock
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Path

from snnav_core.errors import InvalidInput
from snnav_core.types import HeardPath, RobotState, Stop, StopReason
from snnav_ros.convert import Word, nanoseconds, verdict_from_message, word_from_message, word_to_message
from snnav_ros.gate import GateRules, Order, PathGate
from snnav_ros.nodes.base import ManagedNode
from snnav_ros.nodes.node_time import now_of
from snnav_ros.qos import COMMAND, INBOX, LATCHED, for_mode

__all__ = ["PLANNERS_TOPIC", "Fellows"]

PLANNERS_TOPIC = "planners"
_STATES_KEPT = 200  # of each robot
_REASONS_KEPT = 4  # of each robot
_STANDS = 0.02  # [m/s]; slower counts as standing


class Fellows:
    """Hears the words of other planners, and the paths of the robots that they serve.

    Parameters
    ----------
    node : ManagedNode
    planners : sequence of str
        Names of all planner nodes in the order in which they decide, with the one of this node.
    window : float
        How long a path may be promised [s].
    changed : callable
        Called when something was heard that a decision may have waited for.

    Raises
    ------
    InvalidInput
        If the names do not name this node, or one of them twice.

    Notes
    -----
    A planner counts on another one when it has heard its word for the instant that counts, and every path of its last
    issue: of those before it the present instant, of those after it the one before. In lockstep it waits for that. In
    real time it issues nothing without; whoever was not heard may have promised something at that instant, so nothing
    is issued until every window that began then has ended *and* the robots stand by odometry. Then they count as
    standing. Paths and certificates pass the same gate as at a robot: what is unsealed, altered or expired is not used.
    """

    def __init__(
        self, node: ManagedNode, planners: Sequence[str], window: float, changed: Callable[[], None]
    ) -> None:
        self._node, self._name = node, node.get_name()
        if self._name not in planners or len(set(planners)) < len(planners):
            raise InvalidInput(
                f"value {list(planners)} does not name {self._name} and others, each once; list the names of all "
                "planner nodes, in the same order at every planner"
            )
        self._others = [name for name in planners if name != self._name]
        self._index = list(planners).index(self._name)
        self._earlier = set(planners[: self._index])
        self._window, self._changed = nanoseconds(window), changed
        # in lockstep the tick of a path may be heard after the path
        self._rules = GateRules(clock_tolerance=1e6) if node.lockstep else GateRules()
        self._life = f"{clock.time_ns():x}"
        self._issue = 0
        self._gates: dict[str, PathGate] = {}
        self._endings: dict[str, list[Callable[[], object]]] = {}
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a jump of time."""
        self._words: dict[str, Word] = {}
        self._known: dict[str, tuple[str, int]] = {}  # life and issue up to which all promises are known
        self._silent: dict[str, int] = {}  # since which instant something may have been promised unheard [ns]
        self._heard: dict[str, tuple[int, HeardPath]] = {}
        self._halted: dict[str, int] = {}  # robots of one other that another one stopped, and when [ns]
        self._stopped: dict[str, int] = {}  # robots of this planner that others stopped, and when [ns]
        self._robots: dict[str, tuple[str, ...]] = {}  # whom each planner served when it was heard
        self._states: dict[str, deque[RobotState]] = {}
        self._reasons: dict[str, dict[int, StopReason | None]] = {}  # by instant [ns]
        self._last = -1
        for gate in self._gates.values():
            gate.reset()

    @property
    def place(self) -> int:
        """How many planners decide before this one."""
        return self._index

    def configure(self) -> None:
        """Make the publisher."""
        self._mouth = self._node.publisher(
            DiagnosticStatus, PLANNERS_TOPIC, for_mode(self._node.lockstep, LATCHED)
        )

    def start(self) -> None:
        """Listen to the words until the node is deactivated."""
        self._node.listen(DiagnosticStatus, PLANNERS_TOPIC, self._on_word, INBOX)

    def watch(self, robot: str) -> None:
        """Hear what is promised for a robot that another planner serves."""
        self.unwatch(robot)
        quality = for_mode(self._node.lockstep, COMMAND)
        gate = self._gates[robot] = PathGate(robot, self._rules)

        def on_path(message: Any) -> None:
            self._take(robot, gate.offer_path(message, self._now()))

        def on_certificate(message: Any) -> None:
            self._note_reason(robot, message)
            self._take(robot, gate.offer_certificate(message, self._now()))

        self._endings[robot] = [
            self._node.listen(Path, f"{robot}/path", on_path, quality),
            self._node.listen(DiagnosticStatus, f"{robot}/certificate", on_certificate, quality),
        ]

    def unwatch(self, robot: str) -> None:
        """Hear nothing of a robot any more; it left."""
        for end in self._endings.pop(robot, []):
            end()
        for known in (self._gates, self._heard, self._halted, self._stopped, self._states, self._reasons):
            known.pop(robot, None)

    def missing(self, instant: int) -> list[str]:
        """Return the planners whose promises are not known as far as a decision at an instant [ns] needs them."""
        return [name for name in self._others if not self._is_ready(name, instant)]

    def _is_ready(self, name: str, instant: int) -> bool:
        word, needed = self._words.get(name), instant if name in self._earlier else self._last
        if name not in self._earlier and self._node.lockstep and self._last < 0:
            return True  # nobody after this node has decided yet
        if word is None or word.stamp < needed or needed < 0:
            return False
        heard_all = bool(word.decided) or self._node.lockstep  # in lockstep no word is lost
        if heard_all and all(self._has(robot, word.stamp) for robot in word.decided):
            self._known[name] = word.life, word.issue
        if self._known.get(name) != (word.life, word.issue):
            return False
        self._silent.pop(name, None)
        return True

    def _has(self, robot: str, stamp: int) -> bool:
        if robot not in self._gates:
            return True
        return self._heard.get(robot, (-1,))[0] >= stamp and self._gates[robot].verdict_stamp >= stamp

    def _note_reason(self, robot: str, message: Any) -> None:
        """Keep why a robot was stopped; what cannot be read is refused elsewhere."""
        try:
            verdict = verdict_from_message(message)
        except InvalidInput:
            return
        reasons = self._reasons.setdefault(robot, {})
        reasons[nanoseconds(verdict.stamp)] = None if verdict.stop is None else verdict.stop.reason
        while len(reasons) > _REASONS_KEPT:
            del reasons[min(reasons)]

    def give_up(self, instant: int, states: Mapping[str, RobotState]) -> list[str]:
        """Return the planners that must still be waited for, once an instant [ns] has been waited for long enough.

        Robots of the rest count as standing where odometry says.
        """
        left = []
        for name in self.missing(instant):
            since = self._silent.setdefault(name, instant)
            robots = self._robots_of(name)
            moving = [robot for robot in robots if robot in states and states[robot].speed > _STANDS]
            if instant < since + self._window or moving:
                left.append(name)
                continue
            if name in self._words:
                self._known[name] = self._words[name].life, self._words[name].issue
            for robot in robots:
                self._heard[robot] = (instant, HeardPath(None, answers=False))
        return left

    def _robots_of(self, name: str) -> list[str]:
        """Return the robots that a planner served when it was heard; all that nobody else served if it never was."""
        if name in self._robots:
            return [robot for robot in self._robots[name] if robot in self._gates]
        claimed = {robot for other, robots in self._robots.items() for robot in robots}
        return [robot for robot in self._gates if robot not in claimed]

    def add_state(self, state: RobotState) -> None:
        """Keep where a robot is."""
        self._states.setdefault(state.id, deque(maxlen=_STATES_KEPT)).append(state)

    def states_at(self, time: float, latest: Mapping[str, RobotState]) -> dict[str, RobotState]:
        """Return for every robot of `latest` its last state up to a time [s], or the latest where there is none."""
        return {
            name: next((one for one in reversed(self._states[name]) if one.stamp <= time), state)
            for name, state in latest.items()
        }

    def promises(self) -> dict[str, HeardPath]:
        """Return what was promised for robots of other planners, and which of this one they stopped."""
        heard = {
            robot: replace(promise, stop=self._reasons.get(robot, {}).get(self._last))
            for robot, (_, promise) in self._heard.items()
        }
        heard |= dict.fromkeys(self._stopped, HeardPath(None))
        self._stopped.clear()
        return heard

    def say(self, instant: int, decided: Sequence[str], stops: Mapping[str, Stop]) -> None:
        """Tell the others what was published at an instant [ns]; nothing when `decided` is empty."""
        self._issue += bool(decided)
        self._last = instant
        texts = tuple((robot, stop.message) for robot, stop in stops.items())
        word = Word(self._name, instant, self._life, self._issue, tuple(decided), texts)
        self._mouth.publish(word_to_message(word))

    def _on_word(self, message: Any) -> None:
        try:
            word = word_from_message(message, PLANNERS_TOPIC)
        except InvalidInput as error:
            self._node.get_logger().warning(f"message not used: {error}", throttle_duration_sec=5.0)
            return
        if word.planner not in self._others:
            return
        self._words[word.planner] = word
        if word.decided:
            self._robots[word.planner] = word.decided
        for robot, _ in word.stops:
            if robot in self._gates:
                self._halted[robot] = word.stamp
                if self._heard.get(robot, (-1,))[0] <= word.stamp:
                    self._heard[robot] = (word.stamp, HeardPath(None))
            else:
                self._stopped[robot] = word.stamp
        self._changed()

    def _take(self, robot: str, order: Order | None) -> None:
        gate = self._gates[robot]
        if order is None:
            return
        if order.refusal:
            self._node.get_logger().warning(
                f"promise for robot {robot} not used: {order.refusal}", throttle_duration_sec=5.0
            )
            return
        stamp = max(gate.path_stamp, gate.verdict_stamp)
        promise = HeardPath(order.path, order.valid_until)
        if order.path is None or stamp <= self._halted.get(robot, -1):
            promise = HeardPath(None)
        self._heard[robot] = (stamp, promise)
        self._changed()

    def _now(self) -> int:
        """Return the time [ns] for what comes in; in lockstep nothing comes too late or too soon."""
        return 0 if self._node.lockstep else now_of(self._node)
