"""What a planner node says after each instant, as a diagnostic_msgs/DiagnosticStatus on `planners`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from snnav_core.errors import InvalidInput
from snnav_ros.convert.stamps import nanoseconds, seconds
from snnav_ros.convert.status import status_to_message, values_from_message

__all__ = ["Word", "word_from_message", "word_to_message"]

_STOP = "stop "  # before the id of a robot, in a key


@dataclass(frozen=True)
class Word:
    """What a planner did at an instant.

    Parameters
    ----------
    planner : str
        Name of its node.
    stamp : int
        The instant [ns].
    life : str
        Differs from start to start of the node.
    issue : int
        How many times it has published decisions in this life, with this one.
    decided : tuple of str
        Robots whose paths or stops, stamped `stamp`, it published; empty when it published nothing.
    stops : tuple of (str, str)
        Robots of other planners that it stopped, and why in words.
    """

    planner: str
    stamp: int
    life: str
    issue: int
    decided: tuple[str, ...] = ()
    stops: tuple[tuple[str, str], ...] = ()


def word_to_message(word: Word) -> Any:
    """Return the DiagnosticStatus of a word."""
    values = {
        "stamp": repr(seconds(word.stamp)),
        "life": word.life,
        "issue": str(word.issue),
        "decided": " ".join(word.decided),
        **{f"{_STOP}{robot}": why for robot, why in word.stops},
    }
    text = "decided" if word.decided else "issued nothing"
    return status_to_message(word.planner, word.planner, text, values)


def word_from_message(message: Any, topic: str = "planners") -> Word:
    """Return the word of a planner.

    Raises
    ------
    InvalidInput
        If a key is missing, unreadable or there twice.
    """
    values = values_from_message(message, topic)
    try:
        return Word(
            message.name,
            nanoseconds(float(values["stamp"])),
            values["life"],
            int(values["issue"]),
            tuple(values["decided"].split()),
            tuple((key.removeprefix(_STOP), why) for key, why in values.items() if key.startswith(_STOP)),
        )
    except KeyError as error:
        raise InvalidInput(f"{topic}: key {error} is missing; send all keys of a planner") from None
    except ValueError as error:
        raise InvalidInput(f"{topic}: {error}; send the keys as documented") from None
