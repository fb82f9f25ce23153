"""A registration session where things go wrong: what the cameras show is said and not accepted, and it goes on."""

from __future__ import annotations

import math
from collections.abc import Generator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

from benchmarks.registration.forged_markers import STEREO, ForgedScene
from markerseek.registration import (
    Continued,
    Ended,
    MovedMarker,
    Registered,
    RegistrationSession,
    SessionPlan,
    SessionRecord,
    SpotRefused,
    SpotSeen,
    Step,
    StereoSettings,
    TakenMarker,
    Waiting,
    poses,
)
from markerseek.registration.poses import Place
from markerseek.registration.session import is_enough
from markerseek.rigs import movable
from markerseek.sim import EndoscopeSettings, SimulatedEndoscope, SimulatedSettings, camera_above
from tests.registration_sessions import BEGUN, taken
from tests.unit.sim.faulty_endoscope import FaultyEndoscope

SPOT_M = np.array([0.004, -0.003, 0.061])
# As many frames as one look can take: a spot that moves then does so during its search.
FRAMES = 16
SOUND = EndoscopeSettings(frames=FRAMES, calibration_sigma_px=0.0)


class FaultyRoom:
    """A room with one spot and images of 320 x 256 pixels, with a fault until the spot is asked for again."""

    def __init__(self, *, settings: EndoscopeSettings = SOUND, **faults: Any) -> None:
        self._movable = movable(seed=1, settings=SimulatedSettings())
        self.rig = self._movable.rig
        lens = structs.replace(STEREO.left, centre_px=(159.5, 127.5), size_px=(320, 256))
        self.stereo: StereoSettings = structs.replace(STEREO, left=lens, right=lens)
        self._endoscopes = [
            FaultyEndoscope(
                cameras=self.stereo.cameras,
                camera_to_trus=camera_above(np.array([0.0, 0.0, 0.06]), distance_m=0.1, roll_deg=20.0, tilt_deg=8.0),
                settings=looks,
                rng=np.random.default_rng(1),
                clock=self.rig.scanner.clock,
                flashes=lambda: len(self._movable.world.flashes),
                **each,
            )
            for looks, each in ((settings, faults), (SOUND, {}))
        ]
        self._asked = 0

    @property
    def images(self) -> SimulatedEndoscope:
        return self._endoscopes[min(self._asked, 2) - 1]

    def ask(self, waiting: Waiting) -> bool:
        assert waiting.said
        self._asked += 1
        x, y, z = SPOT_M.tolist()
        self.rig = self._movable.move(angle_deg=math.degrees(math.atan2(x, z)), radius_m=math.hypot(x, z), lateral_m=y)
        self.images.show(SPOT_M)
        return self._asked <= 2

    waits_dark = False
    endoscope_held = True
    fired: int | None = None

    def light(self) -> int:
        return self.rig.scanner.light()

    def arm(self) -> None:
        """A simulated rig needs none."""


def steps_until(kind: type[Step], room: FaultyRoom) -> list[Step]:
    """The steps of a session up to the first of a kind."""
    session = RegistrationSession(room, plan=SessionPlan(tolerance_mm=1.0))
    steps: list[Step] = []
    for step in session.steps():
        steps.append(step)
        if isinstance(step, kind):
            break
    return steps


@pytest.mark.parametrize(
    ("faults", "said", "seen"),
    [
        ({"saturated": "left"}, "left camera", 0),
        ({"occluded": "right"}, "right camera", 0),
        ({"reflection": "laser"}, "two places are about as bright", 2),
        ({"settings": structs.replace(SOUND, dropped_share=1.0)}, "0 image pairs came within 3 s", 0),
        ({"delay_frames": 100}, "0 image pairs came within 3 s", 0),
    ],
)
def test_images_that_show_no_spot_are_said_and_the_session_goes_on_when_they_do(
    faults: dict[str, Any], said: str, seen: int
) -> None:
    steps = steps_until(SpotSeen, FaultyRoom(**faults))
    refused = [step for step in steps if isinstance(step, SpotRefused)]
    assert len(refused) == 1
    assert said in refused[0].reason
    places = [*refused[0].left_px, *refused[0].right_px]
    assert len(places) == seen
    # Nothing was accepted before, and the same marker is seen as soon as the fault is gone.
    assert isinstance(steps[-1], SpotSeen)
    assert steps[-1].name == refused[0].name == "1"
    # One of two places that are about as bright is the spot; the other one is its reflection.
    if places:
        apart_px = [np.linalg.norm(np.subtract(each, steps[-1].spot.left_px)) for each in places]
        assert min(apart_px) < 2 < 20 < max(apart_px)


@pytest.mark.parametrize(
    "faults", [{"reflection": "steady"}, {"settings": structs.replace(SOUND, dropped_share=0.5)}, {"delay_frames": 10}]
)
def test_a_steady_reflection_and_late_or_missing_images_do_not_disturb(faults: dict[str, Any]) -> None:
    exact = steps_until(SpotSeen, FaultyRoom())[-1]
    steps = steps_until(SpotSeen, FaultyRoom(**faults))
    assert isinstance(exact, SpotSeen)
    assert isinstance(steps[-1], SpotSeen)
    assert not any(isinstance(step, SpotRefused) for step in steps)
    assert steps[-1].spot.left_px == pytest.approx(exact.spot.left_px, abs=0.5)
    assert steps[-1].spot.right_px == pytest.approx(exact.spot.right_px, abs=0.5)


def test_a_spot_that_moves_by_two_millimetres_during_its_search_is_said_and_taken_again() -> None:
    # 1,100 px of focal length at 0.1 m.
    steps = steps_until(TakenMarker, FaultyRoom(settings=structs.replace(SOUND, motion_px=22.0)))
    refused = [step for step in steps if isinstance(step, SpotRefused)]
    assert len(refused) == 1
    assert "moved by 2" in refused[0].reason
    # Where it was seen after the move.
    assert isinstance(steps[-1], TakenMarker)
    for side in ("left_px", "right_px"):
        assert getattr(refused[0], side)[0] == pytest.approx(getattr(steps[-1].spot, side), abs=40)
    assert "during its search" in refused[0].reason
    assert isinstance(steps[-1], TakenMarker)
    assert steps[-1].answer == "found"
    assert steps[-1].candidates[0].position.position_m == pytest.approx(SPOT_M, abs=0.5e-3)


class ForgedSession(RegistrationSession):
    """A session whose searches and images are forged; its first marker is elsewhere when it is measured again."""

    def __init__(self, room: FaultyRoom, scene: ForgedScene, *, moved_m: float) -> None:
        super().__init__(room, plan=SessionPlan(markers=4, again=True))
        self._scene = scene
        self._places = iter(scene.wide(4))
        self._first_m: np.ndarray | None = None
        turned = scene.rng.standard_normal(3)
        self._by_m = moved_m * turned / np.linalg.norm(turned)

    def _marker(
        self, name: str, *, again: TakenMarker | None = None, check: bool = False
    ) -> Generator[Step, None, TakenMarker | None]:
        assert not check
        spot_m = next(self._places) if again is None else self._first_m
        assert spot_m is not None
        self._first_m = spot_m if self._first_m is None else self._first_m
        # The camera's view of tissue that moves between: the marker moves, the light that the camera sees does not.
        heard_m = spot_m if again is None else spot_m + self._by_m
        seen = self._scene.seen(name, spot_m, [self._scene.candidate(heard_m)])
        marker = taken(
            name,
            camera_m=seen.camera_m.tolist(),
            camera_covariance_m2=seen.camera_covariance_m2.tolist(),
            camera_shared_m=seen.camera_shared_m.tolist(),
            answer="found",
            candidates=list(seen.candidates),
            again=None if again is None else again.name,
        )
        yield self._recorded(marker)
        return marker


class ForgedRoom(FaultyRoom):
    """A room whose calibration is that of the forged markers, and whose spot is always there."""

    def __init__(self) -> None:
        super().__init__()
        self.stereo = STEREO

    def ask(self, waiting: Waiting) -> bool:
        assert waiting.said
        return True


def again_of(room: ForgedRoom, seed: int, *, moved_m: float) -> MovedMarker | None:
    steps = list(ForgedSession(room, ForgedScene(seed), moved_m=moved_m).steps())
    assert isinstance(steps[-1], Ended)
    if not any(isinstance(step, Registered) and step.decided for step in steps):
        return None
    return next(step for step in steps if isinstance(step, MovedMarker))


def test_a_marker_that_has_moved_at_the_end_is_said_and_one_that_has_not_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(poses, "_GRID", (4, 3))
    room = ForgedRoom()
    seeds = range(12)
    still = [found for seed in seeds if (found := again_of(room, seed, moved_m=0.0)) is not None]
    moved = [found for seed in seeds if (found := again_of(room, seed, moved_m=3e-3)) is not None]
    assert len(still) >= 10
    assert all("it has not moved" in each.said for each in still)
    assert all("it has moved: register again" in each.said for each in moved)
    assert np.mean([each.moved_m for each in moved]) == pytest.approx(3e-3, rel=0.2)


@pytest.mark.parametrize(
    ("plan", "said"),
    [
        (SessionPlan(), None),
        (SessionPlan(tre_mm=0.7), None),
        (SessionPlan(tre_mm=1.3), "the goal is 1.3 mm, and was 0.7 mm"),
        (
            SessionPlan(target_trus_m=(0.0, 0.01, 0.04)),
            "the target is 0 10 40 mm, and was the usual one",
        ),
    ],
)
def test_a_session_that_is_continued_with_another_goal_or_target_says_so_to_all(
    tmp_path: Path, plan: SessionPlan, said: str | None
) -> None:
    record = SessionRecord.create(tmp_path / "s", structs.replace(BEGUN, goal_m=0.7e-3))
    record.close()
    record = SessionRecord.reopen(tmp_path / "s")
    with closing(RegistrationSession(ForgedRoom(), plan=plan, record=record).steps()) as steps:
        first = next(steps)
    record.close()
    assert (first.said if isinstance(first, Continued) else None) == said
    view = SessionRecord.reopen(tmp_path / "s").view
    assert view.goal_m == pytest.approx(0.7e-3 if plan.tre_mm is None else plan.goal_m)
    assert view.target_trus_m == plan.target_trus_m


def test_the_ventilation_is_to_be_held_for_each_marker_and_to_go_on_after_it() -> None:
    session = RegistrationSession(FaultyRoom(), plan=SessionPlan(tolerance_mm=1.0, hold=True))
    steps = [step for step in session.steps() if isinstance(step, Waiting | TakenMarker | Ended)]
    first, taken_marker, second, ended = steps
    assert isinstance(first, Waiting)
    assert first.said.endswith(
        "; then hold the ventilation at the end of exhalation until its marker is taken, and say so once it is held"
    )
    assert "go on" not in first.said
    assert isinstance(taken_marker, TakenMarker)
    assert isinstance(second, Waiting)
    assert second.said.startswith("go on with the ventilation; light ")
    assert f"until its marker is taken, for about {taken_marker.rig_s:.0f} s" in second.said
    assert isinstance(ended, Ended)
    assert ended.said.endswith("; go on with the ventilation")


@pytest.mark.parametrize(
    ("tre_mm", "with_another_mm", "enough"),
    [
        (0.99, 0.5, True),
        # The session of the tutorial: another marker gains less than a tenth, and reaches the goal.
        (1.11, 1.01, False),
        (1.11, 1.04, False),
        (1.11, 1.06, True),
        (1.11, None, True),
    ],
)
def test_a_session_above_its_goal_goes_on_while_a_marker_gains_a_twentieth(
    tre_mm: float, with_another_mm: float | None, enough: bool
) -> None:
    place = None
    if with_another_mm is not None:
        place = Place(left_px=(1.0, 2.0), right_px=(1.0, 2.0), camera_m=(0.0, 0.0, 0.1), tre_m=with_another_mm / 1e3)
    assert is_enough(tre_mm / 1e3, place, goal_m=1e-3) is enough
