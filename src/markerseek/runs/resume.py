"""Resumes a run from its journal.

The run is repeated from its beginning: a `RecordedScanner` returns the recorded samples, and each decision of the
policy is compared with the one in the journal. Then two angles are measured again on the rig, and the run continues. So
travel, counts and the result equal those of a run without interruption.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from dataclasses import replace
from functools import partial
from pathlib import Path

from markerseek.core import (
    AnyPolicy,
    Asked,
    DeviceError,
    Event,
    Finished,
    Measured,
    RecordError,
    Refused,
    Started,
    Swept,
)
from markerseek.records.journal import Entry, Journal, RecordedRun, Resuming, RunState, run_state, versions
from markerseek.rigs import Rig
from markerseek.runs.journalled import Beliefs, closing_run, commit_event
from markerseek.runs.recheck import commanded_deg, pulses_before, require_unchanged, samples_to_recheck
from markerseek.runs.recorded_scanner import RecordedScanner
from markerseek.scan import AnyScanner, RunLimits, run

RUN_EVENTS = (Started, Asked, Measured, Swept, Refused, Finished)
"""Events that are replayed; a fault is not one of them, because it has been reset."""


def resumed(
    policy: AnyPolicy,
    rig: Rig,
    journal: Journal,
    recorded: RecordedRun,
    *,
    by: str,
    reset_fault: bool = False,
) -> Generator[Event, None, None]:
    """The events of a run from its beginning: those of the journal, then those of the rig.

    Nothing moves before all decisions in the journal have been repeated and compared. Then the rig is armed in the name
    of the person who resumes it, and the strongest angle so far and one on a flank are measured again; they must be
    unchanged.

    ``policy``, ``rig``: in their state before the run. ``by``: name of the person who arms the rig. ``reset_fault``:
    whether that person has inspected the rig after a fault, and resets it. Yields as `run`; recorded events are not
    written again.
    """
    state = run_state(recorded.entries)
    if state.state == "finished":
        raise RecordError(f"{recorded.path}: the run is over; it cannot be resumed")
    require_reset(recorded.path, state, reset_fault=reset_fault)
    repeated = tuple(entry for entry in recorded.entries if isinstance(entry.event, RUN_EVENTS))
    step = _Handover(rig, journal, recorded, repeated, by=by, attempts=RunLimits().attempts)
    scanner = step.scanner
    pending = deque(repeated)
    events = run(policy, scanner, journal.configuration.plan)
    beliefs = Beliefs(policy, journal.configuration.plan)
    with closing_run(events, scanner.clock, journal):
        # A run that died before its first event has nothing to repeat.
        if not pending:
            step.take()
        # Beliefs of repeated events too: a policy that is asked for its answer earlier may round it otherwise.
        for event in map(beliefs.added, events):
            if pending:
                _require_same(event, pending.popleft(), recorded)
                yield event
                if not pending:
                    step.take()
            else:
                commit_event(event, scanner.clock, rig, journal)
                yield event


class _Handover:
    """Handover from the journal to the rig, once, after the last recorded entry; arguments of `resumed`."""

    def __init__(
        self, rig: Rig, journal: Journal, recorded: RecordedRun, repeated: tuple[Entry, ...], *, by: str, attempts: int
    ) -> None:
        self._rig, self._journal, self._recorded, self._repeated = rig, journal, recorded, repeated
        self._by, self._attempts = by, attempts
        self._checkpoint = _last_checkpoint(rig, recorded) if repeated else None
        self._recorded_scanner: RecordedScanner | None = None
        if repeated:
            same_clock = self._checkpoint is not None
            self._recorded_scanner = RecordedScanner(
                repeated, limits=rig.limits, live=rig.scanner, same_clock=same_clock
            )

    @property
    def scanner(self) -> AnyScanner:
        """Scanner of the whole run."""
        return self._recorded_scanner or self._rig.scanner

    def take(self) -> None:
        """Charge the guard with earlier pulses, record who armed the rig, measure two angles again, and arm."""
        rig, entries = self._rig, self._recorded.entries
        # The budget of pulses is per session on the tissue, not per process.
        rig.scanner.guard.charge(pulses_before(entries, pulses=rig.scanner.pulses, attempts=self._attempts))
        self._restore()
        if self._recorded_scanner is not None:
            self._recorded_scanner.switch_to_rig()
        samples = samples_to_recheck(entries)
        check_deg, flank_deg, *_ = [*map(commanded_deg, samples), None, None]
        note = Resuming(
            by=self._by,
            check_deg=check_deg,
            flank_deg=flank_deg,
            fault_reset=run_state(entries).state == "fault",
            versions=versions(),
        )
        clock = self.scanner.clock
        # Before anything is fired: `pulses_before` counts the pulses of a check that dies.
        self._journal.commit(note, clock_s=clock.now_s())
        arm = partial(rig.arm, by=self._by)
        require_unchanged(samples, rig.scanner, self._journal, clock, arm=arm, attempts=self._attempts)
        # The check has moved a simulated stage and drawn random numbers: both are set back.
        self._restore()
        arm()

    def _restore(self) -> None:
        """Restore a simulated world, and the guard's memory of admitted frames."""
        if self._rig.world is not None and self._checkpoint is not None:
            self._rig.world.restore(self._checkpoint)
        guard = self._rig.scanner.guard
        for entry in self._repeated:
            if isinstance(entry.event, Measured) and entry.event.sample.frame is not None:
                frame = entry.event.sample.frame
                # A restarted receiver counts from 1 again, which the guard would refuse as an old frame.
                header = frame.header if self._checkpoint is not None else replace(frame.header, sequence=0)
                guard.recall(replace(frame, header=header), entry.event.sample.reading)


def require_reset(path: Path, state: RunState, *, reset_fault: bool) -> None:
    """Refuse to resume a run that ended with a fault, by `DeviceError`, unless a person has inspected the rig."""
    if state.state == "fault" and not reset_fault:
        raise DeviceError(
            f"{path}: the run ended with a fault: {state.fault}; look at the rig, then resume with --reset-fault"
        )


def _last_checkpoint(rig: Rig, recorded: RecordedRun) -> bytes | None:
    """Last recorded state of a simulated world; None for a real rig."""
    if rig.world is None:
        return None
    for entry in reversed(recorded.entries):
        if entry.checkpoint is not None:
            return entry.checkpoint
    raise RecordError(f"{recorded.path}: it has no state of the simulated world, so that the run cannot continue")


def _require_same(now: Event, then: Entry, recorded: RecordedRun) -> None:
    # Exact equality of floats: the same code and data must decide the same, bit for bit.
    if now != then.event:
        begun = ", ".join(f"{name} {version}" for name, version in recorded.configuration.versions.items())
        raise RecordError(
            f"{recorded.path}: entry {then.number}: the search decides differently than before: {now} where the "
            f"journal has {then.event}; resume with its first versions ({begun})"
        )
