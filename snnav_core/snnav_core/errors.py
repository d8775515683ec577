"""The exception tree of snnav.

Every message names the offending value and says what to do about it.
"""

from __future__ import annotations

__all__ = [
    "GoalBlocked",
    "GoalUnreachable",
    "InvalidInput",
    "NoPathFound",
    "PlanningError",
    "ScanError",
    "SnnavError",
    "StartBlocked",
]


class SnnavError(Exception):
    """Base of all errors that snnav raises on purpose."""


class InvalidInput(SnnavError, ValueError):
    """A value handed to snnav has the wrong shape, type or range."""


class ScanError(InvalidInput):
    """A range measurement cannot be used at all (wrong beam count, unusable geometry)."""


class PlanningError(SnnavError):
    """Base of the typed reasons why no path was found."""


class StartBlocked(PlanningError):
    """The robot stands outside the unoccupied area, or closer to its boundary than its own radius."""


class GoalBlocked(PlanningError):
    """The target lies outside the unoccupied area reduced by the safety margin."""


class GoalUnreachable(PlanningError):
    """Start and target lie in different components of the reduced area."""


class NoPathFound(PlanningError):
    """Start and target are connected, but no candidate passed the certificate."""
