"""Searches under faults: the paper's rules as a bare program has them, and ours as they stand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from markerseek import rigs
from markerseek.core import MarkerseekError, Receiver
from markerseek.core.estimate import Found
from markerseek.guard import Admission, FiringLimits, Guard
from markerseek.scan import Scanner
from markerseek.search import build
from markerseek.signals import IntensityReader
from markerseek.sim import IntensityCurve, SimulatedSettings
from markerseek.studies.paper import faults
from markerseek.studies.paper.bare_rules import bare_answer, bare_listener
from markerseek.studies.paper.effort import PAPER_MARKERS, Effort
from markerseek.studies.paper.failure_kinds import FAULTS, MOVED_AFTER
from markerseek.studies.paper.methods import BUILT, NAMES, Name, searched
from markerseek.studies.settings import CurveSettings
from markerseek.studies.worlds import intensity_curve

MARKERS_DEG = 30.0
"""Markers lie within this of the middle, in degrees, so that no failure is owed to the end of the range."""

RUNS, FRAMED_RUNS = 120, 30
"""Markers of each fault, and of one that needs frames, for as many markers as the paper has."""

PART = 3
"""Runs that one process makes in a row: from frames they take seconds, and none should wait for another."""

Rules: TypeAlias = Literal["the paper's", "ours"]

Method: TypeAlias = Name | Literal["posterior"]

METHODS: dict[Rules, tuple[Method, ...]] = {"the paper's": NAMES, "ours": (*NAMES, "posterior")}
"""Who searches by which rules."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """One marker searched for under one fault, by bare rules and by ours."""

    fault: str
    bare: tuple[Name, ...]
    ours: tuple[Method, ...]
    marker_deg: float
    number: int
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """How one search under a fault ended.

    Attributes
    ----------
    fault, rules, method
        What went wrong, and who searched.
    error_deg
        Angle answered less the marker's, in degrees; None where no angle was claimed.
    """

    fault: str
    rules: Rules
    method: Method
    error_deg: float | None


def outcomes_of(effort: Effort) -> list[Outcome]:
    """Outcomes of every method under every fault, with both sets of rules.

    Parameters
    ----------
    effort
        What may be used.
    """
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([effort.seed, 9])))
    runs: list[_Run] = []
    for name, fault in FAULTS.items():
        count = max(1, round((FRAMED_RUNS if fault.frames else RUNS) * effort.markers / PAPER_MARKERS))
        runs += _runs(name, count, rng, bare=NAMES, ours=METHODS["ours"])
    return _of_all(runs, effort)


def outcomes_of_ours(fault: str, *, methods: tuple[Method, ...], count: int, effort: Effort) -> list[Outcome]:
    """Outcomes of some methods, by our rules, under one fault.

    Parameters
    ----------
    fault
        Its name in `FAULTS`.
    methods
        Who searches.
    count
        Markers.
    effort
        What may be used; its markers do not count.
    """
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([effort.seed, 10, list(FAULTS).index(fault)])))
    return _of_all(_runs(fault, count, rng, bare=(), ours=methods), effort)


def _runs(
    fault: str, count: int, rng: np.random.Generator, *, bare: tuple[Name, ...], ours: tuple[Method, ...]
) -> list[_Run]:
    places_deg = rng.uniform(-MARKERS_DEG, MARKERS_DEG, count)
    return [
        _Run(fault=fault, bare=bare, ours=ours, marker_deg=float(place), number=number, seed=int(rng.integers(2**31)))
        for number, place in enumerate(places_deg)
    ]


def _of_all(runs: Sequence[_Run], effort: Effort) -> list[Outcome]:
    parts = [tuple(runs[first : first + PART]) for first in range(0, len(runs), PART)]
    return [outcome for part in effort.each(_outcomes, parts, what="failures") for outcome in part]


def _outcomes(runs: tuple[_Run, ...]) -> list[Outcome]:
    outcomes = []
    for run in runs:
        truth_deg = run.marker_deg + FAULTS[run.fault].shift_deg
        answers: list[tuple[Rules, Method, float | None]] = [
            ("the paper's", name, _bare(run, name)) for name in run.bare
        ]
        answers += [("ours", method, _guarded(run, method)) for method in run.ours]
        for rules, method, angle_deg in answers:
            error_deg = None if angle_deg is None else angle_deg - truth_deg
            outcomes.append(Outcome(fault=run.fault, rules=rules, method=method, error_deg=error_deg))
    return outcomes


def _bare(run: _Run, name: Name) -> float | None:
    rig, receiver, settings = _rig(run)
    hear = bare_listener(rig.stage, rig.laser, receiver, rig.imaging or IntensityReader(), pulses=settings.laser.pulses)
    # What numpy says about NaN the program does not read.
    with np.errstate(invalid="ignore"):
        angle_deg = bare_answer(name, hear)
    return None if math.isnan(angle_deg) else angle_deg


def _guarded(run: _Run, method: Method) -> float | None:
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
    built = "posterior" if method == "posterior" else BUILT[method]
    policy = build(built, limits=rig.limits.search, start_deg=rig.stage.angle_deg)
    try:
        _, finished = searched(policy, scanner, dark_frames=rig.dark_frames)
    except MarkerseekError:
        return None
    return finished.estimate.mean_deg if isinstance(finished.estimate, Found) else None


def _rig(run: _Run) -> tuple[rigs.Rig, Receiver, SimulatedSettings]:
    """Fresh rig of a run, and its receiver with the fault in it."""
    fault = FAULTS[run.fault]
    settings = fault.condition.settings
    settings = replace(settings, marker=replace(settings.marker, angle_deg=run.marker_deg, present=fault.present))
    if fault.frames:
        settings = replace(settings, noise=replace(settings.noise, bursts=fault.bursts))
        if fault.peak_counts is not None:
            settings = replace(settings, receiver=replace(settings.receiver, peak_counts=fault.peak_counts))
        rig = rigs.simulated(seed=run.seed, settings=settings)
    else:
        curve, cells = intensity_curve(CurveSettings(), fault.condition.settings, seed=0)
        changing: IntensityCurve | None = curve
        if curve is not None and (fault.shift_deg or fault.fading != 1.0):
            changing = faults.ChangingCurve(
                inner=curve, shift_deg=fault.shift_deg, after=MOVED_AFTER, fading=fault.fading
            )
        rig = rigs.of_intensities(
            seed=run.seed,
            curve=changing if fault.present else None,
            marker_deg=run.marker_deg,
            cells=cells,
            settings=settings,
        )
    receiver: Receiver = rig.receiver
    if fault.spoil is not None:
        receiver = faults.FaultyReceiver(receiver, fault.spoil(run.number % 14))
    return rig, receiver, settings
