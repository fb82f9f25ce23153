"""Angles, times and metadata of an exported bank, all in the order of time."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Literal, TypeAlias

from markerseek.records.banks import BankFacts, FrameBank, IntensityBank

Clock: TypeAlias = Literal["unix", "rig", "none"]
"""What times were read from."""

TIMES: dict[Clock, str] = {
    "unix": "seconds since 1970-01-01 00:00 UTC",
    "rig": "seconds on the clock of the rig",
    "none": "not known: the acquisitions are numbered in the order of their angles, one to a second",
}
"""What times mean, in words."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """Acquisitions in the order of the export."""

    angles_deg: tuple[float, ...]
    """Angle of the probe at each."""
    times_s: tuple[float, ...]
    """When each began, rising."""
    clock: Clock
    """What the times were read from; ``none``: 0, 1, 2 and so on."""
    order: tuple[int, ...]
    """Number of each in the bank, counted from 0."""
    facts: BankFacts

    @property
    def known(self) -> dict[str, str | float | bool]:
        """Facts by name, units in the names; what is not known is left out."""
        facts = {name: each for name, each in asdict(self.facts).items() if each is not None and str(each).strip()}
        return facts | {"times": TIMES[self.clock]}


def series_of(bank: IntensityBank | FrameBank, *, facts: BankFacts | None = None) -> Series:
    """Acquisitions of a bank in the order of time, or of the angles where no times are known.

    Times are used if each acquisition has one and they differ within six digits, counted from the first: SlicerIGSIO
    compares times with that precision, and would merge acquisitions with equal ones.

    ``facts``: what is known of it, where that is more than it holds.
    """
    times, clock = _times(bank)
    order = tuple(sorted(range(len(times)), key=times.__getitem__))
    return Series(
        angles_deg=tuple(bank.angles_deg[index] for index in order),
        times_s=tuple(times[index] for index in order),
        clock=clock,
        order=order,
        facts=bank.facts if facts is None else facts,
    )


def _times(bank: IntensityBank | FrameBank) -> tuple[tuple[float, ...], Clock]:
    count = len(bank.angles_deg)
    started_s = bank.started_s
    first_s = min(started_s, default=0.0)
    different = len({f"{each - first_s:g}" for each in started_s}) == len(started_s) == count
    if not different or not all(0 <= each < math.inf for each in started_s):
        return tuple(map(float, range(count))), "none"
    zero_s = bank.facts.clock_zero_unix_s
    return (started_s, "rig") if zero_s is None else (tuple(zero_s + each for each in started_s), "unix")
