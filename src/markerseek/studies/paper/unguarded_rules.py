"""The paper's rules in a program without checks, to count how they fail.

The policies of this package refuse invalid samples. Here they enter the rules as they are: a comparison with NaN is
false, so that the right part is kept; a weighted average with one NaN is NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from markerseek.core import PAPER_RANGE, Laser, Permit, Reader, ReadingError, Receiver, Stage
from markerseek.guard import FiringLimits, Permits
from markerseek.search import GOLDEN, TERNARY, THRESHOLD, equal_steps
from markerseek.studies.paper.methods import BRACKET_ACQUISITIONS, ONLINE_STEPS, PaperMethod


def unguarded_acquisition(
    stage: Stage, laser: Laser, receiver: Receiver, reader: Reader, *, pulses: int
) -> Callable[[float], float]:
    """Function that returns the intensity at an angle as a program without a guard does: move, fire, read.

    Parameters
    ----------
    stage, laser, receiver, reader
        Parts of the rig.
    pulses
        Pulses of one acquisition.
    """
    permits = Permits(FiringLimits())

    def acquire(angle_deg: float) -> float:
        stage.move_to(angle_deg)
        issued = permits.issue(angle_deg=angle_deg, pulses=pulses, now_s=0.0)
        # A permit without an end: the simulated laser has a clock, and this program does not look at it.
        permit = Permit(token=issued.token, angle_deg=angle_deg, pulses=pulses, expires_s=math.inf)
        receiver.arm(permit)
        laser.fire(permit)
        try:
            return reader.read(receiver.acquire(permit)).intensity
        except ReadingError:
            # Only ours refuses what is no number; a program without checks goes on with it.
            return math.nan

    return acquire


def unguarded_answer(name: PaperMethod, acquire: Callable[[float], float]) -> float:
    """Angle that the rule answers, in degrees; NaN where it has none.

    TS and GSS make 28 acquisitions, WA the 5° steps and the early end of the online analysis.

    Parameters
    ----------
    name
        The method.
    acquire
        Intensity at an angle in degrees.
    """
    if name == "WA":
        return _average(acquire)
    ratio = TERNARY if name == "TS" else GOLDEN
    low_deg, high_deg = PAPER_RANGE.low_deg, PAPER_RANGE.high_deg
    for _ in range(max(BRACKET_ACQUISITIONS) // 2):
        # Two new acquisitions in each iteration, as section 2.3 prints it.
        left_deg = ratio * low_deg + (1 - ratio) * high_deg
        right_deg = (1 - ratio) * low_deg + ratio * high_deg
        at_left, at_right = acquire(left_deg), acquire(right_deg)
        # False with NaN on either side: the right part is kept.
        if at_left >= at_right:
            high_deg = right_deg
        else:
            low_deg = left_deg
    return (low_deg + high_deg) / 2


def _average(acquire: Callable[[float], float]) -> float:
    measured: list[float] = []
    angles = equal_steps(PAPER_RANGE, acquisitions=ONLINE_STEPS)
    for angle_deg in angles:
        measured.append(acquire(float(angle_deg)))
        # The early end of the online analysis: two samples in a row are below the threshold.
        if len(measured) > 2 and max(measured[-2:]) < THRESHOLD * max(measured):
            break
    intensity = np.array(measured)
    weight = np.where(intensity < THRESHOLD * np.max(intensity), 0.0, intensity)
    # NaN is not equal to 0, and makes the average NaN: no angle.
    total = float(weight.sum())
    return float(weight @ angles[: len(measured)]) / total if total != 0 else math.nan
