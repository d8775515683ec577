"""In which order the robots of a step are decided, and how long each has been blocked by others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

__all__ = ["Precedence"]

_BLOCKED = 5  # decisions in a row after which a robot goes to the front (C4-11)


class Precedence:
    """The order of the robots: as given at first; who was blocked for long goes to the front and stays there.

    Parameters
    ----------
    names : iterable of str
        Robot ids in order of priority.
    """

    def __init__(self, names: Iterable[str] = ()) -> None:
        self._order = list(names)
        self._blocked: dict[str, int] = {}

    @property
    def order(self) -> tuple[str, ...]:
        """Robot ids, the first decided first."""
        return tuple(self._order)

    def add(self, name: str) -> None:
        """Append a robot."""
        if name not in self._order:
            self._order.append(name)

    def remove(self, name: str) -> None:
        """Forget a robot."""
        self._order = [other for other in self._order if other != name]
        self._blocked.pop(name, None)

    def rank(self, name: str) -> int:
        """Place of a robot in the order."""
        return self._order.index(name)

    def blocked(self, name: str) -> int:
        """For how many decisions in a row a robot has been blocked by others."""
        return self._blocked.get(name, 0)

    def note(self, blocked: Mapping[str, bool]) -> None:
        """Count who was blocked in the last step; who was for five decisions in a row goes to the front.

        Of several at once the one that had precedence keeps it.
        """
        raised = []
        for name in self._order:
            count = self._blocked.get(name, 0) + 1 if blocked.get(name, False) else 0
            self._blocked[name] = count
            if count > 0 and count % _BLOCKED == 0:
                raised.append(name)
        self._order = raised + [name for name in self._order if name not in raised]

    def prefer(self, first: str, then: str) -> None:
        """Place `first` right before `then` when it comes after it."""
        if self.rank(first) > self.rank(then):
            self._order.remove(first)
            self._order.insert(self.rank(then), first)

    def sequence(self, waits_for: Mapping[str, Iterable[str]]) -> list[str]:
        """The order of a step: as `order`, but nobody before those it waits for."""
        done: list[str] = []

        def visit(name: str, above: tuple[str, ...]) -> None:
            if name in done or name in above or name not in self._order:
                return
            for other in waits_for.get(name, ()):
                visit(other, (*above, name))
            done.append(name)

        for name in self._order:
            visit(name, ())
        return done
