"""Whether the world is still as a run left it: angles measured again before the run goes on."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from markerseek.core import (
    AcquisitionError,
    Asked,
    ChannelFrame,
    Clock,
    ConfigError,
    Measured,
    RecordError,
    Refused,
    Sample,
    SaturationError,
)
from markerseek.records.journal import Checked, Entry, Journal, Resuming
from markerseek.rigs.resemblance import change_of, commanded_deg
from markerseek.scan import SEEN_SIGMAS, Scanner


def telling(entries: Sequence[Entry]) -> tuple[Sample, ...]:
    """Acquisitions of a run that tell most of a change: the strongest, then the one on a flank; fewer where none is.

    The strongest alone says little of a rotation, being near the top of the curve, where its slope is none. A flank is
    the clearly audible acquisition nearest to half the strongest intensity, where a rotation by a degree changes the
    intensity by more than a laser drifts. No rotation leaves both as they were.

    Parameters
    ----------
    entries
        All of the run.
    """
    measured = (entry.event.sample for entry in entries if isinstance(entry.event, Measured))
    lit = [sample for sample in measured if not sample.dark]
    if not lit:
        return ()
    strongest = max(lit, key=lambda sample: sample.reading.intensity)
    most = strongest.reading.intensity
    flanks = [sample for sample in lit if _audible(sample) and sample.reading.intensity <= _FLANK * most]
    if not flanks:
        return (strongest,)
    return strongest, min(flanks, key=lambda sample: abs(sample.reading.intensity - most / 2))


_FLANK = 0.85
"""Most that an acquisition on a flank may have of the strongest intensity."""


def _audible(sample: Sample) -> bool:
    return sample.reading.intensity > SEEN_SIGMAS * (sample.reading.noise_sigma or 0.0)


def pulses_before(entries: Sequence[Entry], *, pulses: int, attempts: int) -> int:
    """Most laser pulses that a run can have been permitted so far.

    Each acquisition that was asked for counts once and once more for each refusal, whether or not it was fired before
    the run died; each check as often as it may be tried.

    Parameters
    ----------
    entries
        All of the run.
    pulses
        Pulses of one acquisition.
    attempts
        How often one acquisition may be tried.
    """
    permits = 0
    lit = False
    for entry in entries:
        match entry.event:
            case Asked(role=role):
                lit = role != "dark"
                permits += lit
            case Refused():
                permits += lit
            case Resuming(check_deg=check_deg, flank_deg=flank_deg):
                permits += attempts * sum(angle_deg is not None for angle_deg in (check_deg, flank_deg))
    return permits * pulses


def require_as_before(
    samples: Sequence[Sample],
    scanner: Scanner,
    journal: Journal,
    clock: Clock,
    *,
    arm: Callable[[], None],
    attempts: int,
) -> None:
    """Measure where acquisitions were made before, keep what is heard, and refuse to go on where it has changed.

    Parameters
    ----------
    samples
        What was heard.
    scanner
        Measures again, once `arm` was called; it is stopped at the end.
    journal
        Where the checks are kept, and a fault that comes up in them.
    clock
        The run's clock.
    arm
        Arms the rig, in the name of a person.
    attempts
        How often one acquisition is tried when its frames are refused.

    Raises
    ------
    AcquisitionError
        If an angle is not heard as it was.
    DeviceError
        If a device did not do its part.
    """
    if not samples:
        return
    difference: str | None = None
    try:
        try:
            arm()
            for sample in samples:
                now = _measured(scanner, commanded_deg(sample), attempts)
                difference = change_of(sample.reading, now.reading)
                frame = now.frame if isinstance(now.frame, ChannelFrame) else None
                journal.commit(Checked(reading=now.reading, difference=difference, frame=frame), clock_s=clock.now_s())
                if difference is not None:
                    difference = f"measured again at {commanded_deg(sample):.3f} deg, {difference}"
                    break
        finally:
            scanner.stop()
    except RecordError:
        raise
    except Exception as error:
        # A fault must outlive this process as well: it is left by a person's reset only.
        journal.fail(error, clock_s=clock.now_s())
        raise
    if difference is not None:
        raise AcquisitionError(f"{difference}: probe, tissue or laser are not as they were; begin a new search")


def _measured(scanner: Scanner, angle_deg: float, attempts: int) -> Sample:
    for attempt in range(1, attempts + 1):
        try:
            return scanner.measure(angle_deg)
        except SaturationError:
            raise
        except AcquisitionError:
            if attempt == attempts:
                raise
    raise ConfigError(f"run limits: attempts is {attempts}, at least 1 is needed")
