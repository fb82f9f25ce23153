"""The intensity curve that comes out of the model: width, tails, symmetry. Channels are aligned here by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from markerseek.acoustics import Absorber, AcousticModel, GaussianAbsorber, GaussianPulse, Probe


def intensity(model: AcousticModel, absorber: Absorber, angle_deg: float) -> float:
    """Envelope peak of the channels, each moved by the time from the absorber to the element's middle, and added."""
    t = math.radians(angle_deg - absorber.angle_deg)
    off = absorber.radius_m * math.sin(t)
    axial = absorber.radius_m * math.cos(t) - model.probe.face_radius_m
    r = np.sqrt((absorber.lateral_m - model.probe.array.lateral_m) ** 2 + off**2 + axial**2)
    channels = model.channel_data([absorber], angle_deg=angle_deg)
    f = np.fft.rfftfreq(4096, 1 / model.sampling_hz)
    turned = np.fft.rfft(channels, 4096, axis=1) * np.exp(2j * np.pi * f * (r[:, None] - r.min()) / 1540.0)
    one_sided = np.zeros(4096, dtype=complex)
    one_sided[: f.size] = 2 * turned.sum(axis=0)
    return float(np.abs(np.fft.ifft(one_sided)).max())


def curve(model: AcousticModel, absorber: Absorber, step_deg: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    off = np.arange(0.0, 35.0 + step_deg / 2, step_deg)
    received = np.array([intensity(model, absorber, absorber.angle_deg + x) for x in off.tolist()])
    return off, received / received[0]


def fwhm(off: np.ndarray, received: np.ndarray) -> float:
    below = int(np.flatnonzero(received < 0.5)[0])
    return 2 * float(np.interp(0.5, received[below - 1 : below + 1][::-1], off[below - 1 : below + 1][::-1]))


# name: model, absorber, FWHM and S(10 deg)/S(0) as they came out, kept so that a change is seen
CURVES = {
    "default": (AcousticModel(), Absorber(radius_m=60e-3), 3.8, 0.059),
    "small absorber": (
        AcousticModel(),
        Absorber(radius_m=60e-3, source=GaussianAbsorber(radius_m=0.05e-3)),
        3.1,
        0.060,
    ),
    "large absorber": (AcousticModel(), Absorber(radius_m=60e-3, source=GaussianAbsorber(radius_m=0.4e-3)), 7.8, 0.145),
    "short laser pulse": (AcousticModel(laser=GaussianPulse()), Absorber(radius_m=60e-3), 3.7, 0.057),
    "low elements": (AcousticModel(probe=Probe(element_height_m=3e-3)), Absorber(radius_m=60e-3), 6.1, 0.090),
    "no lens": (AcousticModel(probe=Probe(elevation_focus_m=None)), Absorber(radius_m=60e-3), 4.0, 0.068),
}


@pytest.mark.parametrize("case", CURVES.values(), ids=CURVES.keys())
def test_curve_is_narrow_with_slow_tails(case) -> None:
    model, absorber, width_deg, at_10 = case
    off, received = curve(model, absorber)
    assert received.argmax() == 0
    assert fwhm(off, received) == pytest.approx(width_deg, abs=0.1)
    assert received[20] == pytest.approx(at_10, abs=0.003)
    # tails fall about as 1/|t|, far slower than a Gaussian: a straight line in logarithms
    tail = off >= 8
    slope = np.polyfit(np.log(off[tail]), np.log(received[tail]), 1)[0]
    assert -2.0 < slope < -0.8
    assert 0.005 < received[60] < 0.1
    # nothing comes back: far out no angle is stronger than a tenth above the weakest one nearer by
    assert (np.diff(received) < 0.03).all()
