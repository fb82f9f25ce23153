"""The search methods by name, and `build`, which makes a policy of one."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import SupportsFloat, SupportsIndex

from markerseek.core import (
    PAPER_RANGE,
    ConfigError,
    Interval,
    MarkerCurve,
    Policy,
    SearchPlan,
    SweepingPolicy,
    Tolerance,
    as_interval,
)
from markerseek.search.average import THRESHOLD
from markerseek.search.bracket import GOLDEN, TERNARY, BracketSearch
from markerseek.search.checked import CheckedPolicy
from markerseek.search.manual import TURNS, ScriptedManual
from markerseek.search.policy import PaperPolicy, check_acquisitions
from markerseek.search.sweep import Exhaustive, WeightedAverage


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """One way to search."""

    name: str
    """Its name on the command line."""
    summary: str
    """What it does, in one line."""
    acquisitions: int
    """Acquisitions where the user names no number."""
    least: int
    """Fewest acquisitions that it can work with."""


METHODS: tuple[Method, ...] = (
    Method(
        name="posterior",
        summary="Bayesian: the next angle is the most informative one; ends once the angle is known well enough",
        acquisitions=16,
        least=2,
    ),
    Method(
        name="weighted-average",
        summary="equal steps, average of the angles weighted by intensity, early end once the peak is passed",
        acquisitions=57,
        least=2,
    ),
    Method(
        name="golden-section",
        summary="golden-section search with two fresh acquisitions per iteration, as in the paper",
        acquisitions=28,
        least=2,
    ),
    Method(
        name="golden-section-reuse",
        summary="golden-section search that keeps the point it can use again, as in textbooks",
        acquisitions=16,
        least=2,
    ),
    Method(
        name="ternary",
        summary="ternary search with two fresh acquisitions per iteration, as in the paper",
        acquisitions=28,
        least=2,
    ),
    Method(
        name="exhaustive",
        summary="fine equal steps over the whole range, vertex of a parabola through the top",
        acquisitions=141,
        least=3,
    ),
    Method(
        name="manual",
        summary="the assistant's way as a script: coarse turns, then back and forth with shrinking steps",
        acquisitions=28,
        least=TURNS + 2,
    ),
)
"""All methods, in the order in which they are shown."""


def method_named(name: str) -> Method:
    """Return the method of that name."""
    for method in METHODS:
        if method.name == name:
            return method
    names = [method.name for method in METHODS]
    near = difflib.get_close_matches(name.strip().lower().replace("_", "-").replace(" ", "-"), names, n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    raise ConfigError(f"method: {name!r} is unknown; {hint}methods are {', '.join(names)}")


def build(
    method: str,
    *,
    limits: Interval | Sequence[SupportsFloat] = PAPER_RANGE,
    acquisitions: SupportsIndex | float | None = None,
    as_published: bool = False,
    start_deg: SupportsFloat | None = None,
    early_end: bool = True,
    others: float | None = None,
    prior: MarkerCurve | None = None,
    cues: Iterable[str] | None = None,
    tolerance: Tolerance | None = None,
) -> Policy:
    """Return a policy for one search.

    Parameters
    ----------
    method
        Name of the method, one of `METHODS`.
    limits
        Range to search: an interval, or its two ends in degrees, as in ``(-35, 35)``.
    acquisitions
        Most acquisitions, a whole number; None: the method's own. An odd number is reduced by one where two are made
        per iteration.
    as_published
        The bare method of the paper, which always answers `Found` and begins at the low end; else the checked form.
    start_deg
        Present angle of the probe, in degrees: checked sweeps and the manual search begin at the nearer end.
        None: at the low end.
    early_end
        Whether a weighted average ends once its peak is recorded and passed, and a posterior once its angle is known
        well enough; the other methods have no early end.
    others
        Prior probability that there is another source as loud, for a posterior; 0: it looks for none, and ends earlier.
        None: 0.05.
    prior
        Intensity curve of a former marker on this rig, from which a posterior begins; None if there was none.
    cues
        Features of a reading that a posterior uses, as for `markerseek.search.posterior.Posterior`; None: all.
    tolerance
        How well the angle of a `Found` must be known; None: to 1 mm at the marker, or 1° where its radius is not known.

    Raises
    ------
    ConfigError
        If the method is unknown, the number of acquisitions does not fit it, a posterior is requested as published, a
        form that it does not have, or ``others``, a prior or cues are given to another method.
    """
    chosen = method_named(method)
    number = chosen.acquisitions if acquisitions is None else acquisitions
    number = check_acquisitions(number, least=chosen.least, method=chosen.name)
    searched = as_interval(limits, name="limits")
    stands_deg = None if start_deg is None else float(start_deg)
    if chosen.name == "posterior":
        if as_published:
            raise ConfigError(
                "posterior: it is markerseek's own and was not published; leave out as_published, or name a method of "
                "the paper, for instance weighted-average"
            )
        # Imported here: other methods need neither SciPy nor the compiled kernels.
        from markerseek.search.posterior import CUES, TARGET_SIGMA_DEG, USUAL_OTHERS, Posterior

        return Posterior(
            limits=searched,
            acquisitions=number,
            start_deg=stands_deg,
            target_sigma_deg=TARGET_SIGMA_DEG if early_end else 0.0,
            cues=CUES if cues is None else cues,
            others=USUAL_OTHERS if others is None else others,
            prior=prior,
            tolerance=tolerance or Tolerance(),
        )
    refuse_posterior_settings(chosen.name, others=others, prior=prior, cues=cues)
    ends_early = early_end and chosen.name == "weighted-average"
    inner = _MAKERS[chosen.name](searched, number, None if as_published else stands_deg, ends_early and as_published)
    if as_published:
        return inner
    return CheckedPolicy(
        inner, limits=searched, early_threshold=THRESHOLD if ends_early else None, tolerance=tolerance or Tolerance()
    )


def refuse_posterior_settings(method: str, **settings: object) -> None:
    """Refuse settings that only the posterior has, given to another method.

    ``settings``: False and None are none.
    """
    for name, value in settings.items():
        if value is not None and value is not False:
            raise ConfigError(f"{method}: {name} is given, but only the posterior has this setting; leave it out")


def build_sweeping(
    *,
    speed_deg_s: float,
    limits: Interval,
    acquisitions: int | None = None,
    start_deg: float | None = None,
    others: float | None = None,
    prior: MarkerCurve | None = None,
    cues: Iterable[str] | None = None,
    tolerance: Tolerance | None = None,
) -> SweepingPolicy:
    """Return a policy for one search by sweeps at a speed, judged by the posterior.

    ``acquisitions``: most of those at rest, which follow where the sweeps are not enough; the others are as of `build`.
    """
    from markerseek.search.posterior import CUES, USUAL_OTHERS, Posterior, SweepPosterior

    def at_rest() -> Posterior:
        return Posterior(
            limits=limits,
            acquisitions=acquisitions or method_named("posterior").acquisitions,
            start_deg=start_deg,
            cues=CUES if cues is None else cues,
            others=USUAL_OTHERS if others is None else others,
            prior=prior,
            tolerance=tolerance or Tolerance(),
        )

    return SweepPosterior(at_rest, limits=limits, speed_deg_s=speed_deg_s, start_deg=start_deg)


def require_sweeping(method: str, *, as_published: bool = False) -> None:
    """Refuse sweeps for a method that asks for one angle after another."""
    if method != "posterior" or as_published:
        raise ConfigError(f"{method}: it asks for one angle after another; only posterior can sweep, so leave it out")


def policy_for(plan: SearchPlan, *, limits: Interval) -> SweepingPolicy:
    """Return the policy of a plan."""
    if plan.sweep_speed_deg_s is not None:
        require_sweeping(plan.method, as_published=plan.as_published)
        return build_sweeping(
            speed_deg_s=plan.sweep_speed_deg_s,
            limits=limits,
            acquisitions=plan.acquisitions,
            start_deg=plan.start_deg,
            others=plan.others,
            prior=plan.prior,
            tolerance=plan.tolerance,
        )
    return build(
        plan.method,
        limits=limits,
        acquisitions=plan.acquisitions,
        as_published=plan.as_published,
        start_deg=plan.start_deg,
        early_end=plan.early_end,
        others=plan.others,
        prior=plan.prior,
        tolerance=plan.tolerance,
    )


def most_acquisitions(plan: SearchPlan) -> int | None:
    """Return the most acquisitions of a plan, its own number or that of its method; None for sweeps."""
    return None if plan.sweep_speed_deg_s is not None else plan.acquisitions or method_named(plan.method).acquisitions


def _weighted_average(limits: Interval, acquisitions: int, start_deg: float | None, early_end: bool) -> PaperPolicy:
    return WeightedAverage(limits=limits, acquisitions=acquisitions, start_deg=start_deg, early_end=early_end)


def _bracket(ratio: float, *, reuse: bool = False) -> Callable[[Interval, int, float | None, bool], PaperPolicy]:
    def make(limits: Interval, acquisitions: int, _start_deg: float | None, _early_end: bool) -> PaperPolicy:
        return BracketSearch(ratio=ratio, limits=limits, acquisitions=acquisitions, reuse=reuse)

    return make


def _exhaustive(limits: Interval, acquisitions: int, start_deg: float | None, _early_end: bool) -> PaperPolicy:
    return Exhaustive(limits=limits, acquisitions=acquisitions, start_deg=start_deg)


def _manual(limits: Interval, acquisitions: int, start_deg: float | None, _early_end: bool) -> PaperPolicy:
    return ScriptedManual(limits=limits, acquisitions=acquisitions, start_deg=start_deg)


_MAKERS: dict[str, Callable[[Interval, int, float | None, bool], PaperPolicy]] = {
    "weighted-average": _weighted_average,
    "golden-section": _bracket(GOLDEN),
    "golden-section-reuse": _bracket(GOLDEN, reuse=True),
    "ternary": _bracket(TERNARY),
    "exhaustive": _exhaustive,
    "manual": _manual,
}
