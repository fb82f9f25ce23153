"""Angles, intensities, times and metadata of an exported bank, all in the order of time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal, TypeAlias

from markerseek.core import ConfigError, PaImage, RecordError
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
    intensities: tuple[float, ...] = ()
    """Intensity of each, NaN where it is not known; empty where none is."""
    pulses: tuple[int, ...] = ()
    """Laser pulses averaged in each; empty where it is not known."""
    facts: BankFacts

    def __post_init__(self) -> None:
        count = len(self.angles_deg)
        given = [len(self.times_s), len(self.order), len(self.intensities) or count, len(self.pulses) or count]
        if any(each != count for each in given):
            raise ConfigError(
                f"series: {count} angles, and {', '.join(map(str, given))} times, places, intensities and pulses; "
                "give one of each for an acquisition"
            )
        if not all(0 <= each < math.inf for each in self.times_s):
            raise ConfigError("series: times_s must be finite and not negative; leave them out where they are unknown")
        if not all(before < after for before, after in pairwise(self.times_s)):
            raise ConfigError("series: times_s must rise; give the acquisitions in the order of time")

    @property
    def known(self) -> dict[str, str | float | bool]:
        """Facts by name, units in the names; what is not known is left out."""
        facts = {
            name: value.encode("utf-8", "replace").decode("utf-8") if isinstance(value, str) else value
            for name, value in asdict(self.facts).items()
            if value is not None and str(value).strip()
        }
        return facts | {"times": TIMES[self.clock]}


def series_of(
    bank: IntensityBank | FrameBank, *, facts: BankFacts | None = None, intensities: tuple[float, ...] | None = None
) -> Series:
    """Acquisitions of a bank in the order of time, or of the angles where no times are known.

    Times are used if each acquisition has one and they differ within six digits, counted from the first: SlicerIGSIO
    compares times with that precision, and would merge acquisitions with equal ones.

    ``facts``: what is known of it, where that is more than it holds. ``intensities``: intensities in the order of the
    bank's angles, in the place of those that it holds.
    """
    times, clock = _times(bank)
    order = tuple(sorted(range(len(times)), key=times.__getitem__))
    held = bank.intensities if intensities is None else intensities
    pulses = bank.pulses if isinstance(bank, FrameBank) else ()
    return Series(
        angles_deg=tuple(bank.angles_deg[index] for index in order),
        times_s=tuple(times[index] for index in order),
        clock=clock,
        order=order,
        intensities=tuple(held[index] for index in order) if held else (),
        pulses=tuple(pulses[index] for index in order) if pulses else (),
        facts=bank.facts if facts is None else facts,
    )


def one_for_each(path: Path, images: Iterator[PaImage], count: int) -> Iterator[PaImage]:
    """The images, checked to be `count` many; `RecordError` if not."""
    given = 0
    for given, image in enumerate(images, start=1):
        if given > count:
            break
        yield image
    if given != count:
        raise RecordError(f"{path}: {count} angles and {'more' if given > count else given} images; give one for each")


def _times(bank: IntensityBank | FrameBank) -> tuple[tuple[float, ...], Clock]:
    count = len(bank.angles_deg)
    started_s = bank.started_s
    first_s = min(started_s, default=0.0)
    different = len({f"{each - first_s:g}" for each in started_s}) == len(started_s) == count
    if not different or not all(0 <= each < math.inf for each in started_s):
        return tuple(map(float, range(count))), "none"
    zero_s = bank.facts.clock_zero_unix_s
    return (started_s, "rig") if zero_s is None else (tuple(zero_s + each for each in started_s), "unix")
