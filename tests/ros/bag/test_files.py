"""Where results are written: whole or not at all, and what cannot be written is told before anything is made."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from snnav_ros.bag.errors import BagError
from snnav_ros.bag.files import check_directory, make_directory, write_text
from snnav_ros.bag.reader import BagReader

NOWHERE = Path("/proc/self/fdinfo")  # a directory in which not even root can make a file


@pytest.mark.parametrize("name", ["out", "a/b/out"])
def test_a_place_that_cannot_be_written_is_told_in_one_line_with_its_reason(name: str) -> None:
    path = NOWHERE / name
    text = rf"^{re.escape(str(path))}: cannot be written \([A-Z][a-z ]+\); choose a writable place$"
    for attempt in (
        lambda: check_directory(path, "mark"),
        lambda: make_directory(path, "mark", lambda _: None),
        lambda: write_text(path, "text"),
    ):
        with pytest.raises(BagError, match=text):
            attempt()


def test_a_check_leaves_nothing_behind(tmp_path: Path) -> None:
    assert check_directory(tmp_path / "a" / "out", "mark") == tmp_path / "a" / "out"
    assert not list(tmp_path.iterdir())


def test_a_run_directory_is_answered_with_the_bag_in_it(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("", encoding="utf-8")
    text = f"is a run directory; give the bag in it, {tmp_path / 'bag'}"
    with pytest.raises(BagError, match=text), BagReader(tmp_path):
        pass
