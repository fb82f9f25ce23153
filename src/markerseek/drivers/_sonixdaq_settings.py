"""Settings of a SonixDAQ: the keys of a rig file, and those that only the driver uses."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from markerseek.core import ConfigError, require_range


@dataclass(frozen=True, slots=True, kw_only=True)
class SonixDaqKeys:
    """Keys of a SonixDAQ in a rig file, without the folder."""

    sampling_hz: float = 40e6
    """Sampling frequency; the files do not hold it."""
    timeout_s: float = 60.0
    """Longest time from the trigger to the complete files; they take about 10 s (paper, section 4)."""
    stable_s: float = 0.2
    """Time for which complete files must stay unchanged before they are read."""
    readout_s: float = 12.0
    """Longest time from a trigger to the last file: a folder unchanged for that long is settled."""
    start_command: tuple[str, ...] | None = None
    """Program and arguments that prepare the device for a trigger; no shell is involved, and ``{frames}`` in them is
    replaced by the number of pulses to come. None: it is always ready."""
    start_timeout_s: float = 10.0
    """Longest duration of that command."""

    def __post_init__(self) -> None:
        for name, high, unit in (
            ("sampling_hz", 1e9, "Hz"),
            ("timeout_s", 600, "s"),
            ("readout_s", 600, "s"),
            ("start_timeout_s", 600, "s"),
        ):
            require_range(f"sonixdaq: {name}", getattr(self, name), low=0, high=high, unit=unit, open_low=True)
        if not 0 <= self.stable_s < self.timeout_s:
            raise ConfigError(f"sonixdaq: stable_s is {self.stable_s} s, it must lie in [0, {self.timeout_s:g}) s")
        if self.start_command is not None and not (self.start_command and self.start_command[0]):
            raise ConfigError("sonixdaq: start_command is empty; leave it out, or name a program and its arguments")


@dataclass(frozen=True, slots=True, kw_only=True)
class SonixDaqSettings(SonixDaqKeys):
    """Settings of the driver: the keys of a rig file, the folder, and the triggers of a dark frame."""

    folder: Path
    """Where its software writes the channel files, over those of the acquisition before."""
    dark_triggers: int = 16
    """Triggers of a dark acquisition, and so the pulses that it averages."""

    def __post_init__(self) -> None:
        # Without arguments, super() does not work in a dataclass with slots, which is made a second time.
        SonixDaqKeys.__post_init__(self)
        if self.dark_triggers < 1:
            raise ConfigError(f"sonixdaq: dark_triggers is {self.dark_triggers}, at least 1 is needed")
