"""The search methods by name, and `build`, which makes a policy of one."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import SupportsFloat, SupportsIndex

from markerseek.core import PAPER_RANGE, ConfigError, Interval, MarkerCurve, Policy, SearchPlan, as_interval
from markerseek.search.average import THRESHOLD
from markerseek.search.bracket import GOLDEN, TERNARY, BracketSearch
from markerseek.search.checked import CheckedPolicy
from markerseek.search.manual import TURNS, ScriptedManual
from markerseek.search.policy import PublishedPolicy, check_acquisitions
from markerseek.search.sweep import Exhaustive, WeightedAverage


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """One way to search.

    Attributes
    ----------
    name
        Its name on the command line.
    summary
        What it does, in one line.
    acquisitions
        Acquisitions where the user names no number.
    least
        Fewest acquisitions that it can work with.
    """

    name: str
    summary: str
    acquisitions: int
    least: int


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
    """Return the method of that name.

    Raises
    ------
    ConfigError
        If there is none; the message lists the names and the nearest one.
    """
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
    single: bool = False,
    prior: MarkerCurve | None = None,
    cues: Iterable[str] | None = None,
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
    single
        Whether there is one source only: a posterior then looks for no other, and ends earlier.
    prior
        Intensity curve of a former marker on this rig, from which a posterior begins; None if there was none.
    cues
        Features of a reading that a posterior uses, as for `markerseek.search.posterior.Posterior`; None: all.

    Raises
    ------
    ConfigError
        If the method is unknown, the number of acquisitions does not fit it, a posterior is requested as published, a
        form that it does not have, or ``single``, a prior or cues are given to another method.
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
        from markerseek.search.posterior import CUES, TARGET_SIGMA_DEG, Posterior

        return Posterior(
            limits=searched,
            acquisitions=number,
            start_deg=stands_deg,
            target_sigma_deg=TARGET_SIGMA_DEG if early_end else 0.0,
            cues=CUES if cues is None else cues,
            single=single,
            prior=prior,
        )
    refuse_posterior_settings(chosen.name, single=single, prior=prior, cues=cues)
    ends_early = early_end and chosen.name == "weighted-average"
    inner = _MAKERS[chosen.name](searched, number, None if as_published else stands_deg, ends_early and as_published)
    if as_published:
        return inner
    return CheckedPolicy(inner, limits=searched, early_threshold=THRESHOLD if ends_early else None)


def refuse_posterior_settings(method: str, **settings: object) -> None:
    """Refuse settings that only the posterior has, given to another method.

    Parameters
    ----------
    method
        Name of the other method.
    **settings
        The settings; False and None are none.

    Raises
    ------
    ConfigError
        If one is given.
    """
    for name, value in settings.items():
        if value is not None and value is not False:
            raise ConfigError(f"{method}: {name} is given, but only the posterior has this setting; leave it out")


def policy_for(plan: SearchPlan, *, limits: Interval) -> Policy:
    """Return the policy of a plan.

    Parameters
    ----------
    plan
        What is asked.
    limits
        Range to search.

    Raises
    ------
    ConfigError
        As `build`.
    """
    return build(
        plan.method,
        limits=limits,
        acquisitions=plan.acquisitions,
        as_published=plan.as_published,
        start_deg=plan.start_deg,
        early_end=plan.early_end,
        single=plan.single,
        prior=plan.prior,
    )


def most_acquisitions(plan: SearchPlan) -> int:
    """Return the most acquisitions of a plan: its own number, or that of its method."""
    return plan.acquisitions or method_named(plan.method).acquisitions


def _weighted_average(limits: Interval, acquisitions: int, start_deg: float | None, early_end: bool) -> PublishedPolicy:
    return WeightedAverage(limits=limits, acquisitions=acquisitions, start_deg=start_deg, early_end=early_end)


def _bracket(ratio: float, *, reuse: bool = False) -> Callable[[Interval, int, float | None, bool], PublishedPolicy]:
    def make(limits: Interval, acquisitions: int, _start_deg: float | None, _early_end: bool) -> PublishedPolicy:
        return BracketSearch(ratio=ratio, limits=limits, acquisitions=acquisitions, reuse=reuse)

    return make


def _exhaustive(limits: Interval, acquisitions: int, start_deg: float | None, _early_end: bool) -> PublishedPolicy:
    return Exhaustive(limits=limits, acquisitions=acquisitions, start_deg=start_deg)


def _manual(limits: Interval, acquisitions: int, start_deg: float | None, _early_end: bool) -> PublishedPolicy:
    return ScriptedManual(limits=limits, acquisitions=acquisitions, start_deg=start_deg)


_MAKERS: dict[str, Callable[[Interval, int, float | None, bool], PublishedPolicy]] = {
    "weighted-average": _weighted_average,
    "golden-section": _bracket(GOLDEN),
    "golden-section-reuse": _bracket(GOLDEN, reuse=True),
    "ternary": _bracket(TERNARY),
    "exhaustive": _exhaustive,
    "manual": _manual,
}
