"""The types of a bank: a scan of many angles with intensities or frames, and the facts known of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from markerseek.core import ChannelFrame, Interval, RecordError

HDF5_SUFFIXES = (".hdf5", ".h5")
"""Suffixes of a bank in IPASC HDF5."""

MOST_DEG = 360.0
"""Largest angle of a bank to either side, in degrees."""

LEAST_STEP_DEG = 1e-6
"""Least distance of two angles of a bank in degrees; a stage's encoder counts steps of 5e-4."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BankFacts:
    """Metadata of a bank; None where a value is not known.

    Attributes
    ----------
    description
        What was scanned and with which device, as text; empty if unknown.
    probe
        Name of the preset by which its frames were imaged.
    probe_settings
        Description of that preset as JSON, where it is one of the user's own.
    sampling_hz
        Sampling frequency in Hz.
    sound_speed_m_s
        Speed of sound in m/s.
    pitch_m
        Distance from one element to the next, in metres.
    wavelength_m
        Wavelength of the laser in metres.
    pulse_energy_j
        Energy of one laser pulse in joules.
    face_radius_m
        Distance of the array's face from the axis of rotation in metres.
    reference_angle_deg
        Angle of the marker known from another measurement, in degrees.
    clock_zero_unix_s
        When the clock of `FrameBank.started_s` read 0, in seconds since 1970.
    simulated
        Whether the data were simulated.
    configuration
        Fingerprint of the rig that scanned it.
    seed
        Seed of a simulated rig.
    made_with
        Program that scanned or imported it, with its version.
    """

    description: str = ""
    probe: str | None = None
    probe_settings: str | None = None
    sampling_hz: float | None = None
    sound_speed_m_s: float | None = None
    pitch_m: float | None = None
    wavelength_m: float | None = None
    pulse_energy_j: float | None = None
    face_radius_m: float | None = None
    reference_angle_deg: float | None = None
    clock_zero_unix_s: float | None = None
    simulated: bool | None = None
    configuration: str | None = None
    seed: int | None = None
    made_with: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Bank:
    """A scan of many angles.

    Attributes
    ----------
    angles_deg
        Angles in degrees, rising; at least 3.
    facts
        What else is known.
    """

    angles_deg: tuple[float, ...]
    facts: BankFacts = field(default_factory=BankFacts)

    @property
    def range(self) -> Interval:
        """From the first angle to the last."""
        return Interval(low_deg=self.angles_deg[0], high_deg=self.angles_deg[-1])

    @property
    def planned(self) -> int:
        """Number of angles planned; more than there are if the scan was cut short."""
        return len(self.angles_deg)


@dataclass(frozen=True, slots=True, kw_only=True)
class IntensityBank(Bank):
    """One intensity for each angle.

    Attributes
    ----------
    intensities
        Peak of the photoacoustic image at each angle.
    """

    intensities: tuple[float, ...] = field(repr=False)

    @property
    def dark_frames(self) -> int:
        """Number of frames that were taken without laser: none, as there are no frames."""
        return 0


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameBank(Bank, ABC):
    """One frame of channel data for each angle, read from disk on demand.

    Attributes
    ----------
    intensities
        Peak of the photoacoustic image at each angle, NaN where it is not known; empty where none is.
    dark_frames
        Number of frames that were taken without laser.
    started_s
        When the acquisition at each angle began, in seconds on a clock that read 0 at `BankFacts.clock_zero_unix_s`;
        NaN where it is not known, empty where none is.
    pulses
        Laser pulses averaged at each angle; empty where it is not known.
    """

    intensities: tuple[float, ...] = field(repr=False, default=())
    dark_frames: int = 0
    started_s: tuple[float, ...] = field(repr=False, default=())
    pulses: tuple[int, ...] = field(repr=False, default=())

    @abstractmethod
    def frame(self, index: int) -> ChannelFrame:
        """Channel data of one angle, counted from 0 at the lowest; `RecordError` where they cannot be read."""

    @abstractmethod
    def dark_frame(self, index: int) -> ChannelFrame:
        """One frame without laser, counted from 0; `RecordError` where it cannot be read."""


def require_angles(path: Path, angles_deg: Sequence[float]) -> None:
    """Refuse angles that a search cannot use.

    Parameters
    ----------
    path
        The bank, for the message.
    angles_deg
        Its angles in degrees, in rising order.

    Raises
    ------
    RecordError
        If there are fewer than 3, one is not finite or more than one turn from zero, or one does not lie above the
        one before by at least `LEAST_STEP_DEG`.
    """
    for angle_deg in angles_deg:
        # Written so that NaN fails the test, too.
        if not abs(angle_deg) <= MOST_DEG:
            raise RecordError(
                f"{path}: an angle is {angle_deg:g} deg, it must be finite and within one turn, -{MOST_DEG:g} to "
                f"{MOST_DEG:g} deg; leave it out, or write it in degrees (a CSV: --unit mrad or rad)"
            )
    for low_deg, high_deg in pairwise(angles_deg):
        if low_deg == high_deg:
            raise RecordError(f"{path}: the angle {low_deg:g} deg appears twice; average repeated angles")
        if low_deg < high_deg < low_deg + LEAST_STEP_DEG:
            raise RecordError(
                f"{path}: the angles {low_deg!r} and {high_deg!r} deg are nearer to one another than "
                f"{LEAST_STEP_DEG:g} deg; average repeated angles"
            )
        if not low_deg < high_deg:
            raise RecordError(f"{path}: the angle {high_deg:g} deg follows {low_deg:g} deg; sort them in rising order")
    # With two angles there is no inner one, and so no peak that could be recognised.
    if len(angles_deg) < 3:
        raise RecordError(f"{path}: it holds {len(angles_deg)} angles, at least 3 are needed for a search")
