"""Runs that go on from a journal after any end.

A resumed run is told again from the beginning. `run` and the policy do not know of it: a scanner hands out what the
journal holds, in its order, and turns to the rig when that is used up. So travel, counts and every decision come out as
they would have, and each decision that is told again is compared with the one that was kept.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from contextlib import closing
from pathlib import Path

from markerseek.core import (
    AcquisitionError,
    Asked,
    ConfigError,
    DeviceError,
    Event,
    Failed,
    Finished,
    Measured,
    Policy,
    RecordError,
    Refused,
    Sample,
    SaturationError,
    Started,
)
from markerseek.records.journal import Checked, Entry, Journal, Recording, Resuming, Standing, standing
from markerseek.records.journal.configuration import versions
from markerseek.rigs.journalled import journalled, keep
from markerseek.rigs.resemblance import change_of, commanded_deg
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

    Before anything else the strongest angle so far is measured again, and must be heard as it was. The rig is armed
    in the name of the person who asks for this.

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
        If the run ended with a fault that is not reset, or the strongest angle is not heard as it was.
    RecordError
        If the run is over, the search decides otherwise than it did, or an event cannot be kept.
    """
    stands = standing(held.entries)
    if stands.state == "finished":
        raise RecordError(f"{held.path}: the run is over; there is nothing to go on with")
    require_reset(held.path, stands, reset_fault=reset_fault)
    pending = deque(entry for entry in held.entries if isinstance(entry.event, TOLD))
    if not pending:
        rig.arm(by=by)
        yield from journalled(policy, rig, journal, limits=limits)
        return
    state = _last_checkpoint(rig, held)
    _check_geometry(rig, journal, stands, state, by=by, attempts=limits.attempts)
    _restore(rig, state)
    rig.arm(by=by)
    scanner = Retelling(tuple(pending), limits=rig.limits, live=rig.scanner, same_clock=state is not None)
    begun_with = journal.configuration
    events = run(policy, scanner, dark_frames=begun_with.dark_frames, stay=begun_with.stay, limits=limits)
    with closing(events):
        for event in events:
            if pending:
                _require_same(event, pending.popleft(), held)
            else:
                keep(event, scanner.clock, rig, journal)
            yield event


def require_reset(path: Path, stands: Standing, *, reset_fault: bool) -> None:
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
    """Last state of the simulated world; None of a real one."""
    if rig.world is None:
        return None
    for entry in reversed(held.entries):
        if entry.checkpoint is not None:
            return entry.checkpoint
    raise RecordError(f"{held.path}: it holds no state of the simulated world, which died with its process")


def _restore(rig: Rig, state: bytes | None) -> None:
    if rig.world is not None and state is not None:
        rig.world.restore(state)


def _check_geometry(
    rig: Rig, journal: Journal, stands: Standing, state: bytes | None, *, by: str, attempts: int
) -> None:
    """Measure the strongest angle again, and keep what was heard; a simulated world must be put back after it."""
    strongest = stands.strongest
    check_deg = None if strongest is None else commanded_deg(strongest)
    note = Resuming(by=by, check_deg=check_deg, fault_reset=stands.state == "fault", versions=versions())
    _restore(rig, state)
    clock = rig.scanner.clock
    journal.commit(note, clock_s=clock.now_s())
    if strongest is None or check_deg is None:
        return
    rig.arm(by=by)
    try:
        again = _measure(rig.scanner, check_deg, attempts)
    except Exception as error:
        # A fault must outlive this process as well: it is left by a person's reset only.
        journal.commit(Failed(error=error), clock_s=clock.now_s())
        raise
    finally:
        rig.scanner.stop()
    changed = change_of(strongest.reading, again.reading)
    journal.commit(Checked(reading=again.reading, difference=changed), clock_s=clock.now_s())
    if changed is not None:
        raise AcquisitionError(
            f"measured again at {check_deg:.3f} deg, {changed}: probe, tissue or laser are not as they were; "
            "begin a new search"
        )


def _measure(scanner: Scanner, angle_deg: float, attempts: int) -> Sample:
    for attempt in range(1, attempts + 1):
        try:
            return scanner.measure(angle_deg)
        except SaturationError:
            raise
        except AcquisitionError:
            if attempt == attempts:
                raise
    raise ConfigError(f"run limits: attempts is {attempts}, at least 1 is needed")


def _require_same(now: Event, then: Entry, held: Recording) -> None:
    if now != then.event:
        begun = ", ".join(f"{name} {version}" for name, version in held.configuration.versions.items())
        raise RecordError(
            f"{held.path}: entry {then.number}: the search decides otherwise than it did: {now} where the journal has "
            f"{then.event}; resume with what it was begun with ({begun})"
        )


TOLD = (Started, Asked, Measured, Refused, Finished)
"""Events that a run tells again; a fault is not one of them, because it was reset."""
