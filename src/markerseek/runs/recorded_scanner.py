"""A scanner that returns the samples of a journal in order, and then measures on a rig.

`run` and the policies need no change: they repeat the run from its beginning with the same samples and times.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence

from markerseek.core import (
    AcquisitionError,
    Asked,
    Clock,
    ConfigError,
    Frame,
    Measured,
    RecordError,
    Refused,
    Sample,
    Started,
    Sweep,
    Swept,
    Turning,
)
from markerseek.guard import Admission, FiringLimits, Guard, Limits
from markerseek.records.journal import Entry
from markerseek.scan import AnyScanner


class ReplayedClock:
    """Clock with the times of the journal's entries, then of a live clock."""

    def __init__(self, now_s: float) -> None:
        self._entry_s = now_s
        self._live: Clock | None = None
        self._ahead_s = 0.0

    def now_s(self) -> float:
        """Time of the run in seconds."""
        return self._entry_s if self._live is None else self._live.now_s() + self._ahead_s

    def wait(self, duration_s: float) -> None:
        """Always an error: nothing waits while entries are repeated."""
        raise ConfigError(f"a wait of {duration_s} s while a journal is replayed; only a rig can wait")

    def show(self, now_s: float) -> None:
        """Set the time of the next entry, in seconds."""
        self._entry_s = now_s

    def switch_to(self, live: Clock, *, same: bool) -> None:
        """Use a live clock from now on.

        ``same``: whether it was put back to the time at which the run stopped; else it is offset so that it continues
        from there.
        """
        if self._live is None:
            self._live = live
            self._ahead_s = 0.0 if same else self._entry_s - live.now_s()


class RecordedScanner:
    """Returns the recorded samples and refusals in order; then measures with a live scanner, if there is one.

    ``entries``: entries of a run, beginning with `Started`. ``same_clock``: whether the live clock was set back to the
    time at which the run stopped.
    """

    def __init__(
        self, entries: Sequence[Entry], *, limits: Limits, live: AnyScanner | None = None, same_clock: bool = False
    ) -> None:
        first = entries[0]
        if not isinstance(first.event, Started):
            raise RecordError("the journal does not begin with the start of a run")
        self._start_deg = first.event.start_deg
        self._limits = limits
        self._live = live
        self._same_clock = same_clock
        self._active: AnyScanner | None = None
        self._refused_frame: Frame | None = None
        # `Asked` ends a sweep that was broken off.
        kept = (Asked, Measured, Refused, Swept)
        self._outcomes = deque(entry for entry in entries if isinstance(entry.event, kept))
        self._clock = ReplayedClock(first.clock_s)
        # Never armed, so that it refuses every permit.
        idle = Guard(limits=limits, firing=FiringLimits(), admission=Admission())
        self._guard = idle if live is None else live.guard

    @property
    def clock(self) -> Clock:
        """Time of the run."""
        return self._clock

    @property
    def guard(self) -> Guard:
        """Guard of the rig; without a rig, one that is never armed."""
        return self._guard

    @property
    def limits(self) -> Limits:
        """Limits of the run."""
        return self._limits

    @property
    def angle_deg(self) -> float:
        """Angle of the probe when the run began, in degrees."""
        return self._start_deg

    def guide(self, angle_deg: float) -> Iterator[Turning]:
        """What a person does for the rig; nobody turns anything for a sample of the journal."""
        if not self._has_outcome():
            yield from self._rig().guide(angle_deg)

    def measure(self, angle_deg: float) -> Sample:
        """The next sample of the journal, or one of the rig.

        Raises `AcquisitionError` if the frame was refused, then or now.
        """
        return self._next() or self._rig().measure(angle_deg)

    def measure_dark(self) -> Sample:
        """The next sample of the journal, or one of the rig with the laser kept off."""
        return self._next() or self._rig().measure_dark()

    def sweep(
        self, sweep: Sweep, *, number: int, goes_on: Callable[[], bool]
    ) -> Generator[Sample | Refused | Swept, None, None]:
        """The outcomes of the next sweep of the journal, or a sweep of the rig.

        Where the journal ends in mid-sweep, its outcomes end without `Swept`, and the rig makes the next one.
        """
        if not self._has_outcome():
            yield from self._rig().sweep(sweep, number=number, goes_on=goes_on)
            return
        while self._outcomes and not isinstance(self._outcomes[0].event, Asked):
            entry = self._outcomes.popleft()
            self._clock.show(entry.clock_s)
            match entry.event:
                case Measured(sample=sample):
                    yield sample
                case Refused() | Swept() as outcome:
                    yield outcome

    @property
    def refused_frame(self) -> Frame | None:
        """Frame of the last acquisition if it was refused, then or now."""
        return self._refused_frame if self._active is None else self._active.refused_frame

    def switch_to_rig(self) -> None:
        """Continue with the clock of the rig, and measure with the rig once the entries are used up."""
        self._active = self._live
        self._clock.switch_to(self._rig().clock, same=self._same_clock)

    def stop(self) -> None:
        """Stop the rig, if the run was switched to it; before that nothing moves."""
        if self._active is not None:
            self._active.stop()

    def _next(self) -> Sample | None:
        if not self._has_outcome():
            return None
        entry = self._outcomes.popleft()
        # The durations in `Finished` are differences of this clock, and must come out as in the first run.
        self._clock.show(entry.clock_s)
        self._refused_frame = None
        if isinstance(entry.event, Refused):
            self._refused_frame = entry.event.frame
            raise AcquisitionError(entry.event.reason)
        return entry.event.sample if isinstance(entry.event, Measured) else None

    def _has_outcome(self) -> bool:
        """Whether the journal holds another outcome, of the `Asked` that come before it."""
        while self._outcomes and isinstance(self._outcomes[0].event, Asked):
            self._outcomes.popleft()
        return bool(self._outcomes)

    def _rig(self) -> AnyScanner:
        if self._active is None:
            raise RecordError("the journal holds no further acquisition, and there is no rig to make one")
        return self._active
