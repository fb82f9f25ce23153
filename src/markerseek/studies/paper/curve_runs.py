"""Errors of the searches on simulated intensity curves, or on frames: the trials of Fig. 5 and of the map.

Markers, noise and rigs are those of `markerseek.studies.trial`: every method searches for the same markers, from curves
as from frames. A row of a study is one search; here the longest search of TS, GSS or the posterior also gives all
shorter ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import islice
from typing import TypeAlias

import numpy as np

from markerseek.core import PAPER_RANGE
from markerseek.search import Curve, equal_steps, peak_of, weighted_average
from markerseek.sim import CurveWorld, LaserSettings, MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from markerseek.studies.paper.banks import PEAK_COUNTS
from markerseek.studies.paper.methods import (
    BRACKET_ACQUISITIONS,
    BRACKETS,
    BUILT,
    ONLINE_STEPS,
    AnyMethod,
)
from markerseek.studies.paper.options import RunOptions
from markerseek.studies.paper.section import Answer
from markerseek.studies.policies import StudyPolicy, build_policy, study_policy
from markerseek.studies.study import Cell, CurveSettings, Study, cells
from markerseek.studies.trial import searched
from markerseek.studies.worlds import Draw, draw_trial, intensity_curve, study_rig


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """Width of the intensity curve, as the radius of the absorber, and noise."""

    source_radius_m: float
    """Radius of the Gaussian absorber."""
    peak_snr_db: float

    @property
    def settings(self) -> SimulatedSettings:
        """Simulated rig of this condition: the probe begins at −35°, the marker lies at the middle of the array.

        The energy of the pulses does not vary, because the paper's simulation has white Gaussian noise only.
        """
        return SimulatedSettings(
            start_deg=PAPER_RANGE.low_deg,
            marker=MarkerSettings(lateral_m=0.0, source_radius_m=self.source_radius_m),
            noise=NoiseSettings(peak_snr_db=self.peak_snr_db),
            laser=LaserSettings(energy_jitter=0.0),
            receiver=ReceiverSettings(peak_counts=PEAK_COUNTS),
        )

    @property
    def fwhm_deg(self) -> float:
        """Full width at half maximum of the noise-free curve."""
        return _fwhm_deg(self.source_radius_m)

    @property
    def words(self) -> str:
        """Width and noise in words."""
        return f"FWHM {self.fwhm_deg:.1f}°, {self.peak_snr_db:g} dB"


USUAL = Condition(source_radius_m=0.15e-3, peak_snr_db=40.0)
"""The defaults of the simulated rig (physics notes)."""


@lru_cache(maxsize=32)
def _fwhm_deg(source_radius_m: float) -> float:
    settings = Condition(source_radius_m=source_radius_m, peak_snr_db=40.0).settings
    curve, _ = intensity_curve(CurveSettings(), settings, seed=0)
    if curve is None:
        return float("nan")
    # Steps of 0.05°, a hundredth of the narrowest width.
    angles = np.linspace(PAPER_RANGE.low_deg, PAPER_RANGE.high_deg, 1401)
    heights = np.array([max(curve.peaks(float(angle))) for angle in angles])
    return peak_of(Curve(angle_deg=angles, intensity=heights)).fwhm_deg or float("nan")


def study_of(
    condition: Condition,
    *,
    seed: int,
    trials: int,
    sweeps: tuple[int, ...],
    marker_deg: float | None = None,
    early: bool = False,
) -> Study:
    """Study of TS and GSS at 28 acquisitions and of full scans of WA, all as published, on the curves of one condition.

    ``sweeps``: acquisitions of the full scans of WA. ``marker_deg``: None draws it for each trial. ``early``: whether
    WA also runs as online: 5° steps, and an early end once the peak is passed.
    """
    most = max(BRACKET_ACQUISITIONS)
    settings = condition.settings
    return Study(
        name="paper",
        policies=(
            *(study_policy(method=BUILT[name], acquisitions=most, as_published=True) for name in BRACKETS),
            *(
                study_policy(method=BUILT["WA"], acquisitions=count, as_published=True, early_end=False)
                for count in sweeps
            ),
            *([study_policy(method=BUILT["WA"], acquisitions=ONLINE_STEPS, as_published=True)] if early else []),
        ),
        seed=seed,
        trials=trials,
        stay=True,
        rig=replace(settings, marker=replace(settings.marker, angle_deg=marker_deg)),
    )


TrialOf: TypeAlias = tuple[Study, int]
"""A trial of the first cell of a study."""

MarkerAnswers: TypeAlias = dict[tuple[AnyMethod, int], Answer]
"""Answers for one marker, by method and number of acquisitions."""


def over_trials(
    studies: Sequence[Study], options: RunOptions, *, stage: str, part: int = 20
) -> list[list[MarkerAnswers]]:
    """Answers for the marker of each trial of each study.

    ``part``: trials that a process is given at once.
    """
    trials = [(study, trial) for study in studies for trial in range(study.trials)]
    results = iter(options.each(answers_of_trial, trials, stage=stage, part=part))
    return [list(islice(results, study.trials)) for study in studies]


def answers_of_trial(trial_of: TrialOf) -> MarkerAnswers:
    """Answers for the marker of a trial, of all policies of the study."""
    study, trial = trial_of
    cell = cells(study)[0]
    draw = draw_trial(study, cell, trial)
    names = {built: name for name, built in BUILT.items()}
    # From frames every search runs in the loop: it is what the curves are compared with.
    at_once = [settings for settings in study.policies if _is_full_scan(settings) and study.level == "curves"]
    answers = _full_scans(study, cell, draw, [settings.most for settings in at_once]) if at_once else {}
    for settings in study.policies:
        if settings in at_once:
            continue
        name = names[settings.plan.method]
        rig = study_rig(study, cell, draw)
        policy = build_policy(settings, limits=rig.limits.search, start_deg=rig.stage.angle_deg)
        found = searched(
            policy,
            rig.scanner,
            dark_frames=0 if settings.plan.as_published else rig.dark_frames,
            counts=() if name == "WA" else BRACKET_ACQUISITIONS,
        )
        # WA may end early, and stands under the number that it was given.
        by_count = found.answers or {settings.most: found.finished.estimate}
        answers |= {(name, n): Answer.of(each, truth_deg=draw.marker_deg) for n, each in by_count.items()}
    return answers


def _is_full_scan(settings: StudyPolicy) -> bool:
    return settings.plan.method == BUILT["WA"] and not settings.plan.early_end


def _full_scans(study: Study, cell: Cell, draw: Draw, counts: Sequence[int]) -> MarkerAnswers:
    """Answers of full scans of WA without the search loop; equal to those of the loop to rounding."""
    # The angles of a full scan do not depend on its samples, so that all intensities are drawn at once: 21 scans of
    # each marker would otherwise take most of the time.
    settings = cell.world.rig
    limits, counts_per_deg = settings.limits.search, settings.stage.counts_per_deg
    curve, images_cells = intensity_curve(cell.world.curve, settings, seed=study.seed, draw=draw.curve)
    world = CurveWorld.of_settings(
        settings,
        curve=curve,
        marker_deg=draw.marker_deg,
        cells=images_cells,
        rng=np.random.Generator(np.random.PCG64(draw.noise_seed)),
    )
    # The probe only moves upwards, so that there is no play, and is at the encoder count.
    reached = [np.round(equal_steps(limits, acquisitions=count) * counts_per_deg) / counts_per_deg for count in counts]
    scans = world.scans([np.maximum(at, settings.start_deg) for at in reached], pulses=settings.laser.pulses)
    answers: MarkerAnswers = {}
    for count, at, intensities in zip(counts, reached, scans, strict=True):
        angle_deg = float(np.clip(weighted_average(at, intensities), limits.low_deg, limits.high_deg))
        answers["WA", count] = Answer(error_deg=abs(angle_deg - draw.marker_deg))
    return answers
