"""Which answer the samples of a search prove: `Found`, `NotFound`, `Ambiguous`, `AtBound` or `Unsure`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

from markerseek.core import (
    MAX_INTENSITY,
    MIN_INTENSITY,
    Ambiguous,
    AtBound,
    Estimate,
    Found,
    Interval,
    MarkerCurve,
    NotFound,
    Tolerance,
)
from markerseek.search.evidence import (
    KNOWN_SIGMA_DEG,
    beyond_tolerance,
    inconsistency,
    marker_radius_m,
    with_half_width,
)
from markerseek.search.posterior.analysis import MEASURED_SHARE, Analysis
from markerseek.search.posterior.angle_posterior import AnglePosterior, modes_deg
from markerseek.search.posterior.rivals import rival_probability, rivals_of
from markerseek.search.posterior.sources import Candidate
from markerseek.search.posterior.survey import STATED, hidden_probability, missed_marker

UNRESOLVED_BEYOND = 0.1
"""Probability of lying beyond an end of the range from which an uncertain angle is answered as `AtBound`."""


def answer_of(
    known: Analysis,
    *,
    others: float,
    spent: bool,
    tolerance: Tolerance,
    weaker_than_predicted: str | None,
    more: str = "take more acquisitions",
) -> Estimate:
    """Return the answer.

    ``others``: prior probability that there is another source as strong; 0: nothing else can be the marker. ``spent``:
    whether so many acquisitions are made that what may still hide is stated, and no veto. ``tolerance``: how well the
    angle must be known. ``weaker_than_predicted``: why the acquisition at the angle found does not confirm it; None if
    it does, or was not made. ``more``: how to have more samples than these, for a person.
    """
    first, *seen = known.sources
    posterior = first.posterior
    floor = known.noise.measured_floor
    outliers_deg = tuple(sorted(sample.angle_deg for sample in known.outliers))
    limits = known.limits
    mean_deg = limits.nearest(posterior.mean_deg)
    if first.missing is not None:
        reason = first.missing + missed_marker(known.lit, known.noise, limits)
        return NotFound(mean_deg=mean_deg, reason=reason, floor=floor, outliers_deg=outliers_deg)
    beside = [each.as_other_source(first) for each in seen if each.missing is None and each.strength_known]
    seen_so_far: dict[str, Any] = {
        "sigma_deg": posterior.sigma_deg,
        "interval95_deg": first.interval95_deg,
        "interval_kind": "posterior",
        "floor": floor,
        "others": tuple(sorted(beside, key=lambda each: -each.relative_db)),
        "surveyed": None if known.survey is None else known.survey.surveyed,
        "outliers_deg": outliers_deg,
        "motion": known.motion,
    }
    probability = other_probability(known, others=others)
    # With a prior of a single source, the strongest is the marker. A source that is not known enough may be stronger.
    settled = first.strength_known and (spent or known.unresolved_rival is None)
    rivals = rivals_of(known.sources) if others and settled else []
    side = _side(posterior, limits)
    falls = None if side is None else _falls_before(known, mean_deg=mean_deg)
    # How strong a source beyond an end is cannot be measured: one inside may as well be the marker.
    if side is not None and falls is None and not rivals:
        return AtBound(mean_deg=mean_deg, side=side, **seen_so_far)
    at_rivals = (mean_deg, *(limits.nearest(each.posterior.mean_deg) for each in rivals))
    modes = at_rivals if rivals else modes_deg(posterior, limits=limits)
    # A rival has been measured.
    places = (mean_deg,) if rivals or len(modes) < 2 else modes
    unmeasured = _unmeasured(first, places, known.measured_deg, more=more)
    if unmeasured is None and (rivals or (len(modes) > 1 and others)):
        return Ambiguous(mean_deg=modes[0], modes_deg=modes, **seen_so_far)
    from_axis_m = marker_radius_m(first.samples)
    found = Found(mean_deg=mean_deg, other_probability=probability, curve=_curve(first), **seen_so_far)
    found = with_half_width(found, radius_m=from_axis_m)
    # An answer that is unsure for its width alone is of the marker: registration takes it.
    other = weaker_than_predicted or falls or unmeasured or known.misfit or known.inconsistency
    if other is None and probability > STATED:
        other = _other(known, probability, more=f"{more}{', or state that there is a single source' if others else ''}")
    moves = _moves(known)
    if other is not None:
        return found.as_unsure("source", other if moves is None else f"{moves}; {other}")
    too_wide = beyond_tolerance(found, tolerance, radius_m=from_axis_m)
    if too_wide is None:
        return found
    return found.as_unsure("width", f"{too_wide}; {moves or _cure(posterior, more=more)}")


def _falls_before(known: Analysis, *, mean_deg: float) -> str | None:
    """Return why the strongest source is not at the end of the range, where its curve puts it; None if it may be."""
    first = known.sources[0]
    weaker = inconsistency(
        first.samples, mean_deg=mean_deg, noise=known.noise, relative_error=first.posterior.sample_error
    )
    if weaker is None:
        return None
    return f"{weaker}, and the curve of a marker is wider than that: check unit and scale of the angles"


def _moves(known: Analysis) -> str | None:
    """Return how the marker moves, and what to do about it; None where no motion was seen."""
    motion = known.motion
    if not motion.is_seen:
        return None
    ways = ((motion.depth_mm, "in depth"), (motion.lateral_mm, "along the array"))
    seen = [f"by ± {amplitude_mm:.1f} mm {way}" for amplitude_mm, way in ways if amplitude_mm]
    how = " and ".join(seen) or "along the turn, as the scatter of the samples shows"
    if motion.period_s is not None:
        how += f", about every {motion.period_s:.2g} s"
    lasts_s = known.lasts_s
    hold = "while it is searched for" if lasts_s is None else f"for the {max(lasts_s, 1.0):.0f} s of a search"
    return f"the marker moves {how}: hold the ventilation {hold}, or let cameras follow the tissue"


def _curve(source: Candidate) -> MarkerCurve | None:
    """Return the width and height of a source's curve; None of intensities that no reader returns."""
    peak = source.posterior.sigma * math.exp(source.log_snr)
    if not MIN_INTENSITY <= peak <= MAX_INTENSITY:
        return None
    return MarkerCurve(fwhm_deg=source.posterior.fwhm_deg, peak=peak)


def _cure(posterior: AnglePosterior, *, more: str) -> str:
    """Return what makes the angle better known."""
    if posterior.centre_sigma_deg > posterior.sigma_deg / 2:
        return f"{more} or average more pulses"
    return (
        "more acquisitions will not narrow it: the source is not known to be a point, and a spot may lie beside the "
        "centre of its curve; light or stain a smaller spot, or tolerate more"
    )


def other_probability(known: Analysis, *, others: float) -> float:
    """Return the probability that another source is the marker: one that hides, or a seen one that may be stronger.

    ``others``: prior probability of a second source as strong.
    """
    first, *seen = known.sources
    none = 1.0 - (others if known.survey is None else hidden_probability(known.survey, others=others))
    for each in seen:
        none *= 1.0 - rival_probability(each, first)
    if known.unresolved_rival is not None:
        # A source that is not known enough may be as strong as one that was not seen.
        none *= 1.0 - max(others, known.unresolved_rival[0].stronger_probability(first))
    return 1.0 - none


def _unmeasured(source: Candidate, modes: Sequence[float], measured_deg: Sequence[float], *, more: str) -> str | None:
    """Return where the marker may be and was not measured, and what to do about it.

    None if it was measured everywhere.
    """
    near_deg = MEASURED_SHARE * source.posterior.fwhm_deg
    left_deg = [each for each in modes if min(abs(each - at) for at in measured_deg) > near_deg]
    if not left_deg:
        return None
    return f"the marker may be near {' or '.join(f'{each:.1f}' for each in left_deg)} deg, not measured so far; {more}"


def _other(known: Analysis, probability: float, *, more: str) -> str:
    """Return why another source may be the marker, and what to do about it."""
    said = f"the probability that another source is the marker is {100 * probability:.2g} %"
    if known.unresolved_rival is not None:
        return f"{said}: a source near {known.unresolved_rival[0].posterior.mean_deg:.0f} deg may be as strong; {more}"
    first, *seen = known.sources
    stronger = max(seen, key=lambda each: rival_probability(each, first), default=first)
    if rival_probability(stronger, first) > probability / 2:
        return f"{said}: the source at {stronger.posterior.mean_deg:.1f} deg may be stronger; {more}"
    if known.survey is None:
        return f"{said}: the range has not been surveyed; {more}"
    return (
        f"{said}: only {100 * known.survey.surveyed:.0f} % of the range is checked for a second source as strong, "
        f"which may be missed near {known.survey.hidden_deg:.0f} deg; {more}"
    )


def _side(posterior: AnglePosterior, limits: Interval) -> Literal["low", "high"] | None:
    """Return the end of the range beyond which the marker probably lies, or may lie where its angle is uncertain."""
    least = 0.5 if posterior.sigma_deg <= KNOWN_SIGMA_DEG else UNRESOLVED_BEYOND
    below = float(posterior.probability[posterior.angle_deg < limits.low_deg].sum())
    above = float(posterior.probability[posterior.angle_deg > limits.high_deg].sum())
    if max(below, above) <= least:
        return None
    return "low" if below > above else "high"
