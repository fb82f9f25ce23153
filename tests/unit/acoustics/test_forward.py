"""Properties of the forward model: linearity, silence, limits, refusals; clutter and echoes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from markerseek.acoustics import (
    Absorber,
    AcousticModel,
    Band,
    Clutter,
    GaussianAbsorber,
    GaussianPulse,
    Medium,
    Probe,
    RectanglePulse,
    Reverberation,
)
from markerseek.core import ConfigError, Interval
from tests.sizes import examples

MODEL = AcousticModel()
MARKER = Absorber(radius_m=60e-3)

places = st.builds(
    Absorber,
    radius_m=st.floats(11.1e-3, 90e-3),
    angle_deg=st.floats(-180.0, 180.0),
    lateral_m=st.floats(-40e-3, 40e-3),
    strength=st.floats(-10.0, 10.0),
)

angles = st.floats(-35.0, 35.0)


@settings(max_examples=examples(40), deadline=None)
@given(radius_m=st.floats(20e-3, 70e-3), lateral_m=st.floats(-25e-3, 25e-3), off_deg=st.floats(0.0, 35.0))
def test_world_and_its_mirror_image_sound_alike(radius_m: float, lateral_m: float, off_deg: float) -> None:
    here = MODEL.channel_data([Absorber(radius_m=radius_m, lateral_m=lateral_m)], angle_deg=off_deg)
    turned = MODEL.channel_data([Absorber(radius_m=radius_m, lateral_m=lateral_m)], angle_deg=-off_deg)
    along = MODEL.channel_data([Absorber(radius_m=radius_m, lateral_m=-lateral_m)], angle_deg=off_deg)
    atol = 1e-4 * max(np.abs(here).max(), 1e-3)
    np.testing.assert_allclose(turned, here, atol=atol)
    np.testing.assert_allclose(along[::-1], here, atol=atol)


@settings(max_examples=examples(30), deadline=None)
@given(off_deg=st.floats(1.0, 35.0))
def test_nowhere_is_the_sum_of_energies_larger_than_in_the_plane(off_deg: float) -> None:
    on = MODEL.channel_data([MARKER], angle_deg=0.0)
    off = MODEL.channel_data([MARKER], angle_deg=off_deg)
    assert 0 < (off**2).sum() < (on**2).sum()


def test_absorbers_add_up_and_strength_is_a_factor() -> None:
    one = structs.replace(MARKER, strength=2.5)
    other = Absorber(radius_m=45e-3, angle_deg=10.0, source=GaussianAbsorber(radius_m=0.1e-3))
    both = MODEL.channel_data([one, other], angle_deg=3.0)
    alone = MODEL.channel_data([MARKER], angle_deg=3.0), MODEL.channel_data([other], angle_deg=3.0)
    np.testing.assert_allclose(both, 2.5 * alone[0] + alone[1], atol=1e-5)
    assert np.abs(alone[1]).max() > 1e-3


def test_absorber_beside_or_behind_the_face_is_silent() -> None:
    assert not MODEL.channel_data([], angle_deg=0.0).any()
    assert not MODEL.channel_data([MARKER], angle_deg=180.0).any()
    edge_deg = math.degrees(math.acos(11e-3 / 60e-3))
    assert MODEL.channel_data([MARKER], angle_deg=edge_deg - 0.01).any()
    assert not MODEL.channel_data([MARKER], angle_deg=edge_deg + 0.01).any()
    assert not MODEL.channel_data([structs.replace(MARKER, strength=0.0)], angle_deg=0.0).any()


def test_sound_that_comes_after_the_record_or_before_it_is_cut_off() -> None:
    assert not MODEL.channel_data([Absorber(radius_m=150e-3)], angle_deg=0.0).any()
    early = AcousticModel(trigger_offset_s=-32.475e-6).channel_data([MARKER], angle_deg=0.0)
    full = MODEL.channel_data([MARKER], angle_deg=0.0)
    shift = round(32.475e-6 * 40e6)
    assert np.abs(early[64, :20]).max() > 0.1 * np.abs(full).max()
    np.testing.assert_allclose(early[:, :-shift], full[:, shift:], atol=1e-3 * np.abs(full).max())
    short = AcousticModel(samples=1310).channel_data([MARKER], angle_deg=0.0)
    np.testing.assert_allclose(short, full[:, :1310], atol=1e-6)


def test_reverberation_repeats_each_arrival_behind_itself() -> None:
    plain = MODEL.channel_data([MARKER], angle_deg=0.0)
    echoing = AcousticModel(reverberation=Reverberation(delay_s=5e-6, gain=-0.3, repeats=2))
    received = echoing.channel_data([MARKER], angle_deg=0.0)
    expected = plain.copy()
    expected[:, 200:] += -0.3 * plain[:, :-200]
    expected[:, 400:] += 0.09 * plain[:, :-400]
    np.testing.assert_allclose(received, expected, atol=1e-4 * np.abs(plain).max())


def test_clutter_fills_its_sector_evenly_and_repeats_with_its_seed() -> None:
    clutter = Clutter(count=4000, strength=0.05, angles=Interval(low_deg=-40.0, high_deg=20.0))
    drawn = clutter.draw(np.random.default_rng(7))
    assert drawn == clutter.draw(np.random.default_rng(7))
    assert drawn != clutter.draw(np.random.default_rng(8))
    radius = np.array([a.radius_m for a in drawn])
    assert 20e-3 <= radius.min() < 21e-3
    assert 69.8e-3 < radius.max() <= 70e-3
    half = math.sqrt((20e-3**2 + 70e-3**2) / 2)
    assert np.mean(radius < half) == pytest.approx(0.5, abs=0.03)
    assert np.mean([a.angle_deg for a in drawn]) == pytest.approx(-10.0, abs=1.0)
    assert np.std([a.lateral_m for a in drawn]) == pytest.approx(30e-3 / math.sqrt(3), rel=0.03)
    strength = np.array([a.strength for a in drawn])
    assert np.abs(strength).mean() == pytest.approx(0.05, rel=0.06)
    assert np.mean(strength > 0) == pytest.approx(0.5, abs=0.03)
    assert Clutter(count=0).draw(np.random.default_rng(1)) == ()
    received = MODEL.channel_data(drawn[:30], angle_deg=-10.0)
    assert np.isfinite(received).all()
    assert 0 < np.abs(received).max() < 1


NAN = float("nan")
INF = float("inf")
REFUSED = {
    "probe: element_width_m": lambda: Probe(element_width_m=0.5e-3),
    "probe: face_radius_m": lambda: Probe(face_radius_m=-1e-3),
    "medium: sound_speed_m_s": lambda: Medium(sound_speed_m_s=1.54),
    "medium: power": lambda: Medium(power=NAN),
    "band: low_hz": lambda: Band(low_hz=7e6),
    "Gaussian absorber: radius_m": lambda: GaussianAbsorber(radius_m=NAN),
    "rectangle pulse: duration_s": lambda: RectanglePulse(duration_s=0.0),
    "Gaussian pulse: fwhm_s": lambda: GaussianPulse(fwhm_s=NAN),
    "absorber: radius_m": lambda: Absorber(radius_m=NAN),
    "absorber: angle_deg": lambda: Absorber(radius_m=0.06, angle_deg=INF),
    "clutter: count": lambda: Clutter(count=-1),
    "clutter: nearest_m": lambda: Clutter(count=1, nearest_m=0.08),
    "reverberation: delay_s": lambda: Reverberation(delay_s=0.0),
    "acoustic model: sampling_hz": lambda: AcousticModel(sampling_hz=NAN),
    "acoustic model: angle_deg": lambda: MODEL.channel_data([MARKER], angle_deg=NAN),
    "absorber: radius_m is 0.0105": lambda: MODEL.channel_data([Absorber(radius_m=0.0105)], angle_deg=0.0),
    "sampling_hz is 20000000.0": lambda: AcousticModel(sampling_hz=20e6).channel_data([MARKER], angle_deg=0.0),
    "leaves nothing in the band": lambda: AcousticModel(laser=GaussianPulse(fwhm_s=1e-3)).pulse(GaussianAbsorber()),
    "lasts": lambda: AcousticModel(laser=RectanglePulse(duration_s=40e-6)).pulse(GaussianAbsorber()),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_cannot_be_used_is_refused_by_name(message: str) -> None:
    with pytest.raises(ConfigError, match=message.removesuffix(" nan")):
        REFUSED[message]()
