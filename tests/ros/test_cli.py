"""What the machine refuses to `snnav` is one line, whatever the command was about to do."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from snnav_ros.cli import main

NOBODY = 65534


@pytest.mark.parametrize(
    "words",
    [("windows", "{}/bag", "--robot", "cart"), ("run", "{}/scene.yaml", "--core")],
    ids=lambda w: w[0],
)
def test_a_place_that_is_closed_to_the_user(
    words: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main([word.format(tmp_path / "missing") for word in words])  # loads what nobody may not be able to read
    capsys.readouterr()
    closed = tmp_path / "closed"
    closed.mkdir(mode=0)
    user = os.geteuid()
    if user == 0:  # who may read everything
        os.seteuid(NOBODY)
    try:
        status = main([word.format(closed) for word in words])
    finally:
        os.seteuid(user)
    assert status == 2
    place = words[1].format(closed)
    assert capsys.readouterr().err == (
        f"snnav: {place}: Permission denied; give a place that you may read and write\n"
    )


def test_a_full_disk_and_a_defect(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(number: int) -> None:
        def write(*_: object) -> None:
            raise OSError(number, os.strerror(number), "out/figures/scene.png")

        monkeypatch.setattr("snnav_ros.run_command.list_scenes", write)

    fail(errno.ENOSPC)
    assert main(["scenes"]) == 2
    assert capsys.readouterr().err == (
        "snnav: out/figures/scene.png: No space left on device; make room, or give another place\n"
    )
    fail(errno.EBADF)  # nobody but us is to blame
    with pytest.raises(OSError, match="Bad file descriptor"):
        main(["scenes"])
