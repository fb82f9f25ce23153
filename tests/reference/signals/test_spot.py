"""Energy of a spot: against closed forms, Monte Carlo, and the peak on simulated stained spots."""

from __future__ import annotations

import math

import numpy as np
import pytest

from markerseek.core import NO_HEADER, ChannelFrame, SpotEnergy
from markerseek.rigs import draw_scene, image_reader
from markerseek.signals import ImageReader, probe_preset
from markerseek.signals.noise_gain import cell_pixels
from markerseek.signals.spot import spot_energy
from markerseek.sim import MarkerSettings, NoiseSettings, SimulatedSettings

X_M = 1e-4 * np.arange(200)
Z_M = 5e-5 * np.arange(300)


def _blob(*, amplitude: float, lateral_m: float, depth_m: float, width_m: float) -> np.ndarray:
    """Envelope with a Gaussian power of this standard deviation along both axes."""
    square = ((Z_M[:, None] - depth_m) ** 2 + (X_M - lateral_m) ** 2) / width_m**2
    return amplitude * np.exp(-square / 4)


def _measured(envelope: np.ndarray, *, lateral_m: float, depth_m: float, sigma: float) -> SpotEnergy | None:
    return spot_energy(
        envelope.astype(np.float32),
        at_lateral_m=X_M,
        at_depth_m=Z_M,
        lateral_m=lateral_m,
        depth_m=depth_m,
        sigma=sigma,
        cell_pixels=1.0,
    )


def test_energy_and_centroid_are_those_of_a_gaussian_spot() -> None:
    envelope = _blob(amplitude=50.0, lateral_m=9.2e-3, depth_m=7.1e-3, width_m=0.4e-3)
    spot = _measured(envelope, lateral_m=9.7e-3, depth_m=6.8e-3, sigma=1e-6)
    assert spot is not None
    # The integral of a Gaussian power is 2π·width², over the area of a pixel.
    expected = 50.0 * math.sqrt(2 * math.pi * 0.4e-3**2 / (1e-4 * 5e-5))
    assert spot.amplitude == pytest.approx(expected, rel=1e-3)
    assert (spot.lateral_m, spot.depth_m) == pytest.approx((9.2e-3, 7.1e-3), abs=2e-6)


def test_its_noise_is_as_stated_and_does_not_bias_it() -> None:
    rng = np.random.default_rng(20261123)
    clean = _blob(amplitude=12.0, lateral_m=9e-3, depth_m=7e-3, width_m=0.5e-3)
    exact = _measured(clean, lateral_m=9e-3, depth_m=7e-3, sigma=1e-6)
    assert exact is not None
    seen = []
    for _ in range(300):
        noise = rng.standard_normal(clean.shape) + 1j * rng.standard_normal(clean.shape)
        spot = _measured(np.abs(clean + noise), lateral_m=9e-3, depth_m=7e-3, sigma=1.0)
        assert spot is not None
        seen.append((spot.amplitude, spot.relative_sigma))
    amplitude, stated = np.array(seen).T
    assert np.mean(amplitude) == pytest.approx(exact.amplitude, rel=0.01)
    assert np.std(amplitude) / np.mean(amplitude) == pytest.approx(np.mean(stated), rel=0.15)


def test_noise_alone_has_none() -> None:
    rng = np.random.default_rng(1)
    noise = np.abs(rng.standard_normal((300, 200)) + 1j * rng.standard_normal((300, 200)))
    assert _measured(noise, lateral_m=9e-3, depth_m=7e-3, sigma=1.0) is None


@pytest.mark.parametrize("name", ["BPL9-5/55", "L3-8"])
def test_pixels_of_a_cell_are_those_by_which_white_noise_scatters(name: str) -> None:
    preset = probe_preset(name)
    reader = ImageReader(preset)
    rng = np.random.default_rng(7)
    sums = []
    for _ in range(8):
        counts = (100 * rng.standard_normal((128, 2080))).astype(np.int16)
        image = reader.picture(ChannelFrame(header=NO_HEADER, samples=counts, sampling_hz=preset.sampling_hz))
        power = image.envelope[200:].astype(np.float64) ** 2
        power /= power.mean() / 2
        sums += [power[z : z + 52, x : x + 19].sum() for z in range(0, 600, 60) for x in range(20, 100, 20)]
    # |noise|² has the variance 4σ⁴, and a sum over n pixels that of n·cell independent ones.
    assert np.var(sums) / (4 * 52 * 19) == pytest.approx(cell_pixels(preset), rel=0.35)


@pytest.mark.long
def test_the_energy_of_a_stained_spot_is_steadier_than_its_peak_and_nearer_to_it() -> None:
    away_mm: dict[str, list[float]] = {"peak": [], "energy": [], "lateral peak": [], "lateral energy": []}
    rough: dict[str, list[float]] = {"peak": [], "energy": []}
    for seed in range(12):
        settings = SimulatedSettings(
            tissue="muscle",
            noise=NoiseSettings(peak_snr_db=50.0),
            marker=MarkerSettings(angle_deg=0.0, lateral_m=3e-3),
        )
        scene = draw_scene(settings, np.random.default_rng(seed))
        reader = image_reader(scene.model.probe.array, sampling_hz=scene.model.sampling_hz)
        angles_deg = np.arange(-2.0, 2.01, 0.5)
        rng = np.random.default_rng([seed, 1])
        readings = []
        for angle_deg in angles_deg:
            data = scene.model.channel_data(scene.absorbers, angle_deg=float(angle_deg))
            counts = np.rint(data + scene.noise.white_sigma * rng.standard_normal(data.shape)).astype(np.int16)
            frame = ChannelFrame(header=NO_HEADER, samples=counts, sampling_hz=scene.model.sampling_hz)
            readings.append(reader.read(frame))
        spots = [reading.spot for reading in readings]
        assert all(spot is not None for spot in spots)
        radius_mm = 1e3 * settings.marker.radius_m
        for name, height in (
            ("peak", np.array([reading.intensity for reading in readings])),
            ("energy", np.array([spot.amplitude for spot in spots if spot is not None])),
        ):
            fitted = np.polyfit(angles_deg, np.log(height), 2)
            curvature, slope, _ = fitted
            rough[name].append(float(np.std(np.log(height) - np.polyval(fitted, angles_deg))))
            away_mm[name].append(math.radians(-slope / (2 * curvature)) * radius_mm)
        top = int(np.argmax([reading.intensity for reading in readings]))
        away_mm["lateral peak"].append(1e3 * (readings[top].lateral_m or 0.0) - 3)
        away_mm["lateral energy"].append(1e3 * np.mean([spot.lateral_m for spot in spots[2:-2] if spot]) - 3)
    rms_mm = {name: float(np.sqrt(np.mean(np.square(each)))) for name, each in away_mm.items()}
    assert rms_mm["energy"] < rms_mm["peak"]
    assert np.mean(rough["energy"]) < 0.7 * np.mean(rough["peak"])
    assert rms_mm["lateral energy"] < 0.5 * rms_mm["lateral peak"]
