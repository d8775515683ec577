"""What was decided for a robot and why, as a diagnostic_msgs/DiagnosticStatus on `<robot>/certificate`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from snnav_core.errors import InvalidInput
from snnav_core.types import Certificate, PathSource, PlannedPath, Stop, StopReason
from snnav_ros.convert.seal import SEAL_KEY, seal_of
from snnav_ros.convert.stamps import nanoseconds, seconds
from snnav_ros.convert.status import ERROR, OK, WARN, pair_message, status_to_message, values_from_message

__all__ = ["Verdict", "verdict_from_message", "verdict_to_message"]

_TEXTS = ("robot_id", "path_digest", "reason")
_NUMBERS = ("valid_until", "least_clearance", "least_separation", "least_radius", "area_stamp")


@dataclass(frozen=True)
class Verdict:
    """What a certificate message says.

    Parameters
    ----------
    stamp : float
        Sample time of the decision [s].
    robot_id : str
    certificate : Certificate or None
        Of the path; None for a stop.
    stop : Stop or None
        Why there is no path.
    source : PathSource or None
        Where the path comes from.
    planning_distance : float or None
        Distance to the boundary that the path was planned for [m].
    seal : str
        As it was received (see `seal_of`); empty when there is none, as in recordings made before there was one.
    """

    stamp: float
    robot_id: str
    certificate: Certificate | None = None
    stop: Stop | None = None
    source: PathSource | None = None
    planning_distance: float | None = None
    seal: str = ""


def verdict_to_message(decision: PlannedPath | Stop, stamp_ns: int, path_message: Any) -> Any:
    """Return the DiagnosticStatus of a decision, sealed together with its path.

    Parameters
    ----------
    decision : PlannedPath or Stop
    stamp_ns : int
        Sample time of the decision [ns].
    path_message : nav_msgs/Path
        The very message that is published with it.

    Returns
    -------
    diagnostic_msgs/DiagnosticStatus
        Numbers are written so that reading gives the same float.
    """
    robot = decision.robot_id
    values = {"stamp": repr(seconds(stamp_ns))}
    if isinstance(decision, Stop):
        good = decision.reason is StopReason.ARRIVED
        level, text = OK if good else WARN, decision.message
        values["stop"] = decision.reason.value
    else:
        certificate = decision.certificate
        level, text = (OK, "certified") if certificate.accepted else (ERROR, certificate.reason)
        values["accepted"] = "true" if certificate.accepted else "false"
        values |= {name: getattr(certificate, name) for name in _TEXTS}
        values |= {name: repr(float(getattr(certificate, name))) for name in _NUMBERS}
        values["source"] = decision.source.value
        values["planning_distance"] = repr(float(decision.planning_distance))
    status = status_to_message(f"{robot}: path", robot, text, values, level)
    status.values.append(pair_message(SEAL_KEY, seal_of(path_message, status)))
    return status


def verdict_from_message(message: Any, topic: str = "certificate") -> Verdict:
    """Return what a DiagnosticStatus says about a path or a stop.

    Raises
    ------
    InvalidInput
        With topic and key if one is missing, unreadable or there twice.
    """
    values = values_from_message(message, topic)
    robot = message.hardware_id
    try:
        stamp, seal = seconds(nanoseconds(float(values["stamp"]))), values.get(SEAL_KEY, "")
        if "stop" in values:
            stop = Stop(robot, StopReason(values["stop"]), message.message)
            return Verdict(stamp, robot, stop=stop, seal=seal)
        numbers = {name: float(values[name]) for name in _NUMBERS}
        if values["accepted"] not in ("true", "false"):
            raise ValueError(f"accepted is {values['accepted']!r}, expected true or false")
        texts = {name: values[name] for name in _TEXTS}
        certificate = Certificate(accepted=values["accepted"] == "true", **texts, **numbers)
        source, distance = PathSource(values["source"]), float(values["planning_distance"])
    except KeyError as error:
        raise InvalidInput(
            f"{topic}: key {error} is missing; send all keys of a certificate or of a stop"
        ) from None
    except ValueError as error:
        raise InvalidInput(f"{topic}: {error}; send the keys as documented") from None
    return Verdict(stamp, robot, certificate, source=source, planning_distance=distance, seal=seal)
