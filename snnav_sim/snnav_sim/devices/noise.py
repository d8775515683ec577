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
    taken alone equals the same scan of a whole run: the random bits come from Philox, a generator that starts at
    any counter at once.
    """

    def __init__(self, seed: int, sensor_id: str, beams: int, settings: NoiseSettings | None = None) -> None:
        self.settings = settings or NoiseSettings()
        self._beams = beams
        self._phases = generator(seed, sensor_id, 0).integers(
            0, 2**self.settings.octaves, self.settings.octaves
        )
        self._bits = np.random.Philox(np.random.SeedSequence([seed, zlib.crc32(sensor_id.encode())]))
        self._start = self._bits.state["state"]
        self._generator = np.random.Generator(self._bits)
        self._blocks = np.full(self.settings.octaves, -1)
        self._held = np.zeros((self.settings.octaves, beams))

    def sample(self, number: int) -> FloatArray:
        """Return the error of every beam in scan `number` >= 0, shape (B,) [m]."""
        blocks = (number + self._phases) >> np.arange(self.settings.octaves)
        for octave in np.flatnonzero(blocks != self._blocks):
            self._held[octave] = self._normals(1 + int(octave), int(blocks[octave]))
        self._blocks = blocks
        flicker: FloatArray = self._held.sum(axis=0)
        flicker *= self.settings.flicker_deviation / math.sqrt(self.settings.octaves)
        return flicker + self.settings.white_deviation * self._normals(0, number)

    def _normals(self, stream: int, number: int) -> FloatArray:
        """One normal value per beam that depends on nothing but stream and number."""
        state = self._bits.state
        state["state"] = {**self._start, "counter": np.array([0, 0, stream, number], dtype=np.uint64)}
        state["buffer_pos"], state["has_uint32"] = 4, 0
        self._bits.state = state
        return self._generator.standard_normal(self._beams)
