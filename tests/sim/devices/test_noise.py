"""Flicker plus white noise of ch. 5."""

from __future__ import annotations

import numpy as np
import pytest

from snnav_sim.devices.noise import Lms200Noise, NoiseSettings


def samples(count: int, settings: NoiseSettings, beams: int = 300) -> np.ndarray:
    noise = Lms200Noise(3, "s", beams, settings)
    return np.array([noise.sample(number) for number in range(count)])


def test_deviations_of_the_thesis() -> None:
    assert NoiseSettings().flicker_deviation == 1.77023e-3
    assert NoiseSettings().white_deviation == 3.03856e-3
    white = samples(200, NoiseSettings(flicker_deviation=0.0))
    assert white.std() == pytest.approx(3.03856e-3, rel=0.02)
    flicker = samples(1024, NoiseSettings(white_deviation=0.0))
    assert flicker.std() == pytest.approx(1.77023e-3, rel=0.05)


def test_flicker_is_correlated_in_time_and_white_is_not() -> None:
    for settings, low, high in (
        (NoiseSettings(white_deviation=0.0), 0.7, 1.0),
        (NoiseSettings(flicker_deviation=0.0), -0.1, 0.1),
    ):
        values = samples(512, settings)
        correlation = np.mean(values[1:] * values[:-1]) / np.mean(values**2)
        assert low < correlation < high


def test_the_flicker_spectrum_falls_as_one_over_f() -> None:
    values = samples(1024, NoiseSettings(white_deviation=0.0), beams=200)
    power = np.mean(np.abs(np.fft.rfft(values, axis=0)) ** 2, axis=1)[2:200]
    slope = np.polyfit(np.log(np.arange(2, 200)), np.log(power), 1)[0]
    assert slope == pytest.approx(-1.0, abs=0.25)


def test_beams_are_independent() -> None:
    values = samples(400, NoiseSettings(white_deviation=0.0), beams=40)
    correlation = np.corrcoef(values.T)
    # 400 scans of a process with a long memory are few independent ones: only the mean over pairs is sharp
    assert abs(correlation[np.triu_indices(40, 1)].mean()) < 0.1
