"""`snnav coverage` tells what is seen, by its status too."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from snnav_ros.cli import main
from snnav_sim.scene import find_scene


def test_it_tells_numbers_and_whether_all_can_be_reached(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["coverage", "hello_flight", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["seen_share"] > 0.95
    assert found["robots"] == {"bee": "reachable"}
    text = (
        find_scene("hello_flight")
        .read_text(encoding="utf-8")
        .replace("target: [5.4, 2.6, 2.0]", "target: [5.4, 2.6, 2.9]")
    )
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
    assert main(["coverage", str(tmp_path / "mine.yaml"), "--out", str(tmp_path / "cuts.png")]) == 1
    assert "bee: the target keeps" in capsys.readouterr().out
    assert (tmp_path / "cuts.png").is_file()


def test_scenes_in_the_plane_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["coverage", "hello"]) == 2
    assert "is a scene in the plane" in capsys.readouterr().err
