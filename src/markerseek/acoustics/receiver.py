"""The receiver: geometry of the probe, its band, its noise, and its converter."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
import scipy.fft

from markerseek.core import ConfigError, Float32, Float64, Int16, LinearArray, Within, require_fields


class Probe(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Side-fire linear array, its row parallel to the axis that it turns about."""

    array: LinearArray = LinearArray()
    """Number and pitch of the elements."""
    element_width_m: Annotated[float, Within(0, 50e-3, "m", open_low=True, cure="0.9 of the pitch is usual")] = 0.39e-3
    """Extent of an element along the row; at most the pitch."""
    element_height_m: Annotated[float, Within(0, 50e-3, "m", open_low=True, cure="3 to 6 mm are usual")] = 5e-3
    """Extent of an element across the row (elevation)."""
    elevation_focus_m: Annotated[
        float | None, Within(0, 1, "m", open_low=True, cure="20 to 40 mm are usual, None is a probe without a lens")
    ] = 30e-3
    """Distance at which the lens focuses in elevation; None without a lens."""
    face_radius_m: Annotated[float, Within(0, 1, "m", open_low=True, cure="8 to 12 mm are usual")] = 10e-3
    """Distance R of the face from the axis of rotation."""

    def __post_init__(self) -> None:
        require_fields(self, "probe")
        if self.element_width_m > self.array.pitch_m:
            raise ConfigError(
                f"probe: element_width_m is {self.element_width_m} m, the elements would overlap: "
                f"it must be at most the pitch of {self.array.pitch_m} m"
            )

    def in_probe_frame(self, *, radius_m: float, off_plane_deg: float) -> tuple[float, float]:
        """Return a point's offset in elevation and its distance from the plane of the face, in metres.

        With t the angle from the image plane to the point these are ρ sin t and ρ cos t − R.

        ``radius_m``: distance ρ of the point from the axis of rotation. ``off_plane_deg``: angle t of the image plane
        less that of the point.
        """
        turned = math.radians(off_plane_deg)
        return radius_m * math.sin(turned), radius_m * math.cos(turned) - self.face_radius_m


class Band(msgspec.Struct, frozen=True, kw_only=True):
    """Receive band with one peak and a Gaussian skirt on each side, of zero phase.

    Zero phase means that the band moves no arrival: the received pulse is centred on the moment at which the sound
    reaches the element. A real receiver delays by a constant, which is part of the trigger offset.
    The peak need not lie midway between the two ends (the defaults are those of a 5–9 MHz probe centred on 6.5 MHz).
    Each skirt has its own width, with a smooth transition, so that the pulse has no long tails.
    """

    centre_hz: float = 6.5e6
    """Frequency of the largest gain, which is 1."""
    low_hz: float = 5e6
    high_hz: float = 9e6
    """``low_hz`` and ``high_hz``: frequencies below and above it at which the gain is one half (−6 dB); neither side
    may be more than four times as wide as the other."""

    def __post_init__(self) -> None:
        if not 0 < self.low_hz < self.centre_hz < self.high_hz < math.inf:
            raise ConfigError(
                f"band: low_hz {self.low_hz} Hz, centre_hz {self.centre_hz} Hz, high_hz {self.high_hz} Hz: "
                "they must be positive, finite and rise in this order"
            )
        # Far out on its narrow side the width w is less than at −6 dB; at a skew of 8 it would reach 0.
        skew = (self.high_hz - self.centre_hz) / (self.centre_hz - self.low_hz)
        if not 1 / 4 <= skew <= 4:
            raise ConfigError(
                f"band: centre_hz is {self.centre_hz} Hz, one side of the band is {max(skew, 1 / skew):.3g} times as "
                "wide as the other, at most 4 is allowed; move the centre towards the middle"
            )

    def gain(self, frequency_hz: Float64[np.ndarray, " frequencies"]) -> Float64[np.ndarray, " frequencies"]:
        """Return the gain at each frequency: 2^−(x/w)², x = f − centre, with w = a + b·tanh(x/narrower half).

        The numbers a and b are such that w is the half width of the band at either end.

        ``frequency_hz``: frequencies, not negative.
        """
        below = self.centre_hz - self.low_hz
        above = self.high_hz - self.centre_hz
        narrower = min(below, above)
        rise = (above - below) / (math.tanh(above / narrower) + math.tanh(below / narrower))
        middle = below + rise * math.tanh(below / narrower)
        away = frequency_hz - self.centre_hz
        half_width = middle + rise * np.tanh(away / narrower)
        gain: Float64[np.ndarray, " frequencies"] = np.exp2(-((away / half_width) ** 2))
        return gain


class Bursts(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Moments at which the noise is far larger than usual: a switching motor, a loose cable.

    A burst multiplies the noise of a whole record by ``gain``·sqrt(ν/χ²ν), drawn once for each burst: over many bursts
    the samples then follow Student's t distribution with ν degrees of freedom, scaled by gain and sigma.
    """

    frame_probability: Annotated[float, Within(0, 1, cure="0 is never")] = 0.0
    """Probability that a frame has a burst on all channels at once."""
    channel_probability: Annotated[float, Within(0, 1, cure="0 is never")] = 0.0
    """Probability, for each channel of each frame, of a burst on that channel alone."""
    gain: Annotated[float, Within(0, 1e6, open_low=True, cure="5 is usual")] = 5.0
    """Usual size of a burst, as a multiple of the noise."""
    freedom: Annotated[float, Within(0, 1e6, open_low=True, cure="3 is usual")] = 3.0
    """Degrees of freedom ν; with fewer the tails are heavier."""

    def __post_init__(self) -> None:
        require_fields(self, "bursts")

    def draw(self, rng: np.random.Generator, *, channels: int) -> Float32[np.ndarray, " channels"]:
        """Return the factors for the noise of each channel in one frame; 1 without a burst."""
        # Sizes are drawn for all channels, so that the random state does not depend on which were hit.
        hit = rng.random(channels) < self.channel_probability
        size = np.where(hit, self._sizes(rng, channels), 1.0)
        if rng.random() < self.frame_probability:
            size *= self._sizes(rng, 1)
        return size.astype(np.float32)

    def _sizes(self, rng: np.random.Generator, count: int) -> np.ndarray:
        return self.gain * np.sqrt(self.freedom / rng.chisquare(self.freedom, count))


class Noise(msgspec.Struct, frozen=True, kw_only=True):
    """Gaussian noise, independent from channel to channel and from frame to frame."""

    white_sigma: Annotated[float, Within(0, 1e12, cure="0 is none")] = 0.0
    """Standard deviation of noise with a flat spectrum, per channel and sample, in the unit of the channel data."""
    coloured_sigma: Annotated[float, Within(0, 1e12, cure="0 is none")] = 0.0
    """Standard deviation of noise with the spectrum of the band, in the same unit."""
    band: Band = Band()
    bursts: Bursts | None = None

    def __post_init__(self) -> None:
        require_fields(self, "noise")

    def sample(
        self, rng: np.random.Generator, *, channels: int, samples: int, sampling_hz: float
    ) -> Float32[np.ndarray, "channels samples"]:
        """Return the noise of one frame, shape (channels, samples), to be added to the channel data.

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
        """Return the noise drawn in the frequency domain, its spectrum the sum of the white and the coloured one."""
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
        low = int(bins[0])
        high = int(bins[-1]) + 1
        spectrum = np.zeros((channels, frequency_hz.size), dtype=np.complex64)
        drawn = rng.random((channels, 2 * (high - low)), dtype=np.float32)
        drawn -= np.float32(0.5)
        # A uniform draw from an interval of length 1 has the variance 1/12.
        scale = (samples * np.sqrt(12 * power[low:high])).astype(np.float32)
        # Two neighbouring draws are the real and the imaginary part of a bin.
        np.multiply(drawn.view(np.complex64), scale, out=spectrum[:, low:high])
        noise: Float32[np.ndarray, "channels samples"] = scipy.fft.irfft(spectrum, samples, axis=1, overwrite_x=True)
        return noise


MIN_COUNT = -2048
LARGEST_COUNT = 2047
"""Full scale of 12 bits, sign included."""


def digitise(data: Float32[np.ndarray, "channels samples"]) -> Int16[np.ndarray, "channels samples"]:
    """Return the counts, shape (channels, samples): rounded to the nearest (ties to even), held at full scale.

    ``data``: channel data in counts; infinite values saturate.
    """
    if np.isnan(data).any():
        raise ConfigError("digitiser: data holds NaN, for which a converter has no code; correct its source")
    counts: Float32[np.ndarray, "channels samples"] = np.rint(data)
    # Clipped before the conversion to int16, which would wrap an overflow round to the other sign.
    np.clip(counts, MIN_COUNT, LARGEST_COUNT, out=counts)
    return counts.astype(np.int16)
