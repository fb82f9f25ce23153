"""The watch of the endoscope while a tip or a point is followed: by pairs that come, or do not."""

from __future__ import annotations

import threading

import pytest

from markerseek.core import StereoPair
from markerseek.following import EndoscopeCheck, NewestPairs
from markerseek.registration import (
    EndoscopeMotion,
    EndoscopeMove,
    EndoscopeNotKnown,
    SimulatedRoom,
    SimulatedRoomSettings,
    Waiting,
)

PLACES_M = ((0.0, 0.0), (10e-3, 8e-3))
MOVE = EndoscopeMove(marker=2, shift_m=(3e-3, -2e-3, 4e-3), turn_deg=(2.0, -3.0, 4.0))


class Given:
    """Pairs that a test hands on."""

    name = "a test"

    def __init__(self) -> None:
        self.pairs: list[StereoPair] = []

    def newest(self) -> list[StereoPair]:
        pairs = self.pairs
        self.pairs = []
        return pairs

    def close(self) -> None:
        """Nothing is open."""


def pairs_of(room: SimulatedRoom, name: str) -> list[StereoPair]:
    """What the cameras see of a place, without light."""
    assert room.ask(Waiting(name=name, place=None, said=""))
    room.rig.scanner.clock.wait(0.2)
    return room.images.newest()


@pytest.mark.parametrize(("moves", "state"), [((), "at rest"), ((MOVE,), "moved")])
def test_the_newest_pair_is_compared_with_the_first(moves: tuple[EndoscopeMove, ...], state: str) -> None:
    room = SimulatedRoom(SimulatedRoomSettings(textured=True, places_m=PLACES_M, moves=moves), seed=3)
    images = Given()
    check = EndoscopeCheck(room.stereo, NewestPairs(images), None)
    assert check.look() is None
    images.pairs = pairs_of(room, "1")
    assert check.look() is None
    images.pairs = pairs_of(room, "2")
    seen = check.look()
    assert isinstance(seen, EndoscopeMotion)
    assert seen.state == state


def test_cameras_that_send_nothing_more_show_nothing() -> None:
    room = SimulatedRoom(SimulatedRoomSettings(textured=True, places_m=PLACES_M), seed=3)
    images = Given()
    check = EndoscopeCheck(room.stereo, NewestPairs(images), None)
    images.pairs = pairs_of(room, "1")
    assert check.look() is None
    seen = check.look()
    assert isinstance(seen, EndoscopeNotKnown)
    assert seen.reason == "no images come"


def test_a_glance_is_computed_beside_and_says_the_same() -> None:
    room = SimulatedRoom(SimulatedRoomSettings(textured=True, places_m=PLACES_M, moves=(MOVE,)), seed=3)
    images = Given()
    first, second = pairs_of(room, "1"), pairs_of(room, "2")
    with EndoscopeCheck(room.stereo, NewestPairs(images), None) as check:
        images.pairs = first
        assert _awaited(check) is None
        # A pair that comes while one is compared waits for the next glance.
        images.pairs = second
        seen = _awaited(check)
        assert isinstance(seen, EndoscopeMotion)
        assert seen.state == "moved"
    check.close()


def _awaited(check: EndoscopeCheck) -> object:
    """Return what a glance says in the end."""
    while (seen := check.glance()) == "going on":
        threading.Event().wait(0.005)
    return seen
