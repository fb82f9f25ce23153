"""One search and its row; the study, the cell and the index of the trial determine everything that is drawn."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Literal, NamedTuple, TypeAlias

import msgspec
from msgspec.structs import replace

from markerseek import rigs
from markerseek.core import (
    Ambiguous,
    AnglePrior,
    AnyPolicy,
    Asked,
    ConfigError,
    DeviceError,
    Estimate,
    Finished,
    Found,
    MarkerCurve,
    Sample,
    SearchError,
    SearchPlan,
    Unsure,
    described,
    estimate_of,
)
from markerseek.records.journal import RunView
from markerseek.runs import own_errors
from markerseek.scan import run
from markerseek.show import AnswerName, answer_name
from markerseek.studies.policies import StudyPolicy, build_policy
from markerseek.studies.study import Cell, Study, Value, cells
from markerseek.studies.worlds import Draw, draw_trial, expected_angle_deg, former_rig, hidden_noise, study_rig

TrialAnswer: TypeAlias = Literal[AnswerName, "failed"]
"""Answer of a search; "failed" is a fault of a device, which ends the search without an angle."""

SOURCE_DEG = 2.0
"""Largest distance of an angle from a source for the angle to be that of the source, in degrees."""


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One search of a study; None is a missing value.

    ``study`` and ``row`` are all that is needed to repeat the search (`run_row`). The columns up to ``noise_seed`` are
    its settings, the others its result. The defaults are those of a search that failed.
    """

    study: str
    """Hash of the study."""
    row: int
    cell: int
    trial: int
    policy: int
    settings: tuple[tuple[str, Value], ...]
    """Varied settings of the cell."""
    method: str
    acquisitions_most: int
    """Acquisitions that were allowed."""
    as_published: bool
    early_end: bool
    noise_seed: int
    answer: TrialAnswer = "failed"
    mean_deg: float | None = None
    truth_deg: float | None
    """Angle of the marker; None without a marker."""
    error_deg: float | None = None
    sigma_deg: float | None = None
    low_deg: float | None = None
    """Lower end of the 95 % interval."""
    high_deg: float | None = None
    """Upper end of the 95 % interval."""
    marks_deg: tuple[float, ...] = ()
    """Answers after as many acquisitions as the marks of the study."""
    acquisitions: int | None = None
    """Acquisitions that were made."""
    refused: int = 0
    travel_deg: float | None = None
    elapsed_s: float | None = None
    known_s: float | None = None
    surveyed: float | None = None
    """As of the answer."""
    other_probability: float | None = None
    """As of the answer."""
    tolerance_deg: float = 1.0
    """Tolerance of the policy at the marker's true distance from the axis."""
    second_deg: float | None = None
    """Angle of the second source, where the scene holds one."""
    second_db: float | None = None
    """Strength of the second source over the marker's."""
    nearest: Literal["stronger", "weaker", "between", "outside"] | None = None
    """Which of the two sources the angle of the answer belongs to."""
    other_deg: float | None = None
    """Angle that the answer names for the other source; None if it names none within `SOURCE_DEG`."""
    fault: str | None = None
    """Why a search failed."""


def run_trial(study: Study, cell: Cell, trial: int, policy: int) -> Row:
    """Run one search, and return its row.

    ``study``, ``cell``, ``trial``, ``policy``: the policy by its index in the study.
    """
    settings = study.policies[policy]
    draw = draw_trial(study, cell, trial)
    rig = study_rig(study, cell, draw)
    truth_deg = rig.facts.truth_deg
    second = draw.scene.second
    two = None if second is None else TwoAngles(draw.marker_deg, second.angle_deg)
    row = Row(
        study=study.digest,
        row=(cell.index * study.trials + trial) * len(study.policies) + policy,
        cell=cell.index,
        trial=trial,
        policy=policy,
        settings=cell.varied,
        method=settings.plan.method,
        acquisitions_most=settings.most,
        as_published=settings.plan.as_published,
        early_end=settings.plan.early_end,
        noise_seed=draw.noise_seed,
        truth_deg=truth_deg,
        tolerance_deg=settings.plan.tolerance.half_width_deg(_radius_m(study, cell, draw)),
        second_deg=None if second is None else second.angle_deg,
        second_db=None if second is None else 20 * math.log10(second.strength),
    )
    prior = trial_prior_curve(study, cell, trial, settings)
    # Simulated faults are part of a study. Other errors are of its settings, and end it.
    try:
        near = _angle_prior(study, cell, trial, settings, rig)
        found = _search(study, settings, rig, prior=prior, near=near)
    except DeviceError as problem:
        # The guard refuses frames without noise as stale, and here no device is to blame.
        hidden = hidden_noise(study, cell, draw, sweep=settings.plan.sweep)
        fault = described(problem) if hidden is None else f"{hidden} ({described(problem)})"
        # A row is one line of the table.
        return msgspec.structs.replace(row, fault=" ".join(fault.split()))
    finished = found.finished
    estimate = found.finished.estimate
    # A search that ended before a mark has its final answer there.
    at_marks = [found.answers.get(mark, estimate) for mark in study.marks]
    # float(): a user's own policy may answer in NumPy's numbers, which no table holds.
    mean_deg = float(estimate.mean_deg)
    # The columns of the interval are of angles that the search vouches for.
    stated = estimate if isinstance(estimate, Found | Unsure) else None
    return msgspec.structs.replace(
        row,
        answer=answer_name(estimate),
        mean_deg=mean_deg,
        error_deg=None if truth_deg is None else abs(mean_deg - truth_deg),
        sigma_deg=None if stated is None else float(stated.sigma_deg),
        low_deg=None if stated is None else float(stated.interval95_deg.low_deg),
        high_deg=None if stated is None else float(stated.interval95_deg.high_deg),
        marks_deg=tuple(float(each.mean_deg) for each in at_marks),
        acquisitions=finished.acquisitions,
        refused=found.view.refused,
        travel_deg=finished.travel_deg,
        elapsed_s=finished.elapsed_s,
        known_s=finished.known_s,
        surveyed=estimate.surveyed,
        other_probability=None if stated is None else stated.other_probability,
        nearest=None if two is None else two.nearest(mean_deg),
        other_deg=None if two is None else two.other_named(estimate),
    )


def _radius_m(study: Study, cell: Cell, draw: Draw) -> float | None:
    """Return the distance of the marker from the axis in metres; None for intensities alone, which do not say it."""
    if study.level == "curves":
        return None
    return cell.world.rig.marker.radius_m if draw.unknowns is None else draw.unknowns.marker.radius_m


def trial_prior_curve(study: Study, cell: Cell, trial: int, settings: StudyPolicy) -> MarkerCurve | None:
    """Return the curve of the former marker of a trial, by a search for it; None if none is asked for, or found."""
    if not settings.prior:
        return None
    try:
        estimate = _search(study, settings, former_rig(study, cell, trial)).finished.estimate
    except DeviceError:
        return None
    return estimate.curve if isinstance(estimate, Found) else None


def _angle_prior(study: Study, cell: Cell, trial: int, settings: StudyPolicy, rig: rigs.Rig) -> AnglePrior | None:
    """Return the prior over the angle of a trial; None if none is asked for, or there is no marker."""
    sigma_deg = settings.near_sigma_deg
    truth_deg = rig.facts.truth_deg
    if sigma_deg is None or truth_deg is None:
        return None
    expected_deg = expected_angle_deg(
        study, cell, trial, truth_deg=truth_deg, sigma_deg=sigma_deg, off_deg=settings.near_off_deg
    )
    return AnglePrior(mean_deg=expected_deg, sigma_deg=sigma_deg)


class TwoAngles(NamedTuple):
    """Angles of the marker, which is the stronger source, and of the weaker one, in degrees."""

    stronger_deg: float
    weaker_deg: float

    def nearest(self, angle_deg: float) -> Literal["stronger", "weaker", "between", "outside"]:
        """Return which of the two sources an angle belongs to, or whether it lies between them or outside."""
        away = abs(angle_deg - self.stronger_deg), abs(angle_deg - self.weaker_deg)
        if min(away) <= SOURCE_DEG:
            return "stronger" if away[0] <= away[1] else "weaker"
        return "between" if min(self) < angle_deg < max(self) else "outside"

    def other_named(self, estimate: Estimate) -> float | None:
        """Return the angle that an answer names for the source that is not its own; None if it names none."""
        other_deg = max(self, key=lambda angle_deg: abs(angle_deg - estimate.mean_deg))
        named = [angle_deg for angle_deg in other_angles_deg(estimate) if abs(angle_deg - other_deg) <= SOURCE_DEG]
        return min(named, key=lambda angle_deg: abs(angle_deg - other_deg), default=None)


def other_angles_deg(estimate: Estimate) -> tuple[float, ...]:
    """Return the angles that an answer names for other sources than its own, in degrees."""
    modes_deg = estimate.modes_deg if isinstance(estimate, Ambiguous) else ()
    return (
        *(angle_deg for angle_deg in modes_deg if angle_deg != estimate.mean_deg),
        *(other.angle_deg for other in estimate.others),
    )


def run_row(study: Study, row: int) -> Row:
    """Run the search of a row again, by its index in the table of the study."""
    if not 0 <= row < study.rows:
        raise ConfigError(f"row is {row}, the study {study.name} has the rows 0 to {study.rows - 1}")
    place, policy = divmod(row, len(study.policies))
    cell, trial = divmod(place, study.trials)
    return run_trial(study, cells(study)[cell], trial, policy)


class SearchTrace(NamedTuple):
    """One search."""

    view: RunView
    """The run at its end."""
    answers: dict[int, Estimate]
    """Answers by number of acquisitions."""

    @property
    def samples(self) -> list[Sample]:
        """Samples of the search in order, without dark frames and confirmations."""
        return [point.sample for point in self.view.points if point.role == "search"]

    @property
    def finished(self) -> Finished:
        """The end of the run."""
        if self.view.finished is None:
            raise SearchError("the run ended without an answer")
        return self.view.finished


def searched(policy: AnyPolicy, rig: rigs.Rig, plan: SearchPlan, *, counts: Collection[int] = ()) -> SearchTrace:
    """Run a search on a rig.

    The angles of a bracket search, and of a posterior without an early end, do not depend on its length: its answers on
    the way are those of shorter searches.

    ``plan``: how the search begins and ends; its other settings are those of the policy. ``counts``: numbers of
    acquisitions after which the answer is kept. Raises `MarkerseekError` whatever ended the run.
    """
    answers: dict[int, Estimate] = {}
    view = RunView(plan=plan, facts=rig.facts)
    for event in run(policy, rig.scanner, plan):
        # When acquisition n is asked for, the policy holds n − 1 samples.
        if isinstance(event, Asked) and event.role == "search" and event.index - 1 in counts:
            answers[event.index - 1] = estimate_of(policy)
        elif isinstance(event, Finished) and event.acquisitions in counts:
            answers[event.acquisitions] = event.estimate
        view = view.add(event, clock_s=rig.scanner.clock.now_s())
    return SearchTrace(view, answers)


def _search(
    study: Study,
    settings: StudyPolicy,
    rig: rigs.Rig,
    *,
    prior: MarkerCurve | None = None,
    near: AnglePrior | None = None,
) -> SearchTrace:
    """Return one search with its answers at the marks; `DeviceError` if a device ended it."""
    devices = rig.scanner.sweeping if settings.plan.sweep else None
    policy = build_policy(
        settings,
        limits=rig.limits.search,
        start_deg=rig.stage.angle_deg,
        prior=prior,
        near=near,
        sweep_speed_deg_s=None if devices is None else devices.stage.fastest_sweep_deg_s,
        sweep_from_end=devices is not None and devices.in_bursts,
    )
    dark_frames = 0 if settings.plan.as_published or settings.plan.sweep else rig.dark_frames
    plan = replace(settings.plan, stay=study.stay, dark_frames=dark_frames)
    with own_errors(settings.plan.method):
        return searched(policy, rig, plan, counts=study.marks)
