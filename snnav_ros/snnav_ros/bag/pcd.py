"""Read organized point clouds from PCD files (Point Cloud Library, version 0.7)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from snnav_core.types import FloatArray
from snnav_ros.bag.errors import BagError, one_line

__all__ = ["read_pcd"]

_KINDS = {"F": "f", "I": "i", "U": "u"}
_SIZES = {"f": (4, 8), "i": (1, 2, 4, 8), "u": (1, 2, 4, 8)}
_MOST_POINTS = 50_000_000
_LONGEST_HEADER = 4096
_AGAIN = "copy it again"


def read_pcd(path: str | Path) -> FloatArray:
    """Return the points of an organized PCD file.

    Parameters
    ----------
    path : path-like
        With fields x, y, z; data ascii, binary or binary_compressed. Other fields are passed over.

    Returns
    -------
    ndarray, shape (rows, columns, 3)
        [m]; NaN where there is no reading. The viewpoint of the file is not used.

    Raises
    ------
    BagError
        One line: the file is cut short, no PCD, not organized, or holds something else.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise BagError(f"{path}: cannot be read ({error.strerror}); give a PCD file") from None
    header = _header(path, content)
    body = content[header.length :]
    if header.data == "binary":
        columns = _rows(path, header, body)
    elif header.data == "binary_compressed":
        columns = _columns(path, header, _unpacked(path, header, body))
    else:
        columns = _numbers(path, header, body)
    points = np.stack([columns[name].astype(np.float64) for name in "xyz"], axis=-1)
    return points.reshape(header.rows, header.columns, 3)


@dataclass(frozen=True)
class _Header:
    """What the lines before the data say; `kind` has one entry per field, `length` is that of the header [byte]."""

    kind: np.dtype[np.void]
    columns: int
    rows: int
    data: str
    length: int

    @property
    def points(self) -> int:
        return self.columns * self.rows


def _header(path: Path, content: bytes) -> _Header:
    match = re.search(rb"^DATA[ \t]+(\w+)[ \t]*\r?\n", content[:_LONGEST_HEADER], re.MULTILINE)
    if match is None:
        raise BagError(f"{path}: has no PCD header with a DATA line; give a PCD file, or {_AGAIN}")
    lines = content[: match.start()].decode("ascii", errors="replace").splitlines()
    words = {line.split()[0].upper(): line.split()[1:] for line in lines if line.split()}
    try:
        names, kinds = words["FIELDS"], words["TYPE"]
        sizes = [int(size) for size in words["SIZE"]]
        counts = [int(count) for count in words.get("COUNT", ["1"] * len(names))]
        columns, rows = int(words["WIDTH"][0]), int(words["HEIGHT"][0])
        points = int(words["POINTS"][0]) if "POINTS" in words else columns * rows
        if any(size not in _SIZES[_KINDS[kind]] for kind, size in zip(kinds, sizes, strict=True)):
            raise ValueError(f"TYPE {' '.join(kinds)} SIZE {' '.join(words['SIZE'])}")
        kind = np.dtype(
            [
                (f"{name}_{index}" if name in names[:index] else name, f"<{_KINDS[each]}{size}", (count,))
                for index, (name, each, size, count) in enumerate(
                    zip(names, kinds, sizes, counts, strict=True)
                )
            ]
        )
    except (KeyError, IndexError, ValueError) as error:
        raise BagError(f"{path}: its PCD header cannot be read ({one_line(error)}); {_AGAIN}") from None
    if not {"x", "y", "z"} <= set(names) or any(counts[names.index(name)] != 1 for name in "xyz"):
        raise BagError(f"{path}: has the fields {' '.join(names)}; x, y and z are needed")
    if min(columns, rows) < 2 or columns * rows > _MOST_POINTS or points != columns * rows:
        raise BagError(
            f"{path}: {columns} x {rows} with {points} points is no organized cloud; give one with a row for every "
            "row of the image"
        )
    data = match.group(1).decode("ascii")
    if data not in ("ascii", "binary", "binary_compressed"):
        raise BagError(f"{path}: DATA {data} is not known; write it as ascii, binary or binary_compressed")
    return _Header(kind, columns, rows, data, match.end())


def _short(path: Path, got: int, expected: int, what: str) -> BagError:
    return BagError(f"{path}: holds {got} {what}, its header says {expected}; it is cut short, {_AGAIN}")


def _rows(path: Path, header: _Header, body: bytes) -> dict[str, FloatArray]:
    """Return the fields of data that is stored point by point."""
    expected = header.points * header.kind.itemsize
    if len(body) < expected:
        raise _short(path, len(body), expected, "bytes")
    records = np.frombuffer(body, dtype=header.kind, count=header.points)
    return {name: records[name][:, 0] for name in "xyz"}


def _columns(path: Path, header: _Header, body: bytes) -> dict[str, FloatArray]:
    """Return the fields of data that is stored field by field."""
    expected = header.points * header.kind.itemsize
    if len(body) != expected:
        raise _short(path, len(body), expected, "bytes")
    found, begin = {}, 0
    for name in header.kind.names or ():
        each = header.kind[name]
        size = header.points * each.itemsize
        if name in ("x", "y", "z"):
            found[name] = np.frombuffer(body[begin : begin + size], dtype=each.base)
        begin += size
    return found


def _numbers(path: Path, header: _Header, body: bytes) -> dict[str, FloatArray]:
    """Return the fields of data that is stored as text."""
    if not body.endswith(b"\n"):
        raise BagError(f"{path}: ends within a line; it is cut short, {_AGAIN}")
    names = header.kind.names or ()
    widths = [header.kind[name].shape[0] for name in names]
    try:
        values = np.array(body.split(), dtype=np.float64)
    except ValueError as error:
        raise BagError(f"{path}: {one_line(error)}; {_AGAIN}") from None
    if len(values) != header.points * sum(widths):
        raise _short(path, len(values), header.points * sum(widths), "numbers")
    table = values.reshape(header.points, sum(widths))
    starts = np.concatenate(([0], np.cumsum(widths)))
    return {name: table[:, starts[names.index(name)]] for name in "xyz"}


def _unpacked(path: Path, header: _Header, body: bytes) -> bytes:
    """Return the data of a compressed file."""
    sizes = np.frombuffer(body[:8], dtype="<u4") if len(body) >= 8 else np.zeros(2)
    packed, whole = int(sizes[0]), int(sizes[1])
    if len(body) < 8 + packed or not packed:
        raise _short(path, max(len(body) - 8, 0), packed, "compressed bytes")
    if whole != header.points * header.kind.itemsize:
        raise _short(path, whole, header.points * header.kind.itemsize, "bytes")
    try:
        return _unpack(body[8 : 8 + packed], whole)
    except (IndexError, ValueError):
        raise BagError(f"{path}: its compressed data is damaged; {_AGAIN}") from None


def _unpack(packed: bytes, size: int) -> bytes:
    """Undo LZF: runs of bytes as they are, and copies of what came up to 8192 bytes before.

    Raises
    ------
    IndexError, ValueError
        If the data ends early, points to before its beginning, or gives another size.
    """
    out = bytearray()
    at, end = 0, len(packed)
    while at < end:
        control = packed[at]
        at += 1
        if control < 32:
            out += packed[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += packed[at]
            at += 1
        back = ((control & 31) << 8) + packed[at] + 1
        at += 1
        begin, length = len(out) - back, length + 2
        if begin < 0:
            raise ValueError("copy from before the beginning")
        piece = out[begin : begin + min(back, length)]
        out += (piece * (length // len(piece) + 1))[:length]
        if len(out) > size:
            raise ValueError("too long")
    if len(out) != size or at != end:
        raise ValueError("another size")
    return bytes(out)
