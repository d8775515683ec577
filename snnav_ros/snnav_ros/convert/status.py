"""Texts by keys in a diagnostic_msgs/DiagnosticStatus: what certificates, announcements and words are made of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from snnav_core.errors import InvalidInput
from snnav_ros.available import new_message

__all__ = ["ERROR", "OK", "WARN", "pair_message", "status_to_message", "values_from_message"]

OK, WARN, ERROR = b"\x00", b"\x01", b"\x02"  # levels


def status_to_message(
    name: str, hardware: str, text: str, values: Mapping[str, str], level: bytes = OK
) -> Any:
    """Return a DiagnosticStatus of a name, a hardware id, a message text, and values in their order."""
    status = new_message("diagnostic_msgs/DiagnosticStatus", level=level, message=text)
    status.name, status.hardware_id = name, hardware
    status.values = [pair_message(key, value) for key, value in values.items()]
    return status


def pair_message(key: str, value: str) -> Any:
    """Return a diagnostic_msgs/KeyValue."""
    return new_message("diagnostic_msgs/KeyValue", key=key, value=value)


def values_from_message(message: Any, where: str) -> dict[str, str]:
    """Return the values of a DiagnosticStatus by their keys; `where` begins the text of an error.

    Raises
    ------
    InvalidInput
        If a key is there twice.
    """
    values = {pair.key: pair.value for pair in message.values}
    if len(values) < len(message.values):
        raise InvalidInput(f"{where}: a key is there twice; send every key once")
    return values
