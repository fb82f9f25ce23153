"""The peak SNR of a simulated rig equals the requested one, as measured on its frames."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec import structs

from markerseek import rigs
from markerseek.acoustics import Probe
from markerseek.core import ChannelFrame, ConfigError
from markerseek.rigs import draw_scene, image_reader
from markerseek.signals import ImageReader, beamformed_sigma
from markerseek.signals.beamform import beamform, image_grid
from markerseek.signals.filtering import band_pass
from markerseek.sim import TISSUES, LaserSettings, MarkerSettings, NoiseSettings, SimulatedSettings

STEADY = SimulatedSettings(laser=LaserSettings(energy_jitter=0.0))


def radio_frequency(imaging: ImageReader, frame: object) -> np.ndarray:
    """Beamformed signal of a frame before its envelope, deep enough for the default aperture to be whole."""
    assert isinstance(frame, ChannelFrame)
    preset = imaging.preset
    grid = image_grid(preset, samples=frame.samples.shape[1], depth_m=np.arange(20e-3, 75e-3, preset.depth_step_m))
    return beamform(band_pass(frame.samples, preset), grid)


@pytest.mark.long
@pytest.mark.parametrize("peak_snr_db", [30.0, 40.0])
@pytest.mark.parametrize("coloured", [0.0, 0.5, 1.0])
def test_the_peak_over_the_noise_of_the_beamformed_signal_is_as_set(peak_snr_db: float, coloured: float) -> None:
    noise = NoiseSettings(peak_snr_db=peak_snr_db, coloured=coloured)
    rig = rigs.simulated(seed=2, marker_deg=5.0, settings=structs.replace(STEADY, noise=noise))
    assert rig.imaging is not None
    dark = [radio_frequency(rig.imaging, rig.scanner.measure_dark().frame) for _ in range(8)]
    peaks = [rig.scanner.measure(5.0).reading.intensity for _ in range(24)]
    sigma = float(np.std(dark))
    # The maximum picks up noise: its square grows by about two variances of it.
    peak = float(np.sqrt(np.mean(np.square(peaks)) - 2 * sigma**2))
    assert 20 * np.log10(peak / sigma) == pytest.approx(peak_snr_db, abs=0.3)


@pytest.mark.parametrize("tissue", TISSUES)
def test_every_tissue_is_searched_on_and_its_noise_does_not_depend_on_the_angle(tissue: str) -> None:
    rig = rigs.simulated(seed=3, tissue=tissue, marker_deg=-4.0, settings=STEADY)
    assert "(simulated)" in rig.facts.description
    on_marker = rig.scanner.measure(-4.0).reading
    assert on_marker.intensity > 3 * rig.scanner.measure(15.0).reading.intensity
    sigmas = [rig.scanner.measure(angle).reading.noise_sigma for angle in (-30.0, -10.0, 10.0, 30.0)]
    assert max(sigmas) / min(sigmas) < 1.25  # type: ignore[type-var, operator]


def test_a_marker_that_cannot_be_detected_is_refused() -> None:
    far = SimulatedSettings(marker=MarkerSettings(radius_m=0.2, angle_deg=0.0))
    with pytest.raises(ConfigError, match="does not arrive within 2080 samples"):
        rigs.simulated(seed=1, settings=far)
    with pytest.raises(ConfigError, match="inside the probe"):
        rigs.simulated(seed=1, settings=SimulatedSettings(marker=MarkerSettings(radius_m=0.005)))


def test_without_a_marker_the_noise_stays_the_same_and_there_is_no_truth() -> None:
    without = SimulatedSettings(marker=MarkerSettings(present=False))
    silent = rigs.simulated(seed=4, settings=without)
    detected = rigs.simulated(seed=4)
    assert silent.facts.truth_deg is None
    one, other = (rig.scanner.measure_dark().reading.noise_sigma for rig in (silent, detected))
    assert one == pytest.approx(other, rel=0.02)


@pytest.mark.parametrize("peak_snr_db", [-20.0, 0.0, 10.0, 20.0, 70.0, 84.0])
def test_no_peak_snr_saturates_the_receiver_and_the_snr_is_as_set(peak_snr_db: float) -> None:
    settings = structs.replace(STEADY, noise=NoiseSettings(peak_snr_db=peak_snr_db))
    rng = np.random.default_rng(6)
    scene = draw_scene(settings, rng)
    assert scene.peak / 10 ** (peak_snr_db / 20) == pytest.approx(
        beamformed_sigma(scene.noise.white_sigma, preset=image_reader(settings.probe.array, sampling_hz=40e6).preset)
    )
    rig = rigs.simulated(seed=6, marker_deg=5.0, settings=settings)
    for angle_deg in (4.0, 5.0, 5.5):
        frame = rig.scanner.measure(angle_deg).frame
        assert isinstance(frame, ChannelFrame)
        assert np.abs(frame.samples).max() < 2047
        # Rounding to counts must not add to the noise by more than a tenth.
        assert np.std(frame.samples[:, :1000]) == pytest.approx(scene.noise.white_sigma, rel=0.1, abs=0.3)


def test_the_strongest_marker_off_its_plane_does_not_saturate() -> None:
    """Brute force over the angle: near the array a marker is stronger in a channel off its plane than in it."""
    probe = Probe(element_height_m=6.9e-3, elevation_focus_m=10e-3)
    marker = MarkerSettings(angle_deg=0.0, radius_m=0.05, source_radius_m=0.3e-3)
    settings = structs.replace(STEADY, probe=probe, marker=marker, noise=NoiseSettings(peak_snr_db=80.0))
    scene = draw_scene(settings, np.random.default_rng(1))
    angles_deg = np.arange(0.0, 30.0, 2.0).tolist()
    largest = [float(np.abs(scene.model.channel_data(scene.absorbers, angle_deg=each)).max()) for each in angles_deg]
    assert 1.2 * largest[0] < max(largest) < 2047


def test_an_snr_beyond_the_converter_names_the_highest_that_fits() -> None:
    with pytest.raises(ConfigError, match=r"steps of the converter hide it; lower peak_snr_db to at most \d\d dB$"):
        rigs.simulated(seed=1, settings=structs.replace(STEADY, noise=NoiseSettings(peak_snr_db=100.0)))
