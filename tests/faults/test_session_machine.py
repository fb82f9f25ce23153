"""Stateful test of a registration session: whatever happens to it, all who decide by it or show it say the same.

Searches and images are forged; the session, its record and its readers are the real ones.
``MARKERSEEK_SESSIONS=1000 pytest tests/faults/test_session_machine.py`` walks as many traces.
"""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Generator
from contextlib import closing
from functools import cache
from pathlib import Path
from unittest import mock

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from msgspec import structs

from benchmarks.registration.forged_markers import STEREO, ForgedScene
from markerseek.bridges import open_registration
from markerseek.bridges.igtl.streams import Streams
from markerseek.bridges.page.session_display import session_verdict
from markerseek.cli.register import _of_session
from markerseek.cli.registering import SessionOver, _require_same
from markerseek.core import ConfigError, MarkerCandidate, RecordError, SearchError
from markerseek.records.journal import line_file
from markerseek.registration import (
    REGISTRATION_FILE,
    Begun,
    Ended,
    MovedMarker,
    RecordedStep,
    Registered,
    RegistrationSession,
    SessionPlan,
    SessionRecord,
    SessionView,
    SpotChecked,
    SpotRefused,
    Step,
    TakenMarker,
    Waiting,
    camera_text,
    poses,
    read_session,
    view_of,
)
from markerseek.rigs import Rig, simulated
from tests.registration_sessions import BEGUN, taken
from tests.sizes import examples

TRACES = int(os.environ.get("MARKERSEEK_SESSIONS", "40"))

# The page needs a calibration to draw the marks.
BEGUN_HERE = structs.replace(BEGUN, cameras=camera_text(STEREO), size_px=STEREO.left.size_px)

MARKERS = st.sampled_from(["found", "found", "found", "missing", "ambiguous", "outlier", "refused", "nobody"])
AGAIN = st.sampled_from(["moved", "still", "missing", "refused", "nobody"])
CHECK = st.sampled_from(["moved", "still", "refused", "nobody"])
PLANS = st.builds(
    SessionPlan,
    tre_mm=st.sampled_from([None, 0.1, 20.0]),
    markers=st.none() | st.just(4),
    again=st.sampled_from([True, True, False]),
    check=st.booleans(),
)


PLACES_M = [(-0.02, -0.012), (0.02, -0.012), (0.0, 0.012), (-0.02, 0.012), (0.02, 0.012), (0.0, -0.012), (0.0, 0.0)]
"""Where the spots are, one after the other: not on a line."""

CHECK_PLACE_M = (0.008, 0.002)
"""Where the spots are that check a registration."""


@cache
def rig() -> Rig:
    return simulated(seed=1)


class Room:
    """A room in which somebody sets the spot, or nobody does."""

    stereo = STEREO
    waits_dark = False
    endoscope_held = True
    fired: int | None = None
    somebody = True

    @property
    def rig(self) -> Rig:
        return rig()

    images = mock.Mock()

    def ask(self, waiting: Waiting) -> bool:
        assert waiting.said
        return self.somebody

    def light(self) -> int:
        return 0

    def arm(self) -> None:
        """No hardware is involved."""


class Session(RegistrationSession):
    """A session whose next marker is forged as `what` says."""

    what = "found"

    def __init__(self, room: Room, plan: SessionPlan, record: SessionRecord, scene: ForgedScene) -> None:
        super().__init__(room, plan=plan, record=record)
        self._scene = scene

    def _marker(
        self, name: str, *, again: TakenMarker | None = None, check: bool = False
    ) -> Generator[Step, None, TakenMarker | None]:
        if self.what == "refused":
            yield self._recorded(SpotRefused(name=name, reason="no light"))
            return None
        scene = self._scene
        x_m, y_m = CHECK_PLACE_M if check else PLACES_M[(len(self.view.markers)) % len(PLACES_M)]
        spot_m = scene.at(x_m, y_m) if again is None else scene.true.apply(np.array(again.camera_m))
        # Tissue that moves between: the marker is elsewhere, the light that the camera sees is not.
        source_m = spot_m + np.array([4e-3, 4e-3, 0.0]) if self.what in ("moved", "outlier") else spot_m
        candidates: list[MarkerCandidate] = [] if self.what == "missing" else [scene.candidate(source_m)]
        if self.what == "ambiguous":
            candidates = [scene.other(spot_m, 0.5), scene.candidate(spot_m, 0.5)]
        seen = scene.seen(name, spot_m, candidates)
        marker = taken(
            name,
            camera_m=seen.camera_m.tolist(),
            camera_covariance_m2=seen.camera_covariance_m2.tolist(),
            camera_shared_m=seen.camera_shared_m.tolist(),
            answer="found" if candidates else "not found",
            candidates=candidates,
            again=None if again is None else again.name,
            check=check,
        )
        yield self._recorded(marker)
        return marker


def exit_code(view: SessionView, folder: Path) -> int:
    """The exit code of ``markerseek register``."""
    try:
        return _of_session(SessionOver(view=view, folder=folder, title="rig")).exit_code
    except SearchError:
        return 2


class Sessions(RuleBasedStateMachine):
    """A session, and a model of what it acknowledged."""

    def __init__(self) -> None:
        super().__init__()
        self.top = Path(tempfile.mkdtemp())
        self.folder = self.top / "session"
        self.patches = [mock.patch.object(poses, "_GRID", (4, 3)), mock.patch.object(poses, "DRAWS", 400)]
        for patch in self.patches:
            patch.start()
        self.room = Room()
        self.acknowledged: list[RecordedStep] = []
        self.steps: Generator[Step, None, None] | None = None
        self.session: Session | None = None

    def teardown(self) -> None:
        self.leave()
        if self.acknowledged:
            self.agree_with_those_who_open_it()
        for patch in self.patches:
            patch.stop()
        shutil.rmtree(self.top)

    @initialize(seed=st.integers(0, 50), plan=PLANS, found=st.sampled_from([4, 3, 1, 0]))
    def begin(self, seed: int, plan: SessionPlan, found: int = 0) -> None:
        self.scene = ForgedScene(seed)
        self.record = SessionRecord.create(self.folder, structs.replace(BEGUN_HERE, goal_m=plan.goal_m))
        self.acknowledged = [self.record.begun]
        self.run(plan)
        for _ in range(found):
            self.answer("found")

    def run(self, plan: SessionPlan) -> None:
        """Begin or go on, to where somebody is asked for a spot."""
        self.session = Session(self.room, plan, self.record, self.scene)
        self.steps = self.session.steps()
        self.go_on()

    def go_on(self, *, most: int = 1000) -> None:
        """Take steps to where a person is asked, or the end; after ``most`` steps the program is where it is."""
        assert self.steps is not None
        for step in self.steps:
            assert not isinstance(step, Begun)
            self.acknowledged.append(step)
            most -= 1
            if isinstance(step, Waiting | SpotRefused) or most == 0:
                return
        self.leave()

    def leave(self) -> None:
        """End the program, wherever it is."""
        if self.steps is not None:
            self.steps.close()
            self.record.close()
        self.steps = None
        self.session = None

    @property
    def asks_again(self) -> bool:
        waits = [step for step in self.acknowledged if isinstance(step, Waiting)]
        return bool(waits) and waits[-1].name in {step.name for step in self.acknowledged if type(step) is TakenMarker}

    @property
    def asks_check(self) -> bool:
        waits = [step for step in self.acknowledged if isinstance(step, Waiting)]
        return bool(waits) and waits[-1].name.startswith("check")

    @precondition(lambda self: self.steps is not None and not self.asks_again and not self.asks_check)
    @rule(what=MARKERS, most=st.sampled_from([1000, 1000, 1000, 1, 2]))
    def light(self, what: str, most: int) -> None:
        self.answer(what, most)

    @precondition(lambda self: self.steps is not None and self.asks_again)
    @rule(what=AGAIN, most=st.sampled_from([1000, 1000, 1]))
    def light_again(self, what: str, most: int) -> None:
        self.answer(what, most)

    @precondition(lambda self: self.steps is not None and self.asks_check)
    @rule(what=CHECK, most=st.sampled_from([1000, 1000, 1]))
    def light_check(self, what: str, most: int) -> None:
        self.answer(what, most)

    def answer(self, what: str, most: int = 1000) -> None:
        assert self.session is not None
        self.session.what = what
        self.room.somebody = what != "nobody"
        self.go_on(most=most)

    @precondition(lambda self: self.steps is not None)
    @rule(what=MARKERS | AGAIN, room_for=st.integers(0, 3))
    def fill_the_disk(self, what: str, room_for: int) -> None:
        assert self.session is not None
        write = line_file._write
        left = [room_for]

        def full(descriptor: int, data: bytes, *, at: int) -> None:
            if left[0] == 0:
                write(descriptor, data[:40], at=at)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            left[0] -= 1
            write(descriptor, data, at=at)

        with mock.patch.object(line_file, "_write", full):
            try:
                self.answer(what)
            except RecordError as problem:
                assert "No space left on device" in str(problem)  # noqa: PT017
                self.leave()

    @precondition(lambda self: self.steps is not None)
    @rule(torn=st.booleans())
    def kill(self, torn: bool) -> None:
        self.leave()
        if torn:
            with (self.folder / "session.jsonl").open("ab") as file:
                file.write(b'{"crc":"0123abcd","number":7,"bo')

    @precondition(lambda self: self.steps is None and self.acknowledged)
    @rule(plan=PLANS)
    def go_on_later(self, plan: SessionPlan) -> None:
        self.record = SessionRecord.reopen(self.folder)
        self.run(plan)

    @precondition(lambda self: self.steps is None and self.acknowledged)
    @rule()
    def go_on_elsewhere(self) -> None:
        with closing(SessionRecord.reopen(self.folder)) as record, pytest.raises(ConfigError, match="was begun on"):
            _require_same(record, structs.replace(record.begun, rig="another", description="another rig"))

    @precondition(lambda self: self.acknowledged)
    @invariant()
    def nothing_that_was_acknowledged_is_lost(self) -> None:
        assert read_session(self.folder) == self.acknowledged

    @precondition(lambda self: self.acknowledged)
    @invariant()
    def all_who_read_it_agree(self) -> None:
        # The model: what the newest markers say, unless one has moved, or a spot has refuted it.
        states = [step for step in self.acknowledged if isinstance(step, Registered)]
        moved = any(isinstance(step, MovedMarker) and step.moved for step in self.acknowledged)
        checks = [step for step in self.acknowledged if isinstance(step, SpotChecked)]
        of_these = [step.check for step in checks if states and step.chosen == states[-1].chosen]
        holds = bool(states) and states[-1].decided and not moved and all(each.agrees for each in of_these)
        view = view_of(read_session(self.folder), self.folder)
        assert (view.registration is not None) == holds
        assert (view.reason is None) == holds
        if self.session is not None:
            assert self.session.view.known == view.known
        assert view.known["decided"] == holds
        assert (exit_code(view, self.folder) == 0) == holds
        names = {each.device: each.content for each in Streams(registration=view).idle()}
        assert (names["DaVinciRegistration"].name == "REGISTERED") == holds
        assert ("DaVinciToProbeHome" in names) == holds
        word = session_verdict(view, next_step="").word
        assert not word.startswith("REGISTERED") or holds
        if isinstance(self.acknowledged[-1], Ended):
            assert self.acknowledged[-1].registered == holds
            assert word.startswith("REGISTERED") == holds
            assert (word == "REGISTERED") == view.goal_reached
        path = self.folder / REGISTRATION_FILE
        assert path.exists() == holds
        if holds:
            written = msgspec.json.decode(path.read_bytes())
            assert written.pop("simulation")["simulated"]
            report = structs.replace(states[-1].report, checks=of_these)
            assert msgspec.json.encode(written) == msgspec.json.encode(msgspec.to_builtins(report))

    def agree_with_those_who_open_it(self) -> None:
        """The folder and both files in it are followed alike, or refused alike."""
        view = view_of(read_session(self.folder), self.folder)
        for path in (self.folder, self.folder / "session.jsonl", self.folder / REGISTRATION_FILE):
            if view.registration is None and (view.moved or view.ended is not None):
                with pytest.raises(RecordError, match="without a registration that holds"):
                    open_registration(path)
                continue
            with open_registration(path) as source:
                assert (source.view.registration is None) == (view.registration is None)
                assert source.view.phase == ("ended" if view.ended is not None else "stopped")


TestSessions = Sessions.TestCase
TestSessions.settings = settings(
    max_examples=examples(TRACES),
    stateful_step_count=16,
    deadline=None,
    derandomize=True,
    suppress_health_check=list(HealthCheck),
)


@pytest.mark.parametrize("killed", [False, True])
def test_a_session_whose_first_marker_has_moved_is_not_registered_when_it_is_continued(killed: bool) -> None:
    """The first trace that was found: `--continue` said *registered*, and wrote the file."""
    state = Sessions()
    try:
        state.begin(3, SessionPlan(markers=4, again=True))
        for _ in range(4):
            state.answer("found")
        assert state.asks_again
        state.all_who_read_it_agree()
        assert (state.folder / REGISTRATION_FILE).exists()
        # Killed between the step that says so and the end.
        state.answer("moved", 2 if killed else 1000)
        state.leave()
        assert isinstance(state.acknowledged[-1], MovedMarker if killed else Ended)
        for _ in range(2):
            state.all_who_read_it_agree()
            state.go_on_later(SessionPlan(markers=4))
            state.nothing_that_was_acknowledged_is_lost()
            assert state.steps is None
            assert isinstance(state.acknowledged[-1], Ended)
            assert not state.acknowledged[-1].registered
            assert "has moved" in state.acknowledged[-1].said
    finally:
        state.teardown()


def test_a_registration_that_a_spot_refutes_is_withdrawn_until_there_is_another_marker() -> None:
    state = Sessions()
    try:
        state.begin(3, SessionPlan(markers=4, check=True))
        for _ in range(4):
            state.answer("found")
        assert state.asks_check
        assert (state.folder / REGISTRATION_FILE).exists()
        state.answer("moved")
        state.all_who_read_it_agree()
        assert not (state.folder / REGISTRATION_FILE).exists()
        assert not state.acknowledged[-1].registered
        assert "check-1: off by 5." in state.acknowledged[-1].said
        assert "the registration does not hold there; light one more marker" in state.acknowledged[-1].said
        # The same markers say the same again: it is another one that is asked for.
        state.go_on_later(SessionPlan(markers=4))
        state.all_who_read_it_agree()
        assert state.acknowledged[-1].name == "5"
        state.answer("found")
        state.all_who_read_it_agree()
        assert state.acknowledged[-1].registered
        assert (state.folder / REGISTRATION_FILE).exists()
    finally:
        state.teardown()
