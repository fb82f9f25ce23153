"""Two-way elevation response against the diffraction integral written out over frequency and height."""

from __future__ import annotations

import numpy as np
import pytest

from markerseek.acoustics import Band, Probe, two_way_elevation


def written_out(probe, radius_m, off_plane_deg):
    """Peak over time of ∫ B²(f)·H²(f)·exp(i 2π f t) df, H the mean of exp(−i k (path − lens))/path over the height."""
    frequency_hz = np.arange(2e6, 15e6, 5e3)
    height_m = (np.arange(801) - 400) / 801 * probe.element_height_m
    turned = np.radians(off_plane_deg)
    off = radius_m * np.sin(turned)
    axial = radius_m * np.cos(turned) - probe.face_radius_m
    # The element's width changes nothing for a point in front of it: it is left out here.
    path = np.hypot(off - height_m, axial)
    focus = probe.elevation_focus_m
    lens = np.hypot(focus, height_m) - focus if focus is not None else 0.0
    k = 2 * np.pi * frequency_hz / 1540.0
    h = np.mean(np.exp(-1j * k[:, None] * (path - lens)) / path, axis=1)
    spectrum = Band().gain(frequency_hz) ** 2 * h**2
    around = 2 * np.hypot(off, axial) / 1540.0 + np.arange(-8e-6, 8e-6, 10e-9)
    return max(abs(np.sum(spectrum * np.exp(2j * np.pi * frequency_hz * t))) for t in around)


@pytest.mark.parametrize("focus_m", [30e-3, None], ids=["lens", "no lens"])
def test_it_is_the_diffraction_integral(focus_m):
    probe = Probe(elevation_focus_m=focus_m)
    angles = np.array([0.0, 1.0, 2.5, 4.0, 7.0])
    expected = np.array([written_out(probe, 60e-3, angle) for angle in angles])
    ours = two_way_elevation(probe, radius_m=60e-3, off_plane_deg=angles)
    # Within half a per cent of the peak, and within three of each value down to 1 %.
    assert np.abs(ours - expected / expected[0]).max() < 5e-3
    assert ours == pytest.approx(expected / expected[0], rel=0.03)


def test_both_sides_are_alike_and_a_hidden_point_has_no_echo():
    sides = two_way_elevation(Probe(), radius_m=50e-3, off_plane_deg=np.array([-3.0, 3.0, 170.0]))
    assert sides[0] == sides[1] > 0
    assert sides[2] == 0.0
