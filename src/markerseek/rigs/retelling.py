"""A scanner that hands out what a journal holds, so that `run` and a policy live through it again."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from markerseek.core import AcquisitionError, Clock, ConfigError, Frame, Measured, RecordError, Refused, Sample, Started
from markerseek.guard import Admission, FiringLimits, Guard, Limits
from markerseek.records.journal import Entry
from markerseek.scan import Scanner


class ToldClock:
    """Shows the times of the entries, then those of a live clock.

    Parameters
    ----------
    now_s
        Time of the first entry in seconds.
    """

    def __init__(self, now_s: float) -> None:
        self._told_s = now_s
        self._live: Clock | None = None
        self._ahead_s = 0.0

    def now_s(self) -> float:
        """Seconds, as the run would have read them."""
        return self._told_s if self._live is None else self._live.now_s() + self._ahead_s

    def wait(self, duration_s: float) -> None:
        """Not possible: the past does not wait.

        Raises
        ------
        ConfigError
            Always.
        """
        raise ConfigError(f"a wait of {duration_s} s in a run that is told again")

    def show(self, now_s: float) -> None:
        """Time of the next entry."""
        self._told_s = now_s

    def go_on(self, live: Clock, *, same: bool) -> None:
        """Show a live clock from now on.

        Parameters
        ----------
        live
            The clock.
        same
            Whether it was put back to where the run stood; else it is made to go on from there.
        """
        if self._live is None:
            self._live = live
            self._ahead_s = 0.0 if same else self._told_s - live.now_s()


class Retelling(Scanner):
    """Measures nothing: it hands out what was measured, or refused, in that order.

    Parameters
    ----------
    entries
        Those of a run, beginning with `Started`.
    limits
        Where the run was allowed to look.
    live
        What measures once the entries are used up; None where nothing may.
    same_clock
        Whether the live clock was put back to where the run stood.
    """

    def __init__(
        self, entries: Sequence[Entry], *, limits: Limits, live: Scanner | None = None, same_clock: bool = False
    ) -> None:
        # Nothing of the base is used but its type: `run` takes a scanner, and this one has no devices.
        first = entries[0]
        if not isinstance(first.event, Started):
            raise RecordError("the journal does not begin with the start of a run")
        self._start_deg = first.event.start_deg
        self._limits = limits
        self._live = live
        self._same_clock = same_clock
        self._gone_on = False
        self._refused_frame: Frame | None = None
        self._outcomes = deque(entry for entry in entries if isinstance(entry.event, Measured | Refused))
        self._told = ToldClock(first.clock_s)
        self.clock: Clock = self._told
        idle = Guard(limits=limits, firing=FiringLimits(), admission=Admission())
        self.guard = idle if live is None else live.guard

    @property
    def limits(self) -> Limits:
        """Where the run was allowed to look."""
        return self._limits

    @property
    def angle_deg(self) -> float:
        """Where the probe stood when the run began, in degrees."""
        return self._start_deg

    def measure(self, angle_deg: float) -> Sample:
        """The next sample of the journal, or one of the rig.

        Raises
        ------
        AcquisitionError
            If the frame was refused, then or now.
        DeviceError
            As `Scanner.measure`.
        """
        return self._next() or self._rig().measure(angle_deg)

    def measure_dark(self) -> Sample:
        """The next sample of the journal, or one of the rig with the laser kept off.

        Raises
        ------
        AcquisitionError
            If the frame was refused, then or now.
        DeviceError
            As `Scanner.measure_dark`.
        """
        return self._next() or self._rig().measure_dark()

    @property
    def refused_frame(self) -> Frame | None:
        """Frame of the last acquisition if it was refused, then or now."""
        return self._refused_frame if self._live is None or not self._gone_on else self._live.refused_frame

    def go_on(self) -> None:
        """Let the clock go on with the live one, and `measure` with the rig once the entries are used up."""
        if self._live is None:
            raise RecordError("the journal holds no further acquisition, and there is no rig to make one")
        self._gone_on = True
        self._told.go_on(self._live.clock, same=self._same_clock)

    def stop(self) -> None:
        """Stop the rig, if it was gone on with; before, nothing moves."""
        if self._live is not None and self._gone_on:
            self._live.stop()

    def _next(self) -> Sample | None:
        if not self._outcomes:
            return None
        entry = self._outcomes.popleft()
        self._told.show(entry.clock_s)
        self._refused_frame = None
        if isinstance(entry.event, Refused):
            self._refused_frame = entry.event.frame
            raise AcquisitionError(entry.event.reason)
        return entry.event.sample if isinstance(entry.event, Measured) else None

    def _rig(self) -> Scanner:
        if self._live is None or not self._gone_on:
            raise RecordError("the journal holds no further acquisition, and there is no rig to make one")
        return self._live
