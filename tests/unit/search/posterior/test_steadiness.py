"""How steady the laser is, as the samples of one marker show it."""

from __future__ import annotations

from markerseek.core import Interval, Reading, Sample
from markerseek.search.posterior import energy_spread


def test_dark_frames_without_any_noise_do_not_hide_the_marker() -> None:
    """A noise floor of 0 is a floor, and every sample is above it."""
    lit = [
        Sample(angle_deg=each, reading=Reading(intensity=100 / (1 + (each / 3) ** 2)))
        for each in (-4, -2, -1, 0, 1, 2, 4)
    ]
    dark = Sample(angle_deg=0.0, reading=Reading(intensity=0.0), dark=True)
    spread = energy_spread(lit, [dark], limits=Interval(low_deg=-10.0, high_deg=10.0))
    assert spread is not None
    assert 0.0 < spread < 0.1
