"""Measures two angles again before a run is resumed; an intensity or a source that has changed ends the attempt."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from markerseek.core import (
    AcquisitionError,
    Asked,
    ChannelFrame,
    Clock,
    ConfigError,
    Measured,
    Reading,
    RecordError,
    Refused,
    Sample,
    SaturationError,
)
from markerseek.records.journal import Checked, Entry, Journal, Resuming
from markerseek.scan import SEEN_SIGMAS, AnyScanner, moved_source

SHARE = 0.1
"""Most that an intensity may change, as a share of the larger: about what a laser's energy drifts."""

SIGMAS = 6.0
"""Standard deviations of the noise that it may change by in addition."""

FLANK_SHARE = 0.85
"""Most that an acquisition on a flank may have of the strongest intensity."""


def samples_to_recheck(entries: Sequence[Entry]) -> tuple[Sample, ...]:
    """Acquisitions of a run that show a change best: the strongest, then one on a flank; fewer where there are none.

    The strongest alone shows little of a rotation: near the top of the curve the slope is zero. The one on a flank is
    the acquisition clearly above the noise whose intensity is nearest to half of the strongest; there a rotation by a
    degree changes the intensity by more than a laser drifts. No rotation leaves both as they were.

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
    flanks = [sample for sample in lit if _above_noise(sample) and sample.reading.intensity <= FLANK_SHARE * most]
    if not flanks:
        return (strongest,)
    return strongest, min(flanks, key=lambda sample: abs(sample.reading.intensity - most / 2))


def _above_noise(sample: Sample) -> bool:
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


def require_unchanged(
    samples: Sequence[Sample],
    scanner: AnyScanner,
    journal: Journal,
    clock: Clock,
    *,
    arm: Callable[[], None],
    attempts: int,
) -> None:
    """Measure acquisitions again, keep the readings in the journal, and refuse to resume where one has changed.

    Parameters
    ----------
    samples
        The acquisitions, from `samples_to_recheck`.
    scanner
        Measures again, once `arm` was called; it is stopped at the end.
    journal
        Where the readings are kept, and a fault that comes up meanwhile.
    clock
        The run's clock.
    arm
        Arms the rig, in the name of a person.
    attempts
        How often one acquisition is tried when its frames are refused.

    Raises
    ------
    AcquisitionError
        If an intensity is not as it was, or its source has moved.
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


def _measured(scanner: AnyScanner, angle_deg: float, attempts: int) -> Sample:
    for attempt in range(1, attempts + 1):
        try:
            return scanner.measure(angle_deg)
        except SaturationError:
            raise
        except AcquisitionError:
            if attempt == attempts:
                raise
    raise ConfigError(f"run limits: attempts is {attempts}, at least 1 is needed")


def commanded_deg(sample: Sample) -> float:
    """Angle in degrees to which the stage was sent for a sample; the one reached can lie slightly outside the range."""
    return sample.angle_deg if sample.frame is None else sample.frame.header.commanded_deg


def change_of(before: Reading, now: Reading) -> str | None:
    """What has changed between two readings at one angle, in words; None if chance alone can explain it.

    Parameters
    ----------
    before, now
        The readings.
    """
    noise = max(before.noise_sigma or 0.0, now.noise_sigma or 0.0)
    allowed = SHARE * max(before.intensity, now.intensity) + SIGMAS * noise
    if not abs(now.intensity - before.intensity) <= allowed:
        return (
            f"the intensity is {now.intensity:.4g} and was {before.intensity:.4g}, {allowed:.3g} would be the most by "
            "chance"
        )
    return moved_source(before, now)
