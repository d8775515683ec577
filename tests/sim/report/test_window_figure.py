"""The figure of a stop opens, and shows speed, window, marks and silences where they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.image import imread

from snnav_sim.report.drawing import MARGIN, MOVER
from snnav_sim.report.window_figure import WindowCurves, draw_window


def curves() -> WindowCurves:
    times = np.linspace(-2.0, 8.0, 101)
    driving = (times[:-1] < 1.0) | (times[:-1] > 6.0)
    left = np.where(times < 0.0, 1.5, np.maximum(0.0, np.where(times < 5.0, 1.5 - times, 1.5)))
    return WindowCurves("cart", times, np.where(driving, 0.8, 0.0), np.zeros(100), left)


def image(folder: Path, of: WindowCurves) -> np.ndarray:
    file = folder / "figure.png"
    draw_window("a stop", of, file)
    return np.round(255.0 * imread(file)[..., :3]).astype(int)


def columns(picture: np.ndarray, colour: str, least: int) -> list[int]:
    """Return where at least so many pixels of a column have nearly a colour: thin lines are smoothed."""
    wanted = [int(colour[index : index + 2], 16) for index in (1, 3, 5)]
    return np.flatnonzero((abs(picture - wanted).max(axis=-1) < 60).sum(axis=0) >= least).tolist()


def test_marks_stand_at_their_times(tmp_path: Path) -> None:
    plain = image(tmp_path, curves())
    assert not columns(plain, MARGIN, 50)
    marked = columns(image(tmp_path, replace(curves(), marks=[(0.0, "kill"), (4.0, "restart")])), MARGIN, 50)
    gaps = np.diff(marked)
    assert (gaps > 3).sum() == 1, "two lines"
    width = plain.shape[1]
    assert 0.3 < gaps.max() / width < 0.45, "4 s of 10 s, less the border"


def test_many_marks_and_one_at_the_end_keep_their_words_inside(tmp_path: Path) -> None:
    marks = [(0.1 * k, f"SIGSTOP node_{k}") for k in range(4)] + [(7.9, "restart of a node with a long name")]
    width = image(tmp_path, curves()).shape[1]
    assert image(tmp_path, replace(curves(), marks=marks)).shape[1] < 1.02 * width


def test_words_that_would_lie_upon_each_other_are_left_out(tmp_path: Path) -> None:
    marks = [(0.2 * k, f"SIGKILL node_{k}") for k in range(30)]
    names = [(time, "") for time, _ in marks]
    worded, plain = (image(tmp_path, replace(curves(), marks=these)) for these in (marks, names))
    assert (worded == plain).all()
    worded, plain = (image(tmp_path, replace(curves(), marks=these[:3])) for these in (marks, names))
    assert not (worded == plain).all()


def test_turns_on_the_spot_are_shown(tmp_path: Path) -> None:
    assert not columns(image(tmp_path, curves()), MOVER, 3)
    turns = np.zeros(100)
    turns[40:60] = -0.5
    assert columns(image(tmp_path, replace(curves(), turn_rates=turns)), MOVER, 3)


def test_a_time_without_clock_is_shaded(tmp_path: Path) -> None:
    plain, shaded = (image(tmp_path, replace(curves(), silences=s)) for s in ((), ((2.0, 5.0),)))
    assert abs(plain.shape[0] - shaded.shape[0]) <= 2, "the legend has one line in both"
    row = shaded.shape[0] // 4
    white = (shaded[row] == 255).all(axis=-1).mean()
    assert white < (plain[row] == 255).all(axis=-1).mean() - 0.1


def test_a_robot_that_never_moved_and_was_never_certified_can_be_drawn(tmp_path: Path) -> None:
    still = replace(curves(), speeds=np.zeros(100), window_left=np.zeros(101))
    assert image(tmp_path, still).ndim == 3
