"""What is followed: a place in the frame of the left camera, with its time and what it may be off by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from markerseek.core import ConfigError, Float64, Sample


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Target:
    """Where the target was at a time.

    Raises `ConfigError` if a number is not finite, or the covariance is none.
    """

    at_s: float
    """On the rig's clock."""
    camera_m: Float64[np.ndarray, " 3"]
    """In the frame of the left camera."""
    covariance_m2: Float64[np.ndarray, "3 3"]
    """Its covariance there, of what is independent from one time to the next."""
    named: int | None = None
    """Number of the place that a person named: it rests on the tissue, and another number is another place, no jump.
    None: a target that moves."""
    shared_m2: Float64[np.ndarray, "3 3"] | None = None
    """Its covariance there by errors that are the same at all times, as those of an arm; None: none are stated."""

    def __post_init__(self) -> None:
        covariances_m2 = [self.covariance_m2, *([] if self.shared_m2 is None else [self.shared_m2])]
        numbers = np.concatenate([[self.at_s], self.camera_m, *(each.ravel() for each in covariances_m2)])
        if not np.isfinite(numbers).all() or min(np.linalg.eigvalsh(each)[0] for each in covariances_m2) < 0:
            raise ConfigError(
                f"target: {self.camera_m.tolist()} m with covariance {self.covariance_m2.tolist()} m² at {self.at_s} s,"
                " these must be finite numbers, and the covariance positive"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorLinks:
    """Which errors are in the uncertainty of a target, and which are not, in words with their numbers."""

    counted: tuple[str, ...]
    not_counted: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Look:
    """What one look by the laser's light gave."""

    target: Target | None
    """The spot; None: both cameras do not show one."""
    reason: str = ""
    """Why there is none."""
    sample: Sample | None = None
    """The frame of the probe from the same pulses; None: it was refused."""


class TargetSource(Protocol):
    """Tells where the target is without any light."""

    name: str
    """What is followed, in words."""

    def newest(self) -> Target | None:
        """Return the newest place since the last call; None: there is none, or it is not seen."""

    @property
    def heard_s(self) -> float:
        """Of when the newest message of its link is, on the rig's clock; the present time where there is no link."""


@runtime_checkable
class LitSource(Protocol):
    """Tells where a laser spot is, with the probe at rest, by pulses under a permit."""

    name: str

    def look(self, pulses: int) -> Look:
        """Fire so many pulses, look at the images, and read the frame of the same pulses."""
