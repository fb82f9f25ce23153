"""Resumes a run from its record: the policy gets the samples, a person arms the rig, the search goes on."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from pathlib import Path

from msgspec import structs

from markerseek.core import (
    AcquisitionError,
    AnyPolicy,
    Asked,
    ConfirmablePolicy,
    DeviceError,
    Found,
    Measured,
    Reading,
    ReadingFrame,
    RecordError,
    Refused,
    Sample,
    SaturationError,
    Sweep,
    SweepingPolicy,
    Swept,
)
from markerseek.guard import FiringLimits
from markerseek.records.journal import (
    Checked,
    Journal,
    JournalEntry,
    JournalEvent,
    RecordedRun,
    Resuming,
    RunView,
    since_started,
    versions,
)
from markerseek.rigs import Rig
from markerseek.runs.journalled import committed, limits_of
from markerseek.scan import RunLimits, Tally, larger_noise, moved_source, run

_SHARE = 0.1
"""Allowed relative change of an intensity: about the drift of a laser's energy."""

PULSE_SHARE = 0.4
"""The same for a single pulse, which differs by up to 10 % from the mean."""

HAND_SHARE = 0.3
"""The same where a person turns the probe, and stops beside the angle of before."""

BEYOND_DEG = 1.0
"""Farthest that a recorded acquisition may lie outside of the search range, in degrees: a hand drifts by less."""

_SIGMAS = 6.0
"""Allowed change in addition, in standard deviations of the noise."""


def resumed(
    policy: AnyPolicy,
    rig: Rig,
    journal: Journal,
    recorded: RecordedRun,
    *,
    by: str,
    anew: Callable[[], AnyPolicy],
    reset_fault: bool = False,
    check: bool = True,
    limits: RunLimits | None = None,
) -> Generator[JournalEvent, None, None]:
    """Yield the events of a run from where it was interrupted.

    The policy gets the recorded samples, `Resuming` is yielded, the rig is armed, and the strongest angle is measured
    again. If the intensity has changed by more than noise, `Checked` says so, and the search begins again; otherwise it
    goes on.

    ``policy``: in its state before the run; ``anew`` makes another. ``by``: name of the person who arms the rig.
    ``reset_fault``: whether that person has inspected the rig after a fault, and resets it. ``check``: False for a
    scan, which only goes on with the angles that are missing. ``limits``: those of a run on this plan unless given.
    """
    view = RunView.of(recorded)
    if view.state == "finished":
        raise RecordError(f"{recorded.path}: the run is over; it cannot be resumed")
    require_reset(recorded.path, view, reset_fault=reset_fault)
    entries = since_started(recorded.entries)
    clock = rig.scanner.clock
    limits = limits or limits_of(journal.configuration)
    begun_s = entries[0].clock_s if entries else 0.0
    ahead_s = journal.clock_s - clock.now_s()
    tell_recorded(policy, entries)
    # The budget of pulses is that of the tissue, not of a process.
    firing = FiringLimits() if rig.bench is None else rig.bench.firing
    rig.scanner.guard.charge(
        pulses_before(
            recorded.entries,
            pulses=rig.scanner.pulses,
            attempts=limits.attempts,
            pulses_per_sweep=firing.pulses_per_sweep,
        )
    )
    # A scan was armed before it got here, and the guard takes frames over only while it is disarmed.
    rig.scanner.guard.disarm()
    _recall(rig, entries)
    strongest = strongest_of(entries) if check else None
    resuming = Resuming(
        by=by,
        check_deg=None if strongest is None else commanded_deg(strongest),
        fault_reset=view.state == "fault",
        versions=versions(),
    )
    journal.commit(resuming, clock_s=clock.now_s() + ahead_s)
    yield resuming
    # Samples that are not at their angles say nothing.
    changed = getattr(policy, "disorder", None) is not None
    try:
        rig.arm(by=by)
        if strongest is not None and not changed:
            by_hand = journal.configuration.plan.by_hand is not None
            checked = _checked(strongest, rig, by_hand=by_hand, attempts=limits.attempts)
            journal.commit(checked, clock_s=clock.now_s() + ahead_s)
            yield checked
            changed = checked.difference is not None
    except BaseException as error:
        rig.scanner.stop()
        if isinstance(error, Exception) and not isinstance(error, RecordError):
            # A fault outlives this process: only a person's reset ends it.
            journal.fail(error, clock_s=clock.now_s() + ahead_s)
        raise
    earlier = [] if changed else [entry.event for entry in entries]
    tally = None if changed else Tally.of(earlier, elapsed_s=clock.now_s() + ahead_s - begun_s)
    if changed:
        policy = anew()
    events = run(policy, rig.scanner, journal.configuration.plan, limits=limits, earlier=tally)
    yield from committed(events, policy, rig, journal, ahead_s=ahead_s, earlier=earlier)


def tell_recorded(policy: AnyPolicy, entries: Iterable[JournalEntry]) -> None:
    """Ask a fresh policy and tell it the recorded samples, in their order, except a dark frame at the end."""
    lit = False
    sweeping = None
    for entry in entries:
        match entry.event:
            case Asked(sweep=sweep):
                sweeping = sweep
            case Measured(role="confirmation", sample=sample) if isinstance(policy, ConfirmablePolicy):
                if isinstance(policy.estimate(), Found):
                    policy.confirm(sample)
            case Measured(role="dark", sample=sample) if not lit:
                policy.tell(sample)
            # The light of a sweep that is not wanted any more goes out a little later.
            case Measured(role="search", sample=sample) if sample.sweep is not None or _asks_at_rest(policy):
                lit = True
                policy.tell(sample)
            case Swept() if isinstance(policy, SweepingPolicy):
                policy.end_sweep()
                sweeping = None
    if sweeping is not None and isinstance(policy, SweepingPolicy) and policy.ask() is None:
        # Killed after the policy had ended the sweep, and before the probe was at rest.
        policy.end_sweep()


def _asks_at_rest(policy: AnyPolicy) -> bool:
    """Whether a policy takes a sample at rest now; told other samples than at first, it may ask for a sweep instead."""
    asked = policy.ask()
    return asked is not None and not isinstance(asked, Sweep)


def strongest_of(entries: Sequence[JournalEntry]) -> Sample | None:
    """Return the acquisition with the largest intensity; None before the first."""
    lit = [each.event.sample for each in entries if isinstance(each.event, Measured) and not each.event.sample.dark]
    return max(lit, key=lambda sample: sample.reading.intensity, default=None)


def require_reset(path: Path, view: RunView, *, reset_fault: bool) -> None:
    """Refuse to resume a run that ended with a fault, by `DeviceError`, unless a person has inspected the rig."""
    if view.state == "fault" and not reset_fault:
        raise DeviceError(
            f"{path}: the run ended with a fault: {view.fault}; look at the rig, then resume with `reset_fault`"
        )


def pulses_before(entries: Iterable[JournalEntry], *, pulses: int, attempts: int, pulses_per_sweep: int) -> int:
    """Return an upper bound of the laser pulses that a run has fired, also in acquisitions that did not end.

    ``pulses``: of one acquisition. ``attempts``: how often one acquisition may be tried. ``pulses_per_sweep``: most
    that a permit of the rig allows for one sweep, which a sweep that was broken off counts for.
    """
    permits = 0
    swept = 0
    open_sweep = 0
    lit = False
    for entry in entries:
        match entry.event:
            case Asked(role=role, sweep=sweep):
                swept += open_sweep
                open_sweep = 0 if sweep is None else pulses_per_sweep
                lit = role != "dark" and sweep is None
                permits += lit
            case Refused():
                permits += lit
            case Swept(pulses=fired):
                swept = swept + fired
                open_sweep = 0
            case Resuming(check_deg=check_deg):
                permits += attempts * (check_deg is not None)
    return permits * pulses + swept + open_sweep


def _recall(rig: Rig, entries: Sequence[JournalEntry]) -> None:
    """Show the guard the admitted frames, so that a receiver that repeats an old one is refused."""
    for entry in entries:
        if isinstance(entry.event, Measured) and (frame := entry.event.sample.frame) is not None:
            # A restarted receiver counts from 1 again.
            again = structs.replace(frame, header=structs.replace(frame.header, sequence=0))
            rig.scanner.guard.recall(again, entry.event.sample.reading)


def _checked(before: Sample, rig: Rig, *, by_hand: bool, attempts: int) -> Checked:
    """Measure at the strongest angle again, and return the reading with what has changed."""
    wanted_deg = before.angle_deg if by_hand else commanded_deg(before)
    # A stage that was sent to an end of the range may have stopped slightly outside of it.
    angle_deg = rig.limits.search.nearest(wanted_deg)
    if not abs(angle_deg - wanted_deg) <= BEYOND_DEG:
        raise RecordError(f"the strongest acquisition lies at {wanted_deg:g} deg, outside of {rig.limits.search}")
    while True:
        attempts -= 1
        try:
            now = rig.scanner.measure(angle_deg)
            break
        except AcquisitionError as refusal:
            # A retry would saturate again, and fire at the tissue for nothing.
            if attempts < 1 or isinstance(refusal, SaturationError):
                raise
    difference = change_of(before.reading, now.reading, share=_allowed_share(before, by_hand=by_hand))
    if difference is not None:
        difference = f"measured again at {angle_deg:.3f} deg, {difference}"
    frame = None if isinstance(now.frame, ReadingFrame) else now.frame
    return Checked(reading=now.reading, difference=difference, frame=frame)


def _allowed_share(before: Sample, *, by_hand: bool) -> float:
    """Return by how much an intensity may have changed, relative to the one before."""
    if by_hand:
        return HAND_SHARE
    return _SHARE if before.sweep is None else PULSE_SHARE


def commanded_deg(sample: Sample) -> float:
    """Return the angle in degrees to which the stage is sent to measure a sample again.

    The one to which it was sent before, because it may have stopped slightly outside of the range; for a sample of a
    sweep, the angle reached.
    """
    if sample.frame is None or sample.sweep is not None:
        return sample.angle_deg
    return sample.frame.header.commanded_deg


def change_of(before: Reading, now: Reading, *, share: float = _SHARE) -> str | None:
    """Return the description of the change between two readings at one angle; None if noise can explain it."""
    allowed = share * max(before.intensity, now.intensity) + _SIGMAS * larger_noise(before, now)
    # `not <=` and not `>`, so that NaN counts as a change.
    if not abs(now.intensity - before.intensity) <= allowed:
        return (
            f"the intensity is {now.intensity:.4g} and was {before.intensity:.4g}, {allowed:.3g} would be the most by "
            "chance"
        )
    return moved_source(before, now)
