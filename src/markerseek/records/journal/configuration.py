"""What a run was begun with: enough to put the same search on the same rig together again."""

from __future__ import annotations

import platform
from typing import Literal

import msgspec
import numpy as np
import scipy

from markerseek._version import __version__
from markerseek.core import ConfigError, Interval

_MOST_DARK_FRAMES = 100


def versions() -> dict[str, str]:
    """Versions of what a result depends on, bit for bit."""
    return {
        "markerseek": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "machine": platform.machine(),
    }


class Configuration(msgspec.Struct, frozen=True, kw_only=True):
    """Search and rig of a run.

    Attributes
    ----------
    method, acquisitions, as_published
        The policy's name and form, and its most acquisitions; None where the method's own number holds.
    search
        Range searched.
    start_deg
        Where the policy was told that the probe stands, in degrees.
    dark_frames
        Acquisitions without laser before the first.
    stay
        Whether the last move and the confirmation are left out.
    closing_dark
        Whether it ends with an acquisition without laser.
    rig
        Kind of the rig.
    recipe
        Settings of the rig in full, as JSON; null for a rig that was not put together from settings.
    imaging
        Preset of the rig's imaging chain in full, as JSON; null where there are intensities only. Journals of version 1
        do not hold it.
    fingerprint
        The same for equal rigs.
    description
        The rig in words.
    face_radius_m, truth_deg, reference_deg
        As in `markerseek.rigs.Rig`.
    seed
        Seed of a simulation.
    versions
        See `versions`.
    """

    method: str
    acquisitions: int | None
    as_published: bool
    search: Interval
    start_deg: float
    dark_frames: int
    stay: bool
    closing_dark: bool = False
    rig: Literal["simulated", "replayed", "bench"]
    recipe: msgspec.Raw
    imaging: msgspec.Raw | msgspec.UnsetType = msgspec.UNSET
    fingerprint: str
    description: str
    face_radius_m: float | None
    truth_deg: float | None
    reference_deg: float | None
    seed: int | None
    versions: dict[str, str] = msgspec.field(default_factory=versions)

    def __post_init__(self) -> None:
        if not 0 <= self.dark_frames <= _MOST_DARK_FRAMES:
            raise ConfigError(f"dark_frames is {self.dark_frames}, it must lie between 0 and {_MOST_DARK_FRAMES}")
