"""Statistics of the noise, and the converter."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal, stats

from markerseek.acoustics import Band, Bursts, Noise, digitise
from markerseek.core import ConfigError


def draw(noise: Noise, seed: int = 1, channels: int = 128, samples: int = 2080) -> np.ndarray:
    return noise.sample(np.random.default_rng(seed), channels=channels, samples=samples, sampling_hz=40e6)


KINDS = {
    "white": Noise(white_sigma=3.0),
    "coloured": Noise(coloured_sigma=3.0),
    "both": Noise(white_sigma=1.8, coloured_sigma=2.4),
}


@pytest.mark.parametrize("noise", KINDS.values(), ids=KINDS.keys())
@pytest.mark.parametrize("samples", [2080, 2081, 1300])
def test_sigma_is_what_was_asked_for_and_samples_are_normal(noise: Noise, samples: int) -> None:
    drawn = draw(noise, samples=samples)
    assert drawn.shape == (128, samples)
    assert drawn.dtype == np.float32
    assert drawn.std() == pytest.approx(3.0, rel=0.01)
    assert abs(drawn.mean()) < 0.05
    # every moment of the record is as noisy as any other, at the ends too
    assert drawn[:, :20].std() == pytest.approx(3.0, rel=0.1)
    assert drawn[:, -20:].std() == pytest.approx(3.0, rel=0.1)
    apart = drawn[:, ::40].ravel()
    assert stats.kstest(apart / 3.0, "norm").pvalue > 1e-3
    assert abs(stats.kurtosis(drawn.ravel())) < 0.05


@pytest.mark.parametrize("noise", KINDS.values(), ids=KINDS.keys())
def test_spectrum_is_that_of_the_band_upon_a_flat_one(noise: Noise) -> None:
    frames = np.concatenate([draw(noise, seed) for seed in range(8)])
    f, density = signal.welch(frames, fs=40e6, nperseg=208, noverlap=0, axis=1)
    density = density.mean(axis=0)
    gain = noise.band.gain(f) ** 2
    expected = noise.white_sigma**2 / 20e6 + noise.coloured_sigma**2 * gain / (gain.sum() * f[1])
    inside = (f > 1e6) & (f < 19e6)
    np.testing.assert_allclose(density[inside], expected[inside], rtol=0.06, atol=0.01 * expected.max())


def test_channels_and_frames_are_independent() -> None:
    noise = Noise(coloured_sigma=1.0)
    drawn = draw(noise)
    correlation = np.corrcoef(drawn)[np.triu_indices(128, 1)]
    assert np.abs(correlation).max() < 0.2
    assert correlation.std() == pytest.approx(0.033, abs=0.015)
    rng = np.random.default_rng(3)
    first = noise.sample(rng, channels=128, samples=2080, sampling_hz=40e6)
    second = noise.sample(rng, channels=128, samples=2080, sampling_hz=40e6)
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) < 0.01
    np.testing.assert_array_equal(draw(noise, 5), draw(noise, 5))


def test_bursts_come_as_often_as_asked_and_have_heavy_tails() -> None:
    rng = np.random.default_rng(11)
    some = Bursts(channel_probability=0.1, gain=4.0)
    sizes = np.array([some.draw(rng, channels=128) for _ in range(400)])
    assert (sizes != 1).mean() == pytest.approx(0.1, abs=0.005)
    # gain·sqrt(ν/χ²): of its inverse square the mean is 1/gain²
    assert (1 / sizes[sizes != 1] ** 2).mean() == pytest.approx(1 / 16, rel=0.05)
    whole = Bursts(frame_probability=0.25)
    sizes = np.array([whole.draw(rng, channels=128) for _ in range(4000)])
    assert (sizes == sizes[:, :1]).all()
    assert (sizes[:, 0] != 1).mean() == pytest.approx(0.25, abs=0.02)
    assert (Bursts().draw(rng, channels=8) == 1).all()


def test_samples_of_bursts_follow_students_t() -> None:
    noise = Noise(white_sigma=1.0, bursts=Bursts(channel_probability=1.0, gain=2.0, freedom=3.0))
    drawn = np.concatenate([draw(noise, seed, samples=16)[:, 5] for seed in range(60)])
    assert stats.kstest(drawn / 2.0, "t", args=(3,)).pvalue > 1e-3
    assert stats.kstest(drawn / 2.0, "norm").pvalue < 1e-3


@given(value=st.floats(-1e6, 1e6, width=32) | st.floats(-2100, 2100, width=32))
def test_converter_is_within_half_a_count_or_at_full_scale(value: float) -> None:
    (count,) = digitise(np.array([[value]], np.float32))[0].tolist()
    assert -2048 <= count <= 2047
    if -2048 < value < 2047:
        assert abs(count - value) <= 0.5
    else:
        assert count in (-2048, 2047)


NAN = float("nan")
REFUSED = {
    "noise: white_sigma": lambda: Noise(white_sigma=NAN),
    "noise: coloured_sigma": lambda: Noise(coloured_sigma=-1.0),
    "bursts: frame_probability": lambda: Bursts(frame_probability=1.2),
    "bursts: channel_probability": lambda: Bursts(channel_probability=NAN),
    "bursts: gain": lambda: Bursts(gain=0.0),
    "bursts: freedom": lambda: Bursts(freedom=NAN),
    "digitiser: data holds NaN": lambda: digitise(np.full((2, 2), np.nan, np.float32)),
    "band: ": lambda: Band(high_hz=float("inf")),
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_cannot_be_used_is_refused_by_name(message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        REFUSED[message]()
