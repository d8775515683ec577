"""Read rosbag2 directories, plain .mcap and .db3 files and ROS 1 .bag files in one way."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from snnav_ros.bag.errors import BagError, one_line
from snnav_ros.bag.messages import jazzy_types

__all__ = ["BagMessage", "BagReader"]

_KINDS = ".mcap, .db3, .bag or a rosbag2 directory with metadata.yaml"


@dataclass(frozen=True, slots=True)
class BagMessage:
    """One recorded message: topic, type, time of recording [ns] and the message as ``rosbags`` gives it."""

    topic: str
    type_name: str
    stamp_ns: int
    message: Any


class _Directory(type(Path())):  # type: ignore[misc]
    """A directory whose name may end in .bag: `AnyReader` takes what is named so for a file of ROS 1."""

    suffix = ""


class BagReader:
    """Iterate the messages of a recording in the order of their recording.

    Parameters
    ----------
    path : path-like
        A rosbag2 directory (MCAP or SQLite), a plain ``.mcap`` or ``.db3`` file, or a ROS 1 ``.bag``.

    Raises
    ------
    BagError
        One line with file and remedy: missing, not a bag, truncated, empty, no such topic (with the topics
        there are), a type without definition.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._reader: AnyReader | None = None

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> Literal[False]:
        self.close()
        return False

    @property
    def topics(self) -> dict[str, str]:
        """Type of every topic, sorted by topic."""
        pairs = {connection.topic: connection.msgtype for connection in self._opened().connections}
        return dict(sorted(pairs.items()))

    def open(self) -> None:
        """Open the recording and read its index."""
        _refuse_other_files(self.path)
        with self._reading("opened"):
            source = _Directory(self.path) if self.path.is_dir() else self.path
            reader = AnyReader([source], default_typestore=jazzy_types())
            reader.open()
        self._reader = reader
        if not reader.message_count:
            self.close()
            raise BagError(f"{self.path}: the bag is empty; record it again")

    def close(self) -> None:
        """Close the files."""
        if self._reader is not None:
            self._reader.close()
        self._reader = None

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Yield the messages of some topics (all by default), in order of their time of recording.

        A leading slash of a topic does not matter.
        """
        reader = self._opened()
        connections = None if topics is None else [c for topic in topics for c in self._find(topic)]
        if connections == []:
            return
        expected = sum(connection.msgcount for connection in connections or reader.connections)
        with self._reading("read"):
            for connection, stamp_ns, raw in reader.messages(connections or ()):
                message = self._decoded(reader, connection, raw)
                expected -= 1
                yield BagMessage(connection.topic, connection.msgtype, stamp_ns, message)
        if expected > 0:
            raise BagError(
                f"{self.path}: {expected} messages of its index are missing; record or copy it again"
            )

    def require(self, topic: str, type_name: str) -> None:
        """Raise BagError unless the topic is there and has this type (``package/msg/Name``)."""
        for connection in self._find(topic):
            if connection.msgtype != type_name:
                raise BagError(
                    f"{self.path}: topic {topic!r} is a {connection.msgtype}, expected {type_name}"
                )

    def _opened(self) -> AnyReader:
        if self._reader is None:
            raise BagError(f"{self.path}: is not open; use the reader in a with statement")
        return self._reader

    def _find(self, topic: str) -> list[Connection]:
        found = [c for c in self._opened().connections if c.topic.strip("/") == topic.strip("/")]
        if not found:
            known = ", ".join(self.topics)
            raise BagError(f"{self.path}: no topic {topic!r}; the bag has {known}")
        return found

    def _decoded(self, reader: AnyReader, connection: Connection, raw: bytes) -> Any:
        if connection.msgtype not in reader.typestore.fielddefs:
            raise BagError(
                f"{self.path}: topic {connection.topic!r} has type {connection.msgtype}, which neither the "
                "bag nor ROS 2 Jazzy defines; leave the topic out"
            )
        return reader.deserialize(raw, connection.msgtype)

    @contextmanager
    def _reading(self, doing: str) -> Iterator[None]:
        """Turn whatever the parsers raise on damaged bytes into one line."""
        try:
            yield
        except (BagError, GeneratorExit):
            raise
        except sqlite3.Error as error:
            raise BagError(
                f"{self.path}: cannot be {doing} ({one_line(error)}); it is no rosbag2 database"
            ) from None
        except Exception as error:
            raise BagError(
                f"{self.path}: cannot be {doing} ({one_line(error)}); it is damaged or cut short, "
                "record or copy it again"
            ) from None


def _refuse_other_files(path: Path) -> None:
    if not path.exists():
        raise BagError(f"{path}: does not exist; give {_KINDS}")
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            if (path / "bag" / "metadata.yaml").is_file():
                raise BagError(f"{path}: is a run directory; give the bag in it, {path / 'bag'}")
            raise BagError(f"{path}: has no metadata.yaml, so it is no rosbag2 directory; give {_KINDS}")
    elif path.suffix not in (".mcap", ".db3", ".bag"):
        raise BagError(f"{path}: is not a bag; give {_KINDS}")
    elif path.stat().st_size == 0:
        raise BagError(f"{path}: the file is empty; record or copy it again")
