"""Measures two angles again before a run is resumed, and refuses to resume if the signal has changed."""

from __future__ import annotations

import math
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
    Sweep,
    Swept,
)
from markerseek.guard import FiringLimits
from markerseek.records.journal import Checked, Entry, Journal, Resuming
from markerseek.scan import SEEN_SIGMAS, AnyScanner, larger_noise, moved_source

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

    That to which it was sent before, for the one reached can lie slightly outside the range; in a sweep, the reached.
    """
    at_rest = sample.frame is not None and sample.sweep is None
    return sample.frame.header.commanded_deg if at_rest and sample.frame is not None else sample.angle_deg


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
