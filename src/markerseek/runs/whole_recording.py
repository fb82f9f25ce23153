"""What a recording says in all, beside what a search of it found."""

from __future__ import annotations

from dataclasses import replace

from markerseek.core import MAX_ACQUISITIONS, Estimate, PolicyPlan
from markerseek.rigs import Rig
from markerseek.search import build


def answer_from_all(rig: Rig, plan: PolicyPlan) -> Estimate | None:
    """Return the posterior's answer from every angle of a recording; None where there are too many, or invented ones.

    ``rig``: a replayed rig that has measured nothing yet. ``plan``: of a search of it, whose method may be another.
    """
    if rig.angles_deg is None or not 2 <= len(rig.angles_deg) <= MAX_ACQUISITIONS:
        return None
    asked = plan if plan.method == "posterior" else PolicyPlan(method="posterior", tolerance=plan.tolerance)
    asked = replace(asked, acquisitions=len(rig.angles_deg), early_end=False, angles_deg=rig.angles_deg)
    policy = build(asked, limits=rig.limits.search)
    for _ in range(rig.dark_frames):
        policy.tell(rig.scanner.measure_dark())
    while (angle_deg := policy.ask()) is not None:
        policy.tell(rig.scanner.measure(angle_deg))
    return policy.estimate()
