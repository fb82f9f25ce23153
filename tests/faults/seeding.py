"""Seeding of bugs into the package: one piece of source text replaced by another, and restored."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import sys
import textwrap
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import ModuleType

ANNOTATIONS = 0x1000000
"""The compiler's flag for annotations that are not evaluated, which all our files have."""


@dataclass(frozen=True, kw_only=True)
class Bug:
    """One piece of source replaced by another, and the check that must notice."""

    where: str
    old: str
    new: str
    check: Callable[[], None]


@contextlib.contextmanager
def seeded(bug: Bug) -> Iterator[None]:
    """The package with one bug in it, also where others have imported it from its place."""
    place, _, path = bug.where.partition(":")
    module = importlib.import_module(f"markerseek.{place}")
    owner: ModuleType | type = module
    *outer, attribute = path.split(".")
    for step in outer:
        owner = getattr(owner, step)
    sound = vars(owner)[attribute]
    plain = getattr(sound, "__func__", sound)
    source = textwrap.dedent(inspect.getsource(inspect.unwrap(plain)))
    if source.count(bug.old) != 1:
        # No AssertionError: `caught` takes one for the check that has noticed the bug.
        raise LookupError(f"{bug.where} does not hold {bug.old!r} once: write the bug again")
    made: dict[str, object] = {}
    text = source.replace(bug.old, bug.new)
    exec(compile(text, module.__file__ or "", "exec", flags=ANNOTATIONS), vars(module), made)
    everywhere = [owner] if owner is not module else _holders(attribute, sound)
    for holder in everywhere:
        setattr(holder, attribute, made[attribute])
    try:
        yield
    finally:
        for holder in everywhere:
            setattr(holder, attribute, sound)


def _holders(attribute: str, sound: object) -> list[ModuleType]:
    return [module for module in list(sys.modules.values()) if vars(module).get(attribute) is sound]


def caught(bug: Bug) -> bool:
    try:
        with seeded(bug):
            bug.check()
    except AssertionError:
        return True
    return False


def table(bugs: Mapping[str, Bug]) -> list[str]:
    """A row for each bug."""
    return [
        f"| {name} | `{bug.where}` | {bug.check.__name__.replace('_', ' ')} | {'caught' if caught(bug) else 'MISSED'} |"
        for name, bug in bugs.items()
    ]
