"""The policies of a study: those of `markerseek.search`, and a user's own.

A user's own policy is named ``module:name``: a class, or a function that makes one. It is called with ``limits`` and
``acquisitions`` by keyword and returns a `markerseek.core.Policy`. The module is imported in each worker process, so
that it must be installed or lie in a folder of PYTHONPATH.
"""

from __future__ import annotations

import importlib
import traceback
import warnings
from dataclasses import dataclass
from pathlib import Path

import markerseek
from markerseek.core import (
    PAPER_RANGE,
    AnyPolicy,
    ConfigError,
    Interval,
    MarkerCurve,
    MarkerseekError,
    Policy,
    PolicyPlan,
    Tolerance,
    described,
)
from markerseek.search import (
    Method,
    build_sweeping,
    check_acquisitions,
    method_named,
    refuse_posterior_settings,
    require_sweeping,
)
from markerseek.studies.entry import EntryPolicy


def _method_of(name: str) -> Method:
    """The method of that name; a `ConfigError` that lists the names if there is none."""
    try:
        return method_named(name)
    except ConfigError as problem:
        raise ConfigError(f"{problem}; in a study also a policy of your own as module:name") from problem


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicySettings:
    """Settings of one policy, as for `markerseek.search.build`."""

    method: str
    """Name of the method, or ``module:name`` of a user's own policy."""
    acquisitions: int | None = None
    """None: the method's own. Required for a user's own policy."""
    as_published: bool = False
    """The paper's form, which always answers; a user's own policy gets no dark frames then."""
    early_end: bool = True
    """Whether a weighted average or a posterior may end before its last angle."""
    others: float | None = None
    """Prior probability that there is another source as loud, for a posterior; 0: it looks for none. None: as usual."""
    prior: bool = False
    """Whether a posterior is given the intensity curve of another marker on the same rig, which it has found before."""
    cues: tuple[str, ...] | None = None
    """Features of a reading that a posterior may use, as for `markerseek.search.posterior.Posterior`; None: all."""
    sweep: bool = False
    """Whether a posterior sweeps, at the fastest speed of the rig's stage."""
    command: tuple[str, ...] = ()
    """Words that start an entry, a search method of somebody else as a child process (`markerseek.studies.entry`);
    ``method`` is then its name only."""
    channels: bool = True
    """Whether an entry is told the channel data of a frame, too."""
    tolerance_mm: float = 1.0
    """How well the angle of a marker that is found must be known, as in `markerseek.core.Tolerance`."""

    @property
    def tolerance(self) -> Tolerance:
        """The tolerance; `ConfigError` if it is not positive."""
        return Tolerance(mm=self.tolerance_mm)

    def __post_init__(self) -> None:
        _ = self.tolerance
        if self.command:
            self._refuse_ours("an entry")
            check_acquisitions(self.acquisitions or 0, least=1, method=self.method)
            return
        if not self.channels:
            raise ConfigError(
                f"{self.method}: channels is False, but only an entry, a policy with command, is told of channel data; "
                "leave it out"
            )
        if is_own(self.method):
            self._require_own()
            return
        least = _method_of(self.method).least
        if self.acquisitions is not None:
            check_acquisitions(self.acquisitions, least=least, method=self.method)
        if self.sweep:
            require_sweeping(PolicyPlan(method=self.method, as_published=self.as_published, early_end=self.early_end))
        if self.method != "posterior":
            refuse_posterior_settings(self.method, others=self.others, prior=self.prior, cues=self.cues)

    def _require_own(self) -> None:
        """Refuse what a user's own policy cannot be given."""
        if self.acquisitions is None:
            raise ConfigError(
                f"{self.method}: acquisitions is None, a policy of your own needs the number of them; give it"
            )
        number = check_acquisitions(self.acquisitions, least=1, method=self.method)
        self._refuse_ours("a policy of your own")
        # A study may come from anyone, and its module may be any that is installed.
        module = self.method.partition(":")[0]
        warnings.warn(f"{self.method}: the study imports the module {module} and runs its code", stacklevel=3)
        # A module that cannot be imported is an error when the study is read, not in a worker process.
        _build_own(self.method, limits=PAPER_RANGE, acquisitions=number)

    def _refuse_ours(self, what: str) -> None:
        """Refuse settings that only methods of this package have."""
        settings = (
            ("early_end", self.early_end, True),
            ("others", self.others, None),
            ("prior", self.prior, False),
            ("cues", self.cues, None),
            ("sweep", self.sweep, False),
        )
        for name, value, usual in settings:
            if value != usual:
                raise ConfigError(f"{self.method}: {name} is {value}, {what} has no such setting")

    @property
    def most(self) -> int:
        """Most acquisitions that it makes."""
        return self.acquisitions or _method_of(self.method).acquisitions

    def __str__(self) -> str:
        form = " as published" if self.as_published else ""
        # Named only where it has an effect: labels are the names of lines in a figure.
        end = "" if self.early_end or self.method not in ("weighted-average", "posterior") else ", no early end"
        others = "" if self.others is None else ", single" if self.others == 0 else f", others {self.others:g}"
        prior = ", with prior" if self.prior else ""
        cues = "" if self.cues is None else f", {' and '.join(self.cues)} only"
        sweep = ", sweeping" if self.sweep else ""
        tolerance = "" if self.tolerance_mm == 1.0 else f", ± {self.tolerance_mm:g} mm"
        return f"{self.method}{form}, {self.most}{end}{others}{prior}{cues}{sweep}{tolerance}"


def build_policy(
    settings: PolicySettings,
    *,
    limits: Interval,
    start_deg: float | None,
    prior: MarkerCurve | None = None,
    sweep_speed_deg_s: float | None = None,
    sweep_from_end: bool = False,
) -> AnyPolicy:
    """Return a policy for one search.

    ``prior``: intensity curve of a former marker on this rig, for a posterior. ``sweep_speed_deg_s``,
    ``sweep_from_end``: of a plan, for one that sweeps.
    """
    if settings.command:
        return EntryPolicy(
            settings.command,
            limits=limits,
            acquisitions=settings.most,
            start_deg=start_deg,
            tolerance=settings.tolerance,
            channels=settings.channels,
        )
    if is_own(settings.method):
        return _build_own(settings.method, limits=limits, acquisitions=settings.most)
    return build_sweeping(
        PolicyPlan(
            method=settings.method,
            acquisitions=settings.acquisitions,
            as_published=settings.as_published,
            start_deg=start_deg,
            early_end=settings.early_end,
            others=settings.others,
            prior=prior,
            cues=settings.cues,
            tolerance=settings.tolerance,
            sweep_speed_deg_s=sweep_speed_deg_s,
            sweep_from_end=sweep_from_end,
        ),
        limits=limits,
    )


def is_own(method: str) -> bool:
    """Whether a method is named as a user's own, ``module:name``."""
    return ":" in method


def _build_own(method: str, *, limits: Interval, acquisitions: int) -> Policy:
    """A user's own policy; a `ConfigError` if the module cannot be imported, has no such name, or makes no policy."""
    module, _, name = method.partition(":")
    try:
        maker = getattr(importlib.import_module(module), name)
    except ModuleNotFoundError as problem:
        raise ConfigError(
            f"{method}: {problem}; install it, or name its folder: PYTHONPATH=FOLDER markerseek study STUDY.toml"
        ) from problem
    except AttributeError as problem:
        raise ConfigError(f"{method}: {problem}; name a class or a function of that module") from problem
    # Code of the user: any error in it is reported under its name, and not as one of this program.
    except Exception as problem:
        raise ConfigError(f"{method}: importing it failed: {described(problem)}{own_lines(problem)}") from problem
    try:
        policy = maker(limits=limits, acquisitions=acquisitions)
    except MarkerseekError:
        raise
    except Exception as problem:
        raise ConfigError(
            f"{method}: calling it with limits and acquisitions failed: {described(problem)}{own_lines(problem)}"
        ) from problem
    if not isinstance(policy, Policy):
        raise ConfigError(f"{method}: it made {policy!r:.80}, which has not all of ask, tell and estimate")
    return policy


def own_lines(problem: Exception) -> str:
    """The lines of an error's traceback that are not this package's, the last one last, each on a line of its own."""
    package = Path(markerseek.__file__).parent
    return "".join(
        f"\n  {frame.filename}, line {frame.lineno}, in {frame.name}: {frame.line}"
        for frame in traceback.extract_tb(problem.__traceback__)
        if package not in Path(frame.filename).parents
    )
