"""What a session knows of the tissue's breath after each search."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec import structs

from markerseek.core import MarkerCandidate, MarkerPosition, RecordError
from markerseek.registration import CorrectedMarker, SearchScene, SessionView
from markerseek.registration.session import _newer_breath
from markerseek.vision import ClockOffset, TissueMoves
from tests.registration_sessions import taken

CLOCK = ClockOffset(offset_s=0.1, sigma_s=0.001)
BREATH = TissueMoves(
    from_s=0.0,
    until_s=12.0,
    rest_mm=(0.0, 0.0, 0.0),
    swing_mm=(2.0, 0.0, 0.0),
    covariance_mm2=((1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0), (0.0, 0.0, 1e-3)),
    period_s=4.0,
    period_sigma_s=0.02,
    pause_at_s=1.0,
    pause_s=1.5,
)
PART = structs.replace(BREATH, from_s=20.0, until_s=25.9, period_s=3.1)
"""A wrong period, of 1.9 breaths."""

WHOLE = structs.replace(BREATH, from_s=20.0, until_s=31.0, period_s=4.1)


def scene(tissue: TissueMoves | None, *, known: float = 1.0, clock: ClockOffset | None = CLOCK) -> SearchScene:
    return SearchScene(pairs=50, known=known, tissue=tissue, clock=clock)


@pytest.mark.parametrize(
    ("before", "seen", "during_s", "after"),
    [
        (None, scene(BREATH), 12.0, BREATH),
        (BREATH, scene(WHOLE), 11.0, WHOLE),
        (BREATH, scene(PART), 5.9, BREATH),
        (None, scene(PART), 5.9, PART),
        (BREATH, scene(None), 3.0, BREATH),
        (BREATH, scene(None), 10.0, None),
        (BREATH, scene(None, known=0.2), 10.0, BREATH),
        (None, scene(BREATH, clock=None), 12.0, None),
        (BREATH, scene(structs.replace(WHOLE, period_s=None, pause_at_s=None)), 11.0, BREATH),
    ],
    ids=[
        "the first",
        "a newer one",
        "a part of a breath",
        "a part is better than none",
        "seen in a pause alone",
        "the ventilation is held",
        "the picture was dark",
        "no clock",
        "no period",
    ],
)
def test_a_breath_stays_known_until_a_search_shows_another_or_none(
    before: TissueMoves | None, seen: SearchScene, during_s: float, after: TissueMoves | None
) -> None:
    assert _newer_breath(before, seen, during_s=during_s) == after


def test_a_breath_is_counted_by_its_period() -> None:
    assert BREATH.breaths == pytest.approx(3.0)
    assert structs.replace(BREATH, period_s=None).breaths == 0.0


def test_a_marker_that_is_answered_again_has_the_new_answer_and_its_own_spot() -> None:
    candidate = MarkerCandidate(
        angle_deg=3.0,
        probability=1.0,
        position=MarkerPosition(position_m=(1e-3, 2e-3, 6e-2), sigma_m=(1e-4, 1e-4, 1e-4)),
    )
    spot = {"camera_covariance_m2": (1e-8 * np.eye(3)).tolist()}
    step = CorrectedMarker(name="1", answer="found", reason=None, candidates=[candidate], said="marker 1 again: found")
    view = SessionView().after(taken("1", **spot)).after(taken("2", **spot)).after(step)
    assert [marker.answer for marker in view.markers] == ["found", "not found"]
    assert view.markers[0] == structs.replace(taken("1", **spot), answer="found", candidates=[candidate])
    with pytest.raises(RecordError, match="marker 3 is corrected, which is not recorded"):
        view.after(structs.replace(step, name="3"))
