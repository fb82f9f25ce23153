"""What the scanner does with tissue that is followed: it waits for its pause, and asks how far it was displaced."""

from __future__ import annotations

import numpy as np

from markerseek.core import Clock, Displacement, FollowedTissue, as_matrix, as_vector

_MOST_BREATHS = 2.0
"""Longest wait for a pause, in breaths: the first pause may be too short, or nearly over."""

_LOOK_S = 0.05
"""Time from one look for the pause to the next: cameras give 10 to 30 images a second."""

_MOMENTS = 5
"""Moments of an acquisition at which the displacement is asked for."""


def await_pause(tissue: FollowedTissue, clock: Clock, *, for_s: float) -> None:
    """Wait until the tissue rests for that long; not where no pause is known, and for `_MOST_BREATHS` at most.

    What lasts longer than a pause waits for the beginning of one.
    """
    breath_s = tissue.breath_s
    if breath_s is None:
        return
    # The beginning of a pause is seen one look too late.
    for_s = min(for_s, max(tissue.pause_s - 2 * _LOOK_S, 0.0))
    until_s = clock.now_s() + _MOST_BREATHS * breath_s
    while tissue.rests(for_s) is False and clock.now_s() < until_s:
        clock.wait(_LOOK_S)


def await_known(tissue: FollowedTissue, clock: Clock, *, at_s: float) -> None:
    """Wait until the displacement at that moment is known."""
    left_s = at_s + tissue.known_after_s - clock.now_s()
    if left_s > 0:
        clock.wait(left_s)


def mean_displacement(tissue: FollowedTissue, *, began_s: float, ended_s: float) -> Displacement | None:
    """Return the mean displacement over an acquisition; None if it is not known at a moment of it.

    Its error is that of one moment: what the moments are off by, such as where the rest is, they have in common.
    """
    moments = [tissue.displacement(float(at_s)) for at_s in np.linspace(began_s, ended_s, _MOMENTS)]
    known = [each for each in moments if each is not None]
    if len(known) < len(moments):
        return None
    return Displacement(
        mm=as_vector(np.mean([each.mm for each in known], axis=0)),
        covariance_mm2=as_matrix(np.mean([each.covariance_mm2 for each in known], axis=0)),
    )
