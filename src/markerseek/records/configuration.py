"""What a run was begun with: enough to repeat the same search on the same rig."""

from __future__ import annotations

import platform
from typing import Annotated, Literal

import msgspec
import numpy as np
import scipy

from markerseek._version import __version__
from markerseek.core import MOST_ACQUISITIONS, Interval

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
        Where the probe stood when the policy was made, in degrees.
    dark_frames
        Acquisitions without laser before the first.
    stay
        Whether the last move and the confirmation are left out.
    rig
        Kind of the rig.
    recipe
        Settings of the rig in full, as JSON; null for a rig that was not put together from settings.
    imaging
        Preset of the rig's imaging chain in full, as JSON; null where there are intensities only.
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
    acquisitions: Annotated[int, msgspec.Meta(ge=0, le=MOST_ACQUISITIONS)] | None
    as_published: bool
    search: Interval
    start_deg: float
    dark_frames: Annotated[int, msgspec.Meta(ge=0, le=_MOST_DARK_FRAMES)]
    stay: bool
    rig: Literal["simulated", "replayed", "bench"]
    recipe: msgspec.Raw
    imaging: msgspec.Raw = msgspec.Raw(b"null")
    fingerprint: str
    description: str
    face_radius_m: float | None
    truth_deg: float | None
    reference_deg: float | None
    seed: int | None
    versions: dict[str, str] = msgspec.field(default_factory=versions)
