"""Sensors that disagree: a return of any of them is an obstacle for all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry import MultiPolygon

from snnav_core.area.overlay import difference
from snnav_core.area.planar import UnoccupiedArea, as_multipolygon
from snnav_core.area.settings import FusionSettings
from snnav_core.sensing.scan import DetectedArea
from snnav_core.sensing.star import shorten_fan
from snnav_core.types import FloatArray

__all__ = ["agree", "cut_returns"]


def agree(
    detected: Sequence[DetectedArea], settings: FusionSettings
) -> tuple[list[DetectedArea], dict[str, int]]:
    """Reconcile what the sensors saw: a return of any of them is an obstacle for all.

    Measured from two places one wall never is in one place, and the union of both areas would hide the nearer
    measurement: where a return lies a little inside the area of another sensor, that area ends there.

    Parameters
    ----------
    detected : sequence of DetectedArea
    settings : FusionSettings

    Returns
    -------
    agreed : list of DetectedArea
        Never larger than before.
    contradictions : dict of str to int
        Per sensor: its returns through which rays of another sensor passed by more than `contradiction_depth`.
    """
    if not detected:
        return [], {}
    returns = _all_returns(detected)
    deepest = np.zeros(len(returns))
    agreed = []
    for part in detected:
        fan, inside = shorten_fan(part.fan, part.pose, returns, settings.shorten_depth)
        deepest = np.maximum(deepest, inside)
        agreed.append(replace(part, fan=fan, simplification=settings.simplification))
    flags = np.split(
        deepest > settings.contradiction_depth, np.cumsum([len(p.returns) for p in detected])[:-1]
    )
    return agreed, {part.sensor_id: int(flag.sum()) for part, flag in zip(detected, flags, strict=True)}


def cut_returns(
    union: MultiPolygon, detected: Sequence[DetectedArea], settings: FusionSettings
) -> MultiPolygon:
    """Cut the returns that still lie inside a union of detected areas out of it (Ch. 3, total detected area).

    Parameters
    ----------
    union : shapely.MultiPolygon
        Union of the detected areas, with memory if wanted [m, map].
    detected : sequence of DetectedArea
        Their returns are obstacles for all sensors.
    settings : FusionSettings

    Returns
    -------
    shapely.MultiPolygon
        The union itself when nothing lies inside.

    Notes
    -----
    Deviation: the thesis takes the plain union. On real scanners a return of one node can lie inside what another
    node's rays passed (pose error, thin objects, glass); the safe side wins.
    """
    returns = _all_returns(detected)
    if union.is_empty or len(returns) == 0:
        return union
    depth, _ = UnoccupiedArea(0.0, union).clearance_field.query(returns)
    inside = depth > settings.return_tolerance
    if not inside.any():
        return union
    obstacles = shapely.buffer(shapely.multipoints(returns[inside]), settings.return_radius, quad_segs=1)
    return _without_crumbs(as_multipolygon(difference(union, obstacles)), settings.least_part)


def _all_returns(detected: Sequence[DetectedArea]) -> FloatArray:
    return np.concatenate([part.returns for part in detected]) if detected else np.empty((0, 2))


def _without_crumbs(region: MultiPolygon, least: float) -> MultiPolygon:
    parts = shapely.get_parts(region)
    return MultiPolygon(list(parts[shapely.area(parts) >= least]))
