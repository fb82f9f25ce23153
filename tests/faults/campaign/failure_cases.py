"""Searches under faults that are no lines of devices: what is wrong with the intensities, and how the searches end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from markerseek import rigs
from markerseek.acoustics import Bursts
from markerseek.core import Found, MarkerseekError, Receiver, SearchPlan
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.scan import Scanner
from markerseek.search import build
from markerseek.signals import IntensityReader
from markerseek.sim import Fault, IntensityCurve, SimulatedSettings
from markerseek.studies.paper import RunOptions
from markerseek.studies.paper.fig5 import USUAL, Condition
from markerseek.studies.paper.methods import ALL_METHODS, BUILT, AnyMethod
from markerseek.studies.statistics import Share
from markerseek.studies.study import CurveSettings
from markerseek.studies.trial import searched
from markerseek.studies.worlds import intensity_curve

from .receiver_faults import RECEIVER_FAULTS, FaultyReceiver

WIDE = Condition(source_radius_m=0.4e-3, peak_snr_db=50.0)
"""Curve and noise of all cases but one: without a fault, no method fails on it."""

FRAMED = Condition(source_radius_m=0.35e-3, peak_snr_db=50.0)
"""Curve and noise of the cases from frames: noise that is larger than the steps of a 12-bit converter."""

MOVED_DEG, MOVED_AFTER = 5.0, 8
"""How far, and after how many acquisitions, a moving marker moves."""

FADING = 0.97
"""Factor on the intensity from one acquisition to the next: half is left after 23."""

MARKERS_DEG = 30.0
"""Largest angle of a marker from the middle, in degrees: no failure comes from the ends of the range."""

Outcomes: TypeAlias = dict[tuple[str, AnyMethod], list[float | None]]
"""Angle of each answer minus the marker's in degrees, by case and method; None where no angle was claimed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultCase:
    """One case of the table of failures."""

    words: str
    """What goes wrong."""
    condition: Condition = WIDE
    present: bool = True
    """Whether there is a marker."""
    receiver: Fault | None = None
    one_frame: bool = False
    """Whether the receiver's fault holds for a single acquisition, one of the first 14, which differs from run to
    run."""
    shift_deg: float = 0.0
    fading: float = 1.0
    frames: bool = False
    """Whether it runs on frames of channel data instead of the curve."""
    peak_counts: float | None = None
    bursts: Bursts | None = None
    """``peak_counts`` and ``bursts``: settings of a run on frames; None: the usual ones."""
    observable: bool | None = True
    """Whether the evidence is in what the devices send; None without a fault."""


_NAN = RECEIVER_FAULTS["NaN"]
# Intensities on curves are in units of the noise: this is half the height of the marker.
_CLIPPED = replace(RECEIVER_FAULTS["clipped"], amount=0.5 * 10 ** (WIDE.peak_snr_db / 20))

CASES: dict[str, FaultCase] = {
    "none": FaultCase(words="no fault", observable=None),
    "no marker": FaultCase(words="no marker", present=False),
    "one NaN": FaultCase(words="one frame NaN", receiver=_NAN, one_frame=True),
    "all NaN": FaultCase(words="all frames NaN", receiver=_NAN),
    "dead": FaultCase(words="dead receiver: all intensities 0", receiver=RECEIVER_FAULTS["dead"]),
    "late": FaultCase(words="frames one step late", receiver=RECEIVER_FAULTS["late frames"]),
    "clipped": FaultCase(words="intensities clipped at 50 %", receiver=_CLIPPED),
    "narrow": FaultCase(words="narrow curve over a noise floor, no fault", condition=USUAL, observable=None),
    "fading": FaultCase(
        words=f"energy drifts: {1 - FADING:.0%} less at each acquisition", fading=FADING, observable=False
    ),
    "moving": FaultCase(
        words=f"marker moves by {MOVED_DEG:g}° after {MOVED_AFTER} acquisitions", shift_deg=MOVED_DEG, observable=False
    ),
    "frames": FaultCase(words="no fault (from frames)", condition=FRAMED, frames=True, observable=None),
    "clipped channels": FaultCase(
        # Twice the full scale of the converter, 2047 counts.
        words="channels clipped at 50 % (from frames)",
        condition=FRAMED,
        frames=True,
        peak_counts=4094.0,
    ),
    "bursts": FaultCase(
        words="bursts of noise in one frame of ten (from frames)",
        condition=FRAMED,
        frames=True,
        bursts=Bursts(frame_probability=0.1, gain=20.0),
    ),
}
"""All cases by name."""


@dataclass(slots=True, kw_only=True)
class ChangingCurve:
    """A curve that moves, or fades, from one acquisition to the next."""

    inner: IntensityCurve
    shift_deg: float = 0.0
    """Angle by which the marker moves after `MOVED_AFTER` acquisitions."""
    fading: float = 1.0
    """Factor on the intensity from each acquisition to the next; 1 does not fade."""
    acquisitions: int = 0
    """Acquisitions so far."""

    def peaks(self, off_plane_deg: float) -> Sequence[float]:
        """Heights of the peaks now; see `markerseek.sim.IntensityCurve`."""
        moved_deg = self.shift_deg if self.acquisitions >= MOVED_AFTER else 0.0
        strength = self.fading**self.acquisitions
        # A world asks once in each acquisition with light, so dark frames do not count.
        self.acquisitions += 1
        return [strength * height for height in self.inner.peaks(off_plane_deg - moved_deg)]


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultRun:
    """One marker, searched for under one fault."""

    case: str
    methods: tuple[AnyMethod, ...]
    marker_deg: float
    number: int
    seed: int


def draw_runs(
    case: str, count: int, rng: np.random.Generator, *, methods: tuple[AnyMethod, ...] = ALL_METHODS
) -> list[FaultRun]:
    """Draw the runs of a case."""
    markers_deg = rng.uniform(-MARKERS_DEG, MARKERS_DEG, count)
    return [
        FaultRun(
            case=case,
            methods=methods,
            marker_deg=float(marker_deg),
            number=number,
            seed=int(rng.integers(2**31)),
        )
        for number, marker_deg in enumerate(markers_deg)
    ]


def outcomes_of(runs: Sequence[FaultRun], options: RunOptions) -> Outcomes:
    """Outcomes of all searches of the runs, in their order."""
    outcomes: Outcomes = {}
    # A few runs a job: one from frames takes seconds, and no process should wait long for another at the end.
    for run, errors_deg in zip(runs, options.each(_errors_deg, runs, stage="failures", part=3), strict=True):
        for method, error_deg in zip(run.methods, errors_deg, strict=True):
            outcomes.setdefault((run.case, method), []).append(error_deg)
    return outcomes


def _errors_deg(run: FaultRun) -> list[float | None]:
    # The last place of the marker: a search is used after it has ended.
    truth_deg = run.marker_deg + CASES[run.case].shift_deg
    angles_deg = (_guarded(run, method) for method in run.methods)
    return [None if angle_deg is None else angle_deg - truth_deg for angle_deg in angles_deg]


def _guarded(run: FaultRun, method: AnyMethod) -> float | None:
    rig, receiver, settings = _rig(run)
    scanner = Scanner(
        stage=rig.stage,
        laser=rig.laser,
        receiver=receiver,
        reader=rig.imaging or IntensityReader(),
        clock=rig.scanner.clock,
        guard=Guard(limits=rig.limits, firing=FiringLimits(), admission=Admission()),
        pulses=settings.laser.pulses,
        arms_itself=True,
    )
    policy = build(SearchPlan(method=BUILT[method], start_deg=rig.stage.angle_deg), limits=rig.limits.search)
    try:
        estimate = searched(policy, scanner, dark_frames=rig.dark_frames).finished.estimate
    # A refusal of the guard, of the policy or of a device: none of them claims an angle.
    except MarkerseekError:
        return None
    return estimate.mean_deg if isinstance(estimate, Found) else None


def _rig(run: FaultRun) -> tuple[rigs.Rig, Receiver, SimulatedSettings]:
    """New rig of a run, its receiver with the fault, and its settings."""
    case = CASES[run.case]
    settings = case.condition.settings
    settings = replace(settings, marker=replace(settings.marker, angle_deg=run.marker_deg, present=case.present))
    if case.frames:
        settings = replace(settings, noise=replace(settings.noise, bursts=case.bursts))
        if case.peak_counts is not None:
            settings = replace(settings, receiver=replace(settings.receiver, peak_counts=case.peak_counts))
        rig = rigs.simulated(seed=run.seed, settings=settings)
    else:
        curve, cells = intensity_curve(CurveSettings(), case.condition.settings, seed=0)
        if curve is not None and (case.shift_deg or case.fading != 1.0):
            curve = ChangingCurve(inner=curve, shift_deg=case.shift_deg, fading=case.fading)
        rig = rigs.of_intensities(
            seed=run.seed,
            curve=curve if case.present else None,
            marker_deg=run.marker_deg,
            cells=cells,
            settings=settings,
        )
    receiver: Receiver = rig.receiver
    if case.receiver is not None:
        step = 1 + run.number % 14
        fault = replace(case.receiver, from_step=step, to_step=step + 1) if case.one_frame else case.receiver
        receiver = FaultyReceiver(receiver, fault)
    return rig, receiver, settings


def share_off(errors_deg: Sequence[float | None], *, limit_deg: float) -> Share:
    """Return the share of runs that claim an angle with an error above the limit.

    ``errors_deg``: None where no angle was claimed. ``limit_deg``: largest error that does not count.
    """
    off = sum(error_deg is not None and abs(error_deg) > limit_deg for error_deg in errors_deg)
    return Share.of(off, len(errors_deg))
