"""Reverberation: repeats of an absorber's arrival behind itself."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.acoustics._checks import positive
from markerseek.core import ConfigError, require_range


@dataclass(frozen=True, slots=True, kw_only=True)
class Reverberation:
    """Repeats of every arrival, as between the probe's face and a layer in front of it."""

    delay_s: float
    """Time from one repeat to the next: twice the layer's thickness over the speed of sound."""
    gain: float = 0.1
    """Amplitude of a repeat over that of the one before it, −1 to 1; negative turns each over."""
    repeats: int = 2

    def __post_init__(self) -> None:
        positive(self.delay_s, name="reverberation: delay_s", unit="s", cure="1 to 20 µs are usual")
        require_range("reverberation: gain", self.gain, low=-1.0, high=1.0, cure="0.05 to 0.3 are usual")
        if self.repeats < 1:
            raise ConfigError(
                f"reverberation: repeats is {self.repeats}, it must be at least 1; leave the reverberation out for none"
            )
