"""PCD files in all three forms give the same points; damaged ones are told in one line."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from snnav_ros.bag.errors import BagError
from snnav_ros.bag.pcd import _unpack, read_pcd

DATA = Path(__file__).parents[4] / "shared" / "data" / "pcd_depth_camera"
ROWS, COLUMNS = 6, 8


def cloud() -> np.ndarray:
    points = np.random.default_rng(1).uniform(-2.0, 2.0, (ROWS, COLUMNS, 3)).astype(np.float32)
    points[2:4, 3:] = np.nan
    return points


def packed(data: bytes) -> bytes:
    """Compress by LZF as a plain compressor would: copies of the longest run found before, else bytes as they are."""
    out, at, plain = bytearray(), 0, bytearray()

    def flush() -> None:
        while plain:
            piece = bytes(plain[:32])
            del plain[:32]
            out.append(len(piece) - 1)
            out.extend(piece)

    while at < len(data):
        begin = data.rfind(data[at : at + 3], max(0, at - 8192), at + 2) if at + 3 <= len(data) else -1
        length = 0
        if 0 <= begin < at:
            while length < 264 and at + length < len(data) and data[begin + length] == data[at + length]:
                length += 1
        if length < 3:
            plain.append(data[at])
            at += 1
            continue
        flush()
        back, rest = at - begin - 1, length - 2
        if rest < 7:
            out.extend(((rest << 5) | (back >> 8), back & 255))
        else:
            out.extend(((7 << 5) | (back >> 8), rest - 7, back & 255))
        at += length
    flush()
    return bytes(out)


def written(path: Path, kind: str, **changes: str) -> Path:
    """Write the cloud with a colour beside each point; changes replace lines of the header."""
    points = cloud().reshape(-1, 3)
    lines = {
        "VERSION": "0.7",
        "FIELDS": "x y rgb z",
        "SIZE": "4 4 4 4",
        "TYPE": "F F U F",
        "COUNT": "1 1 1 1",
        "WIDTH": str(COLUMNS),
        "HEIGHT": str(ROWS),
        "VIEWPOINT": "0 0 0 1 0 0 0",
        "POINTS": str(ROWS * COLUMNS),
        "DATA": kind,
        **changes,
    }
    header = "# .PCD v0.7\n" + "".join(f"{key} {value}\n" for key, value in lines.items())
    records = np.zeros(len(points), dtype=[("x", "<f4"), ("y", "<f4"), ("rgb", "<u4"), ("z", "<f4")])
    records["x"], records["y"], records["z"] = points.T
    records["rgb"] = 7
    if kind == "binary":
        body = records.tobytes()
    elif kind == "ascii":
        body = "".join(" ".join(map(str, row)) + "\n" for row in records.tolist()).encode()
    else:
        whole = b"".join(np.ascontiguousarray(records[name]).tobytes() for name in records.dtype.names)
        small = packed(whole)
        body = np.array([len(small), len(whole)], dtype="<u4").tobytes() + small
    path.write_bytes(header.encode() + body)
    return path


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_what_is_written_is_read(tmp_path: Path, kind: str) -> None:
    assert np.array_equal(read_pcd(written(tmp_path / "a.pcd", kind)), cloud(), equal_nan=True)


@pytest.mark.parametrize("kind", ["ascii", "binary", "binary_compressed"])
def test_wherever_a_file_is_cut_short_one_line_tells_it(tmp_path: Path, kind: str) -> None:
    whole = written(tmp_path / "a.pcd", kind).read_bytes()
    cut = tmp_path / "cut.pcd"
    ends = list(range(0, len(whole) - 8, 7))
    for end in ends:
        cut.write_bytes(whole[:end])
        with pytest.raises(BagError, match=r"cut\.pcd: ") as error:
            read_pcd(cut)
        assert "\n" not in str(error.value)
        assert "again" in str(error.value) or "give" in str(error.value)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"WIDTH": "48", "HEIGHT": "1"}, "no organized cloud"),
        ({"POINTS": "47"}, "no organized cloud"),
        ({"WIDTH": "many"}, "header cannot be read"),
        ({"TYPE": "F F Q F"}, "header cannot be read"),
        ({"SIZE": "4 4 4"}, "header cannot be read"),
        ({"SIZE": "2 4 4 4"}, "TYPE F F U F SIZE 2 4 4 4"),
        ({"FIELDS": "x y rgb depth"}, "x, y and z are needed"),
        ({"DATA": "zipped"}, "DATA zipped is not known"),
        ({"WIDTH": "80000", "HEIGHT": "80000", "POINTS": "6400000000"}, "no organized cloud"),
        ({"WIDTH": "16", "POINTS": "96"}, "cut short"),
    ],
)
def test_a_header_that_means_nothing_is_refused(tmp_path: Path, changes: dict[str, str], told: str) -> None:
    with pytest.raises(BagError, match=told):
        read_pcd(written(tmp_path / "a.pcd", "binary", **changes))


def test_damaged_compression_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.pcd", "binary_compressed")
    content = bytearray(path.read_bytes())
    start = content.index(b"binary_compressed\n") + 18 + 8
    content[start] = 0xFF  # a copy from before the beginning
    path.write_bytes(bytes(content))
    with pytest.raises(BagError, match="damaged"):
        read_pcd(path)


def test_a_file_that_is_not_there_or_something_else(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="cannot be read"):
        read_pcd(tmp_path / "none.pcd")
    (tmp_path / "text.pcd").write_text("hello", encoding="utf-8")
    with pytest.raises(BagError, match="no PCD header"):
        read_pcd(tmp_path / "text.pcd")


@given(st.lists(st.sampled_from([b"abc", b"\x00", b"xyzw" * 9, b"q"]), max_size=60))
def test_unpacking_undoes_packing(pieces: list[bytes]) -> None:
    data = b"".join(pieces)
    assert _unpack(packed(data), len(data)) == data


@given(st.binary(max_size=40), st.integers(0, 100))
def test_any_bytes_are_unpacked_or_refused(junk: bytes, size: int) -> None:
    with contextlib.suppress(IndexError, ValueError):
        assert len(_unpack(junk, size)) == size


@pytest.mark.skipif(not DATA.is_dir(), reason=f"no recorded clouds in {DATA}")
@pytest.mark.parametrize(("name", "count"), [("capture0001.pcd", 249_647), ("capture0002.pcd", 249_931)])
def test_clouds_of_a_real_camera(name: str, count: int) -> None:
    points = read_pcd(DATA / name)
    assert points.shape == (480, 640, 3)
    there = np.isfinite(points).all(axis=-1)
    assert np.count_nonzero(there) == count
    row, column = np.nonzero(there)
    x, y, z = points[there].T
    assert np.abs(525.0 * x / z + 319.5 - column).max() < 1e-3  # every point lies on the ray of its pixel
    assert np.abs(525.0 * y / z + 239.5 - row).max() < 1e-3
