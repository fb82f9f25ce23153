"""Resumes a run from its journal.

The run is repeated from its beginning: a `RecordedScanner` returns the recorded samples, and each decision of the
policy is compared with the one in the journal. Then two angles are measured again on the rig, and the run continues. So
travel, counts and the result equal those of a run without interruption.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from markerseek.core import (
    AcquisitionError,
    AnyPolicy,
    Asked,
    Clock,
    ConfigError,
    DeviceError,
    Event,
    Finished,
    Measured,
    Reading,
    ReadingFrame,
    RecordError,
    Refused,
    Sample,
    SaturationError,
    Started,
    Sweep,
    Swept,
)
from markerseek.guard import FiringLimits
from markerseek.records.journal import Checked, Entry, Journal, RecordedRun, Resuming, RunState, run_state, versions
from markerseek.rigs import Rig
from markerseek.runs.journalled import Beliefs, closing_run, commit_event, limits_of
from markerseek.runs.recorded_scanner import RecordedScanner
from markerseek.scan import SEEN_SIGMAS, AnyScanner, larger_noise, moved_source, run

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
    limits = limits_of(journal.configuration)
    step = _Handover(rig, journal, recorded, repeated, by=by, attempts=limits.attempts)
    scanner = step.scanner
    pending = deque(repeated)
    events = run(policy, scanner, journal.configuration.plan, limits=limits)
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


SHARE = 0.1
"""Allowed relative change of an intensity: about the drift of a laser's energy."""

PULSE_SHARE = 0.4
"""The same against a sample of a sweep: the energy of one pulse differs by up to 10 % from its mean."""

HAND_SHARE = 0.3
"""The same where a person turns the probe, who comes to rest beside the angle of before."""

SIGMAS = 6.0
"""Allowed change in addition, in standard deviations of the noise."""

FLANK_SHARE = 0.85
"""Largest intensity of an acquisition on a flank, as a share of the strongest."""


def samples_to_recheck(entries: Sequence[Entry]) -> tuple[Sample, ...]:
    """Acquisitions that show a change best: the strongest, then one on a flank; fewer where there are none.

    The strongest alone is insensitive to a rotation, because the slope of the curve is zero at its peak. The second is
    the acquisition above the noise whose intensity is nearest to half of the strongest: there, a rotation by a degree
    changes the intensity by more than a laser drifts. Any rotation changes at least one of the two.
    """
    measured = (entry.event.sample for entry in entries if isinstance(entry.event, Measured))
    lit = [sample for sample in measured if not sample.dark]
    if not lit:
        return ()
    strongest = max(lit, key=lambda sample: sample.reading.intensity)
    most = strongest.reading.intensity
    flanks = [sample for sample in lit if _above_noise(sample) and sample.reading.intensity <= FLANK_SHARE * most]
    if not flanks:
        return (strongest,)
    return strongest, min(flanks, key=lambda sample: abs(sample.reading.intensity - most / 2))


def _above_noise(sample: Sample) -> bool:
    noise_sigma = sample.reading.noise_sigma
    # Where the noise is unknown, any intensity counts as a signal.
    return sample.reading.intensity > (0.0 if noise_sigma is None else SEEN_SIGMAS * noise_sigma)


def pulses_before(entries: Sequence[Entry], *, pulses: int, attempts: int) -> int:
    """Upper bound of the laser pulses that a run has fired so far.

    Each acquisition counts once, and once more for each refusal, whether or not it was fired before the run died; each
    check counts as often as it may be tried. A sweep that broke off counts as many as may have been permitted.

    ``attempts``: how often one acquisition may be tried.
    """
    permits = swept = open_sweep = 0
    lit = False
    for entry in entries:
        match entry.event:
            case Asked(role=role, sweep=sweep):
                swept += open_sweep
                open_sweep = 0 if sweep is None else most_pulses(sweep)
                # A dark acquisition fires no pulse.
                lit = role != "dark" and sweep is None
                permits += lit
            case Refused():
                permits += lit
            case Swept(pulses=fired):
                swept += fired
                open_sweep = 0
            case Resuming(check_deg=check_deg, flank_deg=flank_deg):
                permits += attempts * sum(angle_deg is not None for angle_deg in (check_deg, flank_deg))
    return permits * pulses + swept + open_sweep


def most_pulses(sweep: Sweep) -> int:
    """Most pulses that a sweep may have been permitted: by its spacing, else by the guard."""
    most = FiringLimits().pulses_per_sweep
    if sweep.from_deg is None or not sweep.spacing_deg > 0:
        return most
    return min(most, 2 * math.ceil(abs(sweep.to_deg - sweep.from_deg) / sweep.spacing_deg) + 2)


def require_unchanged(
    samples: Sequence[Sample],
    scanner: AnyScanner,
    journal: Journal,
    clock: Clock,
    *,
    arm: Callable[[], None],
    attempts: int,
) -> None:
    """Measure acquisitions again, record the readings in the journal, and refuse to resume if one has changed.

    ``scanner``: measures again, once `arm` was called; it is stopped at the end. ``journal``: receives the readings,
    and a fault if one occurs. ``arm``: arms the rig, in the name of a person. ``attempts``: how often one acquisition
    is tried when its frames are refused.
    """
    if not samples:
        return
    by_hand = journal.configuration.plan.by_hand is not None
    difference: str | None = None
    try:
        try:
            arm()
            for sample in samples:
                # A sweep may end slightly outside the range.
                angle_deg = sample.angle_deg if by_hand else commanded_deg(sample)
                now = _measured(scanner, scanner.limits.search.nearest(angle_deg), attempts)
                share = HAND_SHARE if by_hand else SHARE if sample.sweep is None else PULSE_SHARE
                difference = change_of(sample.reading, now.reading, share=share)
                frame = None if isinstance(now.frame, ReadingFrame) else now.frame
                journal.commit(Checked(reading=now.reading, difference=difference, frame=frame), clock_s=clock.now_s())
                if difference is not None:
                    difference = f"measured again at {angle_deg:.3f} deg, {difference}"
                    break
        finally:
            # Disarmed in any case: `arm` is called again when the run continues.
            scanner.stop()
    except RecordError:
        raise
    except Exception as error:
        # Recorded, because a fault must survive this process: only a person's reset ends it.
        journal.fail(error, clock_s=clock.now_s())
        raise
    if difference is not None:
        raise AcquisitionError(f"{difference}: probe, tissue or laser have changed; begin a new search")


def _measured(scanner: AnyScanner, angle_deg: float, attempts: int) -> Sample:
    for attempt in range(1, attempts + 1):
        try:
            return scanner.measure(angle_deg)
        # A retry would saturate again, and fire at the tissue for nothing.
        except SaturationError:
            raise
        except AcquisitionError:
            if attempt == attempts:
                raise
    raise ConfigError(f"run limits: attempts is {attempts}, at least 1 is needed")


def commanded_deg(sample: Sample) -> float:
    """Angle in degrees to which the stage is sent to measure a sample again.

    The one to which it was sent before, because the angle reached can lie slightly outside the range; for a sample of a
    sweep, the angle reached.
    """
    if sample.frame is None or sample.sweep is not None:
        return sample.angle_deg
    return sample.frame.header.commanded_deg


def change_of(before: Reading, now: Reading, *, share: float = SHARE) -> str | None:
    """Description of the change between two readings at one angle; None if noise can explain it.

    ``share``: allowed relative change of the intensity.
    """
    allowed = share * max(before.intensity, now.intensity) + SIGMAS * larger_noise(before, now)
    # `not <=` and not `>`, so that NaN counts as a change.
    if not abs(now.intensity - before.intensity) <= allowed:
        return (
            f"the intensity is {now.intensity:.4g} and was {before.intensity:.4g}, {allowed:.3g} would be the most by "
            "chance"
        )
    return moved_source(before, now)
