"""What a session knows of the tissue's breath after each search, and how a spot waits for its pause."""

from __future__ import annotations

import pytest
from msgspec import structs

from markerseek.registration import SearchScene, SimulatedRoom, SimulatedRoomSettings
from markerseek.registration.known_breath import KnownBreath, newer_breath
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
    assert newer_breath(before, seen, during_s=during_s) == after


def test_a_breath_is_counted_by_its_period() -> None:
    assert BREATH.breaths == pytest.approx(3.0)
    assert structs.replace(BREATH, period_s=None).breaths == 0.0


def test_a_session_that_is_continued_knows_the_breath_of_its_markers() -> None:
    room = SimulatedRoom(SimulatedRoomSettings(), seed=5)
    markers = [
        structs.replace(taken("1"), scene=scene(BREATH), rig_s=12.0),
        structs.replace(taken("2"), scene=scene(PART), rig_s=5.9),
    ]
    assert KnownBreath(room, gate="found", markers=markers).moves == BREATH
    assert KnownBreath(room, gate="found").moves is None


def test_a_spot_waits_for_a_pause_of_the_breath() -> None:
    room = SimulatedRoom(SimulatedRoomSettings(), seed=5)
    breath = KnownBreath(room, gate="found")
    clock = room.rig.scanner.clock
    breath.await_pause()
    assert clock.now_s() < 1.0
    breath.moves = structs.replace(BREATH, pause_at_s=-1.0)
    clock.wait(0.6 - clock.now_s())
    breath.await_pause()
    # The next pause begins at 3 s.
    assert 3.0 <= clock.now_s() <= 3.1
    breath.await_pause()
    assert clock.now_s() <= 3.1
