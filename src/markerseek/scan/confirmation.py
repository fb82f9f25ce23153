"""Confirmation of an answer by one acquisition at its angle: as strong as expected, and from the same source.

The rule exists only here. `run` applies it; the result, the journal, a replay and a resumed run use its outcome.
"""

from __future__ import annotations

from collections.abc import Sequence

from markerseek.core import Arrival, Estimate, Found, Reading, Sample, undisplaced

_SHARE = 0.8
"""Least share of the strongest sample's intensity. On simulated materials at 20 to 40 dB it was 0.91 or more after a
posterior; after other methods it was below this, less the noise, only where the angle was wrong. As a share of the
peak that a posterior predicts, the alternative, it was 0.73 or more."""

_STRONG_SHARE = 0.5
"""Least share of the strongest intensity: the confirmation's position is compared with those of samples above it."""

_NOISE_SIGMAS = 4.0
"""Standard deviations of noise by which it may be lower still: the strongest of many samples is partly so by chance."""

MOVED_M = 1.5e-3
"""Most that a source may seem to move along the array or in depth, in metres: three to four resolution cells, as far as
arrivals of one source lie apart along the array (of 300 simulated markers two were at 1.1 and 1.2 mm)."""

_PULSES = 3
"""Of single pulses the expected intensity is the median of so many, the strongest: each varies by itself, and the
strongest of many was so by chance."""

SEEN_SIGMAS = 12.0
"""Intensity over the noise from which a position in the image is that of a source; weaker ones scatter too much."""


def apply_confirmation(estimate: Estimate, confirmation: Sample, samples: Sequence[Sample]) -> Estimate:
    """Return the answer after its confirming acquisition: `Unsure` where a checked search's angle is not confirmed.

    The paper's form of a method asks for no detection threshold and keeps its answer.
    """
    if not isinstance(estimate, Found) or estimate.floor is None:
        return estimate
    reason = confirmation_failure(estimate, confirmation, samples)
    return estimate if reason is None else estimate.as_unsure("source", reason)


def confirmation_failure(found: Found, confirmation: Sample, samples: Sequence[Sample]) -> str | None:
    """Return why the acquisition at the angle found does not confirm it, with both numbers; None if it does.

    It must reach `_SHARE` of the strongest sample's intensity, less `_NOISE_SIGMAS` of the noise, and lie above the
    floor. Its source must lie within `MOVED_M` of that of one of the strong samples: the spot of light is wide, and its
    strongest part changes from sample to sample.

    ``found``: the answer of a checked search.
    """
    if not samples:
        return None
    *samples, confirmation = undisplaced([*samples, confirmation])
    strongest = max(samples, key=lambda sample: sample.reading.intensity).reading
    now = confirmation.reading
    expected = strongest.intensity
    pulses = sorted((each.reading.intensity for each in samples if each.sweep is not None), reverse=True)[:_PULSES]
    if pulses and pulses[0] == expected:
        expected = pulses[len(pulses) // 2]
    noise = larger_noise(strongest, now)
    floor = 0.0 if found.floor is None or found.floor.level is None else found.floor.level
    least = max(_SHARE * expected - _NOISE_SIGMAS * noise, floor)
    if not now.intensity >= least:
        return (
            f"the acquisition at the angle found has an intensity of {now.intensity:.4g}, {expected:.4g} was expected "
            f"and {least:.4g} is the least that confirms it; search again, and check laser, receiver and probe"
        )
    strong = [each.reading for each in samples if each.reading.intensity >= _STRONG_SHARE * strongest.intensity]
    moved = [moved_source(reading, now) for reading in sorted(strong, key=lambda each: -each.intensity)]
    # One strong sample with its source in the same position is enough, and so is one whose position is unknown.
    if None in moved:
        return None
    return f"not confirmed: in the acquisition at the angle found, {moved[0]}; search again"


def larger_noise(before: Reading, now: Reading) -> float:
    """Return the larger noise of two readings, in the intensity's unit.

    0 where neither states it: no difference is then noise.
    """
    return max((each.noise_sigma for each in (before, now) if each.noise_sigma is not None), default=0.0)


def moved_source(before: Reading, now: Reading) -> str | None:
    """By how much the source of two readings has moved, in words; None within `MOVED_M` or if one is weak."""
    noise = larger_noise(before, now)
    if not min(before.intensity, now.intensity) > SEEN_SIGMAS * noise:
        return None
    # A long pulse arrives twice, and either of the two may be the stronger: one of them at the place is enough.
    if any(_together(before, each) for each in now.arrivals if each.intensity >= _STRONG_SHARE * now.intensity):
        return None
    for name in ("lateral_m", "depth_m"):
        # A CSV of intensities has no positions: then the intensity alone decides.
        then_m = getattr(before, name)
        now_m = getattr(now, name)
        if then_m is not None and now_m is not None and not abs(now_m - then_m) <= MOVED_M:
            return f"{name} is {1e3 * now_m:.2f} mm and was {1e3 * then_m:.2f} mm, {1e3 * MOVED_M:g} mm is the limit"
    return None


def _together(before: Reading, arrival: Arrival) -> bool:
    """Return whether an arrival lies within `MOVED_M` of the source of a reading."""
    if before.lateral_m is None or before.depth_m is None:
        return False
    return max(abs(arrival.lateral_m - before.lateral_m), abs(arrival.depth_m - before.depth_m)) <= MOVED_M
