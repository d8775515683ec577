"""ROS parameters from dataclasses: declared with text and range, checked at start, read-only afterwards.

The fields of the settings of the core are the parameters; their texts come from the docstrings of the dataclasses, so
there is one place for each. A parameter that no dataclass knows, a wrong type, a value out of range or one that
contradicts another ends the node at its start with one line that names key and value.
"""

from __future__ import annotations

import difflib
import math
import re
import types
import typing
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from snnav_core.errors import InvalidInput, SnnavError
from snnav_ros.parameter_ranges import RANGES

__all__ = ["ParameterError", "ParameterReader", "field_texts"]

Settings = TypeVar("Settings")

_FOREIGN = ("use_sim_time", "start_type_description_service")
_FOREIGN_PREFIXES = ("qos_overrides.",)


class ParameterError(SnnavError):
    """A parameter of a node cannot be used; the message is one line."""


class ParameterReader:
    """Declares and reads the parameters of one node.

    Parameters
    ----------
    node : Node
        Made with ``automatically_declare_parameters_from_overrides=True``: that is how unknown ones are found.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._given = {
            name: parameter.value
            for name, parameter in node.get_parameters_by_prefix("").items()
            if name not in _FOREIGN and not name.startswith(_FOREIGN_PREFIXES)
        }
        self._known: list[str] = []

    def settings(
        self, kind: type[Settings], prefix: str = "", known: Mapping[str, Any] | None = None, **defaults: Any
    ) -> Settings:
        """Declare every field of a dataclass as a parameter and return the dataclass made of their values.

        Parameters
        ----------
        kind : type
            A dataclass; dataclasses in it become groups (``adjustment.pull``).
        prefix : str
            Put before the names, with a dot.
        known : mapping, optional
            Fields that are no parameters, with their values.
        **defaults
            Instead of the defaults of the dataclass, for example from a scene.

        Raises
        ------
        ParameterError
            If a value is missing, of the wrong type, out of range, or contradicts another.
        """
        hints, texts = typing.get_type_hints(kind), field_texts(kind)
        values: dict[str, Any] = dict(known or {})
        for field in fields(kind):  # type: ignore[arg-type]
            if not field.init or field.name in values:
                continue
            name = f"{prefix}.{field.name}" if prefix else field.name
            default = defaults.get(field.name, _default(field))
            if is_dataclass(hints[field.name]):
                inner = (
                    {} if default is MISSING else {f.name: getattr(default, f.name) for f in fields(default)}
                )
                values[field.name] = self.settings(hints[field.name], name, **inner)
            else:
                values[field.name] = self.value(name, hints[field.name], texts.get(field.name, ""), default)
        try:
            return kind(**values)
        except InvalidInput as error:
            raise self._error(prefix or kind.__name__, str(error)) from None

    def value(self, name: str, hint: Any, text: str, default: Any = MISSING) -> Any:
        """Declare one parameter and return its value.

        Parameters
        ----------
        name : str
        hint : type
            bool, int, float, str, a Literal, a tuple of one of them, or one of these ``| None``.
        text : str
            Its description.
        default : object
            Left out for a parameter that must be given; None for one that may stay unset.

        Raises
        ------
        ParameterError
            If it is missing, of the wrong type or out of range.
        """
        self._known.append(name)
        low, high = RANGES.get(name.rpartition(".")[2], (-math.inf, math.inf))
        if name in self._given:
            given = self._given[name]
            try:
                value = _converted(given, hint)
            except TypeError as error:
                raise self._error(name, f"value {given!r} {error}") from None
            self._node.undeclare_parameter(name)
        elif default is MISSING:
            raise self._error(name, "is not given; give it in the parameter file, or give `scene`")
        else:
            value = default
        _check_range(value, low, high, lambda remark: self._error(name, remark))
        self._declare(name, hint, text, value, (low, high))
        return value

    def peek(self, name: str, default: str) -> str:
        """Return the text given for a parameter that `settings` declares later, or the default.

        Raises
        ------
        ParameterError
            If it is no text.
        """
        given = self._given.get(name, default)
        if not isinstance(given, str):
            raise self._error(name, f"value {given!r} is no text; write a name")
        return given

    def finish(self) -> None:
        """Make sure that every given parameter is known.

        Raises
        ------
        ParameterError
            With the nearest known name.
        """
        for name in sorted(set(self._given) - set(self._known)):
            near = difflib.get_close_matches(name, self._known, n=1, cutoff=0.6)
            hint = f"did you mean {near[0]}?" if near else f"known are {', '.join(sorted(self._known))}"
            raise self._error(name, f"is unknown (value {self._given[name]!r}); {hint}")

    def fail(self, name: str, remark: str) -> typing.NoReturn:
        """Refuse a parameter for a reason that only the node knows."""
        raise self._error(name, remark)

    def _declare(self, name: str, hint: Any, text: str, value: Any, limits: tuple[float, float]) -> None:
        descriptor = ParameterDescriptor(description=text, read_only=True, dynamic_typing=value is None)
        kind = _plain(hint)
        descriptor.additional_constraints = _worded(hint)
        if all(map(math.isfinite, limits)) and kind in (float, int):
            if kind is float:
                descriptor.floating_point_range = [
                    FloatingPointRange(from_value=limits[0], to_value=limits[1])
                ]
            else:
                whole = IntegerRange(from_value=int(limits[0]), to_value=int(limits[1]), step=1)
                descriptor.integer_range = [whole]
        held = list(value) if isinstance(value, tuple) else value
        if held == []:
            held, descriptor.dynamic_typing = None, True
        self._node.declare_parameter(name, held, descriptor, ignore_override=True)

    def _error(self, name: str, remark: str) -> ParameterError:
        return ParameterError(f"{self._node.get_fully_qualified_name()}: parameter {name}: {remark}")


def field_texts(kind: type) -> dict[str, str]:
    """Return the text of every field from the Parameters section of a dataclass's docstring (NumPy style)."""
    lines = (kind.__doc__ or "").expandtabs().splitlines()
    indent = min((len(line) - len(line.lstrip()) for line in lines[1:] if line.strip()), default=0)
    texts: dict[str, str] = {}
    names: list[str] = []
    inside = False
    for line in (raw[indent:] for raw in lines[1:]):
        if re.fullmatch(r"\w+", line.strip()) and not line.startswith(" "):
            inside = line.strip() == "Parameters"
        elif inside and line and not line.startswith((" ", "-")):
            names = [name.strip() for name in line.partition(":")[0].split(",")]
        elif inside and line.startswith(" "):
            for name in names:
                texts[name] = f"{texts.get(name, '')} {line.strip()}".strip()
    return texts


def _default(field: Field[Any]) -> Any:
    return field.default_factory() if field.default_factory is not MISSING else field.default


def _options(hint: Any) -> list[Any]:
    union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    return [one for one in (typing.get_args(hint) if union else (hint,)) if one is not type(None)]


def _plain(hint: Any) -> Any:
    """Return the type of a hint without None, of the elements for a tuple."""
    first = _options(hint)[0]
    return typing.get_args(first)[0] if typing.get_origin(first) is tuple else first


def _converted(value: Any, hint: Any) -> Any:
    """Return the value in the type of the hint; whole numbers pass for real ones.

    Raises
    ------
    TypeError
        With the part of a message that follows the value.
    """
    first = _options(hint)[0]
    if typing.get_origin(first) is tuple:
        if isinstance(value, str | bytes) or not isinstance(value, Iterable):
            raise TypeError(f"is no list; give a list of {_named(_plain(hint))}")
        return tuple(_converted(one, _plain(hint)) for one in value)
    if typing.get_origin(first) is typing.Literal:
        if value not in typing.get_args(first):
            raise TypeError(f"must be one of {', '.join(map(repr, typing.get_args(first)))}")
        return value
    if first is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not first:
        raise TypeError(f"is no {_named(first)}; write {_EXAMPLES[first]}")
    return value


def _worded(hint: Any) -> str:
    """Return the type of a parameter in the words of ROS, and whether it may stay unset."""
    first, kind = _options(hint)[0], _plain(hint)
    literal = typing.get_origin(first) is typing.Literal
    name = "string" if literal else {float: "double", int: "int", bool: "bool", str: "string"}[kind]
    several = "[]" if typing.get_origin(first) is tuple else ""
    choice = f", one of {', '.join(typing.get_args(first))}" if literal else ""
    return f"{name}{several}{choice}{', may stay unset' if type(None) in typing.get_args(hint) else ''}"


_EXAMPLES = {float: "a number such as 1.0", int: "a whole number", bool: "true or false", str: "a text"}


def _named(kind: type) -> str:
    return {float: "number", int: "whole number", bool: "truth value", str: "text"}[kind]


def _check_range(value: Any, low: float, high: float, error: Any) -> None:
    for one in value if isinstance(value, tuple) else (value,):
        if isinstance(one, int | float) and not isinstance(one, bool) and not low <= one <= high:
            raise error(f"value {one!r} lies outside [{low:g}, {high:g}]; give one inside")
