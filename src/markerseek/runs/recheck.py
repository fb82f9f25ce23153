"""Measures two angles again before a run is resumed, and refuses to resume if the signal has changed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from markerseek.core import (
    AcquisitionError,
    Asked,
    Clock,
    ConfigError,
    Measured,
    Reading,
    ReadingFrame,
    RecordError,
    Refused,
    Sample,
    SaturationError,
)
from markerseek.records.journal import Checked, Entry, Journal, Resuming
from markerseek.scan import SEEN_SIGMAS, AnyScanner, larger_noise, moved_source

SHARE = 0.1
"""Allowed relative change of an intensity: about the drift of a laser's energy."""

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
    check counts as often as it may be tried.

    ``attempts``: how often one acquisition may be tried.
    """
    permits = 0
    lit = False
    for entry in entries:
        match entry.event:
            case Asked(role=role):
                # A dark acquisition fires no pulse.
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
    """Measure acquisitions again, record the readings in the journal, and refuse to resume if one has changed.

    ``scanner``: measures again, once `arm` was called; it is stopped at the end. ``journal``: receives the readings,
    and a fault if one occurs. ``arm``: arms the rig, in the name of a person. ``attempts``: how often one acquisition
    is tried when its frames are refused.
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
                frame = None if isinstance(now.frame, ReadingFrame) else now.frame
                journal.commit(Checked(reading=now.reading, difference=difference, frame=frame), clock_s=clock.now_s())
                if difference is not None:
                    difference = f"measured again at {commanded_deg(sample):.3f} deg, {difference}"
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
    """Angle in degrees to which the stage was sent for a sample; the one reached can lie slightly outside the range."""
    return sample.angle_deg if sample.frame is None else sample.frame.header.commanded_deg


def change_of(before: Reading, now: Reading) -> str | None:
    """Description of the change between two readings at one angle; None if noise can explain it."""
    allowed = SHARE * max(before.intensity, now.intensity) + SIGMAS * larger_noise(before, now)
    # `not <=` and not `>`, so that NaN counts as a change.
    if not abs(now.intensity - before.intensity) <= allowed:
        return (
            f"the intensity is {now.intensity:.4g} and was {before.intensity:.4g}, {allowed:.3g} would be the most by "
            "chance"
        )
    return moved_source(before, now)
