"""The intensity curve S(θ) as far as it was heard, and what a policy refuses to hear."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, SupportsIndex

import numpy as np

from markerseek.core import MOST_ACQUISITIONS, ConfigError, Found, SearchError
from markerseek.core.reading import Sample
from markerseek.core.shapes import Float64


class PublishedPolicy(Protocol):
    """A policy that always answers `Found`, as the methods of the paper do."""

    def ask(self) -> float | None:
        """Next angle in degrees, or None when the search is over."""

    def tell(self, sample: Sample) -> None:
        """Take in one sample."""

    def estimate(self) -> Found:
        """Answer from the samples alone."""

    def answer(self, *, noise_sigma: float | None) -> Found:
        """The same angle, with the uncertainty that follows from noise of this standard deviation in the intensity."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """Samples of S(θ) in rising order of the angle.

    Attributes
    ----------
    angle_deg
        Angles reached, in degrees, rising; the same angle may stand there twice.
    intensity
        Intensities at these angles, in the unit of the samples.
    """

    angle_deg: Float64[np.ndarray, " samples"]
    intensity: Float64[np.ndarray, " samples"]

    def __len__(self) -> int:
        return self.angle_deg.size

    @property
    def strongest(self) -> int:
        """Index of the largest intensity; of several, the one at the lowest angle."""
        return int(np.argmax(self.intensity))


def curve_of(samples: Sequence[Sample]) -> Curve:
    """Return the curve that these samples draw."""
    angle_deg = np.array([sample.angle_deg for sample in samples], dtype=np.float64)
    intensity = np.array([sample.reading.intensity for sample in samples], dtype=np.float64)
    order = np.argsort(angle_deg, kind="stable")
    return Curve(angle_deg=angle_deg[order], intensity=intensity[order])


def check_sample(sample: Sample) -> None:
    """Refuse a sample that no rule of a search is made for.

    Raises
    ------
    SearchError
        If the angle or the intensity is NaN or infinite, or the intensity is negative.
    """
    if not math.isfinite(sample.angle_deg):
        raise SearchError(f"sample: angle_deg is {sample.angle_deg}, it must be finite; measure this angle again")
    intensity = sample.reading.intensity
    if not math.isfinite(intensity):
        raise SearchError(
            f"sample at {sample.angle_deg:g} deg: intensity is {intensity}, it must be finite; measure this angle again"
        )
    if intensity < 0:
        raise SearchError(
            f"sample at {sample.angle_deg:g} deg: intensity is {intensity:g}, the peak of an envelope is never "
            "below 0; convert decibels to a linear scale first"
        )


def check_acquisitions(
    acquisitions: SupportsIndex | float, *, least: int, most: int = MOST_ACQUISITIONS, method: str
) -> int:
    """Return the number of acquisitions if a search can be made of it.

    Raises
    ------
    ConfigError
        If it is no whole number, or fewer than ``least``, or more than ``most``.
    """
    # Whole numbers of all kinds, NumPy's too, but neither 16.0 nor True.
    if isinstance(acquisitions, bool | float) or not isinstance(acquisitions, SupportsIndex):
        raise ConfigError(f"{method}: acquisitions is {acquisitions!r}, it must be a whole number of at least {least}")
    number = operator.index(acquisitions)
    if number < least:
        raise ConfigError(f"{method}: acquisitions is {acquisitions}, at least {least} are needed")
    if number > most:
        raise ConfigError(f"{method}: acquisitions is {acquisitions}, at most {most} can be made")
    return number
