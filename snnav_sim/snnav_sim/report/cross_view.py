"""Whether what one camera shows free is free indeed, by what another one measured there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from snnav_core.area.doubted import Outlook
from snnav_core.area.grid import Grid
from snnav_core.sensing.depth import DepthCamera, DepthImage
from snnav_core.types import FloatArray

__all__ = ["MARGINS", "CrossView", "compare_views", "values_at"]

MARGINS = (0.0, 0.025, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3)
"""Distances from all that is not shown free [m]: what is nearer is not called free."""

_OPEN = 0.2  # [m]; a hit farther behind what the other camera measured in its direction is hidden from it


@dataclass(frozen=True)
class CrossView:
    """How one camera's free region stands up to another camera's hits.

    Parameters
    ----------
    claims, hits_of : str
        The camera whose region is judged, and the one whose measurements judge it.
    pairs : int
        Pairs of images of the same time.
    hits : int
        Measurements of the second camera in view and range of the first, all of them.
    open_hits : int
        Those of them that the first camera measured in front of, at or up to 0.2 m before: it could contradict.
    carved : int
        Hits in cells that the first camera shows free, nothing being taken off but the errors of its ranges.
    depths : ndarray, shape (M,)
        How far the cells of these lie, whole, inside that region [m], sorted; less than 0 at its rim.
    volumes : ndarray, shape (len(MARGINS),)
        Mean volume of what is called free by margin [m^3].
    worst : float
        Largest share among the pairs of images at the margin asked for.
    """

    claims: str
    hits_of: str
    pairs: int
    hits: int
    open_hits: int
    carved: int
    depths: FloatArray
    volumes: FloatArray
    worst: float

    def false_free(self, margin: float) -> int:
        """Number of hits that lie in what is called free with a margin [m]."""
        return len(self.depths) - int(np.searchsorted(self.depths, margin, side="left"))

    def share(self, margin: float) -> float:
        """Share of all hits in view and range that lie in what is called free with a margin [m]."""
        return self.false_free(margin) / max(self.hits, 1)

    def open_share(self, margin: float) -> float:
        """The same among the hits that are not hidden from the camera whose region is judged."""
        return self.false_free(margin) / max(self.open_hits, 1)

    def summary(self) -> dict[str, Any]:
        """Return the numbers, for JSON."""
        return {
            "claims": self.claims,
            "hits_of": self.hits_of,
            "pairs": self.pairs,
            "hits": self.hits,
            "open_hits": self.open_hits,
            "carved": self.carved,
            "carved_share": round(self.carved / max(self.hits, 1), 6),
            "deepest": round(float(self.depths[-1]), 4) if len(self.depths) else None,
            "worst_pair_share": round(self.worst, 6),
            "by_margin": [
                {
                    "margin": margin,
                    "false_free": self.false_free(margin),
                    "share": round(self.share(margin), 6),
                    "open_share": round(self.open_share(margin), 6),
                    "volume": round(float(volume), 3),
                }
                for margin, volume in zip(MARGINS, self.volumes, strict=True)
            ],
        }


def compare_views(
    outlook: Outlook,
    other: DepthCamera,
    pairs: Sequence[tuple[DepthImage, DepthImage]],
    grid: Grid,
    margin: float,
) -> CrossView:
    """Judge the free region of one camera by the hits of another one.

    Parameters
    ----------
    outlook : Outlook
        Of the camera that claims space to be free.
    other : DepthCamera
        The one whose hits judge it. Its own errors count against the first: no hit is left out.
    pairs : sequence of (DepthImage, DepthImage)
        Images of both, of the same time.
    grid : Grid
    margin : float
        At which the worst pair is looked for [m].
    """
    hits = opened = carved = 0
    depths: list[FloatArray] = []
    worst = 0.0
    volumes = np.zeros(len(MARGINS))
    for image, others in pairs:
        clearance = outlook.clearance(image)
        inside = clearance - np.float32(grid.half_diagonal)
        volumes += [np.count_nonzero(inside >= each) * grid.spacing**3 for each in MARGINS]
        points = other.cloud(others).reshape(-1, 3)
        seen, hidden = _seen(outlook.camera, image, points[np.isfinite(points[:, 0])])
        hits, opened = hits + len(seen), opened + int(np.count_nonzero(~hidden))
        at_hits = values_at(clearance, grid, seen)
        carved += int(np.count_nonzero(at_hits > 0.0))
        deep = at_hits[at_hits > 0.0] - grid.half_diagonal
        worst = max(worst, np.count_nonzero(deep >= margin) / max(len(seen), 1))
        depths.append(deep)
    sorted_depths: FloatArray = np.sort(np.concatenate([np.zeros(0), *depths]))
    names = (outlook.camera.id, other.id)
    mean = volumes / max(len(pairs), 1)
    return CrossView(*names, len(pairs), hits, opened, carved, sorted_depths, mean, worst)


def _seen(camera: DepthCamera, image: DepthImage, points: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the points (M, 3) in view and range of a pinhole camera, and which of these are hidden from it."""
    model = camera.model
    local = (points - camera.position) @ camera.rotation
    local, points = local[local[:, 0] > 0.0], points[local[:, 0] > 0.0]
    column = model.column_centre - local[:, 1] / local[:, 0] / model.column_step
    row = model.row_centre - local[:, 2] / local[:, 0] / model.row_step
    ranges = np.linalg.norm(local, axis=1)
    near = (ranges >= model.range_min) & (ranges <= model.range_max)
    within = (column >= 0) & (column <= model.columns - 1) & (row >= 0) & (row <= model.rows - 1) & near
    column, row = np.rint(column[within]).astype(int), np.rint(row[within]).astype(int)
    measured = np.nan_to_num(image.measured(model), nan=0.0)[row, column]
    return points[within], ranges[within] > measured + _OPEN


def values_at(field: NDArray[np.float32], grid: Grid, points: FloatArray) -> FloatArray:
    """Return the values (N,) of the cells in which points (N, 3) lie, 0 outside of the grid."""
    scaled = (points - grid.origin) / grid.spacing
    inside = ((scaled >= 0.0) & (scaled < grid.shape)).all(axis=1)
    values = np.zeros(len(points))
    values[inside] = field[tuple(scaled[inside].astype(np.int32).T)]
    return values
