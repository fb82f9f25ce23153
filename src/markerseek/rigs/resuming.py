"""Runs that go on from a journal after any end.

A resumed run is told again from the beginning. `run` and the policy do not know of it: a scanner hands out what the
journal holds, in its order, and turns to the rig when that is used up. So travel, counts and every decision come out as
they would have, and each decision that is told again is compared with the one that was kept.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from dataclasses import replace
from functools import partial
from pathlib import Path

from markerseek.core import Asked, DeviceError, Event, Finished, Measured, Policy, RecordError, Refused, Started
from markerseek.records.journal import Entry, Journal, Recording, Resuming, RunState, run_state, versions
from markerseek.rigs.checking import pulses_before, require_as_before, telling
from markerseek.rigs.journalled import closed_and_kept, journalled, keep
from markerseek.rigs.resemblance import commanded_deg
from markerseek.rigs.retelling import Retelling
from markerseek.rigs.rig import Rig
from markerseek.scan import RunLimits, Scanner, run

_RUN_LIMITS = RunLimits()


def resumed(
    policy: Policy,
    rig: Rig,
    journal: Journal,
    held: Recording,
    *,
    by: str,
    reset_fault: bool = False,
    limits: RunLimits = _RUN_LIMITS,
) -> Generator[Event, None, None]:
    """The events of a run from its beginning: those of the journal, then those of the rig.

    All that was decided is decided again and compared. Then the strongest angle so far and one on a flank are measured
    again, and must be heard as they were. Then it goes on. The rig is armed in the name of the person who asks for it.

    Parameters
    ----------
    policy, rig
        As they were before the run.
    journal, held
        What `Journal.reopen` gave.
    by
        Name of the person who arms the rig.
    reset_fault
        Whether that person has looked at the rig after a fault, and resets it.
    limits
        As in `run`.

    Yields
    ------
    Event
        As `run`; those that the journal holds already are not written again.

    Raises
    ------
    DeviceError
        If the run ended with a fault that is not reset, or an angle is not heard as it was.
    RecordError
        If the run is over, the search decides otherwise than it did, or an event cannot be kept.
    """
    stands = run_state(held.entries)
    if stands.state == "finished":
        raise RecordError(f"{held.path}: the run is over; there is nothing to go on with")
    require_reset(held.path, stands, reset_fault=reset_fault)
    told = tuple(entry for entry in held.entries if isinstance(entry.event, TOLD))
    again = _Again(rig, journal, held, told, by=by, attempts=limits.attempts)
    if not told:
        again.go_on()
        yield from journalled(policy, rig, journal, limits=limits)
        return
    pending = deque(told)
    begun_with = journal.configuration
    events = run(policy, again.scanner, dark_frames=begun_with.dark_frames, stay=begun_with.stay, limits=limits)
    with closed_and_kept(events, again.scanner.clock, journal):
        for event in events:
            if not pending:
                keep(event, again.scanner.clock, rig, journal)
                yield event
                continue
            _require_same(event, pending.popleft(), held)
            yield event
            if not pending:
                # Nothing moves before all that was decided has been compared.
                again.go_on()


class _Again:
    """The step from what the journal holds to the rig; it is made once.

    Parameters
    ----------
    rig, journal, held
        As in `resumed`.
    told
        Entries that the run tells again.
    by
        Name of the person who arms the rig.
    attempts
        How often one acquisition is tried when its frames are refused.
    """

    def __init__(
        self, rig: Rig, journal: Journal, held: Recording, told: tuple[Entry, ...], *, by: str, attempts: int
    ) -> None:
        self._rig, self._journal, self._held, self._told = rig, journal, held, told
        self._by, self._attempts = by, attempts
        self._state = _last_checkpoint(rig, held) if told else None
        self.scanner: Scanner = rig.scanner
        if told:
            self.scanner = Retelling(told, limits=rig.limits, live=rig.scanner, same_clock=self._state is not None)

    def go_on(self) -> None:
        """Note who armed the rig, see that it is as it was, and leave it armed."""
        rig, entries = self._rig, self._held.entries
        rig.scanner.guard.charge(pulses_before(entries, pulses=rig.scanner.pulses, attempts=self._attempts))
        self._as_it_was()
        if isinstance(self.scanner, Retelling):
            self.scanner.go_on()
        checks = telling(entries)
        at_deg = [commanded_deg(sample) for sample in checks]
        note = Resuming(
            by=self._by,
            check_deg=at_deg[0] if at_deg else None,
            flank_deg=at_deg[1] if len(at_deg) > 1 else None,
            fault_reset=run_state(entries).state == "fault",
            versions=versions(),
        )
        clock = self.scanner.clock
        self._journal.commit(note, clock_s=clock.now_s())
        arm = partial(rig.arm, by=self._by)
        require_as_before(checks, rig.scanner, self._journal, clock, arm=arm, attempts=self._attempts)
        self._as_it_was()
        arm()

    def _as_it_was(self) -> None:
        """Put a simulated world back to where it was, and tell the guard what it had admitted."""
        if self._rig.world is not None and self._state is not None:
            self._rig.world.restore(self._state)
        guard = self._rig.scanner.guard
        for entry in self._told:
            if isinstance(entry.event, Measured) and entry.event.sample.frame is not None:
                frame = entry.event.sample.frame
                # A receiver that began anew counts from 1 again.
                header = frame.header if self._state is not None else replace(frame.header, sequence=0)
                guard.recall(replace(frame, header=header), entry.event.sample.reading)


def require_reset(path: Path, stands: RunState, *, reset_fault: bool) -> None:
    """Refuse to go on from a fault that no person has reset.

    Parameters
    ----------
    path
        The journal, for the message.
    stands
        Where its run stands.
    reset_fault
        Whether a person has looked at the rig, and resets it.

    Raises
    ------
    DeviceError
        If the run ended with a fault and nobody has.
    """
    if stands.state == "fault" and not reset_fault:
        raise DeviceError(
            f"{path}: the run ended with a fault: {stands.fault}; look at the rig, then resume with --reset-fault"
        )


def _last_checkpoint(rig: Rig, held: Recording) -> bytes | None:
    """Last state of a world that can be put back; None of a real one."""
    if rig.world is None:
        return None
    for entry in reversed(held.entries):
        if entry.checkpoint is not None:
            return entry.checkpoint
    raise RecordError(f"{held.path}: it holds no state of the simulated world, which died with its process")


def _require_same(now: Event, then: Entry, held: Recording) -> None:
    if now != then.event:
        begun = ", ".join(f"{name} {version}" for name, version in held.configuration.versions.items())
        raise RecordError(
            f"{held.path}: entry {then.number}: the search decides otherwise than it did: {now} where the journal has "
            f"{then.event}; resume with what it was begun with ({begun})"
        )


TOLD = (Started, Asked, Measured, Refused, Finished)
"""Events that a run tells again; a fault is not one of them, because it was reset."""
