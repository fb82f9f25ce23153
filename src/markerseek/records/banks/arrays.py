"""Reads banks from arrays of NumPy or MATLAB: angles with intensities, or with frames of channel data.

``.npz`` and ``.mat`` hold variables by name: ``angle_deg``; ``intensity`` or ``frames`` (angles × channels × samples,
counts, or floating-point numbers, which are scaled); and optionally ``sampling_hz``, ``reference_angle_deg``,
``pitch_m``, ``sound_speed_m_s``, ``first_sample_s`` (when the first sample was taken, from the trigger) and ``pulses``.
``.npy`` holds two columns, angle and intensity, or the frames alone. The frames of a Verasonics workspace, and of a
file of zea, come with the same names.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from markerseek.core import MAX_INTENSITY, ChannelFrame, Float64, FrameHeader, Int16, RecordError
from markerseek.files import as_read_error
from markerseek.records.banks.bank import BankFacts, FrameBank, IntensityBank, require_angles
from markerseek.records.banks.counts import as_counts, scale_of
from markerseek.records.sandbox import Sandbox
from markerseek.records.untrusted_arrays import arrays_in, content

USUAL_SAMPLING_HZ = 40e6
"""Sampling frequency of the SonixDAQ in Hz, assumed where the file names none."""

_LARGEST_BYTES = 1 << 33
_ANGLES = ("angle_deg", "angles_deg", "trus_angle_deg")
_INTENSITIES = ("intensity", "intensities")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArrayBank(FrameBank):
    """Frames in memory."""

    path: Path
    samples: Int16[np.ndarray, "angles channels samples"] = field(repr=False)
    """ADC counts."""

    def frame(self, index: int) -> ChannelFrame:
        """Channel data of one angle."""
        header = FrameHeader(
            sequence=index + 1,
            token=self.path.name,
            pulses=self.pulses[index],
            commanded_deg=self.angles_deg[index],
            # Arrays hold no times; NaN says so, where 0 would be a time.
            started_s=math.nan,
            ended_s=math.nan,
        )
        sampling_hz = self.facts.sampling_hz or USUAL_SAMPLING_HZ
        return ChannelFrame(header=header, samples=self.samples[index], sampling_hz=sampling_hz)

    def dark_frame(self, index: int) -> ChannelFrame:
        """Not available: arrays hold no frames without laser."""
        raise RecordError(f"{self.path}: there is no dark frame {index + 1}, it holds none")


def read_arrays(path: Path, *, first_and_step_deg: tuple[float, float] | None = None) -> IntensityBank | ArrayBank:
    """Bank in an ``.npy``, ``.npz`` or ``.mat``.

    ``first_and_step_deg``: angle of the first frame and step to the next, where the file holds no angles.
    """
    with as_read_error(path), Sandbox() as sandbox:
        arrays = arrays_in(path, sandbox, most_bytes=_LARGEST_BYTES)
    return bank_of_arrays(path, arrays, first_and_step_deg=first_and_step_deg)


def bank_of_arrays(
    path: Path, found: Mapping[str, np.ndarray], *, first_and_step_deg: tuple[float, float] | None = None
) -> IntensityBank | ArrayBank:
    """Bank of arrays by their names, as `read_arrays`; ``path``: where they are from."""
    arrays = _named(dict(found))
    angles, intensity, frames = (_picked(arrays, names) for names in (_ANGLES, _INTENSITIES, ("frames",)))
    if first_and_step_deg is not None and frames is not None and angles is None:
        first_deg, step_deg = first_and_step_deg
        angles = first_deg + step_deg * np.arange(len(frames) if frames.ndim else 0)
    elif first_and_step_deg is not None:
        raise RecordError(f"{path}: a first angle and a step are for frames without angles, it holds {content(arrays)}")
    if angles is None:
        raise RecordError(
            f"{path}: angle_deg is missing, it holds {content(arrays)}; add it, or give the first angle and the step"
        )
    order = _rising(path, angles.ravel())
    facts = BankFacts(
        sampling_hz=_scalar(path, arrays, "sampling_hz"),
        reference_angle_deg=_scalar(path, arrays, "reference_angle_deg"),
        pitch_m=_scalar(path, arrays, "pitch_m"),
        sound_speed_m_s=_scalar(path, arrays, "sound_speed_m_s"),
    )
    rising = tuple(float(each) for each in angles.ravel()[order])
    if frames is not None:
        if unfilled := _scalar(path, arrays, "unfilled"):
            warnings.warn(f"{path}: {unfilled:g} frames hold zeros only, and are left out", stacklevel=2)
        counts = _from_trigger(path, _counts(path, frames, len(rising)), arrays, facts.sampling_hz)
        return ArrayBank(
            path=path,
            angles_deg=rising,
            samples=counts[order],
            facts=facts,
            pulses=tuple(_pulses(path, arrays, len(rising))[order].tolist()),
        )
    if intensity is None:
        raise RecordError(f"{path}: intensity or frames expected, it holds {content(arrays)}")
    values = _intensity(path, intensity, len(rising))[order]
    return IntensityBank(angles_deg=rising, intensities=tuple(values.tolist()), facts=facts)


def _named(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays by name; an ``.npy`` of two columns is angles and intensities, any other is frames."""
    if list(arrays) != [""]:
        return arrays
    array = arrays[""]
    if array.ndim == 2 and array.shape[1] == 2:
        return {"angle_deg": array[:, 0], "intensity": array[:, 1]}
    return {"frames": array}


def _picked(arrays: Mapping[str, np.ndarray], names: Sequence[str]) -> np.ndarray | None:
    return next((arrays[name] for name in names if name in arrays), None)


def _rising(path: Path, angles: np.ndarray) -> np.ndarray:
    """Indices that sort the angles, rising."""
    if angles.dtype.kind not in "iuf":
        raise RecordError(f"{path}: angle_deg is {angles.dtype}, it must hold degrees")
    order = np.argsort(angles, kind="stable")
    require_angles(path, angles[order].astype(np.float64).tolist())
    return order


def _counts(path: Path, frames: np.ndarray, angles: int) -> Int16[np.ndarray, "angles channels samples"]:
    if frames.ndim != 3 or min(frames.shape) < 1:
        raise RecordError(
            f"{path}: frames is {frames.dtype} of shape {frames.shape}, (angles, channels, samples) expected"
        )
    # A frame has more samples than channels; the reverse is (angles, samples, channels), a common slip.
    if frames.shape[0] != angles or frames.shape[1] > frames.shape[2]:
        raise RecordError(
            f"{path}: frames has the shape {frames.shape} for {angles} angles; (angles, channels, samples) expected"
        )
    # One scale for all angles, or their intensities could not be compared.
    return as_counts(path, frames, scale=scale_of(path, frames))


def _from_trigger(
    path: Path,
    counts: Int16[np.ndarray, "angles channels samples"],
    arrays: Mapping[str, np.ndarray],
    sampling_hz: float | None,
) -> Int16[np.ndarray, "angles channels samples"]:
    """The same frames with sample 0 at the trigger, to the nearest sample: filled with zeros, or cut off, before."""
    first_s = _scalar(path, arrays, "first_sample_s")
    if not first_s:
        return counts
    if sampling_hz is None:
        raise RecordError(f"{path}: first_sample_s is {first_s:g} s, and sampling_hz is missing; add it")
    length = counts.shape[2]
    # Compared before it is rounded: a number that lies could have any size.
    if not abs(first_s * sampling_hz) < length:
        raise RecordError(
            f"{path}: the first sample is {1e6 * first_s:g} µs from the trigger, more than the {length} samples of a "
            "frame last; correct it (Receive.startDepth of a Verasonics, initial_times of zea, first_sample_s)"
        )
    before = round(first_s * sampling_hz)
    if before < 0:
        return counts[:, :, -before:]
    return np.pad(counts, ((0, 0), (0, 0), (before, 0)))


def _pulses(path: Path, arrays: Mapping[str, np.ndarray], angles: int) -> np.ndarray:
    """Pulses averaged at each angle; 1 where it is not stated."""
    values = arrays.get("pulses", np.ones(angles, int)).ravel()
    if values.size != angles or values.dtype.kind not in "iu" or not (values > 0).all() or not (values < 2**31).all():
        raise RecordError(f"{path}: pulses must be {angles} whole numbers from 1")
    return values.astype(np.int64)


def _intensity(path: Path, intensity: np.ndarray, angles: int) -> Float64[np.ndarray, " angles"]:
    values = intensity.ravel()
    if values.size != angles or values.dtype.kind not in "iuf":
        raise RecordError(f"{path}: intensity is {intensity.dtype} of shape {intensity.shape} for {angles} angles")
    values = values.astype(np.float64)
    if not (np.isfinite(values) & (values >= 0)).all():
        raise RecordError(f"{path}: intensity must be finite and not negative; leave those angles out")
    if (values > MAX_INTENSITY).any():
        raise RecordError(f"{path}: an intensity is {values.max():g}, it must be at most {MAX_INTENSITY:g}; scale them")
    return values


def _scalar(path: Path, arrays: Mapping[str, np.ndarray], name: str) -> float | None:
    if name not in arrays:
        return None
    values = arrays[name]
    if values.size != 1 or values.dtype.kind not in "iuf" or not math.isfinite(float(values.flat[0])):
        raise RecordError(f"{path}: {name} must be one finite number")
    return float(values.flat[0])
