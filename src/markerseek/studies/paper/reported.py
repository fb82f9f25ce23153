"""The paper's numbers by key; the data stand in `printed`."""

from __future__ import annotations

from markerseek.core import ConfigError
from markerseek.studies.paper.number import MATERIALS, Reported
from markerseek.studies.paper.printed import NUMBERS

__all__ = ["MATERIALS", "REPORTED", "SENSITIVE_DEG", "Reported", "reported"]

REPORTED: dict[str, Reported] = {number.key: number for number in NUMBERS}
"""All numbers by key."""

SENSITIVE_DEG = REPORTED["sensitive"].mean
"""Error beyond which the tool tip would leave the image: a run that is off by more counts as failed."""


def reported(key: str) -> Reported:
    """Number of the paper by its key.

    Raises
    ------
    ConfigError
        If there is none.
    """
    if key not in REPORTED:
        raise ConfigError(f"reported: {key!r} is no number of the paper; there are: {', '.join(REPORTED)}")
    return REPORTED[key]
