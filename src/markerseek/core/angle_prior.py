"""A prior over the marker's angle: where a search looks first, and what its samples then said of the prior.

A search never multiplies it into its answer: angle, standard deviation and interval come from samples alone.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated

import msgspec

from markerseek.core.checks import Within, require_fields, require_range
from markerseek.core.errors import ConfigError
from markerseek.core.interval import Interval

_LEAST_SIGMA_DEG = 0.1
_MOST_SIGMA_DEG = 45.0
"""Limits of its standard deviation, in degrees: no prediction is better, and a wider one says nothing."""

_WEIGHTS = (1e-100, 1e100)
"""Limits of the weights of a table, beside 0: their products and sums are numbers too."""

MOST_ANGLES = 1000
"""Most angles of a table."""

REACH_SIGMAS = 3.0
"""Standard deviations to either side of the mean that the window holds."""

FLANK_DEG = 5.0
"""Degrees by which it is wider on either side: a marker at its end still has the flank, of a curve 3 to 17° wide, to
where it is steepest."""

TABLE_MASS = 0.997
"""Share of a table's probability that the window holds: as much as `REACH_SIGMAS` hold of a normal distribution."""

INSIDE = 0.025
"""Least probability of a prior that lies within the search range."""


class AnglePrior(msgspec.Struct, frozen=True, kw_only=True):
    """Where the marker is expected: a normal distribution, or a table (`of_table`).

    Attributes
    ----------
    mean_deg, sigma_deg
        Mean and standard deviation of the angle, in degrees.
    table
        Angles in degrees, ascending, each with its probability density in any unit; linear between them, and 0 outside.
        Empty for a normal distribution.

    Raises
    ------
    ConfigError
        If a number is not finite, out of range or in the wrong order.

    Examples
    --------
    >>> AnglePrior.parse("12.5±2").interval(Interval(low_deg=-35.0, high_deg=35.0))
    Interval(low_deg=1.5, high_deg=23.5)
    """

    mean_deg: Annotated[float, Within(-180.0, 180.0, "deg")]
    sigma_deg: Annotated[float, Within(_LEAST_SIGMA_DEG, _MOST_SIGMA_DEG, "deg")]
    table: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        require_fields(self, "near")

    @classmethod
    def of_table(cls, angles_deg: Sequence[float], weights: Sequence[float]) -> AnglePrior:
        """Return a prior with any density, for example with several peaks.

        Parameters
        ----------
        angles_deg
            Angles in degrees, ascending.
        weights
            Probability density at each, in any unit; linear between them, and 0 outside.

        Raises
        ------
        ConfigError
            If the table cannot be used.
        """
        table = tuple((float(each), float(weight)) for each, weight in zip(angles_deg, weights, strict=False))
        if len(angles_deg) != len(weights) or not 2 <= len(table) <= MOST_ANGLES:
            raise ConfigError(
                f"near: {len(angles_deg)} angles and {len(weights)} weights, a table needs 2 to {MOST_ANGLES} of both"
            )
        for angle_deg, weight in table:
            require_range("near: an angle of the table", angle_deg, low=-180.0, high=180.0, unit="deg")
            if not (weight == 0 or _WEIGHTS[0] <= weight <= _WEIGHTS[1]):
                low, high = _WEIGHTS
                raise ConfigError(
                    f"near: the weight at {angle_deg:g} deg is {weight}, it must be 0 or lie in [{low:g}, {high:g}]"
                )
        if not all(low[0] < high[0] for low, high in pairwise(table)):
            raise ConfigError("near: the angles of the table do not ascend; sort them, and name each once")
        parts = [_moments(*low, *high) for low, high in pairwise(table)]
        mass = sum(each[0] for each in parts)
        if not mass > 0:
            raise ConfigError("near: all weights of the table are 0; at least one must be positive")
        mean_deg = sum(each[1] for each in parts) / mass
        variance = sum(each[2] for each in parts) / mass - mean_deg**2
        sigma_deg = max(math.sqrt(max(variance, 0.0)), _LEAST_SIGMA_DEG)
        return cls(mean_deg=mean_deg, sigma_deg=sigma_deg, table=table)

    @classmethod
    def parse(cls, text: str) -> AnglePrior:
        """Return the prior of a text: ``12.5±2``, ``12.5+-2`` or ``12.5 2``; a table as ``8:1 9:3 10:1``.

        Raises
        ------
        ConfigError
            If it is none.
        """
        if ":" in text:
            pairs = [part.partition(":") for part in re.split(r"[,;\s]+", text.strip())]
            try:
                return cls.of_table([float(each[0]) for each in pairs], [float(each[2]) for each in pairs])
            except ValueError as problem:
                raise problem if isinstance(problem, ConfigError) else _unread(text) from None
        given = re.fullmatch(rf"({_NUMBER})\s*°?{_BETWEEN}({_NUMBER})\s*(?:°|deg)?", text.replace("−", "-").strip())
        if given is None:
            raise _unread(text)
        return cls(mean_deg=float(given[1]), sigma_deg=float(given[2]))

    def __str__(self) -> str:
        """Return the text from which `parse` makes the same prior."""
        if self.table:
            return " ".join(f"{angle_deg!r}:{weight!r}" for angle_deg, weight in self.table)
        return f"{_short(self.mean_deg)}±{_short(self.sigma_deg)}"

    def interval(self, limits: Interval) -> Interval:
        """Return the part of a range in which a search looks first, so wide that both flanks can be measured.

        Of a table it is the shortest that holds `TABLE_MASS` of it, with the same flanks.

        Raises
        ------
        ConfigError
            If the prior lies outside of the range.
        """
        inside = self.below(limits.high_deg) - self.below(limits.low_deg)
        if not inside >= INSIDE:
            raise ConfigError(
                f"near: {self} deg lies outside of {limits}; correct the angle, leave it out, or shift the search range"
            )
        low_deg, high_deg = self._core_deg()
        return Interval(low_deg=limits.nearest(low_deg - FLANK_DEG), high_deg=limits.nearest(high_deg + FLANK_DEG))

    def below(self, angle_deg: float) -> float:
        """Return the probability that the marker lies below an angle in degrees."""
        if not self.table:
            return 0.5 * math.erfc((self.mean_deg - angle_deg) / (math.sqrt(2) * self.sigma_deg))
        part = 0.0
        total = 0.0
        for (low_deg, low), (high_deg, high) in pairwise(self.table):
            total += (high_deg - low_deg) * (low + high) / 2
            reached_deg = min(max(angle_deg, low_deg), high_deg) - low_deg
            part += reached_deg * (low + (high - low) * reached_deg / (high_deg - low_deg) / 2)
        return part / total

    def _core_deg(self) -> tuple[float, float]:
        """Return both ends of the shortest interval that holds the prior but for its tails, in degrees."""
        if not self.table:
            return self.mean_deg - REACH_SIGMAS * self.sigma_deg, self.mean_deg + REACH_SIGMAS * self.sigma_deg
        first_deg = self.table[0][0]
        last_deg = self.table[-1][0]
        places = [first_deg + (last_deg - first_deg) * step / 200 for step in range(201)]
        mass = [self.below(each) for each in places]
        spans = []
        for low_deg, below in zip(places, mass, strict=True):
            high_deg = next((each for each, up in zip(places, mass, strict=True) if up - below >= TABLE_MASS), None)
            if high_deg is not None:
                spans.append((high_deg - low_deg, low_deg, high_deg))
        _, low_deg, high_deg = min(spans)
        return low_deg, high_deg


class PriorEvidence(msgspec.Struct, frozen=True, kw_only=True):
    """What a search has seen of the prior that it was given.

    Attributes
    ----------
    probability
        Probability that the prior is right, after what was measured; 0.95 before.
    whole_range
        Whether the search gave the prior up, and searched the whole range.
    """

    probability: float
    whole_range: bool

    def said(self, prior: AnglePrior) -> str:
        """Return the prior in words, for a person."""
        named = f"a table about {prior.mean_deg:.1f}°" if prior.table else f"{prior.mean_deg:g} ± {prior.sigma_deg:g}°"
        if self.probability < 0.5:
            share = "< 0.1 %" if self.probability < 1e-3 else f"{100 * self.probability:.2g} %"
            verdict = f"contradicted, probability {share}"
        else:
            # Rounded down: nothing makes it certain.
            verdict = f"not contradicted, probability {math.floor(100 * self.probability)} %"
        return f"{named}: {verdict}" + ("; the whole range was searched" if self.whole_range else "")


_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_BETWEEN = r"(?:\s*(?:±|\+/?-)\s*|\s*[,;]\s*|\s+)"


def _short(number: float) -> str:
    return repr(float(number)).removesuffix(".0")


def _unread(text: str) -> ConfigError:
    return ConfigError(
        f"near is {text[:40]!r}, an angle and its standard deviation in degrees are needed, as in 12.5±2; a table of "
        "angles with their weights as in 8:1 9:3 10:1"
    )


def _moments(low_deg: float, low: float, high_deg: float, high: float) -> tuple[float, float, float]:
    """Return the integrals of a linear density, of it times the angle, and times its square."""
    middle_deg = (low_deg + high_deg) / 2
    middle = (low + high) / 2
    width_deg = high_deg - low_deg
    # Simpson's rule is exact for these polynomials.
    weights = (low * width_deg / 6, 4 * middle * width_deg / 6, high * width_deg / 6)
    places_deg = (low_deg, middle_deg, high_deg)
    first = sum(weight * place for weight, place in zip(weights, places_deg, strict=True))
    second = sum(weight * place**2 for weight, place in zip(weights, places_deg, strict=True))
    return sum(weights), first, second
