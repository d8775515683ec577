"""Simulated robots fly through free space that real cameras recorded: a snapshot in which nothing moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from snnav_core.area.spatial import SpatialArea
from snnav_core.sensing.depth import DepthImage
from snnav_core.types import FloatArray
from snnav_sim.simulation_flight import FlightSimulation
from snnav_sim.space_types import SpaceScene

__all__ = ["RecordedFlight", "far_apart"]


class RecordedFlight(FlightSimulation):
    """The robots of a scene in an area that stays as it is.

    Parameters
    ----------
    scene : SpaceScene
        Robots, margins and times; its sensors are not asked.
    area : SpatialArea
        Given to the navigator at every sampling instant.
    """

    def __init__(self, scene: SpaceScene, area: SpatialArea) -> None:
        super().__init__(replace(scene, sensors=()))
        self._area = area

    def _fuse(self, time: float, images: Sequence[tuple[str, DepthImage]]) -> SpatialArea:
        """Return the area as of now: nothing moves."""
        return replace(self._area, stamp=time)


def far_apart(area: SpatialArea, distance: float) -> tuple[FloatArray, FloatArray] | None:
    """Return two points far apart in the largest connected part that keeps a distance [m], or None if there is none.

    The one farthest from the middle of that part, and the one farthest from it.
    """
    labels, number = area.components(distance)
    if number == 0:
        return None
    largest = int(np.argmax(np.bincount(labels.ravel())[1:])) + 1
    places: FloatArray = area.grid.origin + area.grid.spacing * (np.argwhere(labels == largest) + 0.5)
    first = places[np.argmax(np.linalg.norm(places - places.mean(axis=0), axis=1))]
    second = places[np.argmax(np.linalg.norm(places - first, axis=1))]
    return first, second
