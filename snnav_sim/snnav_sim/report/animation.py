"""A run as an animated GIF, small enough to send and open anywhere."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import cKDTree

from snnav_sim.report.drawing import MARGIN, MOVER, SEEN
from snnav_sim.report.look import Look
from snnav_sim.report.moment import Moments
from snnav_sim.report.stage import Stage, stage_legend
from snnav_sim.report.truth import GroundTruth
from snnav_sim.scene_types import Scene

__all__ = ["draw_animation"]

_MOST_FRAMES = 100
_FRAME, _LAST_FRAME = 100, 2000  # [ms]; how long a frame is shown, multiples of 10 in a GIF
_WIDTH, _TALLEST = 8.6, 9.0  # inches
_LEFT, _RIGHT, _TOP, _BOTTOM, _LEGEND_ROW = 0.55, 0.12, 0.36, 0.52, 0.19  # inches around the axes
_LEGEND_COLUMNS = 4
_DPI = 100
_COLOURS = 256
_MIXES = (1.0, 0.7, 0.4)  # of the colour of a thin line with that of the area
_SAMPLES = 5  # frames from which the colours are chosen


def draw_animation(scene: Scene, truth: GroundTruth, moments: Moments, file: Path) -> None:
    """Draw a run as a GIF of at most 100 frames, even in time, that plays for about ten seconds, again and again."""
    steps = max(1, round(moments.end / scene.control_period))
    stride = math.ceil(steps / (_MOST_FRAMES - 1))
    times = [step * scene.control_period for step in range(0, steps, stride)]
    times.append(steps * scene.control_period)
    frames = list(_frames(scene, truth, moments, times))
    sample = [frames[index] for index in np.linspace(0, len(frames) - 1, _SAMPLES).astype(int)]
    colours = _palette(sample, [MARGIN, MOVER, *dict.fromkeys(Look.of(scene).colours)])
    images = [_coded(frame, colours) for frame in frames]
    shown = [_FRAME] * (len(images) - 1) + [_LAST_FRAME]
    images[0].save(file, save_all=True, append_images=images[1:], duration=shown, loop=0, optimize=False)


def _frames(
    scene: Scene, truth: GroundTruth, moments: Moments, times: list[float]
) -> Iterator[NDArray[np.uint32]]:
    """Draw what never changes once, and the rest over it for every time; each frame is 0xRRGGBB per pixel."""
    handles = stage_legend(scene, moments)
    figure, rectangle = _sheet(scene, math.ceil(len(handles) / _LEGEND_COLUMNS))
    canvas: Any = FigureCanvasAgg(figure)  # carries no types
    axes = figure.add_axes(rectangle)
    stage = Stage(axes, scene, truth, moments, size=13.0)
    title = axes.set_title("", loc="left", fontsize=11)
    axes.tick_params(labelsize=8)
    axes.set_xlabel("x [m]", fontsize=8, labelpad=2)
    axes.set_ylabel("y [m]", fontsize=8, labelpad=2)
    figure.legend(handles=handles, loc="lower center", ncols=_LEGEND_COLUMNS, fontsize=8, frameon=False)
    changing = [*stage.changing, title]
    for artist in changing:
        artist.set_animated(True)
    stage.show(times[0])
    canvas.draw()
    background = canvas.copy_from_bbox(figure.bbox)
    for time in times:
        stage.show(time)
        title.set_text(f"{scene.name}: t = {time:.1f} s")
        canvas.restore_region(background)
        for artist in changing:
            axes.draw_artist(artist)
        pixels = np.asarray(canvas.buffer_rgba()).astype(np.uint32)
        yield _packed(pixels)


def _sheet(scene: Scene, legend_rows: int) -> tuple[Figure, tuple[float, float, float, float]]:
    """Return a figure that the workspace fills, and where in it the axes are."""
    width, height = (scene.workspace.max(axis=0) - scene.workspace.min(axis=0)).tolist()
    bottom = _BOTTOM + _LEGEND_ROW * legend_rows
    inner = _WIDTH - _LEFT - _RIGHT
    tall = min(_TALLEST, inner * height / width + _TOP + bottom)
    figure = Figure(figsize=(_WIDTH, tall), dpi=_DPI)
    return figure, (_LEFT / _WIDTH, bottom / tall, inner / _WIDTH, 1.0 - (bottom + _TOP) / tall)


def _palette(frames: list[NDArray[np.uint32]], accents: list[str]) -> NDArray[np.uint32]:
    """Return the most frequent colours and those of thin lines, sorted: all frames share them, nothing flickers."""
    ground = np.array(to_rgb(SEEN))
    mixed = [
        share * np.array(to_rgb(accent)) + (1.0 - share) * ground for accent in accents for share in _MIXES
    ]
    lines = _packed(np.round(255.0 * np.array(mixed)).astype(np.uint32))
    colours, counts = np.unique(np.concatenate([frame.ravel() for frame in frames]), return_counts=True)
    frequent = colours[np.argsort(-counts, kind="stable")[: _COLOURS - len(lines)]]
    return np.unique(np.concatenate((frequent, lines)))


def _coded(frame: NDArray[np.uint32], colours: NDArray[np.uint32]) -> Image.Image:
    """Return the frame in the given colours, each pixel in the nearest one."""
    codes = np.minimum(np.searchsorted(colours, frame), len(colours) - 1).astype(np.uint8)
    other = colours[codes] != frame
    rare, which = np.unique(frame[other], return_inverse=True)
    if len(rare):
        codes[other] = cKDTree(_channels(colours)).query(_channels(rare))[1].astype(np.uint8)[which]
    image = Image.fromarray(codes)
    image.putpalette(_channels(colours).astype(np.uint8).tobytes())
    return image


def _channels(colours: NDArray[np.uint32]) -> NDArray[np.float64]:
    return np.stack([(colours >> shift) & 0xFF for shift in (16, 8, 0)], axis=-1).astype(np.float64)


def _packed(channels: NDArray[np.uint32]) -> NDArray[np.uint32]:
    return (channels[..., 0] << 16 | channels[..., 1] << 8 | channels[..., 2]).astype(np.uint32)
