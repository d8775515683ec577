"""What goes wrong with recordings: every message is one line that names file, value and remedy."""

from __future__ import annotations

from snnav_core.errors import SnnavError

__all__ = ["BagError", "LogError", "NetworkError", "one_line"]


class BagError(SnnavError):
    """A bag cannot be read or written."""


class LogError(SnnavError):
    """A CARMEN log holds nothing that can be used."""


class NetworkError(SnnavError):
    """No sensor network or no start and target can be made of a recording."""


def one_line(error: BaseException) -> str:
    """Return the text of an exception on one line; its type's name when it has no text."""
    return " ".join(str(error).split()) or type(error).__name__
