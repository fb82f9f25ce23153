"""Settings of a receiver behind a PLUS server: the keys of a rig file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from markerseek.core import ConfigError, require_range
from markerseek.drivers._receivers import require_noise_ratio


@dataclass(frozen=True, slots=True, kw_only=True)
class PlusSettings:
    """A PLUS server that sends one int16 IMAGE of channels x samples for each trigger."""

    device: str
    """Name of the images, as the server sends them: "RfVideo_Reference"."""
    driver: Literal["plus"] = "plus"
    """Driver of the data acquisition."""
    host: str = "127.0.0.1"
    port: int = 18944
    """``host`` and ``port``: where the server is."""
    sampling_hz: float = 40e6
    """Sampling frequency; the messages do not hold it."""
    connect_s: float = 5.0
    """Longest time until it answers."""
    timeout_s: float = 20.0
    """Longest time from the trigger to the last image."""
    quiet_s: float = 0.2
    """Time without an image that is waited for before a trigger and after the last image."""
    clock_s: float = 0.05
    """Largest difference between the server's clock and this computer's: images that are older than the trigger by more
    are refused."""
    noise_ratio: float = 2.0
    """As of the other receivers."""

    def __post_init__(self) -> None:
        if not (self.device.isascii() and 0 < len(self.device) <= 20):
            raise ConfigError(f"receiver: device is {self.device!r}, it must have 1 to 20 characters of ASCII")
        require_range("receiver: port", self.port, low=1, high=65535)
        require_range("receiver: sampling_hz", self.sampling_hz, low=0, high=1e9, unit="Hz", open_low=True)
        for name, high in (("connect_s", 600), ("timeout_s", 600), ("quiet_s", 60)):
            require_range(f"receiver: {name}", getattr(self, name), low=0, high=high, unit="s", open_low=True)
        require_range("receiver: clock_s", self.clock_s, low=0, high=60, unit="s")
        require_noise_ratio(self.noise_ratio)
