"""The seal of a path and its certificate: one hash over every field of both messages (docs/interfaces.md, "The seal").

A robot computes it from what it received. A bit that was altered in either message, or a certificate of another path,
gives another seal. It tells damage and mix-ups; it is no signature, for it needs no secret to be made.
"""

from __future__ import annotations

import hashlib
import struct
from typing import Any

__all__ = ["SEAL_KEY", "seal_of"]

SEAL_KEY = "seal"
"""Key of the certificate that holds the seal; the one value that is not sealed."""

_TAG = b"snnav-seal-1"


def seal_of(path: Any, certificate: Any) -> str:
    """Return the seal: 64 hexadecimal digits of the SHA-256 of all fields.

    Parameters
    ----------
    path : nav_msgs/Path
    certificate : diagnostic_msgs/DiagnosticStatus
        All of its values count but those of the key `seal`.

    Notes
    -----
    Numbers are little-endian; every text and list goes with its length, so no two pairs of messages give the same
    bytes. The bytes of CDR would not do: its padding is not defined.
    """
    return hashlib.sha256(_TAG + _path_bytes(path) + _certificate_bytes(certificate)).hexdigest()


def _path_bytes(path: Any) -> bytes:
    poses, stamps = path.poses, []
    numbers: list[float] = []
    for stamped in poses:
        stamp, place, turn = stamped.header.stamp, stamped.pose.position, stamped.pose.orientation
        stamps += (stamp.sec, stamp.nanosec)
        numbers += (place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w)
    return b"".join(
        (
            struct.pack("<iI", path.header.stamp.sec, path.header.stamp.nanosec),
            _text(path.header.frame_id),
            struct.pack("<I", len(poses)),
            struct.pack(f"<{'iI' * len(poses)}", *stamps),
            *(_text(stamped.header.frame_id) for stamped in poses),
            struct.pack(f"<{len(numbers)}d", *numbers),
        )
    )


def _certificate_bytes(status: Any) -> bytes:
    level = status.level if isinstance(status.level, bytes) else bytes([status.level])  # rosbags has a number
    values = [(pair.key, pair.value) for pair in status.values if pair.key != SEAL_KEY]
    texts = (status.name, status.message, status.hardware_id)
    return b"".join(
        (
            level,
            *map(_text, texts),
            struct.pack("<I", len(values)),
            *(_text(key) + _text(value) for key, value in values),
        )
    )


def _text(text: str) -> bytes:
    encoded = text.encode("utf-8", "surrogatepass")
    return struct.pack("<I", len(encoded)) + encoded
