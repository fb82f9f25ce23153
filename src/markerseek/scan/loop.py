"""`run`: drives a policy over a rig, and reports each step.

There is one loop for simulated, replayed and real rigs. `run` is a generator of events, so that a terminal, a page,
a journal or a test can watch it; closing it stops the stage and takes the laser's permit away.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Protocol

from markerseek.core import (
    MOST_ACQUISITIONS,
    AcquisitionError,
    Asked,
    Clock,
    ConfigError,
    Event,
    Failed,
    Finished,
    Found,
    Frame,
    Measured,
    Policy,
    Refused,
    Role,
    Sample,
    SaturationError,
    SearchError,
    Started,
)
from markerseek.guard import Guard, Limits, State
from markerseek.scan.confirmation import judged


class AnyScanner(Protocol):
    """What `run` uses of a scanner: `Scanner`, or one that hands out what a journal holds."""

    @property
    def clock(self) -> Clock:
        """Time on the rig."""

    @property
    def guard(self) -> Guard:
        """Says what may be done, and believed."""

    @property
    def limits(self) -> Limits:
        """Where it may look, and where the probe may be."""

    @property
    def angle_deg(self) -> float:
        """Where the probe stands, in degrees."""

    @property
    def refused_frame(self) -> Frame | None:
        """Frame of the last acquisition if it was refused."""

    def measure(self, angle_deg: float) -> Sample:
        """One acquisition at an angle, in degrees."""

    def measure_dark(self) -> Sample:
        """One acquisition where the probe stands, with the laser kept off."""

    def stop(self) -> None:
        """Disarm the guard and the laser, then stop the stage; allowed twice."""


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
    policy: Policy,
    scanner: AnyScanner,
    *,
    dark_frames: int = 0,
    stay: bool = False,
    closing_dark: bool = False,
    limits: RunLimits = _RUN_LIMITS,
) -> Generator[Event, None, None]:
    """Let a policy search on a rig, and report each step.

    A search that found a marker ends with a move to it and one acquisition there, which the policy does not receive.
    Where that does not confirm the angle (`markerseek.scan.confirmation`), the answer becomes `Unsure`; only the
    paper's form of a method, which has no noise floor, keeps its answer. Each `Measured` is handed out before the
    policy receives it.

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
    closing_dark
        End with a dark frame where the last acquisition with light was taken. If frames come one behind, it holds that
        light, and the run ends with a fault. For receivers that cannot prove to which trigger a frame belongs.
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
    lit: list[Sample] = []
    try:
        place_deg = scanner.angle_deg
        yield Started(start_deg=place_deg, limits=scanner.limits.search)
        for index in range(1, dark_frames + 1):
            dark = yield from _dark(scanner, index, place_deg, limits.attempts)
            policy.tell(dark)
        while (asked_deg := policy.ask()) is not None:
            _require_budget(len(lit), scanner.clock.now_s() - began_s, limits)
            sample = yield from _measured(scanner, "search", len(lit) + 1, asked_deg, limits.attempts)
            lit.append(replace(sample, frame=None))
            travel_deg += abs(sample.angle_deg - place_deg)
            place_deg = sample.angle_deg
            policy.tell(sample)
        estimate = policy.estimate()
        confirmation = None
        if isinstance(estimate, Found) and not stay:
            confirmation = yield from _measured(scanner, "confirmation", 1, estimate.mean_deg, limits.attempts)
            travel_deg += abs(confirmation.angle_deg - place_deg)
            place_deg = confirmation.angle_deg
            estimate = judged(estimate, confirmation, lit)
        if closing_dark and lit:
            # Taken once: a second one would show the dark data of the first if frames came one behind.
            yield from _dark(scanner, dark_frames + 1, place_deg, 1)
        yield Finished(
            estimate=estimate,
            confirmation=confirmation,
            acquisitions=len(lit),
            travel_deg=travel_deg,
            elapsed_s=scanner.clock.now_s() - began_s,
        )
    except Exception as error:
        yield Failed(error=error)
        raise
    finally:
        scanner.stop()


def _dark(scanner: AnyScanner, index: int, angle_deg: float, attempts: int) -> Generator[Event, None, Sample]:
    """A dark frame where the probe stands."""
    yield Asked(role="dark", index=index, angle_deg=angle_deg)
    sample = yield from _admitted(scanner, scanner.measure_dark, angle_deg, attempts)
    yield Measured(role="dark", index=index, sample=sample)
    return sample


def _measured(
    scanner: AnyScanner, role: Role, index: int, angle_deg: float, attempts: int
) -> Generator[Event, None, Sample]:
    """An acquisition at an angle of the search range."""
    # Angles outside are refused before they are announced, for an angle that is no number cannot be recorded.
    scanner.limits.require_search(angle_deg)
    yield Asked(role=role, index=index, angle_deg=angle_deg)
    sample = yield from _admitted(scanner, lambda: scanner.measure(angle_deg), angle_deg, attempts)
    yield Measured(role=role, index=index, sample=sample)
    return sample


def _admitted(
    scanner: AnyScanner, measure: Callable[[], Sample], angle_deg: float, attempts: int
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
