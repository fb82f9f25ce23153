"""The paper's rules as a program would have them that checks nothing.

The package's own policies refuse what is no measurement. What the bare rules make of it is written out here, to be
counted: a comparison with NaN is false, so that the right part is kept; a weighted average with one NaN is NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from markerseek.core import PAPER_RANGE, Permit
from markerseek.core.protocols import Laser, Reader, Receiver, Stage
from markerseek.guard import FiringLimits, Permits
from markerseek.search import GOLDEN, TERNARY, equal_steps
from markerseek.search.average import THRESHOLD
from markerseek.studies.paper.methods import BRACKET_ACQUISITIONS, ONLINE_STEPS, Name


def bare_listener(
    stage: Stage, laser: Laser, receiver: Receiver, reader: Reader, *, pulses: int
) -> Callable[[float], float]:
    """What a program without a guard hears at an angle: it turns, fires, and takes what comes.

    Parameters
    ----------
    stage, laser, receiver, reader
        Parts of the rig.
    pulses
        Pulses of one acquisition.
    """
    permits = Permits(FiringLimits())

    def hear(angle_deg: float) -> float:
        stage.move_to(angle_deg)
        permit: Permit = permits.issue(angle_deg=angle_deg, pulses=pulses, now_s=0.0)
        # Time is no matter to a simulated laser that is told that its permit never ends.
        permit = Permit(token=permit.token, angle_deg=angle_deg, pulses=pulses, expires_s=math.inf)
        receiver.arm(permit)
        laser.fire(permit)
        return reader.read(receiver.acquire(permit)).intensity

    return hear


def bare_answer(name: Name, hear: Callable[[float], float]) -> float:
    """Angle that the bare rule answers, in degrees; NaN where it has none.

    TS and GSS make 28 acquisitions, WA the 5° steps and the early end of the online analysis.

    Parameters
    ----------
    name
        The method.
    hear
        Intensity at an angle in degrees.
    """
    if name == "WA":
        return _average(hear)
    ratio = TERNARY if name == "TS" else GOLDEN
    low_deg, high_deg = PAPER_RANGE.low_deg, PAPER_RANGE.high_deg
    for _ in range(max(BRACKET_ACQUISITIONS) // 2):
        left_deg = ratio * low_deg + (1 - ratio) * high_deg
        right_deg = (1 - ratio) * low_deg + ratio * high_deg
        at_left, at_right = hear(left_deg), hear(right_deg)
        if at_left >= at_right:
            high_deg = right_deg
        else:
            low_deg = left_deg
    return (low_deg + high_deg) / 2


def _average(hear: Callable[[float], float]) -> float:
    heard: list[float] = []
    angles = equal_steps(PAPER_RANGE, acquisitions=ONLINE_STEPS)
    for angle_deg in angles:
        heard.append(hear(float(angle_deg)))
        if len(heard) > 2 and max(heard[-2:]) < THRESHOLD * max(heard):
            break
    intensity = np.array(heard)
    weight = np.where(intensity < THRESHOLD * np.max(intensity), 0.0, intensity)
    total = float(weight.sum())
    return float(weight @ angles[: len(heard)]) / total if total != 0 else math.nan
