"""The policy `Posterior`: asks for the next angle by the posterior, and answers what its samples prove."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from markerseek.core import (
    PAPER_RANGE,
    Ambiguous,
    AnglePrior,
    ByHand,
    ConfigError,
    Estimate,
    Found,
    Interval,
    MarkerCurve,
    NotFound,
    PriorEvidence,
    Sample,
    SearchError,
    Tolerance,
    Unsure,
    require_range,
    undisplaced,
)
from markerseek.search.evidence import KNOWN_SIGMA_DEG, marker_radius_m
from markerseek.search.floor import above_background
from markerseek.search.policy import SearchPolicy, check_acquisitions, check_sample, check_start
from markerseek.search.posterior.analysis import Analysis
from markerseek.search.posterior.answer import answer_of
from markerseek.search.posterior.inference import Inference
from markerseek.search.posterior.likelihood import displaced_sigma_deg, later, radius_m, with_light
from markerseek.search.posterior.next_angle import (
    PLAN,
    PLAN_BY_HAND,
    Belief,
    belief_of,
    flank_again_deg,
    load_kernels,
    most_detectable_deg,
    most_informative_deg,
    planned_deg,
    step_near_deg,
)
from markerseek.search.posterior.prediction import weaker_than_predicted
from markerseek.search.posterior.rivals import rivals_of
from markerseek.search.posterior.sources import BESIDE_DEG, Candidate, top_deg
from markerseek.search.posterior.survey import (
    LATE_WORTH,
    STATED,
    SURVEY_UNTIL,
    USUAL_OTHERS,
    WORTH,
    ExpectedAngle,
    Survey,
    hidden_probability,
)

CUES = frozenset({"intensity", "arrival", "lateral"})
"""Parts of a reading that can be used."""

TARGET_SIGMA_DEG = 0.2
"""Standard deviation at which a search ends unless another is given, in degrees."""

MIN_ACQUISITIONS = 4
"""Acquisitions before which a search does not end for a small standard deviation."""

MIN_SAMPLES = 3
"""Samples that are taken where a prior over the angle expects the marker, before it can be given up."""

SURVEY_RESERVE = 6
"""Acquisitions that precision leaves to the survey, which takes three to five."""

OFTEN = 8
"""Samples of a source after which a few more do not make a difference."""

TOLERATED_SIGMAS = 3.0
"""Standard deviations of the centre that the tolerance must hold before a search ends: with them its 95 % interval, at
1.96, lies well within."""

FLOOR_SNR = 4.2
"""Largest of some ten thousand Rayleigh cells over σ, as it usually comes out."""

_USUAL = Tolerance()


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """How well the centre of the strongest source's curve is known."""

    mean_deg: float
    sigma_deg: float
    """``mean_deg`` and ``sigma_deg``: mean and standard deviation of the centre's angle."""
    fwhm_deg: float
    """Full width of the curve at half maximum."""
    target_deg: float
    """Standard deviation with which it is known well enough."""


class Posterior(SearchPolicy):
    """Searches by a posterior over the marker's angle.

    Parameters
    ----------
    limits
        Range to search.
    acquisitions
        Most acquisitions.
    target_sigma_deg
        The search ends once the centre of the curve is known to this standard deviation, in degrees, well enough for
        the tolerance too, and the marker is found; 0: only with the last acquisition.
    start_deg
        Present angle of the probe, in degrees; the search begins at the nearer end. None: at the low end.
    cues
        Which of `CUES` are used: "intensity", "arrival", "lateral" (places in the image).
    others
        Prior probability of a second source as strong; 0: the search looks for no other, and ends earlier.
    prior
        Width and height of the curve of a former marker on this rig; None if there was none.
    near
        Where the marker is expected: the search begins there. It takes the whole range, with its acquisitions counted
        from 0 again, if that angle is more probably wrong than right, or if it would end without `Found`. None:
        anywhere.
    tolerance
        How well the angle of a `Found` must be known.
    angles_deg
        Angles that can be measured, in degrees: those of a recording, which has nothing new to say of an angle that it
        has given. Each in the range is asked for once, and the search ends with the last. None: any angle of the range.
    by_hand
        How a person turns the probe: it is asked for the steps of a scale, and seldom to turn back. None: a motor does.
    motion_mm
        Amplitude of the tissue's motion that is known, in mm: half of the way; 0: it rests. None: not known.

    Raises
    ------
    ConfigError
        If an argument cannot be used.
    """

    name = "posterior"

    def __init__(
        self,
        *,
        limits: Interval = PAPER_RANGE,
        acquisitions: int = 16,
        target_sigma_deg: float = TARGET_SIGMA_DEG,
        start_deg: float | None = None,
        cues: Iterable[str] = CUES,
        others: float = USUAL_OTHERS,
        prior: MarkerCurve | None = None,
        near: AnglePrior | None = None,
        tolerance: Tolerance = _USUAL,
        angles_deg: Sequence[float] | None = None,
        by_hand: ByHand | None = None,
        motion_mm: float | None = None,
    ) -> None:
        super().__init__()
        check_acquisitions(acquisitions, least=2, method=self.name)
        check_start(start_deg, method=self.name)
        if not 0 <= target_sigma_deg < math.inf:
            raise ConfigError(
                f"posterior: target_sigma_deg is {target_sigma_deg} deg, it must be finite and not negative; "
                "0 uses every acquisition"
            )
        if not 0 <= others < 1:
            raise ConfigError(f"posterior: others is {others}, it must be a probability from 0 to below 1")
        chosen = frozenset(cues)
        if not chosen or not chosen <= CUES:
            raise ConfigError(f"posterior: cues are {sorted(chosen)}, choose at least one of {sorted(CUES)}")
        load_kernels()
        self._limits = limits
        self._budget = acquisitions
        self._target_deg = target_sigma_deg
        self._expected = None if near is None else ExpectedAngle(near, limits=limits)
        self.is_narrowed = near is not None
        self._descending = start_deg is not None and start_deg > self._searched.centre_deg
        self._former = prior
        self._others = others
        self.single = others == 0
        self._tolerance = tolerance
        if motion_mm is not None:
            require_range("posterior: motion_mm", motion_mm, low=0, high=30, unit="mm")
        motion_m = None if motion_mm is None else 1e-3 * motion_mm
        self._inference = Inference(limits=limits, cues=chosen, prior=prior, motion_m=motion_m)
        self._left_deg = None if angles_deg is None else [each for each in angles_deg if each in limits]
        if angles_deg and not self._left_deg:
            raise ConfigError(f"posterior: none of the {len(angles_deg)} angles_deg lies in {limits}")
        self._by_hand = by_hand
        self._asked = 0
        self._before = 0
        self._range_swept = False
        self._delay_s = 0.0
        self._confirmation_taken = False
        self._confirmation_failure: str | None = None
        self._cached: Analysis | None = None

    def tell(self, sample: Sample) -> None:
        """Take one sample: a dark one for the noise floor, one with the laser on for the posterior.

        Raises
        ------
        SearchError
            If the sample is not usable (`check_sample`), or the laser was on and the search is over.
        """
        asked_deg = None if sample.dark else self.ask()
        super().tell(sample)
        if not sample.dark:
            self._asked += 1
            if self._left_deg is not None and asked_deg is not None:
                self._left_deg.remove(asked_deg)
            self._confirmation_taken = False
            self._confirmation_failure = None
        self._cached = None

    def tell_swept(self, sample: Sample) -> None:
        """Take one sample of a sweep, which was not asked for by its angle and does not count as an acquisition.

        Raises
        ------
        SearchError
            If the sample is not usable (`check_sample`).
        """
        check_sample(sample)
        self._lit.append(sample)
        self._confirmation_taken = False
        self._confirmation_failure = None
        self._next = None
        self._cached = None

    def tell_recorded(self, samples: Iterable[Sample]) -> None:
        """Take all samples of a recording, none of which was asked for; the search is then over.

        Raises
        ------
        SearchError
            If a sample is not usable (`check_sample`).
        """
        for sample in samples:
            check_sample(sample)
            (self._dark if sample.dark else self._lit).append(sample)
        self._asked = self._budget
        self._left_deg = []
        self._next = None
        self._cached = None

    @property
    def lit(self) -> list[Sample]:
        """Samples with the laser on, in the order of `tell`, without pulses that gave no light."""
        return with_light(self._lit)

    def take_out_delay(self, delay_s: float, *, order_sigma_deg: float = 0.0) -> None:
        """Take for granted that the light of sweeps comes later than their angles say, by this in seconds.

        ``order_sigma_deg``: standard deviation of the angle by what the order of their frames leaves open.
        """
        self._delay_s = delay_s
        self._inference.order_sigma_deg = order_sigma_deg
        self._next = None
        self._cached = None

    @property
    def moved_deg(self) -> float:
        """Standard deviation of what is not known of the displacement of a marker along the turn.

        0 where neither frames nor cameras show a motion.
        """
        first = self._analysis.first
        intensities = [sample.reading.intensity for sample in first.samples]
        strongest = first.samples[int(np.argmax(intensities))]
        from_axis_m = radius_m(strongest.reading.depth_m)
        # Those by which the curve is placed.
        strong = [each for each in first.samples if each.reading.intensity >= 0.5 * strongest.reading.intensity]
        left_deg = float(np.sqrt(np.mean([displaced_sigma_deg(each, radius_m=from_axis_m) ** 2 for each in strong])))
        motion = first.posterior.motion
        if motion is None or not motion.is_seen:
            return left_deg
        return math.hypot(left_deg, math.degrees(motion.turn_sigma_m / from_axis_m))

    def state_swept(self) -> None:
        """Take for granted from now on that sweeps have surveyed the range, as far as single pulses can."""
        self._range_swept = True
        self._next = None

    single: bool
    """Whether it takes for granted that there is one source at most."""
    is_narrowed: bool
    """Whether it looks first where a prior over the angle expects the marker, and has not given the prior up."""

    @property
    def _searched(self) -> Interval:
        """The part of the range that is searched now."""
        return self._expected.window if self._expected is not None and self.is_narrowed else self._limits

    @property
    def near_evidence(self) -> PriorEvidence | None:
        """What was seen of the prior over the angle; None without one, and before the first sample."""
        if self._expected is None or not self._lit:
            return None
        sources = self._analysis.sources
        # The marker may be either of two sources that are about as strong.
        known = [sources[0], *(rivals_of(sources) if isinstance(self.estimate(), Ambiguous) else ())]
        wrong = min(self._expected.wrong_probability(source.posterior) for source in known)
        return PriorEvidence(probability=1 - wrong, whole_range=not self.is_narrowed)

    def doubts_near(self, *, at_end: bool) -> bool:
        """Return whether the prior over the angle is to be given up; ``at_end``: whether the search would end now."""
        if not self.is_narrowed or len(self._lit) < MIN_SAMPLES:
            return False
        if at_end and not isinstance(self.estimate(), Found):
            return True
        analysis = self._analysis
        if analysis.detected and not at_end and self._comes_first(self._decisive.first):
            return False
        assert self._expected is not None  # noqa: S101 - there is one where the search is narrowed
        # Evenly spread over the window, the acquisitions of the plan miss the fewest markers.
        missed = not analysis.detected and len(self._lit) >= len(PLAN)
        return missed or self._expected.is_contradicted(self._decisive.sources[0], former=self._former)

    def widen(self) -> None:
        """Give up the prior over the angle: search the whole range, keep all samples, count the acquisitions from 0."""
        self.is_narrowed = False
        self._range_swept = False
        self._asked = 0
        self._before = len(self._lit)
        self._next = None
        self._cached = None

    def confirm(self, sample: Sample) -> None:
        """Take the acquisition at the angle found, as one more sample.

        It was not asked for, and does not count as such. Where it is weaker than the posterior predicts, the answer is
        `Unsure`, and the search goes on while acquisitions are left.

        Raises
        ------
        SearchError
            If the sample is not usable (`check_sample`) or dark, or nothing is found that it could confirm.
        """
        check_sample(sample)
        if sample.dark:
            raise SearchError(
                "posterior: the laser was off, and a dark frame confirms nothing; measure this angle again"
            )
        if not isinstance(self.estimate(), Found):
            raise SearchError("posterior: nothing is found that a sample could confirm; tell it as any other")
        first = self._decisive.first
        *_, undisplaced_sample = undisplaced([*self._lit, sample])
        (above,) = above_background([undisplaced_sample], self._analysis.noise.background)
        self._confirmation_taken = True
        self._confirmation_failure = weaker_than_predicted(first, above)
        self._lit.append(sample)
        self._next = None
        self._cached = None

    def estimate(self) -> Estimate:
        """Return the answer as far as the samples prove it; `NotFound` before the first."""
        if not self._lit:
            return NotFound(mean_deg=self._limits.centre_deg, reason="nothing has been measured yet")
        return answer_of(
            self._analysis,
            others=self._others,
            spent=self._range_swept or self._asked >= min(self._budget, SURVEY_UNTIL),
            tolerance=self._tolerance,
            weaker_than_predicted=self._confirmation_failure,
            more="take more acquisitions" if self._left_deg != [] else "record smaller steps",
        )

    @property
    def belief(self) -> Belief | None:
        """What is believed of the marker's angle, for a picture of it; None before the first sample."""
        if not self._lit:
            return None
        posterior = self._analysis.sources[0].posterior
        return belief_of(posterior, limits=self._limits, floor=FLOOR_SNR, detected=self._analysis.detected)

    @property
    def progress(self) -> Progress | None:
        """How well the strongest source is known, for a decision; None before one is detected."""
        if not self._lit or not self._analysis.detected:
            return None
        first = self._decisive.first
        return None if first.missing is not None else self._progress_of(first)

    def progress_near(self, other: Posterior) -> Progress | None:
        """Return how well the source is known here that is the strongest of another posterior.

        None if it is not detected.
        """
        if self.progress is None or other.progress is None:
            return None
        theirs = other._analysis.first
        own = [
            each
            for each in self._analysis.sources
            if each.missing is None
            and (each.source is None or theirs.source is None or each.source.same_position(theirs.source))
        ]
        near = min(own, key=lambda each: abs(each.posterior.mean_deg - theirs.posterior.mean_deg), default=None)
        return None if near is None else self._progress_of(near)

    def _progress_of(self, first: Candidate) -> Progress:
        return Progress(
            mean_deg=first.posterior.mean_deg,
            sigma_deg=first.posterior.centre_sigma_deg,
            fwhm_deg=first.posterior.fwhm_deg,
            target_deg=self._needed_sigma_deg(first),
        )

    @property
    def _decisive(self) -> Analysis:
        """What the samples say so far, for a decision of the search: later analyses grow from this one.

        What only looks at the search takes `_analysis`, and changes nothing of what follows.
        """
        analysis = self._analysis
        self._inference = analysis.grown
        return analysis

    @property
    def _analysis(self) -> Analysis:
        """What the samples say so far."""
        if self._cached is None:
            self._cached = Analysis(
                later(self.lit, self._delay_s),
                self._dark,
                inference=self._inference,
                limits=self._limits,
                single=self.single,
                expected=self._expected if self.is_narrowed else None,
            )
        return self._cached

    def _next_deg(self) -> float | None:
        wanted_deg = self._wanted_deg()
        if self.doubts_near(at_end=wanted_deg is None):
            self.widen()
            wanted_deg = self._wanted_deg()
        if wanted_deg is not None and self._by_hand is not None:
            wanted_deg = step_near_deg(wanted_deg, limits=self._limits, step_deg=self._by_hand.step_deg)
        if self._left_deg is None or wanted_deg is None:
            return wanted_deg
        # Of two as near the lower one: which is nearer by less than a readback repeats must not choose.
        return min(
            self._left_deg, key=lambda angle_deg: (round(abs(angle_deg - wanted_deg), 2), angle_deg), default=None
        )

    def _wanted_deg(self) -> float | None:
        """Return the next angle in degrees, whether it can be measured or not; None at the end."""
        if self._asked >= self._budget:
            return None
        # Three samples near the marker say more about it than one sample where the prior does not expect it.
        if not self._lit or not self._analysis.detected or (self.is_narrowed and len(self._lit) < MIN_SAMPLES):
            return self._detection_deg()
        first = self._decisive.first
        if len(self._lit) < MIN_ACQUISITIONS or self._comes_first(first):
            return self._informative_deg(first)
        return self._remaining_deg()

    def _comes_first(self, source: Candidate) -> bool:
        """Return whether the angle of a source has to be known better before others are looked for."""
        # One beyond an end may never be known well enough, however often it is measured, and another may be the marker.
        patience = self.single or source.seen < OFTEN or self._budget - self._asked > SURVEY_RESERVE
        enough_deg = max(KNOWN_SIGMA_DEG, self._needed_sigma_deg(source))
        return source.posterior.centre_sigma_deg > enough_deg and patience

    def _remaining_deg(self) -> float | None:
        """Return the next angle once the strongest source is known, in degrees; None if the search is done."""
        first = self._analysis.sources[0]
        target_deg = self._needed_sigma_deg(first)
        imprecise = first.posterior.centre_sigma_deg > target_deg
        angle_deg = self._other_source_deg(first, imprecise=imprecise)
        if angle_deg is not None:
            return angle_deg
        if not first.measured:
            return self._limits.nearest(first.posterior.mean_deg)
        if imprecise:
            return self._informative_deg(first)
        answer = self.estimate()
        if isinstance(answer, Found):
            return self._flank_again_deg(first)
        rivalled = isinstance(answer, Ambiguous) and bool(rivals_of(self._analysis.sources))
        # More samples cannot help where the centre is known far better than the marker beside it.
        narrow = (
            isinstance(answer, Unsure)
            and answer.doubt == "width"
            and first.posterior.centre_sigma_deg <= target_deg / 2
        )
        return None if rivalled or narrow else self._informative_deg(first)

    def _flank_again_deg(self, source: Candidate) -> float | None:
        """Return the angle of a flank that is measured again before the search ends, in degrees; None without one.

        It shows a motion just along the turn, where frames show none of it.
        """
        motion = source.posterior.motion
        if self._left_deg is not None or self._range_swept or motion is None or not motion.looked_at:
            return None
        # Cameras see all of a motion, and tissue that is stated to rest has none.
        followed = any(sample.displacement is not None for sample in source.samples)
        if followed or motion.rests:
            return None
        return flank_again_deg(source.posterior, source.samples)

    def _needed_sigma_deg(self, source: Candidate) -> float:
        """Return the standard deviation with which the centre of a source's curve is known well enough, in degrees."""
        tolerated_deg = self._tolerance.half_width_deg(marker_radius_m(source.samples))
        return min(self._target_deg, tolerated_deg / TOLERATED_SIGMAS)

    def _other_source_deg(self, first: Candidate, *, imprecise: bool) -> float | None:
        """Return the next angle to look for another source than the strongest, in degrees; None if none is left."""
        known = self._analysis
        if known.unresolved_rival is not None:
            return self._another_look_deg(*known.unresolved_rival)
        if self.single:
            return None
        doubtful_deg = known.asymmetric_deg(first)
        # Another source comes before more precision, for it may be the marker. The survey comes after it, for the
        # amplitude and width that it assumes are known better then.
        if doubtful_deg is not None or (imprecise and self._budget - self._asked > SURVEY_RESERVE):
            return doubtful_deg
        if known.survey is not None and self._is_surveyed_further(known.survey):
            return known.survey.next_deg
        if first.has_positions:
            return None
        # Intensities alone do not resolve two sources that are near one another.
        wanted_deg = top_deg(first.posterior, known.measured_deg)
        return wanted_deg if wanted_deg is not None and wanted_deg in self._limits else None

    def _is_surveyed_further(self, survey: Survey) -> bool:
        """Return whether another source may still be the marker, and an acquisition would say enough of it."""
        probability = hidden_probability(survey, others=self._others)
        # A confirmation changes the amplitude by a little; it does not begin the survey again.
        worth = 0.0 if self._confirmation_taken or self._range_swept else self._others * survey.gain
        if self._range_swept or self._asked >= SURVEY_UNTIL:
            # Frames show another source from afar, by its place; intensities only where it is the stronger of the two.
            gap = not self._analysis.sources[0].has_positions and worth > max(WORTH, LATE_WORTH * probability)
            return probability > STATED or gap
        return probability > STATED or worth > WORTH

    def _another_look_deg(self, source: Candidate, hidden_deg: float | None) -> float:
        """Return the next angle for a source other than the strongest, in degrees; its top may be hidden."""
        strongest_deg = max(source.samples, key=lambda sample: sample.reading.intensity).angle_deg
        beside = sum(abs(angle_deg - strongest_deg) <= BESIDE_DEG for angle_deg in self._analysis.measured_deg)
        if beside > 1 or (source.source is not None and source.seen > 1):
            if hidden_deg is None and not source.measured and source.posterior.centre_sigma_deg <= KNOWN_SIGMA_DEG:
                return self._limits.nearest(source.posterior.mean_deg)
            return self._informative_deg(source) if hidden_deg is None else hidden_deg
        # Seen once it may be a burst: beside that angle it is seen again, or is none.
        inwards = 1 if strongest_deg < self._limits.centre_deg else -1
        return strongest_deg + inwards * min(0.9 * BESIDE_DEG, self._limits.width_deg / 4)

    def _informative_deg(self, source: Candidate) -> float:
        return most_informative_deg(
            source.posterior,
            self._analysis.measured_deg,
            limits=self._limits,
            floor=FLOOR_SNR,
            by_hand=self._by_hand,
        )

    def _detection_deg(self) -> float:
        """Return the next angle while nothing is detected, in degrees."""
        measured_deg = self._analysis.measured_deg
        noise = self._analysis.noise
        since_deg = measured_deg[self._before :]
        if len(since_deg) < len(PLAN) or noise.floor.level is None or not noise.sigma:
            plan = PLAN if self._by_hand is None else PLAN_BY_HAND
            return planned_deg(since_deg, limits=self._searched, descending=self._descending, plan=plan)
        level = noise.floor.level / noise.sigma
        return most_detectable_deg(
            self._decisive.first.posterior,
            measured_deg,
            limits=self._limits,
            level=level,
            by_hand=self._by_hand,
        )
