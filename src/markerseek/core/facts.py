"""Facts about a rig, or about the recording that it plays back; its devices are elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from markerseek.core.checks import is_finite
from markerseek.core.errors import ConfigError
from markerseek.core.interval import Interval

RigKind: TypeAlias = Literal["simulated", "replayed", "bench"]
"""Whether a rig is simulated, plays back a recording, or is one of devices."""


def rig_in_words(kind: str, emulated: Sequence[str]) -> str:
    """The kind of rig for people, emulated devices named: "bench rig with emulated stage and laser"."""
    return f"{kind} rig" + (f" with emulated {' and '.join(emulated)}" if emulated else "")


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFacts:
    """Facts about a rig, which journals, banks and results store.

    Attributes
    ----------
    kind
        See `RigKind`.
    description
        Description for people.
    fingerprint
        Hash of its settings, or of the recording: equal for equal rigs.
    search
        Angles that may be searched.
    face_radius_m
        Distance of the array's face from the axis of rotation in metres; None where it is not known.
    truth_deg
        True angle of the marker in a simulation, in degrees; None where it is not known.
    reference_deg
        Angle of the marker from another measurement, in degrees, for comparison; None without one.
    seed
        Seed of a simulation; None of any other rig.
    probe
        Name of the preset of the imaging chain; None, as the next four, where there are intensities only.
    probe_settings
        Description of the imaging chain's probe as JSON where it is one of the user's own; None for a preset of ours.
    sampling_hz
        Sampling frequency in Hz.
    sound_speed_m_s
        Speed of sound that the imaging assumes, in m/s.
    pitch_m
        Distance from one element of the array to the next, in metres.
    emulated
        Devices of a bench that say of themselves that they are emulators: "stage", "laser".

    Raises
    ------
    ConfigError
        If an angle is not finite.
    """

    kind: RigKind
    description: str
    fingerprint: str
    search: Interval
    face_radius_m: float | None = None
    # Left out of repr: whoever prints a rig would know the answer before the search.
    truth_deg: float | None = field(default=None, repr=False)
    reference_deg: float | None = None
    seed: int | None = None
    probe: str | None = None
    probe_settings: str | None = None
    sampling_hz: float | None = None
    sound_speed_m_s: float | None = None
    pitch_m: float | None = None
    emulated: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("truth_deg", "reference_deg"):
            angle_deg = getattr(self, name)
            if angle_deg is not None and not is_finite(angle_deg):
                raise ConfigError(f"{name} is {angle_deg} deg, it must be a finite number")

    @property
    def rig_name(self) -> str:
        """As of `rig_in_words`."""
        return rig_in_words(self.kind, self.emulated)

    @property
    def known_deg(self) -> float | None:
        """Angle of the marker in degrees, true in a simulation, else the reference; None if neither is known."""
        return self.reference_deg if self.truth_deg is None else self.truth_deg
