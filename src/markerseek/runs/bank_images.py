"""Images, readings and the intensity curve of a bank, computed one frame at a time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec import structs

from markerseek.core import NO_HEADER, AcquisitionError, PaImage, Reading, ReadingFrame, RecordError, Sample
from markerseek.records.banks import BankFacts, FrameBank, IntensityBank
from markerseek.rigs import preset_of, probe_facts
from markerseek.scan import per_energy
from markerseek.search import Curve, curve_of
from markerseek.signals import ImageReader, ProbePreset


def bank_images(
    bank: FrameBank, *, probe: str | ProbePreset | None = None, order: Sequence[int] | None = None
) -> Iterator[PaImage]:
    """Yield the photoacoustic images of a bank.

    ``probe``: preset of the imaging chain, its name, or the name of a TOML file that describes a probe; None: the one
    that the bank names, else the first of all. ``order``: indices of the angles; None: all, in order.
    """
    imaging = ImageReader(preset_of(bank, probe))
    for index in range(len(bank.angles_deg)) if order is None else order:
        try:
            yield imaging.picture(bank.frame(index))
        except AcquisitionError as problem:
            raise RecordError(f"the frame at {bank.angles_deg[index]:g} deg: {problem}") from problem


def bank_samples(bank: IntensityBank | FrameBank, *, probe: str | ProbePreset | None = None) -> Iterator[Sample]:
    """Yield the acquisitions of a bank, dark ones first, with its stored intensities or those computed from its frames.

    ``probe``: if given, the intensities are computed again.
    """
    if isinstance(bank, IntensityBank):
        times_s = bank.started_s or (math.nan,) * len(bank.angles_deg)
        for angle_deg, intensity, time_s in zip(bank.angles_deg, bank.intensities, times_s, strict=True):
            header = structs.replace(NO_HEADER, commanded_deg=angle_deg, started_s=time_s, ended_s=time_s)
            row = ReadingFrame(header=header, intensity=intensity)
            yield Sample(angle_deg=angle_deg, reading=Reading(intensity=intensity), frame=row)
        return
    known = bank.intensities if intensities_stored(bank, probe=probe) else ()
    imaging = None if known else ImageReader(preset_of(bank, probe))
    for index in range(bank.dark_frames):
        frame = bank.dark_frame(index)
        yield Sample(angle_deg=0.0, reading=Reading(intensity=0.0), dark=True, frame=frame)
    for index, angle_deg in enumerate(bank.angles_deg):
        frame = bank.frame(index)
        try:
            if imaging is None:
                reading = Reading(intensity=known[index])
            else:
                reading = per_energy(imaging.read(frame), frame.header.energy)
        except AcquisitionError as problem:
            raise RecordError(f"the frame at {angle_deg:g} deg: {problem}") from problem
        yield Sample(angle_deg=angle_deg, reading=reading, frame=frame)


def intensities_stored(bank: IntensityBank | FrameBank, *, probe: str | ProbePreset | None = None) -> bool:
    """Return whether the intensities of a bank are those that it holds, not computed from its frames."""
    # All or none: intensities of two imaging chains have different scales.
    return probe is None and bool(bank.intensities) and bool(np.isfinite(bank.intensities).all())


def bank_image(bank: FrameBank, index: int, *, probe: str | ProbePreset | None = None) -> PaImage:
    """Return the image of one angle, counted from 0; arguments and errors as of `bank_images`."""
    return next(bank_images(bank, probe=probe, order=(index,)))


def bank_curve(bank: IntensityBank | FrameBank, *, probe: str | ProbePreset | None = None) -> Curve:
    """Return the intensity over angle; arguments and errors as of `bank_samples`."""
    if intensities_stored(bank, probe=probe):
        return Curve(angle_deg=np.array(bank.angles_deg), intensity=np.array(bank.intensities))
    # The curve needs no frames, and all of them may not fit into memory.
    return curve_of([structs.replace(each, frame=None) for each in bank_samples(bank, probe=probe) if not each.dark])


def dark_intensity(bank: IntensityBank | FrameBank, *, probe: str | ProbePreset | None = None) -> float | None:
    """Return the largest intensity of the dark frames; None if there are none. Arguments as of `bank_samples`."""
    if isinstance(bank, IntensityBank) or bank.dark_frames == 0:
        return None
    imaging = ImageReader(preset_of(bank, probe))
    try:
        return max(imaging.read(bank.dark_frame(index)).intensity for index in range(bank.dark_frames))
    except AcquisitionError as problem:
        raise RecordError(f"a dark frame: {problem}") from problem


def bank_facts(bank: IntensityBank | FrameBank, *, probe: str | ProbePreset | None = None) -> BankFacts:
    """Return the facts of a bank, completed from the preset with which its frames are imaged."""
    if isinstance(bank, IntensityBank):
        return bank.facts
    return structs.replace(bank.facts, **probe_facts(preset_of(bank, probe)))
