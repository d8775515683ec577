"""Range noise of the LMS-200: flicker plus white noise (Ch. 5, Simulation 2)."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass

import numpy as np

from snnav_core.types import FloatArray

__all__ = ["Lms200Noise", "NoiseSettings", "generator"]


@dataclass(frozen=True, slots=True)
class NoiseSettings:
    """Parameters of the noise.

    Parameters
    ----------
    flicker_deviation : float
        Standard deviation of the 1/f part, 1.77023 mm in the thesis [m].
    white_deviation : float
        Standard deviation of the white part, 3.03856 mm in the thesis [m].
    octaves : int
        The spectrum falls as 1/f over so many octaves below half the scan rate.
    """

    flicker_deviation: float = 1.77023e-3
    white_deviation: float = 3.03856e-3
    octaves: int = 10


def generator(seed: int, name: str, *numbers: int) -> np.random.Generator:
    """Return a random generator that depends on nothing but its arguments."""
    return np.random.default_rng([seed, zlib.crc32(name.encode()), *numbers])


class Lms200Noise:
    """Noise of all beams of one device, reproducible by the number of the scan alone.

    Parameters
    ----------
    seed : int
        Seed of the run.
    sensor_id : str
        Every device has its own noise.
    beams : int
    settings : NoiseSettings, optional

    Notes
    -----
    Flicker: one normal value per beam and octave j, held for 2^j scans, all octaves added with equal variance.
    The held values give a spectrum that falls by 3 dB an octave. No state passes from scan to scan, so a scan
    taken alone equals the same scan of a whole run.
    """

    def __init__(self, seed: int, sensor_id: str, beams: int, settings: NoiseSettings | None = None) -> None:
        self.settings = settings or NoiseSettings()
        self._seed, self._name, self._beams = seed, sensor_id, beams
        self._phases = generator(seed, sensor_id, 0).integers(
            0, 2**self.settings.octaves, self.settings.octaves
        )
        self._held: dict[int, tuple[int, FloatArray]] = {}

    def sample(self, number: int) -> FloatArray:
        """Return the error of every beam in scan `number` >= 0, shape (B,) [m]."""
        white: FloatArray = generator(self._seed, self._name, 1, number).standard_normal(self._beams)
        total = np.zeros(self._beams)
        for octave in range(self.settings.octaves):
            total += self._octave(octave, number)
        flicker: FloatArray = total / math.sqrt(self.settings.octaves)
        white *= self.settings.white_deviation
        return white + self.settings.flicker_deviation * flicker

    def _octave(self, octave: int, number: int) -> FloatArray:
        block = (number + int(self._phases[octave])) >> octave
        held = self._held.get(octave)
        if held is None or held[0] != block:
            values = generator(self._seed, self._name, 2, octave, block).standard_normal(self._beams)
            held = self._held[octave] = (block, values)
        return held[1]
