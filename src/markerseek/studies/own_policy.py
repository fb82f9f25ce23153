"""A user's own policy in a study, named ``module:name``: a class, or a function that makes one.

It is called with ``limits`` and ``acquisitions`` by keyword and returns a `markerseek.core.Policy`. The module is
imported in each worker process, so that it must be installed or lie in a folder of PYTHONPATH.
"""

from __future__ import annotations

import importlib

from markerseek.core import ConfigError, Interval, MarkerseekError, Policy


def is_own(method: str) -> bool:
    """Whether a method is named as a user's own, ``module:name``."""
    return ":" in method


def build_own(method: str, *, limits: Interval, acquisitions: int) -> Policy:
    """Return a user's own policy.

    Parameters
    ----------
    method
        Its name, ``module:name``.
    limits, acquisitions
        Range to search, and most acquisitions.

    Raises
    ------
    ConfigError
        If the module cannot be imported, has no such name, or does not make a policy.
    """
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
        raise ConfigError(f"{method}: importing it failed: {described(problem)}") from problem
    try:
        policy = maker(limits=limits, acquisitions=acquisitions)
    except MarkerseekError:
        raise
    except Exception as problem:
        raise ConfigError(
            f"{method}: calling it with limits and acquisitions failed: {described(problem)}"
        ) from problem
    if not isinstance(policy, Policy):
        raise ConfigError(f"{method}: it made {policy!r:.80}, which has not all of ask, tell and estimate")
    return policy


def described(problem: Exception) -> str:
    """An error as its class and message in one line."""
    return f"{type(problem).__name__}: {' '.join(str(problem).split())}"
