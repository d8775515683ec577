"""What closed loops in the plane and in space share: time, decisions in turn with motion, and how a run ends."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Generic, Protocol, TypeVar

from snnav_core.types import PlannedPath, StepResult, Stop, StopReason
from snnav_sim.ending import EndWatch
from snnav_sim.report.record import Decision, RunRecord
from snnav_sim.scene import AnyScene

__all__ = ["ClosedLoop", "Progress"]

Progress = Callable[[float, int], None]
"""Called once per sampling interval with the simulated time [s] and the number of robots that have arrived."""

SceneT = TypeVar("SceneT", bound=AnyScene)
RecordT = TypeVar("RecordT", bound=RunRecord)


class _Follower(Protocol):
    """A simulated robot."""

    def follow(self, decision: PlannedPath | Stop) -> None: ...


class ClosedLoop(ABC, Generic[SceneT, RecordT]):
    """A scene that is decided and moved in turn.

    Parameters
    ----------
    scene : Scene or SpaceScene
    record : RunRecord
        Of what will happen.
    """

    def __init__(self, scene: SceneT, record: RecordT) -> None:
        self.scene = scene
        self.seed = record.seed
        self.record = record
        self._watch = EndWatch(scene)
        self._tick = 0

    @property
    def time(self) -> float:
        """Simulated time [s], exact to a nanosecond."""
        return round(self._tick * self.scene.control_period, 9)

    def run(self, progress: Progress | None = None) -> RecordT:
        """Run to the end and return what happened."""
        while True:
            result = self.decide()
            stops = {name: d.reason.value for name, d in result.decisions.items() if isinstance(d, Stop)}
            self.record.reason = self._watch.update(self.time, stops)
            if progress is not None:
                progress(self.time, sum(reason == StopReason.ARRIVED.value for reason in stops.values()))
            for _ in range(self.scene.ticks_per_sample):
                self.move()
                if self.record.reason:
                    return self.record

    @abstractmethod
    def decide(self) -> StepResult:
        """Measure, fuse and plan at the present sampling instant; hand the paths to the trackers."""

    @abstractmethod
    def move(self) -> None:
        """Let all robots move for one control period; the sample of its start is recorded."""

    def _obey(self, result: StepResult, robots: Mapping[str, _Follower]) -> None:
        """Hand the decisions to the robots and record them."""
        for name, decision in result.decisions.items():
            robots[name].follow(decision)
            self.record.decisions.append(Decision.of(self.time, decision))
