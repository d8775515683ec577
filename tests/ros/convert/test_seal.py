"""The seal: as documented, the same after the wire and from a recording, another one for any other pair."""

from __future__ import annotations

import hashlib
import re
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from nav_msgs.msg import Path as PathMessage
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.typesys import Stores, get_typestore

from snnav_core.types import Certificate, PathSource, PlannedPath, Stop, StopReason, TimedPath
from snnav_ros.convert import path_to_message, stop_to_path, verdict_from_message, verdict_to_message
from snnav_ros.convert.seal import seal_of

DOCUMENT = Path(__file__).parents[3] / "docs" / "interfaces.md"


def pair(count: int = 5, start: float = 12.25) -> tuple[Any, Any]:
    points = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.05, (count, 2)), axis=0)
    path = TimedPath(start, 0.1, points)
    certificate = Certificate("cart", True, start + 2.0, 0.5, np.inf, 1.5, start, path.digest())
    message = path_to_message(path)
    plan = PlannedPath("cart", path, certificate, PathSource.WARM_START, 0.6)
    return message, verdict_to_message(plan, round(start * 1e9), message)


def test_it_is_what_the_document_says() -> None:
    """The example of docs/interfaces.md, run as it stands there, gives the seal that the planner sent."""
    blocks = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
    (block,) = [block for block in blocks if "snnav-seal-1" in block]
    names: dict[str, Any] = {}
    exec(compile(block, str(DOCUMENT), "exec"), names)
    message, certificate = pair()
    assert names["seal"](message, certificate) == verdict_from_message(certificate).seal
    stop = stop_to_path(7)
    reason = verdict_to_message(Stop("cart", StopReason.NO_PATH, "wall — near"), 7, stop)
    assert names["seal"](stop, reason) == verdict_from_message(reason).seal


def test_bytes_are_those_of_the_layout() -> None:
    path = PathMessage()
    path.header.frame_id, path.header.stamp.sec = "map", -2
    status = DiagnosticStatus(level=b"\x01", name="é", values=[KeyValue(key="a", value="b")])
    content = b"snnav-seal-1" + struct.pack("<iII", -2, 0, 3) + b"map" + struct.pack("<I", 0)
    content += b"\x01" + struct.pack("<I", 2) + "é".encode() + struct.pack("<II", 0, 0)
    content += struct.pack("<II", 1, 1) + b"a" + struct.pack("<I", 1) + b"b"
    assert seal_of(path, status) == hashlib.sha256(content).hexdigest()


def test_it_is_the_same_after_the_wire_and_from_a_recording() -> None:
    message, certificate = pair()
    sent = verdict_from_message(certificate).seal
    assert len(sent) == 64
    path, status = serialize_message(message), serialize_message(certificate)
    assert (
        seal_of(deserialize_message(path, PathMessage), deserialize_message(status, DiagnosticStatus)) == sent
    )
    types = get_typestore(Stores.ROS2_JAZZY)
    read = types.deserialize_cdr(path, "nav_msgs/msg/Path")
    assert seal_of(read, types.deserialize_cdr(status, "diagnostic_msgs/msg/DiagnosticStatus")) == sent


def test_texts_cannot_trade_letters() -> None:
    one = DiagnosticStatus(name="ab", message="c")
    other = DiagnosticStatus(name="a", message="bc")
    assert seal_of(stop_to_path(0), one) != seal_of(stop_to_path(0), other)


def test_a_long_path_takes_little_time() -> None:
    message, certificate = pair(300)
    best = min(_duration(message, certificate) for _ in range(10))
    assert best < 0.01, f"{1e3 * best:.2f} ms for 300 poses"


def _duration(message: Any, certificate: Any) -> float:
    begin = time.perf_counter()
    seal_of(message, certificate)
    return time.perf_counter() - begin
