"""The types of a bank: a scan of many angles with intensities or frames, the facts known of it, its order of time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import msgspec
import numpy as np
from msgspec import structs

from markerseek.core import (
    Bool,
    ChannelFrame,
    ConfigError,
    Float64,
    FrameHeader,
    Int64,
    Interval,
    RecordError,
    counted,
    needs_package,
)
from markerseek.records.notes import note

if TYPE_CHECKING:
    import xarray as xr

HDF5_SUFFIXES = (".hdf5", ".h5")
"""Suffixes of a bank in IPASC HDF5."""

MAX_DEG = 360.0
"""Largest angle of a bank to either side, in degrees."""

USUAL_SAMPLING_HZ = 40e6
"""Sampling frequency of the SonixDAQ in Hz, assumed where the file names none."""

MIN_ANGLES = 3
"""Fewest angles of a bank: with two there is no inner one, and so no peak that could be recognised."""

MIN_STEP_DEG = 1e-6
"""Least distance of two angles of a bank in degrees; a stage's encoder counts steps of 5e-4."""


class BankFacts(msgspec.Struct, frozen=True, kw_only=True):
    """Metadata of a bank; None if a value is not known."""

    description: str = ""
    """What was scanned and with which device, as text; empty if unknown."""
    probe: str | None = None
    """Name of the preset by which its frames were imaged."""
    probe_settings: str | None = None
    """Description of that preset as JSON, where it is one of the user's own."""
    sampling_hz: float | None = None
    first_sample_s: float | None = None
    """When the record begins, from the trigger, where that is later; what the frames hold before is filled in."""
    sound_speed_m_s: float | None = None
    pitch_m: float | None = None
    """Distance from one element to the next."""
    wavelength_m: float | None = None
    pulse_energy_j: float | None = None
    """Energy of one laser pulse."""
    face_radius_m: float | None = None
    """Distance of the array's face from the axis of rotation."""
    reference_angle_deg: float | None = None
    """Angle of the marker known from another measurement."""
    clock_zero_unix_s: float | None = None
    """When the clock of `Bank.started_s` read 0, in seconds since 1970."""
    simulated: bool | None = None
    """Whether the data were simulated."""
    configuration: str | None = None
    """Fingerprint of the rig that scanned it."""
    seed: int | None = None
    """Seed of a simulated rig."""
    made_with: str | None = None
    """Program that scanned or imported it, with its version."""


NUMERIC_FACTS = (
    "sampling_hz", "sound_speed_m_s", "pitch_m", "wavelength_m", "pulse_energy_j", "face_radius_m",
    "reference_angle_deg", "clock_zero_unix_s",
)  # fmt: skip
"""Facts that a file of another make may hold, each as one number."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bank:
    """A scan of many angles."""

    angles_deg: tuple[float, ...]
    """Angles, rising; at least 3."""
    facts: BankFacts = field(default_factory=BankFacts)
    intensities: tuple[float, ...] = field(repr=False, default=())
    """Peak of the photoacoustic image at each angle, NaN where it is not known; empty if none is."""
    started_s: tuple[float, ...] = field(repr=False, default=())
    """When the acquisition at each angle began, in seconds on a clock that read 0 at `BankFacts.clock_zero_unix_s`; NaN
    where it is not known, empty if none is."""
    dark_frames: int = 0
    """Number of frames that were taken without laser; none of intensities."""
    notes: tuple[str, ...] = field(repr=False, compare=False, default=())
    """Sentences on what was assumed, changed or left out when it was read."""

    def to_xarray(self) -> xr.Dataset:
        """Return the bank as a data set of xarray: ``intensity`` over ``angle_deg`` where it is known, and the facts.

        One of frames holds them too, read into memory: ``frames`` (``angle_deg``, ``channel``, ``time_s``).
        """
        with needs_package("xarray", extra="notebook", purpose="a data set"):
            import xarray as xr
        held = {"intensity": ("angle_deg", np.array(self.intensities))} if self.intensities else {}
        known = {name: value for name, value in structs.asdict(self.facts).items() if value is not None}
        return xr.Dataset(held, coords={"angle_deg": np.array(self.angles_deg)}, attrs=known)

    @property
    def range(self) -> Interval:
        """From the first angle to the last."""
        return Interval(low_deg=self.angles_deg[0], high_deg=self.angles_deg[-1])


@dataclass(frozen=True, slots=True, kw_only=True)
class IntensityBank(Bank):
    """One intensity for each angle."""

    intensities: tuple[float, ...] = field(repr=False)
    """Peak of the photoacoustic image at each angle."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameBank(Bank, ABC):
    """One frame of channel data for each angle, read from disk on demand."""

    pulses: tuple[int, ...] = field(repr=False, default=())
    """Laser pulses averaged at each angle; empty if it is not known."""
    energies: tuple[float, ...] = field(repr=False, default=())
    """Energy of the pulses at each angle over the usual one, NaN where it was not measured; empty if none is."""
    left_out: tuple[int, ...] = ()
    """Channels that are left out, counted from 0: their samples are 0."""

    def to_xarray(self) -> xr.Dataset:
        """Return the data set of `Bank.to_xarray`, with the frames."""
        frames = [self.frame(index) for index in range(len(self.angles_deg))]
        shapes = {frame.samples.shape for frame in frames}
        if len(shapes) > 1:
            raise RecordError(f"the frames have several shapes, {sorted(shapes)}: one array cannot hold them")
        times_s = np.arange(frames[0].samples.shape[1]) / frames[0].sampling_hz
        samples = ("angle_deg", "channel", "time_s"), np.stack([frame.samples for frame in frames])
        return Bank.to_xarray(self).assign(frames=samples).assign_coords(time_s=times_s)

    @abstractmethod
    def frame(self, index: int) -> ChannelFrame:
        """Return the channel data of one angle, counted from 0 at the lowest.

        `RecordError` where they cannot be read.
        """

    def dark_frame(self, index: int) -> ChannelFrame:
        """Return one frame without laser, counted from 0; `RecordError` where it cannot be read."""
        raise RecordError(f"there is no dark frame {index + 1}, it holds {self.dark_frames or 'none'}")

    def header(self, index: int, *, token: str, row: int) -> FrameHeader:
        """Return the header of the frame at one angle; ``row``: place of the frame in its file, from 0."""
        energy = self.energies[index] if self.energies else math.nan
        # NaN says that no time is known, where 0 would be a time.
        started_s = self.started_s[index] if self.started_s else math.nan
        return FrameHeader(
            sequence=row + 1,
            token=token,
            pulses=self.pulses[index],
            commanded_deg=self.angles_deg[index],
            started_s=started_s,
            ended_s=started_s,
            energy=None if math.isnan(energy) else energy,
        )


def without_channels(
    bank: IntensityBank | FrameBank, path: Path, channels: tuple[int, ...]
) -> IntensityBank | FrameBank:
    """Return the bank with zeros in some channels, counted from 1; `ConfigError` where there is no such channel."""
    if not channels:
        return bank
    if isinstance(bank, IntensityBank):
        raise ConfigError(f"{path}: `without_channels` is for frames, and it holds intensities; leave it out")
    chosen = np.flatnonzero(chosen_channels(path, channels, count=len(bank.frame(0).samples)))
    # What the frames without these channels show is computed again.
    return replace(bank, left_out=tuple(sorted({*bank.left_out, *chosen.tolist()})), intensities=())


def chosen_channels(path: Path, channels: Sequence[int], *, count: int) -> Bool[np.ndarray, " channels"]:
    """Return which channels of a frame are named, counted from 1; `ConfigError` where there is no such channel."""
    for channel in channels:
        if not 1 <= channel <= count:
            raise ConfigError(f"{path}: `without_channels` is {channel}, the channels are 1 to {count}")
    return np.isin(np.arange(1, count + 1), channels)


def record_of(path: Path) -> Path:
    """Return the journal beside a bank, in which a scan is kept until the bank is made of it."""
    return path.with_name(f"{path.name}.journal")


def unwrapped(path: Path, angles_deg: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
    """Return the angles without the jump of a scan that crosses 360 or ±180 degrees; a note says what was changed.

    The circle is cut at its largest gap, if that is more than twice as wide as every other gap, so that at least two
    steps are missing there. A scan of the full circle has no such gap, and keeps its angles.

    ``angles_deg``: in any order; they come back in the same order.
    """
    rising = np.unique(angles_deg[np.isfinite(angles_deg)])
    if rising.size < MIN_ANGLES or np.abs(rising).max() > MAX_DEG:
        return angles_deg
    gaps = np.diff(rising, append=rising[0] + MAX_DEG)
    cut = int(gaps.argmax())
    inner = cut < rising.size - 1 and gaps[-1] >= 0
    if not inner or gaps[cut] <= 2 * np.sort(gaps)[-2]:
        if gaps[-1] <= np.diff(rising).max() + MIN_STEP_DEG:
            note(
                path,
                f"the angles cover the full circle, and a marker near {rising[0]:g} or {rising[-1]:g} deg is "
                "seen at both ends; if it is there, leave out angles on the other side, so that a gap remains",
            )
        return angles_deg
    last_deg = rising[cut]
    first_deg = rising[cut + 1]
    # Of the two ranges, a turn apart, the one that is nearer to 0.
    lower = first_deg + last_deg - MAX_DEG > -MAX_DEG
    turn_deg, moved = (-MAX_DEG, angles_deg >= first_deg) if lower else (MAX_DEG, angles_deg <= last_deg)
    # Rounded, because 359.9 - 360 has more digits than 359.9.
    turned = np.where(moved, np.round(angles_deg + turn_deg, 9), angles_deg)
    old = angles_deg[moved]
    new = turned[moved]
    note(
        path,
        f"the angles jump by a full turn, so that {old.min():g} to {old.max():g} deg are read as "
        f"{new.min():g} to {new.max():g} deg; it runs from {np.nanmin(turned):g} to {np.nanmax(turned):g} deg, and "
        "all angles of the answer count so",
    )
    return turned


def silenced(samples: np.ndarray, left_out: Sequence[int]) -> np.ndarray:
    """Return the samples of (…, channels, samples) with zeros in the channels that are left out, counted from 0."""
    chosen = np.isin(np.arange(samples.shape[-2]), left_out)
    return np.where(chosen[:, None], samples.dtype.type(0), samples) if chosen.any() else samples


def first_of(names: Sequence[str]) -> str:
    """Return the first names of many, for a message."""
    return ", ".join(names[:5]) + (" …" if len(names) > 5 else "")


def in_rising_order(
    path: Path, angles_deg: Float64[np.ndarray, " n"]
) -> tuple[tuple[float, ...], Int64[np.ndarray, " n"]]:
    """Return the angles that a search can use in rising order, with the former place of each."""
    turned = unwrapped(path, angles_deg)
    order = np.argsort(turned, kind="stable")
    angles = tuple(turned[order].tolist())
    require_angles(path, angles)
    return angles, order


def require_angles(path: Path, angles_deg: Sequence[float]) -> None:
    """Refuse angles that a search cannot use.

    ``path``: the bank, for the message. ``angles_deg``: its angles, in rising order.
    """
    for angle_deg in angles_deg:
        # Written so that NaN fails the test, too.
        if not abs(angle_deg) <= MAX_DEG:
            raise RecordError(
                f"{path}: an angle is {angle_deg:g} deg, it must be finite and within one turn, -{MAX_DEG:g} to "
                f"{MAX_DEG:g} deg; leave it out, take a full turn off all angles, or write them in degrees "
                "(of a table or arrays: `unit`, or `deg_per_unit`)"
            )
    for low_deg, high_deg in pairwise(angles_deg):
        if high_deg - low_deg < MIN_STEP_DEG:
            raise RecordError(
                f"{path}: the angle {low_deg:g} deg appears twice, or nearer than {MIN_STEP_DEG:g} deg; average "
                "repeated angles"
            )
    if len(angles_deg) < MIN_ANGLES:
        raise RecordError(
            f"{path}: it holds {counted(len(angles_deg), 'angle')}, at least {MIN_ANGLES} are needed for a search"
        )


TimeSource: TypeAlias = Literal["unix", "rig", "none"]
"""What times were read from."""

TIMES: dict[TimeSource, str] = {
    "unix": "seconds since 1970-01-01 00:00 UTC",
    "rig": "seconds on the clock of the rig",
    "none": "not known: the acquisitions are numbered in the order of their angles, one to a second",
}
"""What times mean, in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """Acquisitions in the order of the export."""

    angles_deg: tuple[float, ...]
    """Angle of the probe at each."""
    times_s: tuple[float, ...]
    """When each began, rising."""
    clock: TimeSource
    """What the times were read from; ``none``: 0, 1, 2 and so on."""
    order: tuple[int, ...]
    """Number of each in the bank, counted from 0."""
    facts: BankFacts

    @property
    def known(self) -> dict[str, str | float | bool]:
        """Facts by name, units in the names; what is not known is left out."""
        facts = {
            name: each for name, each in structs.asdict(self.facts).items() if each is not None and str(each).strip()
        }
        return facts | {"times": TIMES[self.clock]}


def series_of(bank: IntensityBank | FrameBank, *, facts: BankFacts | None = None) -> Series:
    """Return the acquisitions of a bank in the order of time, or of the angles where no times are known.

    Times are used if each acquisition has one and they differ within six digits, counted from the first: SlicerIGSIO
    compares times with that precision, and would merge acquisitions with equal ones.

    ``facts``: what is known of it, where that is more than it holds.
    """
    times, clock = _times(bank)
    order = tuple(sorted(range(len(times)), key=times.__getitem__))
    return Series(
        angles_deg=tuple(bank.angles_deg[index] for index in order),
        times_s=tuple(times[index] for index in order),
        clock=clock,
        order=order,
        facts=bank.facts if facts is None else facts,
    )


def _times(bank: IntensityBank | FrameBank) -> tuple[tuple[float, ...], TimeSource]:
    count = len(bank.angles_deg)
    started_s = bank.started_s
    first_s = min(started_s, default=0.0)
    different = len({f"{each - first_s:g}" for each in started_s}) == len(started_s) == count
    if not different or not all(0 <= each < math.inf for each in started_s):
        return tuple(map(float, range(count))), "none"
    zero_s = bank.facts.clock_zero_unix_s
    return (started_s, "rig") if zero_s is None else (tuple(zero_s + each for each in started_s), "unix")
