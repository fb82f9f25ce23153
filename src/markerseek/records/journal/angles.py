"""Whether the angles in a journal can be those of its run."""

from __future__ import annotations

from collections.abc import Iterable

from markerseek.core import Asked, Finished, Found, Interval, Measured, Refused, Started
from markerseek.records.configuration import Configuration
from markerseek.records.journal.events import Entry, Resuming

_ARRIVAL_DEG = 0.1
"""How far from the angle asked for the guard lets a stage come to rest, in degrees."""

_TURN = Interval(low_deg=-360.0, high_deg=360.0)
"""Where a probe can stand at all, at the start and for dark frames."""


def angle_faults(configuration: Configuration, entries: Iterable[Entry]) -> list[tuple[int, str]]:
    """Numbers of entries with an angle outside the limits of their run, each with the reason; 0 is the configuration.

    Parameters
    ----------
    configuration
        What the run was begun with; acquisitions with light lie in its search range.
    entries
        Its entries, in order.
    """
    search, start_deg = configuration.facts.search, configuration.plan.start_deg
    reached = Interval(low_deg=search.low_deg - _ARRIVAL_DEG, high_deg=search.high_deg + _ARRIVAL_DEG)
    faults: list[tuple[int, str]] = []
    if start_deg is not None and start_deg not in _TURN:
        faults.append((0, f"the start angle {start_deg:g} deg lies outside {_TURN}"))
    dark = False
    for entry in entries:
        angles: list[tuple[float | None, Interval]] = []
        match entry.event:
            case Started(start_deg=start_deg, limits=limits):
                angles = [(start_deg, _TURN)]
                if limits != search:
                    faults.append((entry.number, f"it searches {limits}, the run was begun with {search}"))
            case Asked(role=role, angle_deg=angle_deg):
                dark = role == "dark"
                angles = [(angle_deg, _TURN if dark else search)]
            case Measured(sample=sample):
                angles = [(sample.angle_deg, _TURN if sample.dark else reached)]
            case Refused(angle_deg=angle_deg):
                angles = [(angle_deg, _TURN if dark else reached)]
            case Resuming(check_deg=check_deg, flank_deg=flank_deg):
                angles = [(check_deg, reached), (flank_deg, reached)]
            case Finished(estimate=estimate):
                angles = [(estimate.mean_deg, search if isinstance(estimate, Found) else _TURN)]
        faults += [
            (entry.number, f"the angle {angle_deg:g} deg lies outside {allowed}")
            for angle_deg, allowed in angles
            if angle_deg is not None and angle_deg not in allowed
        ]
    return faults
