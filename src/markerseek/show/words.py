"""An answer in words: its name, reason and angle, other sources, and what the answer took."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Literal, TypeAlias

from markerseek.core import (
    Ambiguous,
    AngleBelief,
    AtBound,
    Estimate,
    Found,
    MarkerMotion,
    NotFound,
    OtherSource,
    Unsure,
    counted,
    listed,
)

AnswerName: TypeAlias = Literal["found", "not found", "ambiguous", "at bound", "unsure"]
"""Names of the answers in the JSON output."""

NO_CLAIM = "the paper's form of a method always answers, also where there is no marker"
"""Why the paper's form of a method claims nothing."""


def answer_name(estimate: Estimate) -> AnswerName:
    """Return the name of an answer in the JSON output."""
    match estimate:
        case Found():
            return "found"
        case NotFound():
            return "not found"
        case Ambiguous():
            return "ambiguous"
        case AtBound():
            return "at bound"
        case Unsure():
            return "unsure"


def answer_reason(estimate: Estimate) -> str | None:
    """Return why an answer names no angle, in one sentence; None if the marker was found."""
    match estimate:
        case Found():
            return None
        case NotFound(reason=reason) | Unsure(reason=reason):
            return reason
        case Ambiguous():
            return _which_of(estimate)
        case AtBound(side=side):
            return f"the intensity still rises at the {side} end of the range; shift the range towards it"


def _which_of(estimate: Ambiguous) -> str:
    """Return the places between which an answer does not decide, and how strong they are."""
    named = {each.angle_deg: each for each in estimate.others if each.angle_deg in estimate.modes_deg}
    places = [
        f"{mode:.2f} deg" + (f" ({named[mode].relative_db:+.1f} dB)" if mode in named else "")
        for mode in estimate.modes_deg
    ]
    if not named:
        return f"the samples fit a marker at each of {listed(places)}"
    return f"sources at {listed(places)} may each be the marker: they are within 6 dB, as far as that is known"


def angle_text(belief: AngleBelief) -> str:
    """Return the angle that an answer names, or its angles, as precisely as known; empty if nothing was detected."""
    estimate = belief.estimate
    # The angle of a search that detected nothing is that of the noise.
    if isinstance(estimate, NotFound):
        return ""
    if isinstance(estimate, Ambiguous):
        return with_minus(" or ".join(f"{each:.1f}°" for each in estimate.modes_deg))
    digits = 3 if belief.sigma_deg is None else digits_of(belief.sigma_deg)
    return with_minus(f"{estimate.mean_deg:z.{digits}f}°")


def digits_of(sigma_deg: float) -> int:
    """Return how many digits behind the point show two significant digits of a standard deviation."""
    # Rounded first: 0.0996 is 0.10 and not 0.100.
    return 3 if sigma_deg <= 0 else max(0, 1 - math.floor(math.log10(float(f"{sigma_deg:.1e}"))))


def with_minus(text: str) -> str:
    """Return a text with minus signs instead of hyphens in its negative numbers."""
    return re.sub(r"(?<![\w.])-(?=\d)", "−", text)


def sigma_text(belief: AngleBelief) -> str:
    """Return the standard deviation with two significant digits; empty without one, and if there are several angles."""
    sigma_deg = belief.sigma_deg
    # That of an ambiguous answer is of one of its sources, and would be read as that of the last angle.
    if sigma_deg is None or isinstance(belief.estimate, Ambiguous):
        return ""
    return f" ± {sigma_deg:.{digits_of(sigma_deg)}f}°"


def interval_text(belief: AngleBelief) -> str:
    """Return the 95 % interval of an angle, and how far it reaches from the angle at the marker, if that is known."""
    # Of one source only where an answer names several.
    if belief.interval95_deg is None or belief.sigma_deg is None or isinstance(belief.estimate, Ambiguous):
        return ""
    low, high = (f"{end_deg:z.{digits_of(belief.sigma_deg)}f}°" for end_deg in belief.interval95_deg)
    estimate = belief.estimate
    half_width_m = estimate.half_width_m
    at_marker = "" if half_width_m is None else f", ±\N{NO-BREAK SPACE}{1e3 * half_width_m:.2g}\N{NO-BREAK SPACE}mm"
    # What a bracket search has left is no probability.
    name = "last bracket" if estimate.interval_kind == "bracket" else "95 %"
    return with_minus(f"{name}: {low} to {high}{at_marker}")


def answer_line(
    answer: str,
    angle_deg: float,
    *,
    sigma_deg: float | None = None,
    interval95_deg: Sequence[float] | None = None,
    reason: str | None = None,
    as_published: bool = False,
) -> str:
    """Return an answer with its angle and reason, in one line that claims no more than the method does.

    Parameters
    ----------
    answer
        Name of the answer, such as "found".
    angle_deg
        Best angle of the method, in degrees.
    sigma_deg
        Standard deviation of the angle, in degrees; None if there is none.
    interval95_deg
        Both ends of the 95 % interval of the angle, in degrees; None if there is none.
    reason
        Why the answer is so; None if the marker was found.
    as_published
        Whether the answer is that of the paper's form of a method, which claims nothing.
    """
    angle = f"{angle_deg:.3f}°" + ("" if sigma_deg is None else f" ± {sigma_deg:.3f}°")
    if interval95_deg is not None:
        angle += " [{:.3f}°, {:.3f}°]".format(*interval95_deg)
    if as_published:
        return f"angle {angle}, nothing is claimed"
    if answer == "found":
        return f"found at {angle}"
    said = answer if reason is None else f"{answer}: {reason}"
    # The angle of a search that detected nothing is that of the noise; an ambiguous reason names all angles.
    return said if answer in {"not found", "ambiguous"} else f"{said}; best guess {angle}, not claimed"


def estimate_line(estimate: Estimate, *, as_published: bool = False) -> str:
    """Return an answer as `answer_line` has it; ``as_published``: whether it claims nothing, and is no more certain."""
    interval = None if as_published else estimate.interval95_deg
    return answer_line(
        answer_name(estimate),
        estimate.mean_deg,
        sigma_deg=None if as_published else estimate.sigma_deg,
        interval95_deg=None if interval is None else (interval.low_deg, interval.high_deg),
        reason=answer_reason(estimate),
        as_published=as_published,
    )


WRONG_SOURCE = "wrong source"
"""Name of the row that says whether another source may be the marker."""


def others_rows(
    others: Sequence[OtherSource], surveyed: float | None, other_probability: float | None
) -> list[tuple[str, str]]:
    """Return the rows of other sources: those that were found, and whether another source may be the marker.

    Parameters
    ----------
    others
        Further sources.
    surveyed
        Share of the range in which a source as strong would have been detected; None if it is not known.
    other_probability
        Probability that another source is the marker; None if it is not known, 0 if the user has excluded it.
    """
    rows = [("other source", _other(each)) for each in others]
    if surveyed is not None:
        rows.append(("range checked", f"{100 * surveyed:.1f} %, for a second source as strong"))
    if other_probability:
        share = "< 0.1 %" if other_probability < 1e-3 else f"{100 * other_probability:.2g} %"
        rows.append((WRONG_SOURCE, f"{share}, the probability that another source is the marker"))
    return rows


NAMED_OUTLIERS = 4
"""Most outliers whose angles are named."""


def outliers_rows(outliers_deg: Sequence[float]) -> list[tuple[str, str]]:
    """Return the row of the samples that an answer leaves out, and why; none without them."""
    if not outliers_deg:
        return []
    angles = ", ".join(f"{each:.2f}°" for each in outliers_deg[:NAMED_OUTLIERS])
    more = ", …" if len(outliers_deg) > NAMED_OUTLIERS else ""
    outliers = counted(len(outliers_deg), "outlier")
    return [("left out", f"{outliers}, several times as strong as the samples beside: {angles}{more}")]


def motion_rows(motion: MarkerMotion | None) -> list[tuple[str, str]]:
    """Return the row of the marker's motion; none where the search did not look for it, or detected no marker."""
    if motion is None:
        return []
    if motion.lateral_mm is None or motion.depth_mm is None:
        text = "cannot be seen: that takes frames of two moments that show where the marker is"
    elif max(motion.lateral_mm, motion.depth_mm) > 0:
        text = f"the marker moves: ± {motion.depth_mm:.2g} mm in depth, ± {motion.lateral_mm:.2g} mm along the array"
        if motion.period_s is not None:
            text += f", about every {motion.period_s:.2g} s"
    elif motion.turn_looked_at:
        text = "none seen in depth, along the array, and in a flank that was measured twice"
    else:
        text = "none seen in depth and along the array; not looked for along the turn, where frames do not show it"
    if motion.cameras_mm is not None:
        text = (
            f"seen by the cameras: ± {motion.cameras_mm:.2g} mm at the samples, taken out; ± {motion.left_mm:.2g} mm "
            "along the turn left"
        )
    if motion.turn_sigma_mm >= 0.01:
        text += f"; the interval has room for ± {motion.turn_sigma_mm:.2g} mm along the turn"
    return [("motion", text)]


def acquisitions_text(acquisitions: int, refused: int) -> str:
    """Return the number of acquisitions, and of those that were refused."""
    return str(acquisitions) + (f", {refused} refused" if refused else "")


def time_text(elapsed_s: float, *, known_s: float | None, simulated: bool) -> str:
    """Return the duration of a search on the clock of its rig.

    ``known_s``: time to the answer, before the probe turned to the marker; None if there was none.
    """
    text = f"{elapsed_s:.1f} s"
    if known_s is not None and known_s < elapsed_s:
        text = f"{known_s:.1f} s to the answer, {text} with the probe at the marker"
    return text + (", on the simulated clock" if simulated else "")


def _other(source: OtherSource) -> str:
    place = ""
    if source.lateral_m is not None and source.depth_m is not None:
        place = f", lateral {1e3 * source.lateral_m:.1f} mm, depth {1e3 * source.depth_m:.1f} mm"
    # Adding zero makes 0 of a rounded -0.
    return f"{round(source.relative_db, 1) + 0.0:+.1f} dB at {source.angle_deg:.2f}° ± {source.sigma_deg:.2f}°{place}"
