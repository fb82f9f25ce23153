"""An assembled rig: its devices, its scanner and its facts; and the fingerprint, which is the same for equal rigs."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from types import TracebackType
from typing import Protocol, Self

import msgspec

from markerseek.core import Laser, Receiver, RigFacts, Stage
from markerseek.drivers import BenchSettings
from markerseek.guard import Limits
from markerseek.records.banks import FrameBank, IntensityBank
from markerseek.rigs.recipe import Recipe
from markerseek.scan import Scanner
from markerseek.signals import ImageReader
from markerseek.sim import SimulatedSettings


class Checkpointed(Protocol):
    """A world whose state can be kept and restored."""

    def checkpoint(self) -> bytes:
        """State now, as JSON."""

    def restore(self, checkpoint: bytes) -> None:
        """Restore a state."""


class Devices(Protocol):
    """The lines to real devices."""

    def arm(self) -> None:
        """Let commands through."""

    def close(self) -> None:
        """Release them; allowed twice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """Everything that a search needs.

    Attributes
    ----------
    facts
        What is known of it.
    stage, laser, receiver
        Its devices.
    scanner
        Measures with them.
    imaging
        Imaging chain of its channel data; None where there are intensities only.
    dark_frames
        Frames without laser that a search should begin with; 0 where it cannot take any.
    closing_dark
        Whether a search should end with a dark frame, as `markerseek.scan.run` says: on rigs of devices.
    distinct_angles
        Number of angles at which anything can be measured; None where it is any.
    recipe
        How to put the same rig together again; None where that cannot be said.
    world
        A simulated world, or a recording that is played back, whose state a journal keeps with each commit; None where
        the world is real.
    devices
        The lines to real devices; None where no hardware is involved.
    """

    facts: RigFacts
    stage: Stage
    laser: Laser
    receiver: Receiver
    scanner: Scanner
    imaging: ImageReader | None
    dark_frames: int
    distinct_angles: int | None = None
    closing_dark: bool = False
    recipe: Recipe | None = None
    world: Checkpointed | None = None
    devices: Devices | None = None

    def arm(self, *, by: str) -> None:
        """Allow it to move and fire, in the name of a person who stands beside it; a fault must be reset first."""
        self.scanner.guard.arm(by=by)
        if self.devices is not None:
            self.devices.arm()

    def close(self) -> None:
        """Release its devices; allowed twice."""
        if self.devices is not None:
            self.devices.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    @property
    def limits(self) -> Limits:
        """Where it may look, and where the probe may be."""
        return self.scanner.limits

    @property
    def simulated(self) -> bool:
        """Whether no hardware is involved."""
        return self.facts.kind == "simulated"


def with_probe(facts: RigFacts, imaging: ImageReader | None) -> RigFacts:
    """The facts, those of the probe taken from an imaging chain; unchanged where there are intensities only."""
    if imaging is None:
        return facts
    preset = imaging.preset
    return replace(
        facts,
        probe=preset.name,
        sampling_hz=preset.sampling_hz,
        sound_speed_m_s=preset.sound_speed_m_s,
        pitch_m=preset.array.pitch_m,
    )


def fingerprint(of: SimulatedSettings | BenchSettings | IntensityBank | FrameBank) -> str:
    """First half of the SHA-256 of the settings, or of what a recording says of itself, as JSON.

    Frames are not looked at. What is not known of a recording is left out, so that the fingerprint stays the same when
    more can be known of one.
    """
    plain: object = of
    if isinstance(of, IntensityBank | FrameBank):
        facts = msgspec.to_builtins(of.facts)
        known = {name: value for name, value in facts.items() if value is not None}
        plain = {"angles_deg": of.angles_deg, "intensities": of.intensities, "facts": known}
    return hashlib.sha256(msgspec.json.encode(plain)).hexdigest()[:32]
