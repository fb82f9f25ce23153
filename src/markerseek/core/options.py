"""Options from the fields of a struct: only the field defines name, type, default and documentation of its option.

The command line, the page, links and network messages offer the same options.
"""

from __future__ import annotations

import types
import typing
from dataclasses import dataclass
from functools import cache
from typing import Any

import msgspec
from msgspec import structs

from markerseek.core.angle_prior import AnglePrior
from markerseek.core.errors import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Option:
    """One setting that a person can choose."""

    name: str
    """Name of the field."""
    kind: Any
    """Type of the value: bool, int, float, str, `AnglePrior`, or, on the command line alone, a ``Literal`` of texts.

    The value may also be ``None`` if that is the default.
    """
    default: Any
    """Value if nobody chooses one."""
    shown: str | None
    """What to show for a default of ``None``."""
    least: int | None
    """Smallest value allowed; None: no limit."""
    help: str
    """Documentation of the field."""

    @property
    def flag(self) -> str:
        """The option as it is typed, for example ``--tolerance-mm``."""
        return f"--{self.name.replace('_', '-')}"

    def read(self, text: str) -> bool | float | str | AnglePrior:
        """Return the value that a text states; `ConfigError` if the text does not have the type of this option."""
        if self.kind is AnglePrior:
            return AnglePrior.parse(text)
        try:
            if self.kind is bool:
                return _TRUTH[text.lower()]
            value: float | str = self.kind(text)
        except (KeyError, ValueError):
            raise ConfigError(
                f"{self.name} is {text[:40]!r}, it must be {_IN_WORDS[self.kind]}; correct it, or leave it out"
            ) from None
        return value


_TRUTH = {"true": True, "1": True, "false": False, "0": False}
_IN_WORDS: dict[type, str] = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


class Help(msgspec.Struct, frozen=True):
    """Makes a field an option, as its annotation: ``Annotated[bool, Help("Simulate noise and clutter alone.")]``."""

    text: str
    """Documentation of the field, and help of the option."""
    shown: str | None = None
    """As of `Option`."""
    least: int | None = None
    """As of `Option`."""


@cache
def options_of(kind: type[msgspec.Struct]) -> tuple[Option, ...]:
    """Return the options among the fields of a struct, in their order; those of a parent class come last."""
    found = []
    for each in sorted(structs.fields(kind), key=lambda each: each.name not in kind.__annotations__):
        for help_ in getattr(each.type, "__metadata__", ()):
            if isinstance(help_, Help):
                option = Option(
                    name=each.name,
                    kind=_required(typing.get_args(each.type)[0]),
                    default=each.default,
                    shown=help_.shown,
                    least=help_.least,
                    help=help_.text,
                )
                found.append(option)
    return tuple(found)


def _required(kind: Any) -> Any:
    """Return the type without ``None``."""
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union:
        return next(each for each in typing.get_args(kind) if each is not types.NoneType)
    return kind


def arguments_of(settings: msgspec.Struct) -> list[str]:
    """Return the options of these settings that differ from their defaults, as they are typed: ``--seed=3``."""
    given = [(each, getattr(settings, each.name)) for each in options_of(type(settings))]
    return [
        each.flag if value is True else f"{each.flag}={as_text(value)}"
        for each, value in given
        if value != each.default
    ]


def as_text(value: object) -> str:
    """Return a value as text, without loss: 3.0 as 3, a truth value as 0 or 1."""
    return str(int(value)) if isinstance(value, bool) else str(value).removesuffix(".0")
