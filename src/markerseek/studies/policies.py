"""The policies of a study: those of `markerseek.search`, and a user's own (`markerseek.runs.own_method`).

The module of a user's own is imported in each worker process.
"""

from __future__ import annotations

import logging
from typing import Any

import msgspec
from msgspec.structs import replace

from markerseek.core import (
    PAPER_RANGE,
    AnglePrior,
    AnyPolicy,
    ConfigError,
    Interval,
    SearchPlan,
    options_of,
)
from markerseek.files import nearest_key, settings_from
from markerseek.runs import own_method, require_own
from markerseek.search import (
    build_sweeping,
    is_own_method,
    method_named,
    refuse_posterior_settings,
    require_plan,
)

_LOG = logging.getLogger(__name__)

OF_STUDY = ("prior", "near_sigma_deg", "near_off_deg")
OF_PLAN = (*(each.name for each in options_of(SearchPlan) if each.name != "near"), "early_end", "cues")
"""Keys of a policy in a study: its own, and those of the plan; where the marker is expected depends on the marker."""


class StudyPolicy(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One policy of a study; `study_policy` makes one of its keys."""

    plan: SearchPlan
    """Plan of its searches; ``method`` may also be ``module:name``, a policy of the user's own."""
    prior: bool = False
    """Whether a posterior is given the intensity curve of another marker on the same rig, which it has found before."""
    near_sigma_deg: float | None = None
    """Standard deviation of a prior over the angle that a posterior is given, which errs by as much, in degrees; None:
    it is given none."""
    near_off_deg: float = 0.0
    """By how much that prior is off besides, towards the middle of the range, in degrees."""

    def __post_init__(self) -> None:
        plan = self.plan
        if self.near_sigma_deg is not None:
            AnglePrior(mean_deg=self.near_off_deg, sigma_deg=self.near_sigma_deg)
        elif self.near_off_deg:
            raise ConfigError(f"{plan.method}: near_off_deg is {self.near_off_deg} deg without near_sigma_deg; give it")
        if is_own_method(plan.method):
            self._require_own()
            return
        try:
            method_named(plan.method)
        except ConfigError as problem:
            raise ConfigError(f"{problem}; in a study also a policy of your own as module:name") from problem
        require_plan(plan)
        if plan.method != "posterior":
            refuse_posterior_settings(plan.method, prior=self.prior, near_sigma_deg=self.near_sigma_deg)

    def _require_own(self) -> None:
        """Refuse what a user's own policy cannot be given."""
        method = self.plan.method
        require_own(self.plan)
        for name, value, default in (("prior", self.prior, False), ("near_sigma_deg", self.near_sigma_deg, None)):
            if value != default:
                raise ConfigError(f"{method}: {name} is {value}, a policy of your own has no such setting")
        # A study may come from anyone, and its module may be any that is installed.
        module = method.partition(":")[0]
        _LOG.warning("%s: the study imports the module %s and runs its code", method, module)
        # A module that cannot be imported is an error when the study is read, not in a worker process.
        own_method(method).policy(limits=PAPER_RANGE, acquisitions=self.most)

    @property
    def most(self) -> int:
        """Most acquisitions that it makes."""
        if is_own_method(self.plan.method):
            return own_method(self.plan.method).number(self.plan)
        return self.plan.acquisitions or method_named(self.plan.method).acquisitions

    def __str__(self) -> str:
        plan = self.plan
        form = " as published" if plan.as_published else ""
        # Named only where it has an effect: labels are the names of lines in a figure.
        end = "" if plan.early_end or plan.method not in ("weighted-average", "posterior") else ", no early end"
        others = "" if plan.others is None else ", single" if plan.others == 0 else f", others {plan.others:g}"
        prior = ", with prior" if self.prior else ""
        near = "" if self.near_sigma_deg is None else f", near ± {self.near_sigma_deg:g}°"
        off = f", {self.near_off_deg:g}° off" if self.near_off_deg else ""
        cues = "" if plan.cues is None else f", {' and '.join(plan.cues)} only"
        sweep = ", sweeping" if plan.sweep else ""
        tolerance = "" if plan.tolerance_mm == 1.0 else f", ± {plan.tolerance_mm:g} mm"
        return f"{plan.method}{form}, {self.most}{end}{others}{prior}{near}{off}{cues}{sweep}{tolerance}"


def study_policy(**keys: object) -> StudyPolicy:
    """Return one policy of a study from its keys: those of a plan that a person chooses, and its own.

    Raises `ConfigError` as a plan does.

    ``keys``: plain values, as TOML has them; ``method`` is needed.
    """
    for key in keys:
        nearest_key(key, (*OF_PLAN, *OF_STUDY), prefix="policies.")
    if "method" not in keys:
        raise ConfigError("the key policies.method is missing; add it")
    plan = settings_from({key: keys[key] for key in keys if key in OF_PLAN}, SearchPlan, name="policies")
    own = {key: keys[key] for key in keys if key in OF_STUDY}
    return settings_from({"plan": plan, **own}, StudyPolicy, name="policies")


def build_policy(policy: StudyPolicy, *, limits: Interval, **of_rig: Any) -> AnyPolicy:
    """Return a policy for one search; ``of_rig``: fields of the plan that follow from the rig (`SearchPlan`)."""
    plan = replace(policy.plan, **of_rig)
    if is_own_method(plan.method):
        return own_method(plan.method).policy(limits=limits, acquisitions=policy.most)
    return build_sweeping(plan, limits=limits)
