"""Noise of the receiver: white, coloured by the receive band, and heavy-tailed bursts; independent at every call."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.fft

from markerseek.acoustics._checks import not_negative, positive
from markerseek.acoustics.band import Band
from markerseek.core import Float32, require_range


@dataclass(frozen=True, slots=True, kw_only=True)
class Bursts:
    """Moments at which the noise is far larger than usual: a switching motor, a loose cable.

    A burst multiplies the noise of a whole record by ``gain``·sqrt(ν/χ²ν), drawn once for each burst: over many bursts
    the samples then follow Student's t distribution with ν degrees of freedom, scaled by gain and sigma.
    """

    frame_probability: float = 0.0
    """Probability that a frame has a burst on all channels at once."""
    channel_probability: float = 0.0
    """Probability, for each channel of each frame, of a burst on that channel alone."""
    gain: float = 5.0
    """Usual size of a burst, as a multiple of the noise."""
    freedom: float = 3.0
    """Degrees of freedom ν; with fewer the tails are heavier."""

    def __post_init__(self) -> None:
        for name in ("frame_probability", "channel_probability"):
            require_range(f"bursts: {name}", getattr(self, name), low=0.0, high=1.0, cure="0 is never")
        positive(self.gain, name="bursts: gain", cure="5 is usual")
        positive(self.freedom, name="bursts: freedom", cure="3 is usual")

    def draw(self, rng: np.random.Generator, *, channels: int) -> Float32[np.ndarray, " channels"]:
        """Factors for the noise of each channel in one frame; 1 without a burst."""
        # Sizes are drawn for all channels, so that the random state does not depend on which were hit.
        hit = rng.random(channels) < self.channel_probability
        size = np.where(hit, self._sizes(rng, channels), 1.0)
        if rng.random() < self.frame_probability:
            size *= self._sizes(rng, 1)
        return size.astype(np.float32)

    def _sizes(self, rng: np.random.Generator, count: int) -> np.ndarray:
        return self.gain * np.sqrt(self.freedom / rng.chisquare(self.freedom, count))


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Gaussian noise, independent from channel to channel and from frame to frame."""

    white_sigma: float = 0.0
    """Standard deviation of noise with a flat spectrum, per channel and sample, in the unit of the channel data."""
    coloured_sigma: float = 0.0
    """Standard deviation of noise with the spectrum of the band, in the same unit."""
    band: Band = field(default_factory=Band)
    bursts: Bursts | None = None

    def __post_init__(self) -> None:
        for name in ("white_sigma", "coloured_sigma"):
            not_negative(getattr(self, name), name=f"noise: {name}", cure="0 is none")

    def sample(
        self, rng: np.random.Generator, *, channels: int, samples: int, sampling_hz: float
    ) -> Float32[np.ndarray, "channels samples"]:
        """Noise of one frame, shape (channels, samples), to be added to the channel data.

        ``channels``, ``samples``: shape of the frame.
        """
        if self.coloured_sigma > 0:
            noise = self._shaped(rng, channels, samples, sampling_hz)
        elif self.white_sigma > 0:
            noise = rng.standard_normal((channels, samples), dtype=np.float32)
            noise *= np.float32(self.white_sigma)
        else:
            return np.zeros((channels, samples), dtype=np.float32)
        if self.bursts is not None:
            noise *= self.bursts.draw(rng, channels=channels)[:, np.newaxis]
        return noise

    def _shaped(
        self, rng: np.random.Generator, channels: int, samples: int, sampling_hz: float
    ) -> Float32[np.ndarray, "channels samples"]:
        """Noise drawn in the frequency domain, its spectrum the sum of the white and the coloured one."""
        # The record is one period of a periodic process: its ends join. The parts of a bin are drawn uniformly from an
        # interval, which costs a third of a normal draw; each sample is a sum over a thousand of them, and normal (its
        # excess kurtosis is about −0.001), as in S. O. Rice, Bell Syst. Tech. J. 23, 282 (1944).
        frequency_hz = scipy.fft.rfftfreq(samples, 1 / sampling_hz)
        # parts of unit variance in bin k give a variance of 4/samples², in the real bins at both ends 1/samples²
        share = np.full(frequency_hz.size, 4.0)
        share[0] = 1.0
        if samples % 2 == 0:
            share[-1] = 1.0
        power = self.band.gain(frequency_hz) ** 2
        power *= self.coloured_sigma**2 / (share @ power)
        # flat: a real bin holds half the variance of a complex one
        flat = np.where(share == 1.0, 2.0, 1.0)
        power += self.white_sigma**2 * flat / (share @ flat)
        # Bins below −80 dB are left at 0: they would cost draws and change nothing.
        bins = np.flatnonzero(power > 1e-8 * power.max())
        low, high = int(bins[0]), int(bins[-1]) + 1
        spectrum = np.zeros((channels, frequency_hz.size), dtype=np.complex64)
        drawn = rng.random((channels, 2 * (high - low)), dtype=np.float32)
        drawn -= np.float32(0.5)
        # A uniform draw from an interval of length 1 has the variance 1/12.
        scale = (samples * np.sqrt(12 * power[low:high])).astype(np.float32)
        # Two neighbouring draws are the real and the imaginary part of a bin.
        np.multiply(drawn.view(np.complex64), scale, out=spectrum[:, low:high])
        noise: Float32[np.ndarray, "channels samples"] = scipy.fft.irfft(spectrum, samples, axis=1, overwrite_x=True)
        return noise
