"""What every search policy does with its samples: it checks them, keeps them, and caches its next angle."""

from __future__ import annotations

import math
import operator
from abc import ABC, abstractmethod
from typing import ClassVar, Protocol, SupportsIndex, runtime_checkable

from markerseek.core import MAX_ACQUISITIONS, ConfigError, Found, Sample, SearchError


class SearchPolicy(ABC):
    """A policy that keeps the samples of one search; subclasses say which angle is next.

    Samples with the laser on are kept apart from dark ones, which say nothing of the curve.
    """

    name: ClassVar[str] = "search"
    """Name of the method, by which it is asked for and by which messages call it."""
    summary: ClassVar[str] = ""
    """What it does, in one line."""
    acquisitions: ClassVar[int]
    """Acquisitions where the user names no number; without it they must be named."""
    least: ClassVar[int] = 2
    """Fewest acquisitions that it can work with."""

    def __init__(self) -> None:
        self._lit: list[Sample] = []
        self._dark: list[Sample] = []
        self._next: tuple[float | None] | None = None

    def __repr__(self) -> str:
        """Return its class and how many acquisitions it has."""
        return f"<{self.name} after {len(self._lit)} acquisitions>"

    def ask(self) -> float | None:
        """Return the next angle in degrees; None at the end of the search. It is computed once for each new sample."""
        if self._next is None:
            self._next = (self._next_deg(),)
        return self._next[0]

    def tell(self, sample: Sample) -> None:
        """Take one sample.

        Raises
        ------
        SearchError
            If the sample is not usable (`check_sample`), or the laser was on and the search is over.
        """
        check_sample(sample)
        if sample.dark:
            self._dark.append(sample)
        elif self.ask() is None:
            raise SearchError(f"{self.name}: it is over after {len(self._lit)} acquisitions; begin a new search")
        else:
            self._lit.append(sample)
            self._update(sample)
        self._next = None

    @abstractmethod
    def _next_deg(self) -> float | None:
        """Return the next angle in degrees from the samples so far; None at the end."""

    def _update(self, sample: Sample) -> None:  # noqa: B027  most policies have no state beside their samples
        """Change the state of the search by a sample with the laser on, which is the last one kept."""


@runtime_checkable
class PaperPolicy(Protocol):
    """A policy that always answers `Found`, as the methods of the paper do."""

    def ask(self) -> float | None:
        """Return the next angle in degrees, or None when the search is over."""

    def tell(self, sample: Sample) -> None:
        """Take one sample."""

    def estimate(self) -> Found:
        """Return the answer from the samples alone."""

    def answer(self, *, noise_sigma: float | None) -> Found:
        """Return the same angle, with the uncertainty by noise of this standard deviation in the intensity."""


def check_sample(sample: Sample) -> None:
    """Refuse a sample that no search can use."""
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
    acquisitions: SupportsIndex | float, *, least: int, most: int = MAX_ACQUISITIONS, method: str
) -> int:
    """Return the number of acquisitions if a search can be made of it."""
    # Whole numbers of all kinds, NumPy's too, but neither 16.0 nor True.
    if isinstance(acquisitions, bool | float) or not isinstance(acquisitions, SupportsIndex):
        raise ConfigError(f"{method}: acquisitions is {acquisitions!r}, it must be a whole number of at least {least}")
    number = operator.index(acquisitions)
    if number < least:
        raise ConfigError(f"{method}: acquisitions is {acquisitions}, at least {least} are needed")
    if number > most:
        raise ConfigError(f"{method}: acquisitions is {acquisitions}, at most {most} can be made")
    return number


def check_start(start_deg: float | None, *, method: str) -> None:
    """Refuse a start angle that is not finite; None is the low end of the range."""
    if start_deg is not None and not math.isfinite(start_deg):
        raise ConfigError(f"{method}: start_deg is {start_deg} deg, it must be finite")
