"""What an assembled rig is, and the fingerprint by which equal ones are known."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Literal

import msgspec

from markerseek.core import Laser, Receiver, Stage
from markerseek.guard import Limits
from markerseek.records.banks import FrameBank, IntensityBank
from markerseek.scan import Scanner
from markerseek.signals import ImageReader
from markerseek.sim import SimulatedSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """Everything that a search needs.

    Attributes
    ----------
    kind
        Whether it is simulated or replays a recording.
    description
        What it is, in words.
    stage, laser, receiver
        Its devices.
    scanner
        Measures with them.
    imaging
        Imaging chain of its channel data; None where there are intensities only.
    dark_frames
        Frames without laser that a search should begin with; 0 where it cannot take any.
    face_radius_m
        Distance of the array's face from the axis of rotation in metres; None where it is not known.
    truth_deg
        Angle of the marker in degrees in a simulation; None where nobody knows it.
    configuration
        Fingerprint of the settings, or of the recording: the same for equal rigs.
    reference_deg
        Angle that was found otherwise, in degrees, to be compared with; None without one.
    distinct_angles
        Number of angles at which anything can be measured; None where it is any.
    """

    kind: Literal["simulated", "replayed"]
    description: str
    stage: Stage
    laser: Laser
    receiver: Receiver
    scanner: Scanner
    imaging: ImageReader | None
    dark_frames: int
    face_radius_m: float | None
    truth_deg: float | None
    configuration: str
    reference_deg: float | None = None
    distinct_angles: int | None = None

    @property
    def limits(self) -> Limits:
        """Where it may look, and where the probe may be."""
        return self.scanner.limits

    @property
    def simulated(self) -> bool:
        """Whether no hardware is involved."""
        return self.kind == "simulated"


def fingerprint(of: SimulatedSettings | IntensityBank | FrameBank) -> str:
    """First half of the SHA-256 of the settings or the recording, as JSON."""
    plain = msgspec.json.encode(of, enc_hook=str)
    return hashlib.sha256(plain).hexdigest()[:32]
