"""Quality of service of every topic (docs/interfaces.md)."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

__all__ = [
    "CLOCK",
    "CLOCK_INPUT",
    "CLOUDS",
    "COMMAND",
    "DIAGNOSTICS",
    "DONE_INBOX",
    "INBOX",
    "LATCHED",
    "LOCKSTEP",
    "ODOMETRY",
    "ODOMETRY_INPUT",
    "RECORDED",
    "SENSOR",
    "VOLUMES",
    "for_mode",
]


def _profile(depth: int, *, reliable: bool = True, latched: bool = False) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


SENSOR = _profile(5, reliable=False)
"""`sensors/<id>/scan`, `sensors/<id>/points` in real time."""

LATCHED = _profile(1, latched=True)
"""`unoccupied_area`, `unoccupied_area/grid`."""

ODOMETRY = _profile(10)
ODOMETRY_INPUT = _profile(10, reliable=False)

COMMAND = _profile(1)
"""`<robot>/path`, `<robot>/certificate`, `<robot>/goal_pose`, `<robot>/cmd_vel`."""

DIAGNOSTICS = _profile(10)

INBOX = _profile(1000, latched=True)
"""`robots`, `planners` where they are heard, in both modes; each publisher keeps its last word (`LATCHED`). In lockstep
also the diagnostics of all nodes."""

RECORDED = _profile(1000)
"""What the recorder of a run hears in real time, scans excepted."""

CLOCK = _profile(1)
CLOCK_INPUT = _profile(1, reliable=False)
"""`/clock` free running; subscribers ask for best effort."""

LOCKSTEP = _profile(100, latched=True)
"""Every topic of a lockstep run but large ones (`CLOUDS`, `VOLUMES`), on both sides: nothing is lost, up to 100 scans
of a sensor per tick, and who is discovered late gets what he waits for."""

CLOUDS = _profile(10, latched=True)
"""`sensors/<id>/points` in lockstep: nine images of a sensor per tick and the word that ends it; they are large."""

VOLUMES = _profile(2, latched=True)
"""`unoccupied_area` of space and its grid in lockstep: 6 MB each, and who needs one holds the clock."""

DONE_INBOX = _profile(1000, latched=True)
"""`lockstep/done` at the clock: one inbox for the words of all participants."""


def for_mode(lockstep: bool, profile: QoSProfile) -> QoSProfile:
    """Return `profile`, or in lockstep the profile of lockstep."""
    return LOCKSTEP if lockstep else profile
