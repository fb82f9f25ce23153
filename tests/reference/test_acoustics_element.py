"""Element response against brute-force quadrature in the frequency domain and against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import simpson

from markerseek.acoustics import (
    Absorber,
    AcousticModel,
    Band,
    GaussianAbsorber,
    GaussianPulse,
    Medium,
    Probe,
    RectanglePulse,
    Sphere,
)
from markerseek.core import LinearArray

WINDOW = 4096  # samples of the record of the brute-force form, so that nothing wraps around
TRACED = (0, 20, 63, 64, 100, 127)


def brute_force(model: AcousticModel, absorber: Absorber, angle_deg: float, elements: tuple[int, ...]) -> np.ndarray:
    """Simpson's rule over a fine grid of the face, at each frequency, with the attenuation of each path as it is."""
    probe, medium = model.probe, model.medium
    f = np.fft.rfftfreq(WINDOW, 1 / model.sampling_hz)
    spectrum = absorber.source.spectrum(f, sound_speed_m_s=medium.sound_speed_m_s)
    spectrum = spectrum * model.laser.spectrum(f) * model.band.gain(f)
    # unit: the envelope of the lossless pulse peaks at 1 at 50 mm
    fine = 16 * WINDOW
    analytic = np.zeros(fine, dtype=complex)
    analytic[: f.size] = 2 * spectrum
    spectrum = spectrum / np.abs(np.fft.ifft(analytic) * fine).max() * 50e-3
    used = np.flatnonzero(np.abs(spectrum) > 1e-6 * np.abs(spectrum).max())
    eta = np.linspace(-0.5, 0.5, 321) * probe.element_height_m
    u = np.linspace(-0.5, 0.5, 33) * probe.element_width_m
    t = math.radians(angle_deg - absorber.angle_deg)
    elevation = absorber.radius_m * math.sin(t)
    axial = absorber.radius_m * math.cos(t) - probe.face_radius_m
    focus = probe.elevation_focus_m
    lens = np.zeros_like(eta) if focus is None else np.sqrt(focus**2 + eta**2) - focus
    heard = []
    for element in elements:
        x = (element - (probe.array.elements - 1) / 2) * probe.array.pitch_m
        r = np.sqrt((absorber.lateral_m - x - u[:, None]) ** 2 + (elevation - eta) ** 2 + axial**2)
        delay = (r - lens) / medium.sound_speed_m_s + model.trigger_offset_s
        channel = np.zeros(f.size, dtype=complex)
        for i in used:
            loss = medium.attenuation_db_cm_mhz * (f[i] / 1e6) ** medium.power * r * 100
            wave = 10 ** (-loss / 20) / r * np.exp(-2j * np.pi * f[i] * delay)
            channel[i] = spectrum[i] * simpson(simpson(wave, x=eta, axis=1), x=u)
        area = probe.element_width_m * probe.element_height_m
        heard.append(absorber.strength * np.fft.irfft(channel / area, WINDOW) * WINDOW)
    return np.array(heard)[:, : model.samples]


CASES = {
    "on plane": (AcousticModel(), Absorber(radius_m=60e-3), 0.0),
    "2 deg": (AcousticModel(), Absorber(radius_m=60e-3), 2.0),
    "10 deg": (AcousticModel(), Absorber(radius_m=60e-3, strength=-3.0), 10.0),
    "marker and probe both turned": (AcousticModel(), Absorber(radius_m=60e-3, angle_deg=12.0), -8.0),
    "end of the range": (AcousticModel(), Absorber(radius_m=60e-3), 35.0),
    "other end, lateral": (AcousticModel(), Absorber(radius_m=60e-3, lateral_m=25e-3), -35.0),
    "lateral": (AcousticModel(), Absorber(radius_m=60e-3, lateral_m=-25e-3), 0.0),
    "near": (AcousticModel(), Absorber(radius_m=15e-3), 0.0),
    "near, off plane": (AcousticModel(), Absorber(radius_m=16e-3), 20.0),
    "short laser pulse": (AcousticModel(laser=GaussianPulse(fwhm_s=5e-9)), Absorber(radius_m=60e-3), 10.0),
    "small sphere, end": (
        AcousticModel(laser=GaussianPulse(fwhm_s=5e-9)),
        Absorber(radius_m=60e-3, source=Sphere(radius_m=0.05e-3)),
        35.0,
    ),
    "small sphere, lateral": (
        AcousticModel(laser=GaussianPulse(fwhm_s=5e-9)),
        Absorber(radius_m=60e-3, lateral_m=25e-3, source=Sphere(radius_m=0.05e-3)),
        0.0,
    ),
    "tissue": (
        AcousticModel(medium=Medium(attenuation_db_cm_mhz=0.6, power=1.1)),
        Absorber(radius_m=60e-3, lateral_m=10e-3),
        10.0,
    ),
    "no loss, no lens": (
        AcousticModel(medium=Medium(attenuation_db_cm_mhz=0.0), probe=Probe(elevation_focus_m=None)),
        Absorber(radius_m=60e-3),
        20.0,
    ),
    "tall elements": (
        AcousticModel(probe=Probe(element_height_m=6e-3, elevation_focus_m=20e-3), laser=GaussianPulse()),
        Absorber(radius_m=50e-3, source=GaussianAbsorber(radius_m=0.05e-3)),
        30.0,
    ),
    "trigger offset": (AcousticModel(trigger_offset_s=0.987e-6), Absorber(radius_m=45e-3), 5.0),
    "large and slow": (
        AcousticModel(laser=GaussianPulse(fwhm_s=100e-9)),
        Absorber(radius_m=60e-3, source=GaussianAbsorber(radius_m=0.4e-3)),
        10.0,
    ),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_agrees_with_brute_force_to_one_per_cent(case: tuple[AcousticModel, Absorber, float]) -> None:
    model, absorber, angle_deg = case
    heard = model.channel_data([absorber], angle_deg=angle_deg)[list(TRACED)]
    expected = brute_force(model, absorber, angle_deg, TRACED)
    largest = np.abs(expected).max(axis=1)
    assert (largest > 0).all()
    assert (np.abs(heard - expected).max(axis=1) < 0.01 * largest).all()
