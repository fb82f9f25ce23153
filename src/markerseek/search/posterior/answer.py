"""Which answer the samples prove: `Found`, `NotFound`, `Ambiguous`, `AtBound` or `Unsure`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np

from markerseek.core import (
    LEAST_INTENSITY,
    MOST_INTENSITY,
    Ambiguous,
    AtBound,
    Estimate,
    Float64,
    Found,
    Interval,
    MarkerCurve,
    NotFound,
    Sample,
)
from markerseek.search.checked import SIGMA_LIMIT_DEG
from markerseek.search.floor import SearchNoise
from markerseek.search.posterior.angle_posterior import AnglePosterior, modes_deg
from markerseek.search.posterior.candidates import BESIDE_DEG, RIVAL_DB, Candidate
from markerseek.search.posterior.detectability import NARROW_DEG, missed_marker
from markerseek.search.posterior.shapes import log_curve
from markerseek.search.posterior.survey import SURVEYED, Survey

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
    """All that follows from the samples so far.

    Attributes
    ----------
    noise
        Noise of the search.
    sources
        The sources, the loudest first, at least one.
    survey
        What may still hide; None where it is not known.
    misfit
        Why the curve does not explain the samples of the loudest; None if it does.
    unresolved
        From `unresolved`; None where there is one source only.
    """

    noise: SearchNoise
    sources: Sequence[Candidate]
    survey: Survey | None
    misfit: str | None
    unresolved: tuple[Candidate, float | None] | None


def ranked(sources: Sequence[Candidate]) -> list[Candidate]:
    """Return the sources with the loudest first, those behind of which angle or existence are not known."""
    # While a source is seen from far only, its loudness may come out as anything.
    return sorted(
        sources,
        key=lambda each: (each.missing is not None, each.posterior.centre_sigma_deg > SIGMA_LIMIT_DEG, -each.loudness),
    )


def rivals_of(sources: Sequence[Candidate]) -> list[Candidate]:
    """Return the sources that may be the marker as well as the loudest: about as loud, and at another angle."""
    first, *others = sources
    present = [each for each in others if each.missing is None and each.apart_from(first)]
    return [each for each in present if each.may_exceed(first, by_db=-RIVAL_DB, sigmas=RIVAL_SIGMAS)]


def unresolved(
    sources: Sequence[Candidate], measured_deg: Sequence[float], *, limits: Interval
) -> tuple[Candidate, float | None] | None:
    """Return a source of which too little is known to say that it is not the marker; None without one.

    With it comes the angle at which its top may have been missed, in degrees; None where that is not known.

    Parameters
    ----------
    sources
        The sources, the loudest first.
    measured_deg
        Angles measured so far, in degrees.
    limits
        Range of the search.
    """
    first, *others = sources
    for each in others:
        top_deg = hidden_top_deg(first, each, measured_deg, limits=limits)
        unknown = each.posterior.centre_sigma_deg > SIGMA_LIMIT_DEG and each.may_exceed(first, by_db=-RIVAL_DB)
        if unknown or top_deg is not None:
            return each, top_deg
    return None


def hidden_top_deg(
    first: Candidate, other: Candidate, measured_deg: Sequence[float], *, limits: Interval
) -> float | None:
    """Return an angle at which a narrow top of another source may have been missed, in degrees; None without one.

    Its strong samples may lie on the flank of a narrow curve, or on the shoulders of it, and its top in a gap beside
    them. The curve posited there is as narrow as any, no weaker than `RIVAL_DB` below the loudest, and no stronger at
    either end of the gap than what was measured of the source there.

    Parameters
    ----------
    first, other
        The loudest source, and another.
    measured_deg
        Angles measured so far, in degrees.
    limits
        Range of the search.
    """
    strongest = max(sample.reading.intensity for sample in other.samples)
    strong = [sample for sample in other.samples if sample.reading.intensity >= SHOULDER_SHARE * strongest]
    log_least = first.loudness - RIVAL_DB * math.log(10) / 20
    ends_deg = {1: limits.high_deg, -1: limits.low_deg}
    for edge, side in product(sorted(strong, key=lambda sample: -sample.reading.intensity), ends_deg):
        beyond = [each for each in measured_deg if side * (each - edge.angle_deg) > 0]
        beside_deg = min(beyond, key=lambda each: abs(each - edge.angle_deg), default=ends_deg[side])
        gap_deg = abs(beside_deg - edge.angle_deg)
        away_deg = np.linspace(0.0, gap_deg, GAP_ANGLES)
        highest = np.log(edge.reading.intensity) - _narrow(away_deg)
        for there in other.samples:
            if there.angle_deg == beside_deg and there.reading.intensity > 0:
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
    return log_curve(away_deg, fwhm_deg=NARROW_DEG, tail=1.2, knee=2.4)


def answer_of(
    lit: Sequence[Sample], state: SearchState, *, limits: Interval, single: bool, weaker_than_predicted: str | None
) -> Estimate:
    """Return the answer.

    Parameters
    ----------
    lit
        Samples with the laser on, at least one.
    state
        What follows from them.
    limits
        Range of the search.
    single
        Whether there is one source only, so that nothing else can be the marker.
    weaker_than_predicted
        Why the acquisition at the angle found does not confirm it; None if it does, or was not made.
    """
    first = state.sources[0]
    posterior, floor = first.posterior, state.noise.floor
    mean_deg = limits.nearest(posterior.mean_deg)
    if first.missing is not None:
        reason = first.missing + missed_marker(lit, state.noise, limits)
        return NotFound(mean_deg=mean_deg, reason=reason, floor=floor)
    others = tuple(each.beside(first) for each in state.sources[1:] if each.missing is None)
    surveyed = None if state.survey is None else state.survey.share
    rivals = rivals_of(state.sources)
    side = _side(posterior, limits)
    # How loud a source beyond an end is cannot be measured: one inside may as well be the marker.
    if side is not None and not rivals:
        return AtBound(mean_deg=mean_deg, side=side, floor=floor, others=others, surveyed=surveyed)
    at_rivals = (mean_deg, *(limits.nearest(each.posterior.mean_deg) for each in rivals))
    modes = at_rivals if rivals else modes_deg(posterior, limits=limits)
    if len(modes) > 1:
        return Ambiguous(mean_deg=modes[0], modes_deg=modes, floor=floor, others=others, surveyed=surveyed)
    doubt = _uncertain(posterior) or weaker_than_predicted or state.misfit or (None if single else _hidden(state))
    found = Found(
        mean_deg=mean_deg,
        sigma_deg=posterior.sigma_deg,
        interval95_deg=first.interval95_deg,
        interval_kind="posterior",
        floor=floor,
        others=others,
        surveyed=surveyed,
        curve=_curve(first),
    )
    return found if doubt is None else found.doubted(doubt)


def _curve(source: Candidate) -> MarkerCurve | None:
    """Width and height of a source's curve; None of intensities that no reader returns."""
    peak = source.posterior.sigma * math.exp(source.loudness)
    if not LEAST_INTENSITY <= peak <= MOST_INTENSITY:
        return None
    return MarkerCurve(fwhm_deg=source.posterior.fwhm_deg, peak=peak)


def _uncertain(posterior: AnglePosterior) -> str | None:
    """Why the angle is not known well enough; None if it is."""
    if posterior.sigma_deg <= SIGMA_LIMIT_DEG:
        return None
    limit = f"the standard deviation, {posterior.sigma_deg:.2f} deg, is above {SIGMA_LIMIT_DEG:g} deg"
    if posterior.centre_sigma_deg <= SIGMA_LIMIT_DEG:
        return (
            f"{limit}: the centre of the curve is known to {posterior.centre_sigma_deg:.2f} deg, but the source is not "
            "known to be a point, and a spot may lie beside that centre; light or stain a smaller spot"
        )
    return f"{limit}; take more acquisitions or average more pulses"


def _hidden(state: SearchState) -> str | None:
    """Why another source may be the marker; None if none can."""
    if state.unresolved is not None:
        other, _ = state.unresolved
        return (
            f"another source, near {other.posterior.mean_deg:.0f} deg, may be as loud; take more acquisitions, or "
            "state that there is a single source"
        )
    survey = state.survey
    if survey is None or survey.share >= SURVEYED:
        return None
    return (
        f"a source as loud would have been detected in {100 * survey.share:.0f} % of the range only, and may be missed "
        f"near {survey.hidden_deg:.0f} deg; take more acquisitions, or state that there is a single source"
    )


def _side(posterior: AnglePosterior, limits: Interval) -> Literal["low", "high"] | None:
    """The end of the range beyond which the marker probably lies, or may lie where its angle is uncertain."""
    least = 0.5 if posterior.sigma_deg <= SIGMA_LIMIT_DEG else UNRESOLVED_BEYOND
    below = float(posterior.share[posterior.angle_deg < limits.low_deg].sum())
    above = float(posterior.share[posterior.angle_deg > limits.high_deg].sum())
    if max(below, above) <= least:
        return None
    return "low" if below > above else "high"
