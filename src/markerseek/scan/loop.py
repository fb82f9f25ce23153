"""`run`: drives a policy over a rig, and reports each step.

There is one loop for simulated, replayed and real rigs. `run` is a generator of events, so that a terminal, a page,
a journal or a test can watch it; closing it stops the stage and takes the laser's permit away.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass

from markerseek.core import (
    MOST_ACQUISITIONS,
    AcquisitionError,
    Asked,
    ConfigError,
    Event,
    Failed,
    Finished,
    Found,
    Measured,
    Policy,
    Refused,
    Sample,
    SaturationError,
    SearchError,
    Started,
)
from markerseek.guard import State
from markerseek.scan.scanner import Scanner


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLimits:
    """What a run may cost before it is ended with an error.

    Attributes
    ----------
    acquisitions
        Most acquisitions that a policy may ask for.
    duration_s
        Longest time on the rig's clock, in seconds.
    attempts
        How often one acquisition is tried when its frames are refused.
    """

    acquisitions: int = MOST_ACQUISITIONS
    duration_s: float = 3600.0 * 3
    attempts: int = 3


_RUN_LIMITS = RunLimits()


def run(
    policy: Policy, scanner: Scanner, *, dark_frames: int = 0, stay: bool = False, limits: RunLimits = _RUN_LIMITS
) -> Generator[Event, None, None]:
    """Let a policy search on a rig, and report each step.

    A search that found a marker ends with a move to it and one acquisition there, which confirms and is not told.
    Each `Measured` is handed out before the policy is told of it.

    Parameters
    ----------
    policy
        Decides where to look next.
    scanner
        The rig.
    dark_frames
        Acquisitions without laser before the first, which tell the policy what noise looks like.
    stay
        Leave the probe where the last acquisition was taken, and confirm nothing.
    limits
        What the run may cost.

    Yields
    ------
    Event
        Started; Asked, Refused and Measured; then Finished, or Failed followed by its error.

    Raises
    ------
    Exception
        Whatever ended the run, a `MarkerseekError` unless a driver broke its promise; the probe stays where it stopped.
    """
    began_s = scanner.clock.now_s()
    travel_deg = 0.0
    count = 0
    try:
        place_deg = scanner.angle_deg
        yield Started(start_deg=place_deg, limits=scanner.limits.search)
        for index in range(1, dark_frames + 1):
            yield Asked(role="dark", index=index, angle_deg=place_deg)
            dark = yield from _admitted(scanner, scanner.measure_dark, place_deg, limits.attempts)
            yield Measured(role="dark", index=index, sample=dark)
            policy.tell(dark)
        while (asked_deg := policy.ask()) is not None:
            _require_budget(count, scanner.clock.now_s() - began_s, limits)
            scanner.limits.require_search(asked_deg)
            yield Asked(role="search", index=count + 1, angle_deg=asked_deg)
            sample = yield from _admitted(scanner, _at(scanner, asked_deg), asked_deg, limits.attempts)
            count += 1
            travel_deg += abs(sample.angle_deg - place_deg)
            place_deg = sample.angle_deg
            yield Measured(role="search", index=count, sample=sample)
            policy.tell(sample)
        estimate = policy.estimate()
        confirmation = None
        if isinstance(estimate, Found) and not stay:
            yield Asked(role="confirmation", index=1, angle_deg=estimate.mean_deg)
            confirm = _at(scanner, estimate.mean_deg)
            confirmation = yield from _admitted(scanner, confirm, estimate.mean_deg, limits.attempts)
            travel_deg += abs(confirmation.angle_deg - place_deg)
            yield Measured(role="confirmation", index=1, sample=confirmation)
        yield Finished(
            estimate=estimate,
            confirmation=confirmation,
            acquisitions=count,
            travel_deg=travel_deg,
            elapsed_s=scanner.clock.now_s() - began_s,
        )
    except Exception as error:
        yield Failed(error=error)
        raise
    finally:
        scanner.stop()


def _at(scanner: Scanner, angle_deg: float) -> Callable[[], Sample]:
    return lambda: scanner.measure(angle_deg)


def _admitted(
    scanner: Scanner, measure: Callable[[], Sample], angle_deg: float, attempts: int
) -> Generator[Event, None, Sample]:
    """Measure again while frames are refused, and no more often than the limit says."""
    for attempt in range(1, attempts + 1):
        try:
            return measure()
        except SaturationError:
            raise
        except AcquisitionError as refusal:
            if scanner.guard.state is State.FAULT:
                raise
            if attempt == attempts:
                error = AcquisitionError(f"{refusal} (refused {attempts} times at {angle_deg:.2f} deg)")
                scanner.guard.fail(str(error))
                raise error from refusal
            yield Refused(angle_deg=angle_deg, reason=str(refusal), frame=scanner.refused_frame)
    raise ConfigError(f"run limits: attempts is {attempts}, at least 1 is needed")


def _require_budget(count: int, elapsed_s: float, limits: RunLimits) -> None:
    if count >= limits.acquisitions:
        raise SearchError(f"the policy asked for more than {limits.acquisitions} acquisitions; its search does not end")
    if not elapsed_s <= limits.duration_s:
        raise SearchError(f"the search took {elapsed_s:.0f} s, more than the {limits.duration_s:.0f} s allowed")
