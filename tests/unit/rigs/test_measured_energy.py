"""Readings are divided by the energy of their pulses where the rig measures it, and how steady a laser is is said."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec import structs

from markerseek import rigs
from markerseek.core import PAPER_RANGE, AcquisitionError, Reading, Sample
from markerseek.search.posterior import energy_spread
from markerseek.sim import LaserSettings, MarkerSettings, NoiseSettings, SimulatedSettings

STEADY = SimulatedSettings(
    marker=MarkerSettings(angle_deg=3.0, lateral_m=0.0),
    noise=NoiseSettings(peak_snr_db=60.0),
    laser=LaserSettings(energy_jitter=0.0),
)


def samples(laser: LaserSettings, angles_deg: list[float]) -> list[Sample]:
    rig = rigs.simulated(seed=4, settings=structs.replace(STEADY, laser=laser))
    return [rig.scanner.measure(angle_deg) for angle_deg in angles_deg]


def test_a_reading_is_divided_by_the_measured_energy() -> None:
    """Of one angle, at energies that differ by 30 %: every height of the reading stays the same."""
    unsteady = structs.replace(STEADY.laser, energy_spread=0.3)
    places = [3.5] * 4
    steady, measured, as_fired = (
        samples(laser, places) for laser in (STEADY.laser, structs.replace(unsteady, energy_meter_noise=0.0), unsteady)
    )
    usual = steady[0].reading

    def spread(of: list[Sample]) -> float:
        return float(np.std([sample.reading.intensity for sample in of]) / usual.intensity)

    assert spread(as_fired) > 0.1
    assert spread(measured) < 0.005
    for sample in measured:
        assert sample.frame is not None
        energy = sample.frame.header.energy
        assert energy is not None
        reading = sample.reading
        assert reading.intensity == pytest.approx(usual.intensity, rel=0.01)
        assert reading.arrivals[0].intensity == pytest.approx(usual.arrivals[0].intensity, rel=0.01)
        assert reading.noise_sigma == pytest.approx(usual.noise_sigma / energy, rel=0.1)
        assert reading.local_maxima is not None
        assert np.frombuffer(reading.local_maxima.intensities, "<f4").max() == pytest.approx(
            reading.intensity, rel=0.05
        )


def test_an_energy_that_cannot_be_is_refused() -> None:
    """A laser of a tenth of its energy has failed: what it lit is no measurement."""
    failed = structs.replace(STEADY.laser, energy_spread=1.0, energy_meter_noise=0.3)
    with pytest.raises(AcquisitionError, match=r"energy of the pulses is .* must lie between 0\.1 and 10|the noise is"):
        samples(failed, [3.0] * 40)


@pytest.mark.parametrize("spread", [0.002, 0.03, 0.08])
def test_how_steady_the_laser_is_follows_from_a_scan(spread: float) -> None:
    rng = np.random.default_rng(6)
    angles_deg = np.repeat(np.linspace(-12.0, 12.0, 25), 2)
    heights = 1000 / np.cosh(angles_deg / 2.5) * np.exp(spread * rng.standard_normal(angles_deg.size))
    lit = [
        Sample(angle_deg=angle_deg, reading=Reading(intensity=height, noise_sigma=0.5, cells=5000))
        for angle_deg, height in zip(angles_deg.tolist(), heights.tolist(), strict=True)
    ]
    assert energy_spread(lit, limits=PAPER_RANGE) == pytest.approx(spread, rel=0.6, abs=0.003)
    assert energy_spread(lit[:3], limits=PAPER_RANGE) is None
