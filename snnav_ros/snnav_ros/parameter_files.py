"""Parameter files looked at before ROS reads them: its own messages name neither the key nor a remedy."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from snnav_core.errors import SnnavError

__all__ = ["ParameterFileError", "check_parameter_files", "parameter_files"]


class ParameterFileError(SnnavError):
    """A parameter file cannot be used; the message is one line."""


def parameter_files(arguments: Sequence[str]) -> list[Path]:
    """Return the parameter files among the arguments of a program."""
    return [Path(value) for key, value in pairwise(arguments) if key == "--params-file"]


def check_parameter_files(arguments: Sequence[str]) -> None:
    """Make sure that ROS can read every parameter file among the arguments of a program.

    Raises
    ------
    ParameterFileError
        With file, line or key, and remedy.
    """
    import yaml  # here, for until the program has begun a signal ends it with a stack trace

    for path in parameter_files(arguments):
        try:
            content = yaml.safe_load(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise ParameterFileError(
                f"{path}: cannot be read ({error.strerror}); give an existing file"
            ) from None
        except UnicodeDecodeError:
            raise ParameterFileError(f"{path}: is no text in UTF-8; save it as such") from None
        except yaml.YAMLError as error:
            raise ParameterFileError(_yaml_message(path, error)) from None
        if not isinstance(content, dict):
            raise ParameterFileError(
                f"{path}: holds no nodes; write `node_name:` and below `ros__parameters:`"
            )
        _check(path, (), content)


def _yaml_message(path: Path, error: Exception) -> str:
    mark = getattr(error, "problem_mark", None)
    line = f":{mark.line + 1}" if mark is not None else ""
    return f"{path}{line}: is no YAML ({getattr(error, 'problem', None) or 'unreadable'}); correct it there"


def _check(path: Path, keys: tuple[str, ...], value: Any) -> None:
    """Refuse what YAML allows and ROS does not: lists of mixed types, empty lists, nothing, lists of lists."""
    where = ".".join(keys)
    if isinstance(value, dict):
        for key, inner in value.items():
            _check(path, (*keys, str(key)), inner)
    elif value is None or value == []:
        raise ParameterFileError(f"{path}: {where}: has no value; give one or remove the key")
    elif isinstance(value, list):
        kinds = {type(one) for one in value}
        if kinds == {int, float}:
            raise ParameterFileError(
                f"{path}: {where}: {value} mixes whole and real numbers; write all with a point"
            )
        if len(kinds) > 1 or not kinds <= {bool, int, float, str}:
            raise ParameterFileError(f"{path}: {where}: {value} must be a list of one kind of plain values")
