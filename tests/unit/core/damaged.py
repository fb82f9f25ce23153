"""Readings that cannot be measurements, as a reader from elsewhere may return them."""

from __future__ import annotations

from typing import Any

from msgspec.structs import force_setattr, replace

from markerseek.core import Reading


def damaged(reading: Reading | None = None, **values: Any) -> Reading:
    """A copy of a reading with these values, set past its own check."""
    made = replace(reading or Reading(intensity=1.0))
    for name, value in values.items():
        force_setattr(made, name, value)
    return made
