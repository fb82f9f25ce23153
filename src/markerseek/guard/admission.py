"""Admission of frames: a frame with a fault is refused with its reason, and never reaches a policy as an intensity."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    ConfigError,
    Frame,
    Permit,
    Reading,
    ReadingFrame,
    SaturationError,
    is_finite,
    not_finite,
    require_range,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Admission:
    """The rules under which a frame and its reading are accepted."""

    settled_deg: float = 0.05
    """Most that the readback may change during an acquisition."""
    age_s: float = 5.0
    """Most time between the end of an acquisition and its admission."""
    saturated_limit: float = 0.05
    """Most channels at full scale in the marker's window, as a share of all; 1 admits any."""
    dead_limit: float = 0.05
    """Most channels without a signal, as a share of all; 1 admits any."""
    noise_ratio: float = 2.0
    """Most by which a frame may be noisier or quieter than the first lit or dark one of the run; inf admits any."""
    dark_alarm: float | None = None
    """Probability that noise alone makes a dark frame look like one with a source; None admits any dark frame."""
    repeats: bool = False
    """Whether the data may repeat the frame before, or be constant or 0: true for recordings only."""

    def __post_init__(self) -> None:
        if not 0 < self.settled_deg < 1:
            raise ConfigError(f"admission: settled_deg is {self.settled_deg} deg, it must lie between 0 and 1 deg")
        require_range("admission: age_s", self.age_s, low=0, high=60, unit="s", open_low=True)
        for name in ("saturated_limit", "dead_limit"):
            require_range(f"admission: {name}", getattr(self, name), low=0, high=1)
        require_range("admission: noise_ratio", self.noise_ratio, low=1, high=math.inf, open_low=True)
        if self.dark_alarm is not None:
            require_range("admission: dark_alarm", self.dark_alarm, low=0, high=0.01, open_low=True)

    def admit_frame(
        self, frame: Frame, *, permit: Permit, issued_s: float, now_s: float, previous: Frame | None
    ) -> None:
        """Refuse a frame that does not belong to this permit.

        Its header must carry the readback before and after. Times are on the rig's clock in seconds, `previous` is the
        frame before in this run. `AcquisitionError` if it carries another token, comes out of order, was not fired as
        permitted, was taken while moving or at another time, is of another shape, or holds old data.
        """
        header = frame.header
        if header.token != permit.token:
            raise AcquisitionError(f"stale frame: of {header.token!r}, not of {permit.token!r}; take it again")
        if previous is not None and not header.sequence > previous.header.sequence:
            raise AcquisitionError(f"frame {header.sequence} after {previous.header.sequence}: out of order; try again")
        pulses = permit.pulses_in_frame
        to_deg = permit.commanded_deg
        if header.pulses != pulses:
            raise AcquisitionError(f"{header.pulses} pulses were seen, {pulses} were permitted; check the laser")
        if header.commanded_deg != to_deg:
            raise AcquisitionError(f"the frame is of {header.commanded_deg} deg, not of {to_deg} deg; take it again")
        if header.angle_before_deg is None or header.angle_after_deg is None:
            raise AcquisitionError("the frame carries no readback of the angle; the scanner must add it")
        most_deg = max(self.settled_deg, permit.turned_deg)
        moved_deg = abs(header.angle_after_deg - header.angle_before_deg)
        if not moved_deg <= most_deg:
            why = f"the probe moved by {moved_deg:.3f} deg during the acquisition, the limit is {most_deg} deg"
            raise AcquisitionError(f"{why}; let it settle")
        if not issued_s <= header.started_s <= header.ended_s <= now_s <= header.ended_s + self.age_s:
            when = f"{header.started_s:.3f} to {header.ended_s:.3f} s, permitted at {issued_s:.3f} s, now {now_s:.3f} s"
            raise AcquisitionError(f"stale frame: taken {when}; the limit of age is {self.age_s} s; take it again")
        if previous is not None and _shape(frame) != _shape(previous):
            raise AcquisitionError(f"the frame is {_shape(frame)}, not {_shape(previous)}; was a setting changed?")
        if not self.repeats and _is_old(frame, previous):
            raise AcquisitionError("stale frame: its data are constant, 0, or those of the frame before; take it again")

    def admit_reading(self, reading: Reading, *, frame: Frame, usual_sigma: float | None) -> None:
        """Refuse a reading that cannot be a measurement; `usual_sigma` is the noise of the run's first of its kind.

        `AcquisitionError` if the intensity is not a finite number of at least 0, another feature is not finite, the
        noise has changed, or too many channels are dead; `SaturationError` if too many are saturated.
        """
        if not (is_finite(reading.intensity) and reading.intensity >= 0):
            raise AcquisitionError(f"intensity is {reading.intensity}: it must be finite and at least 0; take it again")
        if (name := not_finite(reading)) is not None:
            raise AcquisitionError(f"{name} is {getattr(reading, name)}, it must be finite; take it again")
        sigma = reading.noise_sigma
        if sigma is not None and usual_sigma and not 1 / self.noise_ratio <= sigma / usual_sigma <= self.noise_ratio:
            why = f"the noise is {sigma:.3g} and was {usual_sigma:.3g} at first in this run, by more than a factor of"
            raise AcquisitionError(f"{why} {self.noise_ratio:g}; take it again, and find what disturbs the receiver")
        saturated = reading.saturated_fraction
        if saturated is not None and not saturated <= self.saturated_limit:
            why = f"saturated: {saturated:.0%} of the channels are at full scale in the marker's window, the limit is"
            raise SaturationError(f"{why} {self.saturated_limit:.0%}; reduce the gain or the laser's energy")
        if isinstance(frame, ChannelFrame):
            dead = len(reading.dead_channels)
            channels = frame.samples.shape[0]
            if not dead <= self.dead_limit * channels:
                why = f"{dead} of {channels} channels are dead, the limit is {self.dead_limit:.0%}"
                raise AcquisitionError(f"{why}; check the probe's connector")

    def source_in_dark(self, reading: Reading) -> str | None:
        """Return the message that a dark frame holds a source; None if noise alone can explain it, or is not known.

        The largest of M cells of noise exceeds σ·sqrt(2·ln(M/p)) with probability p.
        """
        sigma = reading.noise_sigma
        cells = reading.cells
        if self.dark_alarm is None or not sigma or not cells:
            return None
        limit = sigma * math.sqrt(2 * math.log(cells / self.dark_alarm))
        why = f"the frame was taken without light, yet it holds a source of {reading.intensity:.4g}, while noise"
        cure = "it is of another acquisition, or light came: restart the data acquisition, and begin a new search"
        return None if reading.intensity <= limit else f"{why} alone reaches {limit:.4g}; {cure}"


def _shape(frame: Frame) -> str:
    """Return the text of what must not change within a run."""
    if isinstance(frame, ReadingFrame):
        return "a number"
    return f"of shape {frame.samples.shape} at {frame.sampling_hz:g} Hz"


def _is_old(frame: Frame, previous: Frame | None) -> bool:
    """Return whether the data are not new; `previous` is of the same kind and shape."""
    if isinstance(frame, ReadingFrame):
        return frame.intensity in (0, getattr(previous, "intensity", None))
    data = frame.samples.ravel()
    before = getattr(previous, "samples", None)
    return not np.any(data != data[:1]) or (before is not None and np.array_equal(data, before.ravel()))
