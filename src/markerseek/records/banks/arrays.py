"""Reads banks from arrays of NumPy or MATLAB: angles with intensities, or with frames of channel data.

``.npz`` and ``.mat`` hold variables by name: ``angle_deg`` (or ``angle_mrad``, ``angle_rad``); ``intensity`` or
``frames`` (angles × channels × samples, counts, or floating-point numbers, which are scaled); and optionally the facts
`NUMERIC_FACTS`, ``first_sample_s`` (when the first sample was taken, from the trigger), and of each angle ``pulses``,
``energy`` and ``started_s``. A `TableFormat` names others. ``.npy`` holds two columns, angle and
intensity, or intensities or frames alone. The frames of a Verasonics workspace, of a file of zea, and of other HDF5
files come with the same names. The frames of a Vantage are a ring, which is put into the order of the scan.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
from msgspec.structs import replace

from markerseek.core import Bool, ChannelFrame, ConfigError, Float64, Int16, RecordError
from markerseek.files import DEGREES, as_read_error, unit_in
from markerseek.records.banks.bank import (
    NUMERIC_FACTS,
    USUAL_SAMPLING_HZ,
    BankFacts,
    FrameBank,
    IntensityBank,
)
from markerseek.records.banks.foreign_frames import (
    as_counts,
    loudness,
    scaling_of,
    turned,
    unpadded,
    without_channels_of,
)
from markerseek.records.banks.iq import CARRIERS, carrier_of, envelope_peaks, is_paired, paired, radio_frequency
from markerseek.records.banks.repeats import Merged, merged
from markerseek.records.banks.scan_order import filled, in_scan_order
from markerseek.records.banks.table import amplitudes, decibels, warn_skipped
from markerseek.records.banks.table_angles import angles_in_degrees, stated_deg
from markerseek.records.banks.table_format import AXES, DEFAULT_FORMAT, TableFormat
from markerseek.records.named_arrays import NamedArrays, arrays_in, content
from markerseek.records.notes import note
from markerseek.records.vantage import NUMBERS

LATEST_FIRST_S = 200e-6
"""Latest first sample of a record after the trigger in seconds: no sound of these frequencies comes from deeper."""

_LARGEST_BYTES = 1 << 33
_ANGLES = ("angle_deg", "angles_deg", "trus_angle_deg", "angle_mrad", "angle_rad", "angle")
_INTENSITIES = ("intensity", "intensities", "intensity_db", "intensities_db")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArrayBank(FrameBank):
    """Frames in memory."""

    path: Path
    samples: Int16[np.ndarray, "angles channels samples"] = field(repr=False)
    """ADC counts."""

    def frame(self, index: int) -> ChannelFrame:
        """Return the channel data of one angle."""
        header = self.header(index, token=self.path.name, row=index)
        sampling_hz = self.facts.sampling_hz or USUAL_SAMPLING_HZ
        return ChannelFrame(header=header, samples=self.samples[index], sampling_hz=sampling_hz)


def read_arrays(path: Path, table: TableFormat = DEFAULT_FORMAT, *, blanked: int = 0) -> IntensityBank | ArrayBank:
    """Return the bank in an ``.npy``, ``.npz`` or ``.mat``; ``table`` and ``blanked`` as of `read_bank`."""
    with as_read_error(path):
        arrays = arrays_in(path, most_bytes=_LARGEST_BYTES)
    return bank_of_arrays(path, arrays, table, ordered=NUMBERS in arrays, blanked=blanked)


def bank_of_arrays(
    path: Path, found: Mapping[str, np.ndarray], table: TableFormat, *, ordered: bool, blanked: int
) -> IntensityBank | ArrayBank:
    """Return the bank of arrays by their names, as `read_arrays`.

    ``path``: where they are from. ``ordered``: whether their format says that the axes have the order of `AXES`.
    """
    held = content(found)
    if ordered and table.axes is not None:
        raise ConfigError(f"{path}: the axes of this format are known; leave `axes` out")
    units = found.units if isinstance(found, NamedArrays) else {}
    arrays = _named(path, dict(found))
    # Units that the file states count as those in a name.
    titles = {name: f"{name} [{units[name]}]" if name in units else name for name in arrays}
    angle, value = _picked(path, arrays, table, titles=titles, held=held)
    if value is None:
        raise RecordError(
            f"{path}: intensity or frames expected, it holds {held}; name its variables, `columns=ANGLE,INTENSITY` or "
            "ANGLE,FRAMES, or the one without angles, `columns=INTENSITY` with `first_and_step_deg`"
        )
    if angle is None and not table.states_angles:
        raise RecordError(
            f"{path}: angle_deg is missing, it holds {held}; state the first angle and the step, "
            "`first_and_step_deg=(-35, 0.5)`, or a file of angles, `angles_deg`, or name its variables, "
            "`columns=ANGLE,INTENSITY` or ANGLE,FRAMES"
        )
    listed = arrays[angle].ravel() if angle is not None else np.array(table.angles_deg or ())
    counted = listed.size or None
    arrays = in_scan_order(path, arrays, value, angles=listed if counted else None, first_frame=table.first_frame)
    values = paired(arrays[value])
    frames = value == "frames" or values.ndim == len(AXES)
    if frames:
        values = turned(path, values, AXES if ordered else table.axes, angles=counted)
    elif table.axes is not None or table.without_channels:
        option = "--axes" if table.axes is not None else "--without-channel"
        raise RecordError(f"{path}: {option} is for frames, it holds {held}; leave it out")
    count = len(values) if frames else values.size
    degrees = _degrees(path, arrays, angle, table, count, titles=titles)
    _require_units(path, units, arrays, frames=value if frames else None)
    facts = msgspec.convert({name: _scalar(path, arrays, name) for name in NUMERIC_FACTS}, BankFacts)
    if frames and not ordered and facts.sampling_hz is None:
        _note_unread(path, arrays)
    # Only now: a frame that was lost has its place in the scan.
    held_by = filled(path, values, arrays.get(NUMBERS, np.arange(1, count + 1))) if frames else True
    if frames:
        values, padding = unpadded(values)
        if padding:
            note(path, padding)
        values = without_channels_of(path, values, table.without_channels)
        values, sampling_hz = _of_iq(path, arrays, values, facts.sampling_hz, ordered=ordered)
        facts = replace(facts, sampling_hz=sampling_hz)
        frames = values.ndim == len(AXES)
    values = values if frames else _intensities(path, values, degrees.size)
    kept = _valid(path, degrees, values, table) & held_by
    scan = _Scan(path=path, degrees=degrees[kept], values=values[kept], kept=kept, arrays=arrays, facts=facts)
    return scan.frames(blanked) if frames else scan.intensities(db=decibels(table.db, titles[value]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Scan:
    """What was read of each acquisition, in the order of the file."""

    path: Path
    degrees: Float64[np.ndarray, " n"]
    values: np.ndarray
    """Intensities, or frames (n, channels, samples)."""
    kept: Bool[np.ndarray, " all"]
    """Which acquisitions of the file these are."""
    arrays: Mapping[str, np.ndarray]
    facts: BankFacts

    def intensities(self, *, db: bool) -> IntensityBank:
        """Return them as a bank, over the energies of their pulses."""
        energies = self._energies()
        read = amplitudes(self.values, db=db, where=lambda index: f"{self.path}, angle {self.degrees[index]:g} deg")
        read = read if energies is None else read / np.where(np.isnan(energies), 1.0, energies)
        scan = merged(self.path, self.degrees, lambda: read)
        return IntensityBank(
            angles_deg=scan.angles_deg,
            intensities=tuple(scan.mean(read).tolist()),
            facts=self.facts,
            started_s=self._started_s(scan),
        )

    def frames(self, blanked: int) -> ArrayBank:
        """Return them as a bank; ``blanked``: as of `read_bank`."""
        path = self.path
        sampling_hz = self.facts.sampling_hz
        before = _samples_before(path, self.arrays, sampling_hz, samples=self.values.shape[2])
        blanked = max(0, blanked - before)
        scan = merged(path, self.degrees, lambda: np.array([loudness(each, blanked) for each in self.values]))
        values = scan.mean(self.values)
        # One scale for all angles, or their intensities could not be compared.
        scaling = scaling_of(path, values, blanked=blanked)
        energies = self._energies()
        pulses = _pulses(path, self.arrays, self.kept.size)[self.kept]
        return ArrayBank(
            path=path,
            angles_deg=scan.angles_deg,
            samples=np.stack([_from_trigger(as_counts(path, each, scaling), before) for each in values]),
            facts=replace(self.facts, first_sample_s=max(0, before) / (sampling_hz or USUAL_SAMPLING_HZ) or None),
            pulses=tuple(scan.total(pulses).tolist()),
            energies=() if energies is None else tuple(scan.mean(energies).tolist()),
            started_s=self._started_s(scan),
        )

    def _started_s(self, scan: Merged) -> tuple[float, ...]:
        started_s = self.arrays.get("started_s")
        return () if started_s is None else tuple(scan.mean(started_s[self.kept]).tolist())

    def _energies(self) -> Float64[np.ndarray, " n"] | None:
        return _energies(self.path, self.arrays, self.kept)


def _of_iq(
    path: Path, arrays: Mapping[str, np.ndarray], frames: np.ndarray, sampling_hz: float | None, *, ordered: bool
) -> tuple[np.ndarray, float | None]:
    """Return the IQ data as frames of radio frequency with their sampling frequency, or intensities.

    Other frames as they are.
    """
    carrier_hz = carrier_of(path, arrays, frames, ordered=ordered)
    if frames.dtype.kind != "c":
        return frames, sampling_hz
    if carrier_hz is None:
        # The sampling frequency of no image.
        return envelope_peaks(path, frames), None
    return radio_frequency(path, frames, carrier_hz=carrier_hz, sampling_hz=sampling_hz)


def _named(path: Path, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arrays by name.

    An ``.npy`` of two columns is angles and intensities, one of an axis intensities, else frames.
    """
    if list(arrays) != [""]:
        return arrays
    array = arrays[""]
    if array.ndim == 1:
        return {"intensity": array}
    if array.ndim != 2:
        return {"frames": array}
    if array.shape[1] != 2:
        turned = "is it transposed? Save array.T" if array.shape[0] == 2 else "one frame is for `load_frame()`"
        raise RecordError(
            f"{path}: {array.dtype} of shape {array.shape}; two columns, angle and intensity, or frames of shape "
            f"({', '.join(AXES)}) are expected; {turned}"
        )
    # No name says that they are degrees.
    return {"angle": array[:, 0], "intensity": array[:, 1]}


def _picked(
    path: Path, arrays: Mapping[str, np.ndarray], table: TableFormat, *, titles: Mapping[str, str], held: str
) -> tuple[str | None, str | None]:
    """Return the names of the angles, and of the intensities or frames; None if there are none."""
    if table.columns is not None:
        missing = [name for name in table.columns if name and name not in arrays]
        if missing:
            raise RecordError(f"{path}: there is no variable {missing[0]}, it holds {held}")
        return table.columns[0] or None, table.columns[1]
    angle = next((name for name in _ANGLES if name in arrays), None)
    # A fact such as reference_angle_deg is one number.
    named = [
        name
        for name, each in arrays.items()
        if each.size > 1 and max(each.shape) == each.size and _says_unit(titles[name])
    ]
    angle = named[0] if angle is None and len(named) == 1 else angle
    value = next((name for name in ("frames", *_INTENSITIES) if name in arrays), None)
    deep = [name for name, each in arrays.items() if (each.ndim == len(AXES) or is_paired(each)) and each.size > 1]
    if value is None and len(deep) > 1:
        raise RecordError(
            f"{path}: frames expected, and several arrays have {len(AXES)} axes: {', '.join(deep)}; name one, "
            f"`columns={angle or 'ANGLE'},{deep[0]}`, or `columns={deep[0]}` with `first_and_step_deg`"
        )
    return angle, deep[0] if value is None and deep else value


def _says_unit(name: str) -> bool:
    """Return whether the name of a variable has a unit of angle, or says that it is an angle in another unit."""
    named = unit_in(name)
    return named.unit is not None or (named.is_angle and named.other != "")


def _degrees(
    path: Path,
    arrays: Mapping[str, np.ndarray],
    name: str | None,
    table: TableFormat,
    count: int,
    *,
    titles: Mapping[str, str],
) -> Float64[np.ndarray, " angles"]:
    """Return the angles in degrees, of the variable of that name or as stated; ``count``: how many there must be.

    ``titles``: names with the units that the file states.
    """
    if name is None:
        return stated_deg(table, path, count, what="frames")
    if table.states_angles:
        raise RecordError(
            f"{path}: a first angle and a step, or a file of angles, are for frames or intensities without angles, "
            f"and {name} has them; leave them out, or name the frames alone, `columns=FRAMES`"
        )
    angles = arrays[name]
    if angles.dtype.kind not in "iuf":
        raise RecordError(f"{path}: {name} is {angles.dtype}, it must hold angles")
    return angles_in_degrees(table, path, titles[name], angles.ravel().astype(np.float64))


_UNITS_OF_FACTS = {
    "sampling_hz": ("hz", "hertz", "1/s", "s-1"),
    "sound_speed_m_s": ("m/s", "m s-1", "m.s-1", "meters/second", "metres/second"),
    "reference_angle_deg": ("deg", *DEGREES),
    "pulse_energy_j": ("j", "joule", "joules"),
    **dict.fromkeys(CARRIERS, ("hz", "hertz", "1/s", "s-1")),
    **dict.fromkeys(("pitch_m", "wavelength_m", "face_radius_m"), ("m", "metre", "metres", "meter", "meters")),
    **dict.fromkeys(("clock_zero_unix_s", "first_sample_s", "started_s"), ("s", "sec", "second", "seconds")),
}
"""Units, in lower case, that a file may state for what has its unit in its name."""


def _require_units(
    path: Path, units: Mapping[str, str], arrays: Mapping[str, np.ndarray], *, frames: str | None
) -> None:
    """Refuse facts whose stated unit is not that of their name, and frames in decibels (``frames``: their name)."""
    for name, understood in _UNITS_OF_FACTS.items():
        if name in arrays and units.get(name, understood[0]).lower() not in understood:
            raise RecordError(
                f"{path}: {name} has the unit {units[name]!r}, {understood[0]} is expected; convert it, and correct "
                "the attribute"
            )
    if frames is not None and frames in units and decibels(False, f"[{units[frames]}]"):
        raise RecordError(f"{path}: {frames} has the unit {units[frames]!r}; save the frames as they were sampled")


_MOST_UNREAD = 8
"""Most variables that a note names."""


def _note_unread(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Note the single numbers under names that say nothing here: one may be the sampling frequency."""
    single = [name for name, each in arrays.items() if each.size == 1 and each.dtype.kind in "iuf"]
    unread = sorted({*single} - {*_UNITS_OF_FACTS, "pulses", "energy"})
    if not unread:
        return
    listed = ", ".join(f"{name[:40]} ({float(arrays[name].flat[0]):g})" for name in unread[:_MOST_UNREAD])
    more = f" and {len(unread) - _MOST_UNREAD} more" if len(unread) > _MOST_UNREAD else ""
    cure = "a sampling frequency is read under the name sampling_hz, in Hz"
    note(path, f"not read, because their names say nothing here: {listed}{more}; {cure}")


def _samples_before(path: Path, arrays: Mapping[str, np.ndarray], sampling_hz: float | None, *, samples: int) -> int:
    """Return the samples from the trigger to the first one, to the nearest.

    Negative where the record begins before the trigger.

    ``samples``: length of the record.
    """
    first_s = _scalar(path, arrays, "first_sample_s")
    if not first_s:
        return 0
    if sampling_hz is None:
        raise RecordError(f"{path}: first_sample_s is {first_s:g} s, and sampling_hz is missing; add it")
    cure = "correct it, in seconds (Receive.startDepth of a Verasonics, initial_times of zea, first_sample_s)"
    if first_s > LATEST_FIRST_S:
        raise RecordError(
            f"{path}: the first sample is {1e6 * first_s:g} µs after the trigger, at most {1e6 * LATEST_FIRST_S:g} µs "
            f"may be, the time of sound from 0.3 m; {cure}"
        )
    # Compared before it is rounded: a number that lies could have any size.
    if not -first_s * sampling_hz < samples:
        raise RecordError(
            f"{path}: the first sample is {-1e6 * first_s:g} µs before the trigger, and the {samples} samples of a "
            f"frame end before it; {cure}"
        )
    return round(first_s * sampling_hz)


def _from_trigger(counts: Int16[np.ndarray, "channels samples"], before: int) -> Int16[np.ndarray, "channels samples"]:
    """Return the frame with sample 0 at the trigger, cut off or filled with each channel's median."""
    if before <= 0:
        return counts[:, -before:]
    filler = np.rint(np.median(counts, axis=1, keepdims=True)).astype(np.int16)
    return np.hstack([np.repeat(filler, before, axis=1), counts])


def _pulses(path: Path, arrays: Mapping[str, np.ndarray], angles: int) -> np.ndarray:
    """Return the pulses averaged at each angle; 1 where it is not stated."""
    values = arrays.get("pulses", np.ones(angles, int)).ravel()
    if values.size != angles or values.dtype.kind not in "iu" or not (values > 0).all() or not (values < 2**31).all():
        raise RecordError(f"{path}: pulses must be {angles} whole numbers from 1")
    return values.astype(np.int64)


def _energies(
    path: Path, arrays: Mapping[str, np.ndarray], kept: Bool[np.ndarray, " angles"]
) -> Float64[np.ndarray, " kept"] | None:
    """Return the energy of the pulses at the angles that are kept over their mean, NaN where it was not measured.

    None if no angle has one.
    """
    if "energy" not in arrays:
        return None
    stated = arrays["energy"].ravel()
    energies = stated[kept].astype(np.float64) if stated.size == kept.size and stated.dtype.kind in "iuf" else None
    if energies is None or not (np.isnan(energies) | ((energies > 0) & (energies < math.inf))).all():
        raise RecordError(
            f"{path}: energy must be {kept.size} positive numbers, one for each angle, in any unit; NaN where it was "
            "not measured"
        )
    return None if np.isnan(energies).all() else energies / np.nanmean(energies)


def _intensities(path: Path, intensity: np.ndarray, angles: int) -> Float64[np.ndarray, " angles"]:
    if intensity.size != angles or intensity.dtype.kind not in "iuf":
        raise RecordError(f"{path}: intensity is {intensity.dtype} of shape {intensity.shape} for {angles} angles")
    return intensity.ravel().astype(np.float64)


def _valid(
    path: Path, degrees: Float64[np.ndarray, " angles"], values: np.ndarray, table: TableFormat
) -> Bool[np.ndarray, " angles"]:
    """Return which angles and values are finite numbers; refused where others are not to be left out."""
    finite: Bool[np.ndarray, " angles"] = np.isfinite(degrees)
    finite &= np.array([np.isfinite(each).all() for each in values], dtype=bool)
    if finite.all():
        return finite
    if not table.skip_invalid:
        raise RecordError(
            f"{path}: {int((~finite).sum())} of {finite.size} angles hold a number that is not finite; leave those "
            "angles out, or say so: `skip_invalid`"
        )
    warn_skipped(path, "angle number", [str(index + 1) for index in np.flatnonzero(~finite)])
    return finite


def _scalar(path: Path, arrays: Mapping[str, np.ndarray], name: str) -> float | None:
    if name not in arrays:
        return None
    values = arrays[name]
    if values.size != 1 or values.dtype.kind not in "iuf" or not math.isfinite(float(values.flat[0])):
        raise RecordError(f"{path}: {name} must be one finite number")
    return float(values.flat[0])
