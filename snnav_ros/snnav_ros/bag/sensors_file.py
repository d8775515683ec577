"""The file that says where the scanners of a recording hang, which topics hold their scans, and how to read them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from snnav_core.area.fusion import PlanarSensor
from snnav_core.sensing.scan import ScanSettings
from snnav_core.types import Pose2D
from snnav_ros.bag.errors import BagError, one_line
from snnav_ros.convert import MAP_FRAME
from snnav_sim.scene_yaml import Field, read_document

__all__ = ["TopicSensor", "read_sensors"]

_POSE = ("topic", "x", "y", "yaw")
_MOUNTING = ("z", "pitch", "roll")
_REMARKS = ("units", "note")
_LARGEST_TILT = 0.02  # [rad]; shortens a range by 0.02 %
_MOST_BEAMS = 1_000_000
_FORM = "{sensors: {<id>: {topic: ..., x: ..., y: ..., yaw: ...}}}"


@dataclass(frozen=True)
class TopicSensor:
    """A scanner of a recording.

    Parameters
    ----------
    sensor : PlanarSensor
        Name, pose in the map, how its ranges are read.
    topic : str
        Topic of its scans.
    mirrored : bool
        Whether it hangs upside down (roll of half a turn): its beams run the other way round.
    no_return : tuple of float
        Readings by which the device says that nothing came back [m]: they are read as +inf, as REP-117 has it.
    """

    sensor: PlanarSensor
    topic: str
    mirrored: bool = False
    no_return: tuple[float, ...] = ()


def read_sensors(path: str | Path) -> tuple[TopicSensor, ...]:
    """Read a file of sensor poses, YAML or JSON.

    Parameters
    ----------
    path : path-like
        ``sensors: {<id>: {topic, x, y, yaw, ...}}`` in metres and radians; docs/real-logs.md has all keys.

    Returns
    -------
    tuple of TopicSensor
        In the order of the file.

    Raises
    ------
    SnnavError
        One line with file, line, key, value and remedy.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or one_line(error)
        raise BagError(f"{path}: cannot be read ({reason}); give a YAML or JSON file {_FORM}") from None
    if not text.strip():
        raise BagError(f"{path}: the file is empty; write {_FORM}")
    entries = read_document(text, str(path)).mapping(("sensors",), ("frame", *_REMARKS))
    if "frame" in entries:
        entries["frame"].choice((MAP_FRAME,))
    _refuse_other_units(entries)
    found = entries["sensors"].children()
    if not found:
        entries["sensors"].fail(f"{entries['sensors'].quoted()} names no sensor", f"write {_FORM}")
    places = entries["sensors"].mapping((), found)  # refuses a name given twice
    sensors = tuple(_sensor(name, place) for name, place in places.items())
    _refuse_shared_topics(sensors, places)
    return sensors


def _refuse_other_units(entries: dict[str, Field]) -> None:
    """Do not read degrees as radians where the file itself says what it holds."""
    if "note" in entries:
        entries["note"].text(may_be_empty=True)
    if "units" in entries:
        text = entries["units"].text().lower()
        if "deg" in text or "mm" in text or "millimet" in text:
            entries["units"].fail(
                f"{entries['units'].quoted()} cannot be read", "give metres and radians, and say so here"
            )


def _sensor(name: str, place: Field) -> TopicSensor:
    entries = place.mapping(_POSE, (*_MOUNTING, *_REMARKS, "no_return", *_READING))
    if "z" in entries:
        entries["z"].number("m")
    _refuse_other_units(entries)
    mirrored = _is_mirrored(entries)
    pose = Pose2D(entries["x"].number("m"), entries["y"].number("m"), _angle(entries["yaw"]))
    values = {key: read(entries[key]) for key, read in _READING.items() if key in entries}
    sensor = PlanarSensor(name, pose, ScanSettings(**values))
    no_return = _codes(entries["no_return"]) if "no_return" in entries else ()
    return TopicSensor(sensor, entries["topic"].text().strip(), mirrored, no_return)


def _angle(field: Field) -> float:
    angle = field.number("rad")
    if abs(angle) > 2.0 * math.pi + 1e-3:
        field.fail(f"{field.quoted()} is more than a turn", "give the angle in radians, not in degrees")
    return angle


def _is_mirrored(entries: dict[str, Field]) -> bool:
    """Tell whether a scanner stands upright or hangs upside down; nothing else measures in the plane."""
    pitch, roll = (entries.get(key) for key in ("pitch", "roll"))
    if pitch is not None and abs(_angle(pitch)) > _LARGEST_TILT:
        pitch.fail(
            f"{pitch.quoted()} tilts the scanner out of the plane",
            "leave it out; for a scanner upside down give roll 3.14159 and the yaw of its beam at 0",
        )
    tilt = 0.0 if roll is None else abs(math.remainder(_angle(roll), 2.0 * math.pi))
    if roll is not None and _LARGEST_TILT < tilt < math.pi - _LARGEST_TILT:
        roll.fail(
            f"{roll.quoted()} tilts the scanner out of the plane", "give 0 (upright) or 3.14159 (upside down)"
        )
    return tilt > 0.5 * math.pi


def _refuse_shared_topics(sensors: tuple[TopicSensor, ...], places: dict[str, Field]) -> None:
    seen: dict[str, str] = {}
    for entry in sensors:
        name, topic = entry.sensor.id, entry.topic.strip("/")
        if topic in seen:
            places[name].fail(
                f"topic {entry.topic} is also that of {seen[topic]}", "give every sensor a topic of its own"
            )
        seen[topic] = name


def _length(field: Field) -> float:
    return field.number("m", 0.0)


def _cut(field: Field) -> float:
    return field.number("m", 0.0, above=True)


def _codes(field: Field) -> tuple[float, ...]:
    return tuple(item.number("m") for item in field.items("a list of ranges [m]"))


# How the ranges are read: the key of the file is the name of the setting.
_READING: dict[str, Any] = {
    "inf_is_free": Field.flag,
    "never_repeats": Field.flag,
    "error_codes": _codes,
    "range_accuracy": _length,
    "range_cut": _cut,
    "expected_beams": lambda field: field.whole(2, _MOST_BEAMS),
    "jump_ratio": lambda field: field.number("-", 0.0),
    "jump_distance": _length,
}
