"""The sensor network and how its scans become the unoccupied area."""

from __future__ import annotations

from dataclasses import dataclass, field

from snnav_core.checks import check_not_negative, check_positive
from snnav_core.sensing.scan import ScanSettings
from snnav_core.types import Pose2D

__all__ = ["FusionSettings", "PlanarSensor"]


@dataclass(frozen=True)
class PlanarSensor:
    """A fixed planar range finder: its name, its surveyed pose in the map, how to read its ranges."""

    id: str
    pose: Pose2D
    settings: ScanSettings = field(default_factory=ScanSettings)


@dataclass(frozen=True, slots=True)
class FusionSettings:
    """How scans become the unoccupied area.

    Parameters
    ----------
    boundary_speed : float
        V_max: nothing that moves in the workspace is faster [m/s].
    memory : bool
        Keep what was free and cannot yet have been reached (A_mem, deviation C3-5). Without effect when
        `boundary_speed` is zero: then every scan shows all there is.
    max_scan_age : float
        An older scan counts as no scan [s].
    clock_tolerance : float
        A scan may be stamped this far ahead of the clock at its arrival [s], one farther ahead is refused. Every scan
        counts as this much older than its stamp says.
    return_tolerance : float
        A return this far [m] or less inside the union does not cut it; the planning reserve covers it.
    return_radius : float
        Half width of the obstacle that stands for one cut return [m].
    shorten_depth : float
        Where a return lies up to this far inside the area of another sensor, along its ray, that sensor's beams end at
        the return [m]; a deeper return becomes a small obstacle of its own.
    simplification : float
        The outline of each sensor's area may lose points, and the area this much, before the union [m].
    least_part : float
        Parts of the area smaller than this are dropped: no robot fits into them [m^2].
    contradiction_depth : float
        A return farther inside the union than this [m] is counted as a contradiction.
    robot_tolerance : float
        A return of a sensor that sees robots is a robot's when it lies this far or less outside of the robot's disk
        [m]; nothing else fits in between.
    """

    boundary_speed: float = 0.0
    memory: bool = True
    max_scan_age: float = 1.0
    clock_tolerance: float = 0.0
    return_tolerance: float = 0.001
    return_radius: float = 0.01
    shorten_depth: float = 0.1
    simplification: float = 0.003
    least_part: float = 0.05
    contradiction_depth: float = 0.1
    robot_tolerance: float = 0.1

    def __post_init__(self) -> None:
        at_least_zero = (
            "boundary_speed",
            "clock_tolerance",
            "return_tolerance",
            "shorten_depth",
            "simplification",
            "least_part",
            "contradiction_depth",
            "robot_tolerance",
        )
        check_not_negative(self, at_least_zero, "fusion setting ")
        check_positive(self, ("max_scan_age", "return_radius"), "fusion setting ")

    @property
    def remembers(self) -> bool:
        """Whether what was free and is not seen any more stays free for a while."""
        return self.memory and self.boundary_speed > 0.0
