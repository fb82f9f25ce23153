"""What is left out where two values are compared, or one is shown."""

from __future__ import annotations

import msgspec


def equal_without(one: msgspec.Struct, other: object, left_out: str) -> bool:
    """Whether two values are of one class and equal in all fields but one."""
    return type(one) is type(other) and all(
        getattr(one, name) == getattr(other, name) for name in one.__struct_fields__ if name != left_out
    )


def repr_without(value: msgspec.Struct, left_out: str) -> str:
    """Return the `repr` of a value without one of its fields."""
    shown = ", ".join(f"{name}={getattr(value, name)!r}" for name in value.__struct_fields__ if name != left_out)
    return f"{type(value).__name__}({shown})"
