"""Options from the fields of a dataclass: only the field defines name, type, default and documentation of its option.

The command line, the page, links and network messages offer the same options.
"""

from __future__ import annotations

import ast
import inspect
import sys
import types
import typing
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache
from itertools import pairwise
from typing import Any

from markerseek.core.angle_prior import AnglePrior
from markerseek.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """One setting that a person can choose."""

    name: str
    """Name of the field."""
    kind: type[bool] | type[int] | type[float] | type[str] | type[AnglePrior]
    """Type of the value; the value may also be ``None`` if that is the default."""
    default: Any
    """Value if nobody chooses one."""
    shown: str | None
    """What to show for a default of ``None``."""
    least: int | None
    """Smallest value allowed; None: no limit."""
    help: str
    """The field's documentation, on one line."""

    @property
    def flag(self) -> str:
        """The option as it is typed, for example ``--tolerance-mm``."""
        return f"--{self.name.replace('_', '-')}"

    def read(self, text: str) -> bool | float | str | AnglePrior:
        """Value that a text states; `ConfigError` if the text does not have the type of this option."""
        if issubclass(self.kind, AnglePrior):
            return self.kind.parse(text)
        try:
            if self.kind is bool:
                return _TRUTH[text.lower()]
            return self.kind(text)
        except (KeyError, ValueError):
            raise ConfigError(
                f"{self.name} is {text[:40]!r}, it must be {_IN_WORDS[self.kind]}; correct it, or leave it out"
            ) from None


_TRUTH = {"true": True, "1": True, "false": False, "0": False}
_IN_WORDS: dict[type, str] = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


def option(default: Any, *, shown: str | None = None, least: int | None = None) -> Any:
    """A field of a dataclass that is also an option; the arguments are those of `Option`."""
    return field(default=default, metadata={_OPTION: (shown, least)})


_OPTION = "option"


def options_of(kind: type[Any]) -> tuple[Option, ...]:
    """The options among the fields of a dataclass, in their order; those of a parent class come last."""
    chosen = [each for each in fields(kind) if _OPTION in each.metadata]
    if not chosen:
        return ()
    types_, documented = typing.get_type_hints(kind), documentation(kind)
    return tuple(
        Option(
            name=each.name,
            kind=_required(types_[each.name]),
            default=each.default,
            shown=each.metadata[_OPTION][0],
            least=each.metadata[_OPTION][1],
            help=documented[each.name],
        )
        for each in sorted(chosen, key=lambda each: each.name not in kind.__annotations__)
    )


def documentation(kind: type[Any]) -> dict[str, str]:
    """The documentation of each field of a dataclass: the text below it in the source, on one line."""
    found: dict[str, str] = {}
    for owner in reversed([each for each in kind.__mro__ if is_dataclass(each)]):
        for before, after in pairwise(_body(owner.__module__, owner.__name__)):
            match before, after:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                    found[name] = " ".join(text.split())
    return found


# Read once, although a command line asks for its options often.
@cache
def _body(module: str, name: str) -> list[ast.stmt]:
    """Statements of a class in a module. `inspect.getsource` of the class would read the file twice."""
    body = ast.parse(inspect.getsource(sys.modules[module])).body
    return next(each.body for each in body if isinstance(each, ast.ClassDef) and each.name == name)


def _required(kind: Any) -> Any:
    """The type without ``None``."""
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union:
        return next(each for each in typing.get_args(kind) if each is not types.NoneType)
    return kind


def arguments_of(settings: Any) -> list[str]:
    """The options of these settings that differ from their defaults, as they are typed: ``--seed=3``."""
    given = [(each, getattr(settings, each.name)) for each in options_of(type(settings))]
    return [
        each.flag if value is True else f"{each.flag}={as_text(value)}"
        for each, value in given
        if value != each.default
    ]


def as_text(value: object) -> str:
    """A value as text, without loss: 3.0 as 3, a truth value as 0 or 1."""
    return str(int(value)) if isinstance(value, bool) else str(value).removesuffix(".0")
