"""Strict reading of YAML: every value knows its file, line and key, and every error says so in one line."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable
from typing import Any, NoReturn

import yaml

from snnav_core.errors import SnnavError

__all__ = ["Field", "SceneError", "read_document"]

_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
_SPECIAL = {".inf": math.inf, "+.inf": math.inf, "-.inf": -math.inf, ".nan": math.nan}
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_LONGEST_QUOTE = 60


class SceneError(SnnavError):
    """A scene cannot be used; the message is one line: ``file:line: key: value and what is wrong: remedy``."""


def read_document(text: str, source: str) -> Field:
    """Parse one YAML document whose root is a mapping.

    Parameters
    ----------
    text : str
        The document.
    source : str
        File name for messages.

    Raises
    ------
    SceneError
        If the text is not YAML, holds no or several documents, or is not a mapping.
    """
    try:
        node = yaml.compose(text, Loader=_LOADER)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = 1 if mark is None else mark.line + 1
        problem = " ".join(str(error.problem or error.context).split())
        raise SceneError(
            f"{source}:{line}: not valid YAML ({problem}): correct the syntax at this line"
        ) from None
    except (yaml.YAMLError, RecursionError) as error:
        raise SceneError(
            f"{source}:1: not valid YAML ({' '.join(str(error).split())}): save it as UTF-8"
        ) from None
    if node is None:
        raise SceneError(f"{source}:1: the file is empty: write a scene, see docs/scene-format.md")
    if not isinstance(node, yaml.MappingNode):
        raise SceneError(
            f"{source}:{node.start_mark.line + 1}: the file is no mapping: start with `name: ...`"
        )
    return Field(node, source, "")


class Field:
    """One YAML node with the way to it.

    Parameters
    ----------
    node : yaml.Node
    source : str
        File name for messages.
    path : str
        Keys from the root, such as ``robots[0].speed``.
    """

    def __init__(self, node: yaml.Node, source: str, path: str) -> None:
        self._node = node
        self.source = source
        self.path = path

    @property
    def line(self) -> int:
        """Line of the value, counted from 1."""
        return int(self._node.start_mark.line) + 1

    def fail(self, problem: str, remedy: str) -> NoReturn:
        """Raise a SceneError for this value."""
        place = f"{self.path}: " if self.path else ""
        raise SceneError(f"{self.source}:{self.line}: {place}{problem}: {remedy}")

    def quoted(self) -> str:
        """Return the value as written, shortened, for a message."""
        if isinstance(self._node, yaml.ScalarNode):
            text = " ".join(str(self._node.value).split())
            text = text if len(text) <= _LONGEST_QUOTE else text[:_LONGEST_QUOTE] + "..."
            return text or "an empty value"
        if isinstance(self._node, yaml.SequenceNode):
            return f"a list of {len(self._node.value)}"
        return "a mapping"

    def child(self, node: yaml.Node, key: str) -> Field:
        """Return a value below this one."""
        separator = "" if key.startswith("[") or not self.path else "."
        return Field(node, self.source, f"{self.path}{separator}{key}")

    def mapping(self, required: Iterable[str], optional: Iterable[str]) -> dict[str, Field]:
        """Return the entries of a mapping whose keys are known, complete and unique.

        Raises
        ------
        SceneError
            For an unknown key (naming the nearest known one), a duplicate or a missing key.
        """
        required, known = list(required), [*required, *optional]
        if not isinstance(self._node, yaml.MappingNode):
            self.fail(f"{self.quoted()} is no mapping", f"write {{{', '.join(required)}, ...}}")
        entries: dict[str, Field] = {}
        for key_node, value_node in self._node.value:
            key = str(key_node.value)
            place = self.child(key_node, key if isinstance(key_node, yaml.ScalarNode) else "?")
            if key not in known:
                place.fail("unknown key", _hint(key, known))
            if key in entries:
                place.fail(f"key given twice (first in line {entries[key].line})", "keep one of them")
            entries[key] = self.child(value_node, key)
        for key in required:
            if key not in entries:
                self.fail(f"key {key} is missing", f"add {key}: ...")
        return entries

    def children(self) -> dict[str, Field]:
        """Return the entries of a mapping as written, unchecked; empty for any other value."""
        if not isinstance(self._node, yaml.MappingNode):
            return {}
        return {str(key.value): self.child(value, str(key.value)) for key, value in self._node.value}

    def items(self, form: str) -> list[Field]:
        """Return the entries of a list; `form` is shown to who wrote something else."""
        if not isinstance(self._node, yaml.SequenceNode):
            self.fail(f"{self.quoted()} is no list", f"write {form}")
        return [self.child(node, f"[{index}]") for index, node in enumerate(self._node.value)]

    def text(self, may_be_empty: bool = False) -> str:
        """Return a string of one line (a folded block counts as one); it may be empty only if told so."""
        if not isinstance(self._node, yaml.ScalarNode) or self._node.tag.endswith(":null"):
            self.fail(f"{self.quoted()} is no text", "write a word or a line in quotes")
        value = (
            " ".join(str(self._node.value).split())
            if self._node.style in ("|", ">")
            else str(self._node.value)
        )
        if value == "" and may_be_empty:
            return value
        if not value.strip() or not value.isprintable():
            self.fail(
                "the text is empty, has several lines or unprintable characters", "write one line of text"
            )
        return value

    def flag(self) -> bool:
        """Return true or false."""
        if not isinstance(self._node, yaml.ScalarNode) or self._node.value not in ("true", "false"):
            self.fail(f"{self.quoted()} is neither true nor false", "write true or false")
        return bool(self._node.value == "true")

    def choice(self, values: Iterable[str]) -> str:
        """Return one of the given words."""
        values = list(values)
        if not isinstance(self._node, yaml.ScalarNode) or self._node.value not in values:
            self.fail(f"{self.quoted()} is not known here", f"write one of {', '.join(values)}")
        return str(self._node.value)

    def any_number(self, unit: str) -> float:
        """Return a number, which may be ``.nan`` or ``.inf`` (a recorded range may)."""
        node = self._node
        if isinstance(node, yaml.ScalarNode) and not node.style:
            text = str(node.value)
            if text.lower() in _SPECIAL:
                return _SPECIAL[text.lower()]
            if _NUMBER.fullmatch(text):
                return float(text)
        self.fail(f"{self.quoted()} is no number", f"write a plain number [{unit}] without unit or quotes")

    def number(
        self, unit: str, least: float = -math.inf, most: float = math.inf, above: bool = False
    ) -> float:
        """Return a finite number in [least, most], or in (least, most] when `above` is set."""
        value = self.any_number(unit)
        low_ok = value > least if above else value >= least
        if math.isfinite(value) and low_ok and value <= most:
            return value
        bounds = []
        if math.isfinite(least):
            bounds.append(f"{'above' if above else 'at least'} {least:g}")
        if math.isfinite(most):
            bounds.append(f"at most {most:g}")
        remedy = f"give a number {' and '.join(bounds)}" if bounds else "give a finite number"
        self.fail(f"{self.quoted()} is out of range", f"{remedy} [{unit}]")

    def whole(self, least: int, most: int) -> int:
        """Return a whole number in [least, most]."""
        value = self.any_number("whole number")
        remedy = f"give a whole number from {least} to {most}"
        if not (math.isfinite(value) and least <= value <= most):
            self.fail(f"{self.quoted()} is out of range", remedy)
        if value != int(value):
            self.fail(f"{self.quoted()} is no whole number", remedy)
        return int(value)

    def point(self, what: str = "[x, y]") -> tuple[float, float]:
        """Return two finite coordinates [m]."""
        items = self.items(what)
        if len(items) == 3:
            self.fail(
                "a list of 3 coordinates", f"write {what}; a scene in space has workspace: {{box: ...}}"
            )
        if len(items) != 2:
            self.fail(f"{self.quoted()}, expected 2", f"write {what}")
        return items[0].number("m"), items[1].number("m")


def _hint(key: str, known: list[str]) -> str:
    """Return what to write instead of an unknown key."""
    if f"{key}_deg" in known:
        return f"angles are given in degrees, write {key}_deg"
    near = difflib.get_close_matches(key, known, n=1, cutoff=0.5)
    return f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}"
