"""Names and default values of the commands on recordings, apart so that ``snnav --help`` is quick."""

from __future__ import annotations

from dataclasses import dataclass, field

from snnav_core.errors import InvalidInput

__all__ = [
    "POSE_TOPIC",
    "SCAN_TOPIC",
    "EvaluationSettings",
    "FreeSpaceSettings",
    "NetworkSettings",
    "ReplaySettings",
    "TracksSettings",
]

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


@dataclass(frozen=True, slots=True)
class ReplaySettings:
    """How simulated robots drive among recorded people; lengths in m, times in s.

    Parameters
    ----------
    boundary_speed : float
        V_max: nobody is faster [m/s]; a robot must be.
    safety_margin : float
        From a robot's centre to whatever is not known to be free.
    sampling_interval, control_period : float
    time_window : int
        In sampling intervals.
    radius, speed, max_turn_rate : float
        Of every robot.
    to_and_fro : bool
        Whether a robot that arrives turns back to where it started, until the recording is over.
    stay : bool
        Whether the replay goes on to the end of the recording when all robots stand at their goals.

    Raises
    ------
    InvalidInput
        If the sampling interval is no multiple of the control period.
    """

    boundary_speed: float = 1.2
    safety_margin: float = 0.25
    sampling_interval: float = 0.1
    control_period: float = 0.05
    time_window: int = 3
    radius: float = 0.2
    speed: float = 1.5
    max_turn_rate: float = 3.0
    to_and_fro: bool = False
    stay: bool = False

    def __post_init__(self) -> None:
        ratio = self.sampling_interval / self.control_period
        if ratio < 1.0 - 1e-9 or abs(ratio - round(ratio)) > 1e-6:
            raise InvalidInput(
                f"sampling interval {self.sampling_interval:g} s is no multiple of the control period "
                f"{self.control_period:g} s; give one"
            )

    @property
    def ticks_per_sample(self) -> int:
        """Number of control periods in a sampling interval."""
        return round(self.sampling_interval / self.control_period)


@dataclass(frozen=True, slots=True)
class TracksSettings:
    """How bodies are tracked in a recording; lengths in m, times in s.

    Parameters
    ----------
    sampling_interval : float
        Between two fused measurements.
    window : float
        A velocity is fitted to the measurements of so long.
    top_speed : float
        Nobody is faster [m/s].
    range_noise : float
        Standard deviation of a range; real scanners are worse than the LMS-200 of the simulation.
    free_depth : float
        A return farther than this inside of what was free before is a sign of motion: more than noise and errors of
        the poses together.
    """

    sampling_interval: float = 0.3
    window: float = 1.5
    top_speed: float = 2.0
    range_noise: float = 0.01
    free_depth: float = 0.1


@dataclass(frozen=True, slots=True)
class FreeSpaceSettings:
    """How the free region of recorded depth cameras is found, and who flies through it; lengths in m, times in s.

    Parameters
    ----------
    range_accuracy, range_growth, pose_accuracy : float
        By how much cameras are wrong at most, see `CameraErrors`.
    range_max : float
        Longer readings are no measurement.
    grid_spacing : float
        Edge of a cell.
    safety_margin : float
        From a robot's centre to whatever is not known to be free.
    radius, speed, max_turn_rate : float
        Of the robot.
    sampling_interval, control_period : float
    time_window : int
        In sampling intervals.
    seed : int
        Of the roadmaps.
    """

    range_accuracy: float = 0.01
    range_growth: float = 0.003
    pose_accuracy: float = 0.1
    range_max: float = 9.0
    grid_spacing: float = 0.04
    safety_margin: float = 0.12
    radius: float = 0.08
    speed: float = 0.3
    max_turn_rate: float = 3.0
    sampling_interval: float = 0.2
    control_period: float = 0.05
    time_window: int = 6
    seed: int = 1
