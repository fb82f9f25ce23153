"""Which answer the samples prove: `Found`, `NotFound`, `Ambiguous`, `AtBound` or `Unsure`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from markerseek.core import (
    MAX_INTENSITY,
    MIN_INTENSITY,
    Ambiguous,
    AtBound,
    Estimate,
    Float64,
    Found,
    Interval,
    MarkerCurve,
    NotFound,
    Sample,
    Tolerance,
)
from markerseek.search.evidence import KNOWN_SIGMA_DEG, beyond_tolerance, marker_radius_m, with_half_width
from markerseek.search.floor import SearchNoise
from markerseek.search.posterior.candidates import BESIDE_DEG, LOUDER_SIGMAS, MEASURED_SHARE, RIVAL_DB, Candidate
from markerseek.search.posterior.inference import AnglePosterior, modes_deg
from markerseek.search.posterior.shapes import log_curve
from markerseek.search.posterior.survey import (
    NARROW_DEG,
    STATED,
    USUAL_KNEE,
    USUAL_TAIL,
    Survey,
    hidden_probability,
    missed_marker,
)

UNRESOLVED_BEYOND = 0.1
"""Probability of lying beyond an end of the range from which an uncertain angle is answered as `AtBound`."""

RIVAL_SIGMAS = 1.0
"""Standard deviations of the ratio of two loudnesses within which a source is a rival: at two, one 10 dB weaker was."""

GAP_ANGLES = 41
"""Places of a hidden top that are tried in a gap."""

SHOULDER_SHARE = 0.5
"""Share of its strongest sample from which others may lie on a shoulder beside the top of a source."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SearchState:
    """All that follows from the samples so far."""

    noise: SearchNoise
    sources: Sequence[Candidate]
    """The sources, the strongest first, at least one."""
    survey: Survey | None
    """Survey of the range; None if not known."""
    misfit: str | None
    """Result of `predictive_check` for the strongest source."""
    unresolved_rival: tuple[Candidate, float | None] | None
    """None if there is one source only."""


def ranked(sources: Sequence[Candidate]) -> list[Candidate]:
    """Return the sources, the strongest first; those whose angle or existence is not known come last."""
    # While a source is only seen from far away, its strength may come out as anything.
    return sorted(sources, key=lambda each: (each.missing is not None, not each.known, -each.log_snr))


def rivals_of(sources: Sequence[Candidate]) -> list[Candidate]:
    """Return the sources that may be the marker instead of the strongest: about as strong, and at another angle.

    A source whose strength is not known is not among them; it is unresolved.
    """
    first, *others = sources
    present = [each for each in others if each.missing is None and each.loudness_known and each.apart_from(first)]
    return [each for each in present if _may_be_as_loud(each, first, by_db=-RIVAL_DB, sigmas=RIVAL_SIGMAS)]


def _may_be_as_loud(source: Candidate, first: Candidate, *, by_db: float, sigmas: float = LOUDER_SIGMAS) -> bool:
    """Whether a source may be the marker instead of the strongest.

    A source beyond an end of the range counts with the strength seen in the range, because the marker is in the range.
    """
    if source.beyond:
        seen = max(sample.reading.intensity for sample in source.samples) / source.posterior.sigma
        return seen > math.exp(first.log_snr) * 10 ** (by_db / 20)
    return source.may_be_stronger_than(first, by_db=by_db, sigmas=sigmas)


def unresolved_rival(
    sources: Sequence[Candidate], measured_deg: Sequence[float], *, limits: Interval, by_db: float = -RIVAL_DB
) -> tuple[Candidate, float | None] | None:
    """Return a source that may still be the marker, because too little is known of it; None without one.

    With it comes the angle at which its top may have been missed, in degrees; None if not known.

    ``sources``: the sources, the loudest first. ``measured_deg``: angles measured so far. ``by_db``: loudness over the
    loudest from which one is a rival, in dB.
    """
    first, *others = sources
    for each in others:
        # At the angle of the loudest it does not matter which of the two is the marker.
        if each.measured and not each.apart_from(first):
            continue
        top_deg = missed_peak_deg(first, each, measured_deg, limits=limits, by_db=by_db)
        if top_deg is not None or (not each.known and _may_be_as_loud(each, first, by_db=by_db)):
            return each, top_deg
    return None


def missed_peak_deg(
    first: Candidate, other: Candidate, measured_deg: Sequence[float], *, limits: Interval, by_db: float = -RIVAL_DB
) -> float | None:
    """Return an angle at which a narrow top of another source may have been missed, in degrees; None without one.

    Its strong samples may lie on the flank of a narrow curve, or on the shoulders of it, and its top in a gap beside
    them.

    ``first``, ``other``: the loudest source, and another. ``measured_deg``: angles measured so far. ``by_db``: least
    loudness of that top over the loudest, in dB.
    """
    strongest = max(sample.reading.intensity for sample in other.samples)
    strong = [sample for sample in other.samples if sample.reading.intensity >= SHOULDER_SHARE * strongest]
    strong.sort(key=lambda sample: -sample.reading.intensity)
    return top_beside_deg(first, other, strong, measured_deg, limits=limits, by_db=by_db)


def top_beside_deg(
    first: Candidate,
    other: Candidate,
    beside: Sequence[Sample],
    measured_deg: Sequence[float],
    *,
    limits: Interval,
    by_db: float = -RIVAL_DB,
) -> float | None:
    """Return an angle in a gap beside some samples at which a top may have been missed, in degrees; None without one.

    The curve posited there is as narrow as any, no weaker than ``by_db`` over the loudest, and no stronger at either
    end of the gap than what was measured of the source there.

    ``beside``: samples of ``other``.
    """
    log_least = first.log_snr + by_db * math.log(10) / 20
    ends_deg = {1: limits.high_deg, -1: limits.low_deg}
    # A reading of nothing, as in a table with zeros, has no flank of a curve beside it.
    for edge, side in product([each for each in beside if each.reading.intensity > 0], ends_deg):
        beyond = [each for each in measured_deg if side * (each - edge.angle_deg) > 0]
        neighbour_deg = min(beyond, key=lambda each: abs(each - edge.angle_deg), default=ends_deg[side])
        gap_deg = abs(neighbour_deg - edge.angle_deg)
        away_deg = np.linspace(0.0, gap_deg, GAP_ANGLES)
        highest = np.log(edge.reading.intensity) - _narrow(away_deg)
        for there in other.samples:
            if there.angle_deg == neighbour_deg and there.reading.intensity > 0:
                highest = np.minimum(highest, np.log(there.reading.intensity) - _narrow(gap_deg - away_deg))
        hidden = away_deg[highest - math.log(other.posterior.sigma) > log_least]
        if hidden.size:
            angle_deg = edge.angle_deg + side * float(hidden.mean())
            # Beside a sample nothing is hidden, however loud.
            if min(abs(angle_deg - each) for each in measured_deg) > BESIDE_DEG / 2:
                return angle_deg
    return None


def _narrow(away_deg: Float64[np.ndarray, " angles"]) -> Float64[np.ndarray, " angles"]:
    """Ln of the narrowest usual curve at distances from its top, in degrees."""
    return log_curve(away_deg, fwhm_deg=NARROW_DEG, tail=USUAL_TAIL, knee=USUAL_KNEE)


def answer_of(
    lit: Sequence[Sample],
    state: SearchState,
    *,
    limits: Interval,
    others: float,
    spent: bool,
    tolerance: Tolerance,
    weaker_than_predicted: str | None,
    more: str = "take more acquisitions",
) -> Estimate:
    """Return the answer.

    ``lit``: samples with the laser on, at least one. ``others``: prior probability that there is another source as
    loud; 0: nothing else can be the marker. ``spent``: whether so many acquisitions are made that what may still hide
    is stated, and no veto. ``tolerance``: how well the angle must be known. ``weaker_than_predicted``: why the
    acquisition at the angle found does not confirm it; None if it does, or was not made. ``more``: how to have more
    samples than these, for a person.
    """
    first = state.sources[0]
    posterior, floor = first.posterior, state.noise.floor
    mean_deg = limits.nearest(posterior.mean_deg)
    if first.missing is not None:
        reason = first.missing + missed_marker(lit, state.noise, limits)
        return NotFound(mean_deg=mean_deg, reason=reason, floor=floor)
    beside = [each.as_other_source(first) for each in state.sources[1:] if each.missing is None and each.loudness_known]
    further = tuple(sorted(beside, key=lambda each: -each.relative_db))
    surveyed = None if state.survey is None else state.survey.surveyed
    probability = other_probability(state, others=others)
    # With a prior of a single source, the strongest is the marker. A source that is not known enough may be stronger.
    settled = first.loudness_known and (spent or state.unresolved_rival is None)
    rivals = rivals_of(state.sources) if others and settled else []
    side = _side(posterior, limits)
    # How loud a source beyond an end is cannot be measured: one inside may as well be the marker.
    if side is not None and not rivals:
        return AtBound(
            mean_deg=mean_deg,
            side=side,
            floor=floor,
            others=further,
            surveyed=surveyed,
            sigma_deg=posterior.sigma_deg,
            interval95_deg=first.interval95_deg,
            interval_kind="posterior",
        )
    at_rivals = (mean_deg, *(limits.nearest(each.posterior.mean_deg) for each in rivals))
    modes = at_rivals if rivals else modes_deg(posterior, limits=limits)
    # A rival has been measured.
    places = (mean_deg,) if rivals or len(modes) < 2 else modes
    unmeasured = _unmeasured(first, places, [sample.angle_deg for sample in lit], more=more)
    if unmeasured is None and (rivals or (len(modes) > 1 and others)):
        return Ambiguous(
            mean_deg=modes[0],
            modes_deg=modes,
            floor=floor,
            others=further,
            surveyed=surveyed,
            sigma_deg=posterior.sigma_deg,
            interval95_deg=first.interval95_deg,
            interval_kind="posterior",
        )
    radius_m = marker_radius_m(first.samples)
    found = Found(
        mean_deg=mean_deg,
        sigma_deg=posterior.sigma_deg,
        interval95_deg=first.interval95_deg,
        interval_kind="posterior",
        floor=floor,
        others=further,
        surveyed=surveyed,
        other_probability=probability,
        curve=_curve(first),
    )
    found = with_half_width(found, radius_m=radius_m)
    # An answer that is unsure for its width alone is of the marker: registration takes it.
    other = weaker_than_predicted or unmeasured or state.misfit
    if other is None and probability > STATED:
        other = _other(
            state, probability, more=f"{more}{', or state that there is a single source (--single)' if others else ''}"
        )
    if other is not None:
        return found.as_unsure("source", other)
    too_wide = beyond_tolerance(found, tolerance, radius_m=radius_m)
    return found if too_wide is None else found.as_unsure("width", f"{too_wide}; {_cure(posterior, more=more)}")


def _curve(source: Candidate) -> MarkerCurve | None:
    """Width and height of a source's curve; None of intensities that no reader returns."""
    peak = source.posterior.sigma * math.exp(source.log_snr)
    if not MIN_INTENSITY <= peak <= MAX_INTENSITY:
        return None
    return MarkerCurve(fwhm_deg=source.posterior.fwhm_deg, peak=peak)


def _cure(posterior: AnglePosterior, *, more: str) -> str:
    """What makes the angle better known."""
    if posterior.centre_sigma_deg > posterior.sigma_deg / 2:
        return f"{more} or average more pulses"
    return (
        "more acquisitions will not narrow it: the source is not known to be a point, and a spot may lie beside the "
        "centre of its curve; light or stain a smaller spot, or tolerate more"
    )


def other_probability(state: SearchState, *, others: float) -> float:
    """Probability that another source is the marker: one that still hides, or one that was seen and may be louder.

    ``others``: prior probability of a second source as strong.
    """
    first, *seen = state.sources
    none = 1.0 - (others if state.survey is None else hidden_probability(state.survey, others=others))
    for each in seen:
        none *= 1.0 - _louder_probability(each, first)
    if state.unresolved_rival is not None:
        # A source that is not known enough may be as strong as one that was not seen.
        none *= 1.0 - max(others, state.unresolved_rival[0].louder_probability(first))
    return 1.0 - none


def _unmeasured(source: Candidate, modes: Sequence[float], measured_deg: Sequence[float], *, more: str) -> str | None:
    """Where the marker may be and was not measured, and what to do about it; None if it was measured everywhere."""
    near_deg = MEASURED_SHARE * source.posterior.fwhm_deg
    left_deg = [each for each in modes if min(abs(each - at) for at in measured_deg) > near_deg]
    if not left_deg:
        return None
    return f"the marker may be near {' or '.join(f'{each:.1f}' for each in left_deg)} deg, not measured so far; {more}"


def _louder_probability(source: Candidate, first: Candidate) -> float:
    """Probability that a source that was seen is the louder one of two, and another one at all."""
    if source.missing is not None or not source.apart_from(first):
        return 0.0
    return source.louder_probability(first) if _may_be_as_loud(source, first, by_db=-RIVAL_DB) else 0.0


def _other(state: SearchState, probability: float, *, more: str) -> str:
    """Why another source may be the marker, and what to do about it."""
    said = f"the probability that another source is the marker is {100 * probability:.2g} %"
    cure = more
    if state.unresolved_rival is not None:
        return f"{said}: a source near {state.unresolved_rival[0].posterior.mean_deg:.0f} deg may be as strong; {cure}"
    first, *seen = state.sources
    louder = max(seen, key=lambda each: _louder_probability(each, first), default=first)
    if _louder_probability(louder, first) > probability / 2:
        return f"{said}: the source at {louder.posterior.mean_deg:.1f} deg may be stronger; {cure}"
    if state.survey is None:
        return f"{said}: the range has not been surveyed; {cure}"
    return (
        f"{said}: only {100 * state.survey.surveyed:.0f} % of the range is checked for a second source as strong, "
        f"which may be missed near {state.survey.hidden_deg:.0f} deg; {cure}"
    )


def _side(posterior: AnglePosterior, limits: Interval) -> Literal["low", "high"] | None:
    """The end of the range beyond which the marker probably lies, or may lie where its angle is uncertain."""
    least = 0.5 if posterior.sigma_deg <= KNOWN_SIGMA_DEG else UNRESOLVED_BEYOND
    below = float(posterior.probability[posterior.angle_deg < limits.low_deg].sum())
    above = float(posterior.probability[posterior.angle_deg > limits.high_deg].sum())
    if max(below, above) <= least:
        return None
    return "low" if below > above else "high"
