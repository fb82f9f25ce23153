"""The faults of the table of failures: what each does to a search."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from markerseek.acoustics import Bursts
from markerseek.core import Frame
from markerseek.studies.paper import faults
from markerseek.studies.paper.curve_runs import Condition

WIDE = Condition(source_radius_m=0.4e-3, peak_snr_db=50.0)
"""Curve and noise of all faults but one: without a fault, neither set of rules fails on it."""

FRAMED = Condition(source_radius_m=0.35e-3, peak_snr_db=50.0)
"""Curve and noise of the faults that need frames: a converter of 12 bits still shows this noise."""

NARROW = Condition(source_radius_m=0.15e-3, peak_snr_db=40.0)
"""The default of the simulated rig."""

MOVED_DEG, MOVED_AFTER = 5.0, 8
"""How far, and after how many acquisitions, a moving marker moves."""

FADING = 0.97
"""Factor on the intensity from one acquisition to the next: half is left after 23."""

_Spoil: TypeAlias = Callable[[int, Frame, Frame | None], Frame]


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One thing that goes wrong.

    Attributes
    ----------
    words
        What it is.
    condition
        Curve and noise.
    present
        Whether there is a marker.
    spoil
        Makes what happens to frames, given a number from 0 to 13 that differs from run to run; None: nothing.
    shift_deg, fading
        See `markerseek.studies.paper.faults.ChangingCurve`.
    frames
        Whether it runs on frames of channel data instead of the curve.
    peak_counts, bursts
        Settings of a run on frames; None: the usual ones.
    observable
        Whether the evidence is in what the devices send; None without a fault.
    """

    words: str
    condition: Condition = WIDE
    present: bool = True
    spoil: Callable[[int], _Spoil] | None = None
    shift_deg: float = 0.0
    fading: float = 1.0
    frames: bool = False
    peak_counts: float | None = None
    bursts: Bursts | None = None
    observable: bool | None = True


_HALF = 0.5 * 10 ** (WIDE.peak_snr_db / 20)

FAULTS: dict[str, Fault] = {
    "none": Fault(words="no fault", observable=None),
    "no marker": Fault(words="no marker", present=False),
    "one NaN": Fault(words="one frame NaN", spoil=faults.nan_at),
    "all NaN": Fault(words="all frames NaN", spoil=lambda _: faults.nan_always),
    "dead": Fault(words="dead receiver: all intensities 0", spoil=lambda _: faults.dead),
    "late": Fault(words="frames one step late", spoil=lambda _: faults.late),
    "clipped": Fault(words="intensities clipped at 50 %", spoil=lambda _: faults.clipped(_HALF)),
    "narrow": Fault(words="narrow curve over a noise floor, no fault", condition=NARROW, observable=None),
    "fading": Fault(words=f"energy drifts: {1 - FADING:.0%} less at each acquisition", fading=FADING, observable=False),
    "moving": Fault(
        words=f"marker moves by {MOVED_DEG:g}° after {MOVED_AFTER} acquisitions", shift_deg=MOVED_DEG, observable=False
    ),
    "frames": Fault(words="no fault (from frames)", condition=FRAMED, frames=True, observable=None),
    "clipped channels": Fault(
        words="channels clipped at 50 % (from frames)", condition=FRAMED, frames=True, peak_counts=4094.0
    ),
    "bursts": Fault(
        words="bursts of noise in one frame of ten (from frames)",
        condition=FRAMED,
        frames=True,
        bursts=Bursts(frame_probability=0.1, gain=20.0),
    ),
}
"""All faults by name."""
