"""A search method of the user's own, named ``module:name``: a class, or a function that makes a policy.

It is called with ``limits`` and ``acquisitions`` by keyword and returns a `markerseek.core.Policy`. Its file lies in
the working directory or in a folder of PYTHONPATH, or its module is installed. A class may state its usual number of
acquisitions as ``acquisitions``, and the fewest as ``least``.

A method of one's own is named by who starts a search or a study. It is never imported because a record, the page or
another program names it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from markerseek.core import ConfigError, Interval, MarkerseekError, Policy, SearchError, SearchPlan, described
from markerseek.files import is_class_name, own_lines, own_module
from markerseek.search import check_acquisitions, is_own_method


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnMethod:
    """A method of the user's own, imported."""

    name: str
    make: Callable[..., object]
    """The class or function; it takes ``limits`` and ``acquisitions``."""

    def number(self, plan: SearchPlan) -> int:
        """Return the most acquisitions of a plan, its own number or that of the class."""
        number = getattr(self.make, "acquisitions", None) if plan.acquisitions is None else plan.acquisitions
        if number is None:
            raise ConfigError(
                f"{self.name}: acquisitions is None, and the class states no number of them; give it, or state "
                "acquisitions = 16 in the class"
            )
        return check_acquisitions(number, least=getattr(self.make, "least", 1), method=self.name)

    def policy(self, *, limits: Interval, acquisitions: int) -> Policy:
        """Return a new policy; `ConfigError` if the class fails, or makes no policy."""
        try:
            policy = self.make(limits=limits, acquisitions=acquisitions)
        except MarkerseekError:
            raise
        # Code of the user: any error in it is reported under its name, and not as one of this program.
        except Exception as problem:
            raise ConfigError(
                f"{self.name}: calling it with limits and acquisitions failed: {described(problem)}{own_lines(problem)}"
            ) from problem
        return require_policy(policy, name=self.name)


def own_method(name: str) -> OwnMethod:
    """Return the method that is named ``module:name``, imported.

    Raises
    ------
    ConfigError
        If it is not found, or fails while it is imported.
    """
    if not is_class_name(name):
        raise ConfigError(
            f'method is {name!r}, it must be "module:Class", as in "own_policy:CentreOfMass": the name of the file '
            "without its folder and .py, a colon, and that of the class"
        )
    module_name, _, made_name = name.partition(":")
    module = own_module(module_name, str(Path.cwd()), named_by=name, place="in the working directory")
    make = getattr(module, made_name, None)
    if not callable(make):
        raise ConfigError(f"{name}: {module_name} has no class or function {made_name}; correct the name")
    return OwnMethod(name=name, make=make)


def require_own(plan: SearchPlan) -> None:
    """Refuse settings that a method of the user's own is not given."""
    usual = SearchPlan()
    for name in ("early_end", "others", "prior", "near", "cues", "sweep"):
        value = getattr(plan, name)
        if value != getattr(usual, name):
            raise ConfigError(f"{plan.method}: {name} is {value}, a policy of your own has no such setting")


@contextmanager
def own_errors(method: str) -> Iterator[None]:
    """Report an error in a method of the user's own under its name, and not as one of this program."""
    try:
        yield
    except Exception as problem:
        if not is_own_method(method):
            raise
        if isinstance(problem, SearchError):
            raise SearchError(f"{method}: {problem}") from problem
        if isinstance(problem, MarkerseekError):
            raise
        raise SearchError(f"{method}: the policy failed: {described(problem)}{own_lines(problem)}") from problem


def require_policy(policy: object, *, name: str) -> Policy:
    """Return the policy; refuse what lacks `ask`, `tell` or `estimate`, and a class that was not called."""
    if isinstance(policy, type):
        raise ConfigError(
            f"{name}: it is the class {policy.__qualname__}, and no policy; make one, {policy.__name__}(…)"
        )
    if not isinstance(policy, Policy):
        raise ConfigError(f"{name}: it made {policy!r:.80}, which has not all of ask, tell and estimate")
    return policy


def name_of(policy: Policy) -> str:
    """Return the name of a policy's class, as a method is named."""
    return f"{type(policy).__module__}:{type(policy).__qualname__}"
