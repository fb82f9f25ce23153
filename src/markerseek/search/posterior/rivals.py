"""Which sources may be the marker beside the strongest, and where the top of one may have been missed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from markerseek.core import Float64, Interval, Sample
from markerseek.search.curve import log_curve
from markerseek.search.posterior.sources import BESIDE_DEG, RIVAL_DB, Candidate
from markerseek.search.posterior.survey import NARROW_DEG, USUAL_KNEE, USUAL_TAIL

STRONGER_SIGMAS = 2.0
"""Standard deviations of the ratio of two strengths by which one must exceed the other to be the stronger."""

RIVAL_SIGMAS = 1.0
"""Standard deviations of the ratio of two strengths within which a source is a rival: at two, one 10 dB weaker was."""

GAP_ANGLES = 41
"""Places of a hidden top that are tried in a gap."""

SHOULDER_SHARE = 0.5
"""Share of its strongest sample from which others may lie on a shoulder beside the top of a source."""


def ranked(sources: Sequence[Candidate]) -> list[Candidate]:
    """Return the sources, the strongest first.

    Those whose angle or existence is not known come last, but for one that was measured and is far stronger than any
    whose angle is known.
    """
    # While a source is only seen from far away, its strength may come out as anything.
    first, *others = sorted(sources, key=lambda each: (each.missing is not None, not each.known, -each.log_snr))
    stronger = [
        each
        for each in others
        if each.missing is None and each.strength_known and not each.beyond and _is_far_stronger(each, first)
    ]
    strongest = max(stronger, key=lambda each: each.log_snr, default=first)
    return [strongest, *(each for each in (first, *others) if each is not strongest)]


def _is_far_stronger(source: Candidate, other: Candidate) -> bool:
    """Return whether a source is so much stronger that the other cannot be the marker."""
    return source.relative_db(other) - RIVAL_SIGMAS * _spread_db(source, other) > RIVAL_DB


def _spread_db(source: Candidate, other: Candidate) -> float:
    """Return the standard deviation of the ratio of two strengths, in dB."""
    return math.hypot(source.log_snr_sigma, other.log_snr_sigma) * 20 / math.log(10)


def rivals_of(sources: Sequence[Candidate]) -> list[Candidate]:
    """Return the sources that may be the marker instead of the strongest: about as strong, and at another angle.

    A source whose strength is not known is not among them; it is unresolved.
    """
    first, *others = sources
    present = [each for each in others if each.missing is None and each.strength_known and each.apart_from(first)]
    return [each for each in present if may_be_as_strong(each, first, by_db=-RIVAL_DB, sigmas=RIVAL_SIGMAS)]


def may_be_as_strong(source: Candidate, first: Candidate, *, by_db: float, sigmas: float = STRONGER_SIGMAS) -> bool:
    """Return whether a source may be the marker instead of the strongest.

    A source beyond an end of the range counts with the strength seen in the range, because the marker is in the range.
    """
    if source.beyond:
        seen = max(sample.reading.intensity for sample in source.samples) / source.posterior.sigma
        return seen > math.exp(first.log_snr) * 10 ** (by_db / 20)
    return source.relative_db(first) + sigmas * _spread_db(source, first) > by_db


def rival_probability(source: Candidate, first: Candidate) -> float:
    """Return the probability that a source that was seen is the stronger one of two, and another one at all."""
    if source.missing is not None or not source.apart_from(first):
        return 0.0
    return source.stronger_probability(first) if may_be_as_strong(source, first, by_db=-RIVAL_DB) else 0.0


def unresolved_rival(
    sources: Sequence[Candidate], measured_deg: Sequence[float], *, limits: Interval, by_db: float = -RIVAL_DB
) -> tuple[Candidate, float | None] | None:
    """Return a source that may still be the marker, because too little is known of it; None without one.

    With it comes the angle at which its top may have been missed, in degrees; None if not known.

    ``sources``: the sources, the strongest first. ``measured_deg``: angles measured so far. ``by_db``: strength over
    the strongest from which one is a rival, in dB.
    """
    first, *others = sources
    for each in others:
        # At the angle of the strongest it does not matter which of the two is the marker.
        if each.measured and not each.apart_from(first):
            continue
        top_deg = missed_peak_deg(first, each, measured_deg, limits=limits, by_db=by_db)
        if top_deg is not None or (not each.known and may_be_as_strong(each, first, by_db=by_db)):
            return each, top_deg
    return None


def missed_peak_deg(
    first: Candidate, other: Candidate, measured_deg: Sequence[float], *, limits: Interval, by_db: float = -RIVAL_DB
) -> float | None:
    """Return an angle at which a narrow top of another source may have been missed, in degrees; None without one.

    Its strong samples may lie on the flank of a narrow curve, or on the shoulders of it, and its top in a gap beside
    them.

    ``first``, ``other``: the strongest source, and another. ``measured_deg``: angles measured so far. ``by_db``: least
    strength of that top over the strongest, in dB.
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

    The curve posited there is as narrow as any, no weaker than ``by_db`` over the strongest, and no stronger at either
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
            # Beside a sample nothing is hidden, however strong.
            if min(abs(angle_deg - each) for each in measured_deg) > BESIDE_DEG / 2:
                return angle_deg
    return None


def _narrow(away_deg: Float64[np.ndarray, " angles"]) -> Float64[np.ndarray, " angles"]:
    """Return ln of the narrowest usual curve at distances from its top, in degrees."""
    return log_curve(away_deg, fwhm_deg=NARROW_DEG, tail=USUAL_TAIL, knee=USUAL_KNEE)
