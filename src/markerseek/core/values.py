"""Values of which one field is left out where they are compared, or shown."""

from __future__ import annotations

from typing import ClassVar

import msgspec


class EqualWithout(msgspec.Struct, frozen=True, kw_only=True):
    """A value that equals another one whatever one of its fields is."""

    left_out: ClassVar[str]
    """Name of this field."""

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and all(
            getattr(self, name) == getattr(other, name) for name in self.__struct_fields__ if name != self.left_out
        )

    def __hash__(self) -> int:
        return hash(tuple(getattr(self, name) for name in self.__struct_fields__ if name != self.left_out))


def repr_without(value: msgspec.Struct, left_out: str) -> str:
    """Return the `repr` of a value without one of its fields."""
    shown = ", ".join(f"{name}={getattr(value, name)!r}" for name in value.__struct_fields__ if name != left_out)
    return f"{type(value).__name__}({shown})"
