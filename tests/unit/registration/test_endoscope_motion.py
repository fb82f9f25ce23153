"""Whether the endoscope has moved between markers, in textured rooms whose truth is known."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError, StereoPair
from markerseek.registration import (
    EndoscopeMotion,
    EndoscopeMove,
    EndoscopeNotKnown,
    SessionRecord,
    SimulatedRoom,
    SimulatedRoomSettings,
    TakenMarker,
    Waiting,
)
from markerseek.registration.endoscope_motion import EndoscopeWatch
from tests.registration_sessions import BEGUN, taken

PLACES_M = ((0.0, 0.0), (10e-3, 8e-3), (-12e-3, 8e-3))
MOVE = EndoscopeMove(marker=2, shift_m=(3e-3, -2e-3, 4e-3), turn_deg=(2.0, -3.0, 4.0))


def room(*moves: EndoscopeMove, textured: bool = True) -> SimulatedRoom:
    return SimulatedRoom(SimulatedRoomSettings(textured=textured, places_m=PLACES_M, moves=moves), seed=3)


def dark_pair(place: SimulatedRoom, name: str) -> StereoPair:
    """What the cameras see of the next place, without light."""
    assert place.ask(Waiting(name=name, place=None, said=""))
    place.rig.scanner.clock.wait(0.2)
    return place.images.newest()[-1]


def test_an_endoscope_that_stands_still_is_at_rest() -> None:
    still = room()
    watch = EndoscopeWatch(still.stereo.cameras)
    watch.begin("1", dark_pair(still, "1"))
    seen = watch.look(dark_pair(still, "2"), after="1")
    assert isinstance(seen, EndoscopeMotion)
    assert seen.state == "at rest"
    assert seen.moved_mm < 0.05
    assert "stands where it stood at marker 1" in seen.said


def test_a_move_is_seen_where_it_leads_and_back_again() -> None:
    moved = room(MOVE)
    watch = EndoscopeWatch(moved.stereo.cameras)
    first = moved.true
    pairs = [dark_pair(moved, "1"), dark_pair(moved, "2")]
    watch.begin("1", pairs[0])
    seen = watch.look(pairs[1], after="1")
    assert isinstance(seen, EndoscopeMotion)
    assert seen.state == "moved"
    assert "has moved after marker 1" in seen.said
    true = moved.true.inverse().matrix @ first.matrix
    between = Rotation.from_matrix(true[:3, :3] @ seen.transform.rotation.T)
    assert np.degrees(between.magnitude()) < 0.1
    point_m = 1e-3 * (np.array(seen.middle_mm) - np.array(seen.displacement_mm))
    # The calibration states focal lengths that are wrong by half a percent.
    assert np.linalg.norm(seen.transform.apply(point_m) - (true[:3, :3] @ point_m + true[:3, 3])) < 0.2e-3
    # A place is recognised to which the endoscope comes back, also if it was elsewhere meanwhile.
    again = EndoscopeWatch(moved.stereo.cameras)
    again.begin("1", pairs[0])
    again.begin("2", StereoPair(left=np.zeros_like(pairs[0].left), right=np.zeros_like(pairs[0].left), at_s=0.0))
    seen = again.look(pairs[0], after="2")
    assert isinstance(seen, EndoscopeMotion)
    assert (seen.since, seen.after, seen.state) == ("1", "2", "at rest")


@pytest.mark.parametrize(("textured", "reason"), [(False, "too little texture"), (True, "were not kept")])
def test_what_the_images_do_not_show_is_not_known(textured: bool, reason: str) -> None:
    place = room(textured=textured)
    watch = EndoscopeWatch(place.stereo.cameras)
    assert watch.look(dark_pair(place, "1"), after="") is None
    watch.begin("1", None if textured else dark_pair(place, "1"))
    seen = watch.look(dark_pair(place, "2"), after="1")
    assert isinstance(seen, EndoscopeNotKnown)
    assert seen.state == "not known"
    assert reason in seen.said


def test_the_fact_is_a_field_of_the_marker_that_records_of_before_do_not_have() -> None:
    motion = EndoscopeMotion(
        since="1",
        after="1",
        displacement_mm=(3.0, 0.0, 4.0),
        rotation_deg=(0.0, 1.0, 0.0),
        middle_mm=(0.0, 0.0, 100.0),
        covariance=tuple(map(tuple, np.diag([0.01**2] * 3 + [0.1**2] * 3).tolist())),
    )
    assert motion.said == (
        "the endoscope has moved after marker 1, by 5.00 ± 0.10 mm and 1.00 ± 0.01 deg against the tissue"
    )
    marker = taken("2", endoscope=motion)
    values = msgspec.to_builtins(marker)
    assert msgspec.convert(values, TakenMarker) == marker
    del values["endoscope"]
    assert msgspec.convert(values, TakenMarker).endoscope is None
    with pytest.raises(ConfigError, match="none of a motion"):
        msgspec.structs.replace(motion, covariance=((1.0,),))


def test_images_are_kept_without_loss(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    left, right = rng.integers(0, 256, size=(2, 48, 64), dtype=np.uint8)
    record = SessionRecord.create(tmp_path / "session", BEGUN)
    assert record.kept_pair("1") is None
    record.keep_pair("1", StereoPair(left=left, right=right, at_s=1.0))
    kept = record.kept_pair("1")
    record.close()
    assert kept is not None
    np.testing.assert_array_equal(kept.left, left)
    np.testing.assert_array_equal(kept.right, right)
