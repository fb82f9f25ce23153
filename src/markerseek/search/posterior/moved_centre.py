"""The posterior of the centre of the curve of a marker that moves: its displacements along the turn integrated out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from markerseek.core import Float64
from markerseek.search.posterior.centre import HALF_WIDTH_SIGMAS, MIN_SHARE, Centre, Fit, blurred, drawn_cells
from markerseek.search.posterior.grid import Particles, mean_and_sigma
from markerseek.search.posterior.motion import SIGMAS_M, TurnMotion, measured_twice
from markerseek.search.posterior.symmetry import Displaced, Hypotheses, symmetric_log_likelihood

MOTION_DOUBT = 0.05
"""Probability that the marker moves from which its displacements are integrated out."""

MOVES_ALONG_TURN = 0.1
"""Prior probability that the marker moves just along the turn, where the frames of samples at rest show nothing of it.
It counts where a flank was measured again (`flank_again_deg`), which speaks for or against it."""

SCATTERING = 0.08
"""Relative error of a sample by itself from which samples at rest scatter as no laser does (the largest of
`SAMPLE_ERRORS` is 0.09): the marker may move just along the turn, too."""

MOTION_ANGLES = 81
MOTION_STEPS = 801
"""Angles at which the likelihood of each motion is computed, and most steps of the posterior over all of them."""

_LEAST_WINDOW_M = 0.3e-3
"""Displacement over which the evidence of each motion is integrated at least, that of rest as well: the narrow
posterior of a marker at rest may lie beside the angle that explains the samples best."""

LEAST_MOTION = 1e-3
"""Probability by the frames, over that of the most probable, below which a motion is left out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _MovedCentre:
    """The posterior of the centre of the curve for one size of the motion."""

    hypotheses: Hypotheses
    moved_deg: float
    """Standard deviation of the displacement along the turn."""
    log_evidence: float
    angles_deg: Float64[np.ndarray, " angles"]
    weight: Float64[np.ndarray, "angles hypotheses"]
    """Probability of each angle and hypothesis; they add up to 1."""
    log_amplitude: Float64[np.ndarray, "angles hypotheses"]

    @property
    def probability(self) -> Float64[np.ndarray, " angles"]:
        """Probability of each angle."""
        return np.asarray(self.weight.sum(axis=1))


def with_motion(centre: Centre, motion: TurnMotion, *, from_axis_m: float, particles: int) -> Centre:
    """Return the posterior of the centre with the displacements along the turn integrated out.

    The place in the pause is the marker's: the centre over its places is blurred by the displacement from it.

    ``from_axis_m``: distance of the marker from the axis. ``particles``: markers to draw.
    """
    if motion.rests and not motion.looked_at:
        # Of intensities alone, scatter is none of motion: two sources that overlap scatter about one curve too.
        return centre
    swept = any(each.sweep is not None for group in centre.strong for each in group)
    # Just along the turn, where frames show nothing.
    unseen = motion.probability[0] > 1 - MOTION_DOUBT
    strong_deg = [each.angle_deg for group in centre.strong for each in group]
    again = not swept and measured_twice(strong_deg, fwhm_deg=centre.fwhm_deg)
    centre = replace(centre, measured_again=again)
    if unseen and (swept or (centre.sample_error <= SCATTERING and not again)):
        return centre
    moved_deg = np.degrees(SIGMAS_M / from_axis_m)
    probability = motion.probability
    # Tissue that is stated to rest does, whatever the laser does at one angle.
    if unseen and again and not motion.rests:
        moving = MOVES_ALONG_TURN * probability[1:] / probability[1:].sum()
        probability = np.concatenate([[1 - MOVES_ALONG_TURN], moving])
    fit = centre.fit
    if fit is None:
        # Too few samples for an evidence of their own.
        sigma_deg = math.sqrt(float(probability @ moved_deg**2))
        angles_deg, wider = blurred(centre.angles_deg, centre.probability, sigma_deg=sigma_deg)
        return replace(centre, angles_deg=angles_deg, probability=wider, moved_sigma_deg=sigma_deg)
    mean_deg, still_deg = mean_and_sigma(centre.angles_deg, centre.probability)
    least_deg = math.degrees(_LEAST_WINDOW_M / from_axis_m)
    parts = []
    for sigma_deg, share in zip(moved_deg.tolist(), probability.tolist(), strict=True):
        if share <= LEAST_MOTION * probability.max():
            continue
        # Which direction along the turn goes with which one in depth is not known.
        signs = (1.0, -1.0) if sigma_deg > 0 and motion.relative_displacement.any() else (0.0,)
        for sign in signs:
            displaced = Displaced(
                by_deg=np.append(sign * sigma_deg * motion.relative_displacement, 0.0),
                sigma_deg=np.append(sigma_deg * motion.relative_sigma, sigma_deg),
            )
            parts.append(
                _moved_centre(
                    fit,
                    fit.moving if sigma_deg > 0 and not unseen else fit.at_rest,
                    displaced,
                    moved_deg=sigma_deg,
                    log_share=math.log(share / len(signs)),
                    angles_deg=mean_deg + math.hypot(still_deg, max(sigma_deg, least_deg)) * _MOTION_SIGMAS,
                )
            )
    log_evidence = np.array([each.log_evidence for each in parts])
    evidence = np.exp(log_evidence - log_evidence.max())
    if parts[0].moved_deg == 0 and evidence[0] > (1 - MOTION_DOUBT) * evidence.sum():
        return centre
    return _mixed(centre, fit, parts, evidence, particles=particles)


_MOTION_SIGMAS = np.linspace(-HALF_WIDTH_SIGMAS, HALF_WIDTH_SIGMAS, MOTION_ANGLES)


def _moved_centre(
    fit: Fit,
    hypotheses: Hypotheses,
    displaced: Displaced,
    *,
    moved_deg: float,
    log_share: float,
    angles_deg: Float64[np.ndarray, " angles"],
) -> _MovedCentre:
    """Return the posterior for one size of the motion; ``log_share``: ln of its probability by the frames."""
    log_p, log_amplitude = symmetric_log_likelihood(
        fit.shapes, hypotheses, fit.samples, angles_deg, displaced=displaced
    )
    log_p += hypotheses.log_prior + fit.log_prior(angles_deg)[:, None]
    largest = float(log_p.max())
    weight = np.exp(log_p - largest)
    total = float(weight.sum())
    return _MovedCentre(
        hypotheses=hypotheses,
        moved_deg=moved_deg,
        log_evidence=log_share + largest + math.log(total * float(angles_deg[1] - angles_deg[0])),
        angles_deg=angles_deg,
        weight=weight / total,
        log_amplitude=log_amplitude,
    )


def _mixed(
    centre: Centre,
    fit: Fit,
    parts: Sequence[_MovedCentre],
    evidence: Float64[np.ndarray, " parts"],
    *,
    particles: int,
) -> Centre:
    """Return the posterior over all motions by their evidence, each blurred by the displacement from the pause."""
    kept = [(each, share) for each, share in zip(parts, evidence.tolist(), strict=True) if share > MIN_SHARE]
    total = sum(share for _, share in kept)
    kept = [(each, share / total) for each, share in kept]
    wider = [blurred(each.angles_deg, each.probability, sigma_deg=each.moved_deg) for each, _ in kept]
    low_deg = min(float(angles_deg[0]) for angles_deg, _ in wider)
    high_deg = max(float(angles_deg[-1]) for angles_deg, _ in wider)
    step_deg = min(float(angles_deg[1] - angles_deg[0]) for angles_deg, _ in wider)
    angles_deg = np.linspace(low_deg, high_deg, min(math.ceil((high_deg - low_deg) / step_deg) + 1, MOTION_STEPS))
    probability = np.zeros(angles_deg.size)
    for (_, share), (own_deg, own) in zip(kept, wider, strict=True):
        density = np.interp(angles_deg, own_deg, own, left=0.0, right=0.0)
        probability += share * density / density.sum()
    moments = np.array([mean_and_sigma(each.angles_deg, each.probability) for each, _ in kept])
    shares = np.array([share for _, share in kept])
    mean_deg = float(shares @ moments[:, 0])
    by_hypothesis = [(share * each.weight.sum(axis=0), each.hypotheses) for each, share in kept]
    drawn = [_drawn_moved(each, math.ceil(particles * share)) for each, share in kept]
    return replace(
        centre,
        angles_deg=angles_deg,
        probability=probability,
        particles=Particles(
            theta_deg=np.concatenate([each.theta_deg for each in drawn]),
            member=np.concatenate([each.member for each in drawn]),
            log_amplitude=np.concatenate([each.log_amplitude for each in drawn]),
        ),
        fwhm_deg=sum(float(weight @ fit.shapes.fwhm_deg[each.member]) for weight, each in by_hypothesis),
        sample_error=sum(float(weight @ each.sample_error) for weight, each in by_hypothesis),
        moved_sigma_deg=math.sqrt(sum(share * each.moved_deg**2 for each, share in kept)),
        centre_sigma_deg=math.sqrt(float(shares @ (moments[:, 1] ** 2 + (moments[:, 0] - mean_deg) ** 2))),
    )


def _drawn_moved(part: _MovedCentre, count: int) -> Particles:
    """Return the markers of equal weight drawn from the posterior for one size of the motion."""
    row, column = drawn_cells(part.weight, count)
    return Particles(
        theta_deg=part.angles_deg[row],
        member=part.hypotheses.member[column],
        log_amplitude=part.log_amplitude[row, column],
    )
