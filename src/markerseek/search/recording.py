"""A search of a recording, whose other angles are taken after it: the answer is from all of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from msgspec.structs import replace

from markerseek.core import Estimate, Found, Policy, PriorEvidence, Sample, Searched, estimate_of

if TYPE_CHECKING:
    from markerseek.search.posterior import Posterior


class WholeRecording:
    """Searches a recording as a policy would search on a rig, then takes the other angles, and answers from all.

    ``search``: the policy. ``posterior``: a new one, which gives the answer. ``angles_deg``: angles of the recording.
    """

    def __init__(self, search: Policy, posterior: Posterior, *, angles_deg: Sequence[float]) -> None:
        self._search = search
        self._posterior = posterior
        self._left_deg = list(angles_deg)
        self._dark: list[Sample] = []
        # One of each angle: a method of the paper may return to one, and a recording says the same again.
        self._taken: dict[float, Sample] = {}
        self._told = 0
        self._searched: Searched | None = None
        self._is_answered = False

    @property
    def searched(self) -> Searched | None:
        """What the search took and said; None before its end."""
        if self._searched is None and self._search.ask() is None:
            self._searched = Searched(estimate=estimate_of(self._search), acquisitions=self._told)
        return self._searched

    @property
    def near_evidence(self) -> PriorEvidence | None:
        """What the search has seen of a prior over the angle; None without one, and before its first sample."""
        evidence: PriorEvidence | None = getattr(self._search, "near_evidence", None)
        return evidence

    @property
    def present(self) -> Policy:
        """The policy that answers now: that of the search, once all angles are taken the posterior of all."""
        if self.searched is None or self._left_deg:
            return self._search
        if not self._is_answered:
            self._is_answered = True
            self._posterior.tell_recorded([*self._dark, *(self._taken[each] for each in sorted(self._taken))])
        return self._posterior

    def ask(self) -> float | None:
        """Return the next angle of the search in degrees; after it the next one left, and None after the last."""
        return self._search.ask() if self.searched is None else next(iter(self._left_deg), None)

    def tell(self, sample: Sample) -> None:
        """Take one sample."""
        # A frame has half a megabyte, and no policy uses it.
        sample = replace(sample, frame=None)
        if sample.dark:
            self._dark.append(sample)
            self._search.tell(sample)
            return
        if self.searched is None:
            self._search.tell(sample)
            self._told += 1
        self._taken[sample.angle_deg] = sample
        self._left_deg = [each for each in self._left_deg if each != sample.angle_deg]

    def estimate(self) -> Estimate:
        """Return the answer of the search while angles are left, then the one from all angles.

        Where a search by the posterior names another angle than all angles, no angle is claimed. The other methods end
        at any peak: what they say is no evidence against all angles.
        """
        answer = self.present.estimate()
        if self.searched is None or not self._is_answered or not isinstance(answer, Found):
            return answer
        if not isinstance(self._search, type(self._posterior)):
            return answer
        reason = contradiction(answer, self.searched.estimate)
        return answer if reason is None else answer.as_unsure("source", reason)


AGREEING_DEG = 1.0
"""Distance of two answers in degrees up to which they agree, whatever their intervals are."""


def contradiction(answer: Found, searched: Estimate) -> str | None:
    """Return why an answer from all angles contradicts that of the search, in words; None if it does not."""
    if not isinstance(searched, Found) or abs(answer.mean_deg - searched.mean_deg) <= AGREEING_DEG:
        return None
    all_angles = answer.interval95_deg
    few = searched.interval95_deg
    if few.low_deg <= all_angles.high_deg and all_angles.low_deg <= few.high_deg:
        return None
    return (
        f"all angles together have the marker at {answer.mean_deg:.2f} deg, and the search of some of them at "
        f"{searched.mean_deg:.2f} deg: one curve does not explain this recording; look at its picture"
    )
