"""Names and default values of the commands on recordings, apart so that ``snnav --help`` is quick."""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["POSE_TOPIC", "SCAN_TOPIC", "EvaluationSettings", "NetworkSettings"]

SCAN_TOPIC, POSE_TOPIC = "scan", "pose"


@dataclass(frozen=True, slots=True)
class NetworkSettings:
    """Values of the scene that a network becomes; lengths in m, times in s, angles in rad.

    Parameters
    ----------
    range_cut : float
        Longer readings are free only up to this range.
    speed, max_turn_rate, radius : float
        Of every robot.
    safety_margin, sampling_interval, control_period : float
    time_window : int
        In sampling intervals.
    seed : int
        Of starts, targets and the run.
    """

    range_cut: float = 20.0
    speed: float = 0.5
    max_turn_rate: float = 1.5
    radius: float = 0.3
    safety_margin: float = 0.4
    sampling_interval: float = 0.5
    control_period: float = 0.05
    time_window: int = 4
    seed: int = 1


@dataclass(frozen=True, slots=True)
class EvaluationSettings:
    """What is run: nodes and routes a building, the seed of the routes, the values of robot and planner."""

    nodes: int = 40
    pairs: int = 10
    network: NetworkSettings = field(default_factory=NetworkSettings)
