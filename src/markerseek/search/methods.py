"""The search methods by name, and `build`, which makes a policy of one."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, SupportsFloat, TypeAlias

from msgspec.structs import replace

from markerseek.core import (
    MAX_ACQUISITIONS,
    PAPER_RANGE,
    AnyPolicy,
    ConfigError,
    Interval,
    Policy,
    SearchPlan,
    as_interval,
)
from markerseek.search.bracket import BracketSearch, GoldenSection, GoldenSectionReuse, TernarySearch
from markerseek.search.checked import CheckedPolicy
from markerseek.search.manual import ScriptedManual
from markerseek.search.policy import PaperPolicy, check_acquisitions
from markerseek.search.recording import WholeRecording
from markerseek.search.steps import Exhaustive, WeightedAverage

if TYPE_CHECKING:
    from markerseek.search.posterior import Posterior


MethodName: TypeAlias = Literal[
    "posterior", "weighted-average", "golden-section", "golden-section-reuse", "ternary", "exhaustive", "manual"
]
"""Names of the methods, for an editor and a type checker."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """One way to search."""

    name: str
    """Its name on the command line."""
    summary: str
    """What it does, in one line."""
    acquisitions: int
    """Acquisitions where the user names no number."""
    least: int = 2
    """Fewest acquisitions that it can work with."""


PAPER_METHODS: tuple[
    type[GoldenSection | GoldenSectionReuse | TernarySearch | WeightedAverage | Exhaustive | ScriptedManual], ...
] = (
    WeightedAverage,
    GoldenSection,
    GoldenSectionReuse,
    TernarySearch,
    Exhaustive,
    ScriptedManual,
)
"""The methods that always answer, a class each."""

METHODS: tuple[Method, ...] = (
    # Its class is imported where it is used: other methods need neither SciPy nor the compiled kernels.
    Method(
        name="posterior",
        summary="Bayesian: the next angle is the most informative one; ends once the angle is known well enough",
        acquisitions=16,
    ),
    *(
        Method(name=each.name, summary=each.summary, acquisitions=each.acquisitions, least=each.least)
        for each in PAPER_METHODS
    ),
)


def method_named(name: str) -> Method:
    """Return the method of that name."""
    for method in METHODS:
        if method.name == name:
            return method
    names = [method.name for method in METHODS]
    near = difflib.get_close_matches(name.strip().lower().replace("_", "-").replace(" ", "-"), names, n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    if is_own_method(name):
        hint = "a class of your own is taken from who starts a search or a study, not from a record or a request; "
    raise ConfigError(f"method: {name!r} is unknown; {hint}methods are {', '.join(names)}")


def is_own_method(name: str) -> bool:
    """Return whether a method is named as a user's own, ``module:name``."""
    return ":" in name


def build(plan: SearchPlan | str, *, limits: Interval | Sequence[SupportsFloat] = PAPER_RANGE) -> Policy:
    """Return a policy for one search.

    Parameters
    ----------
    plan
        How it searches; the name of a method stands for its plan with all defaults.
    limits
        Range to search: an interval, or its two ends in degrees, as in ``(-35, 35)``.

    Raises
    ------
    ConfigError
        If the method is unknown, the number of acquisitions does not fit it, a posterior is requested as published, a
        form that it does not have, ``others``, a prior or cues are given to another method, or a prior over the angle
        lies outside of the range.
    """
    if isinstance(plan, str):
        plan = SearchPlan(method=plan)
    if plan.sweep_speed_deg_s is not None:
        raise ConfigError(f"{plan.method}: a plan of sweeps is given to a policy of single angles; use build_sweeping")
    method_named(plan.method)
    searched = as_interval(limits, name="limits")
    if plan.whole:
        return _whole(plan, limits=searched)
    if plan.method == "posterior":
        return _posterior(plan, limits=searched)
    acquisitions = _acquisitions(plan)
    refuse_posterior_settings(plan.method, others=plan.others, prior=plan.prior, near=plan.near, cues=plan.cues)
    inner = _as_published(plan, searched, acquisitions)
    if plan.as_published:
        return inner
    ends_early = plan.early_end and plan.method == "weighted-average"
    return CheckedPolicy(inner, limits=searched, early_end=ends_early, tolerance=plan.tolerance)


def _whole(plan: SearchPlan, *, limits: Interval) -> WholeRecording:
    """Return a search of a recording that goes on to its other angles."""
    search = replace(plan, whole=False)
    if plan.method != "posterior":
        # These settings are for the answer from all angles, which the posterior gives.
        search = replace(search, others=None, prior=None, cues=None)
    every = posterior_of_all(plan, limits=limits)
    return WholeRecording(build(search, limits=limits), every, angles_deg=plan.angles_deg or ())


def of_all_angles(search: Policy, plan: SearchPlan, *, limits: Interval) -> Policy:
    """Return a policy of the user's own as the search of a plan: the answer to a recording is from all its angles."""
    if not plan.whole:
        return search
    return WholeRecording(search, posterior_of_all(plan, limits=limits), angles_deg=plan.angles_deg or ())


def posterior_of_all(plan: SearchPlan, *, limits: Interval) -> Posterior:
    """Return the posterior that answers from all angles of a recording, whatever the method of its search.

    ``plan``: of the search, with the angles of the recording.
    """
    if plan.angles_deg is None:
        raise ConfigError("angles_deg is None, it must hold the angles of the recording")
    most = max(2, min(len(plan.angles_deg), MAX_ACQUISITIONS))
    return _posterior(replace(plan, method="posterior", acquisitions=most, angles_deg=None, near=None), limits=limits)


def build_sweeping(plan: SearchPlan, *, limits: Interval) -> AnyPolicy:
    """Return a policy for one search, as `build`, which sweeps where its plan says so.

    The most acquisitions of its plan are those at rest, which follow where sweeps are not enough.
    """
    if plan.sweep_speed_deg_s is None:
        return build(plan, limits=limits)
    require_sweeping(plan)
    from markerseek.search.posterior import SWEPT_SIGMA_DEG, SweepPosterior

    return SweepPosterior(
        lambda: _posterior(plan, limits=limits, target_deg=SWEPT_SIGMA_DEG),
        limits=limits,
        speed_deg_s=plan.sweep_speed_deg_s,
        start_deg=plan.start_deg,
        near=plan.near,
        in_bursts=plan.sweep_from_end,
    )


def _posterior(plan: SearchPlan, *, limits: Interval, target_deg: float | None = None) -> Posterior:
    """Return the posterior of a plan, at rest; ``target_deg``: None takes its own."""
    _refuse_published(plan)
    # Imported here: other methods need neither SciPy nor the compiled kernels.
    from markerseek.search.posterior import CUES, TARGET_SIGMA_DEG, USUAL_OTHERS, Posterior

    target_deg = TARGET_SIGMA_DEG if target_deg is None else target_deg
    return Posterior(
        limits=limits,
        acquisitions=_acquisitions(plan),
        start_deg=plan.start_deg,
        target_sigma_deg=target_deg if plan.early_end else 0.0,
        cues=CUES if plan.cues is None else plan.cues,
        others=USUAL_OTHERS if plan.others is None else plan.others,
        prior=plan.prior,
        near=plan.near,
        tolerance=plan.tolerance,
        angles_deg=plan.angles_deg,
        by_hand=plan.by_hand,
        motion_mm=plan.motion_mm,
    )


def require_plan(plan: SearchPlan) -> None:
    """Refuse a plan that no policy of this package can carry out, before devices are opened."""
    method_named(plan.method)
    _acquisitions(plan)
    if plan.sweep:
        require_sweeping(plan)
    if plan.method == "posterior":
        _refuse_published(plan)
    else:
        refuse_posterior_settings(plan.method, others=plan.others, prior=plan.prior, near=plan.near, cues=plan.cues)


def require_sweeping(plan: SearchPlan) -> None:
    """Refuse sweeps for a plan of another method, or of one that uses every acquisition."""
    if plan.method != "posterior" or plan.as_published:
        raise ConfigError(f"{plan.method}: it asks for one angle after another; only posterior sweeps")
    if not plan.early_end:
        raise ConfigError("posterior: early_end is False, and sweeps end once the angle is known; leave it out")


def _refuse_published(plan: SearchPlan) -> None:
    if plan.as_published:
        raise ConfigError(
            "posterior: it is markerseek's own and was not published; leave out as_published, or name a method of "
            "the paper, for instance weighted-average"
        )


def refuse_posterior_settings(method: str, **settings: object) -> None:
    """Refuse settings that only the posterior has, given to another method.

    ``settings``: False and None are none.
    """
    for name, value in settings.items():
        if value is not None and value is not False:
            raise ConfigError(f"{method}: {name} is given, but only the posterior has this setting; leave it out")


def most_acquisitions(plan: SearchPlan) -> int | None:
    """Return the most acquisitions of a plan: its own number or that of its method, and those of a whole recording.

    None if it sweeps. With a prior over the angle they are counted twice, because the search has the whole number again
    after it gives up the prior.
    """
    if plan.sweep_speed_deg_s is not None:
        return None
    return _acquisitions(plan) * (1 if plan.near is None else 2) + (len(plan.angles_deg or ()) if plan.whole else 0)


def _acquisitions(plan: SearchPlan) -> int:
    """Return the number of acquisitions of a plan, its own or that of its method, if a search can be made of it."""
    if is_own_method(plan.method) and plan.acquisitions is not None:
        return check_acquisitions(plan.acquisitions, least=1, method=plan.method)
    method = method_named(plan.method)
    number = method.acquisitions if plan.acquisitions is None else plan.acquisitions
    return check_acquisitions(number, least=method.least, method=method.name)


def _as_published(plan: SearchPlan, limits: Interval, acquisitions: int) -> PaperPolicy:
    """Return the method of a plan as the paper has it.

    A checked one begins at the nearer end, and ends early by itself.
    """
    (method,) = (each for each in PAPER_METHODS if each.name == plan.method)
    if issubclass(method, BracketSearch):
        return method(limits=limits, acquisitions=acquisitions)
    start_deg = None if plan.as_published else plan.start_deg
    if issubclass(method, WeightedAverage):
        early_end = plan.early_end and plan.as_published
        return method(limits=limits, acquisitions=acquisitions, start_deg=start_deg, early_end=early_end)
    return method(limits=limits, acquisitions=acquisitions, start_deg=start_deg)
