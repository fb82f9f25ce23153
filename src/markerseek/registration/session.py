"""A registration as one session: from the first spot to a transform, with the next place and an end.

For each marker: both cameras look for the laser spot, what the markers so far say of it guides its search, the cameras
look again whether it has stood still, and all markers together give the transform, or say what is missing.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from contextlib import closing, nullcontext
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TypeVar

import numpy as np
from msgspec import structs
from scipy.spatial.transform import Rotation

from markerseek.core import (
    AcquisitionError,
    Finished,
    Float64,
    Found,
    MarkerCurve,
    Measured,
    SearchPlan,
    StereoPair,
    Swept,
    as_vector,
    counted,
)
from markerseek.guard import State
from markerseek.records.journal import Configuration, Journal, JournalEvent
from markerseek.registration.answered_again import Answered, KeptSearch, with_header
from markerseek.registration.camera_tissue import CameraRotation, CameraTissue, SeenScene
from markerseek.registration.choice import Choice, SeenMarker, choose, chosen_pairs
from markerseek.registration.endoscope_motion import (
    EndoscopeMotion,
    EndoscopeNotKnown,
    EndoscopeWatch,
    SeenEndoscope,
    less_breath,
)
from markerseek.registration.marker_movement import marker_movement
from markerseek.registration.plan import MOST_MARKERS, SessionPlan
from markerseek.registration.poses import Place, Poses, Prediction, reach_of
from markerseek.registration.record import SessionRecord
from markerseek.registration.room import SHOWN_S, Room
from markerseek.registration.search_scene import SearchScene
from markerseek.registration.search_watch import SearchWatch
from markerseek.registration.session_words import (
    GO_ON,
    asking_for,
    endoscope_in_words,
    state_in_words,
    target_in_words,
    with_hold,
)
from markerseek.registration.spot_check import check_spot
from markerseek.registration.spots import Looked, SpotError, SpotFinder
from markerseek.registration.stations import carry, stands_elsewhere, station_names
from markerseek.registration.steps import (
    Continued,
    CorrectedMarker,
    Ended,
    RecordedStep,
    Registered,
    Searching,
    Spot,
    SpotChecked,
    SpotRefused,
    SpotSeen,
    Step,
    TakenMarker,
    Waiting,
)
from markerseek.registration.view import SessionView
from markerseek.registration.watched_motion import on_cameras_clock, show_motion
from markerseek.runs import Run, new_run, plan_on
from markerseek.show import answer_name, answer_reason
from markerseek.vision import ClockOffset, NotKnown, SceneMove, SceneTexture, SceneWatch, TissueMoves, scene_texture

LEAST_MARKERS = 4
"""Markers before which a session does not end by itself: three cannot show that one is wrong."""

_WORTH = 0.05
"""Share of the expected TRE by which another marker must lower it, or a session above its goal ends: a marker takes
some 20 s with its spot, and who has named a goal wants to reach it."""

MOST_AT_REST = 6
"""Most acquisitions at rest of a search by sweeps that has detected nothing."""

MOST_TEXTURELESS = 2
"""How often in a row images without texture are accepted where somebody may move the endoscope."""

MOST_LOOK_ON_S = 13.0
"""Longest time after a search in which the cameras look on: one and a half of the longest breaths."""

_LOOK_ON_S = 0.5

_GLANCE_S = 4.0
"""Time in which a breath shows, if there is one."""

_WATCHED_BREATHS = 2.0
"""Breaths that are watched before a search: with fewer, a wrong period fits as well."""

_OVER_BREATHS = 1.6
"""Breaths without motion after which there is none any more."""

_ENOUGH_BREATHS = 2.5
"""Breaths after which a search knows them as well as an earlier one."""

APART_M = 5e-3
"""Distance from a spot that was taken, below which another spot is the same: the person has not moved it yet."""

_Recorded = TypeVar("_Recorded", bound=RecordedStep)


class RegistrationSession:
    """A session; iterate over `steps`.

    Parameters
    ----------
    room
        Rig, images and person: a `DeviceRoom`, or a `SimulatedRoom`.
    plan
        What it is to reach.
    record
        Where its steps are recorded, and the markers of a session that is continued; None: nowhere.

    Examples
    --------
    >>> from markerseek.registration import Registered, RegistrationSession, SimulatedRoom, SimulatedRoomSettings
    >>> session = RegistrationSession(SimulatedRoom(SimulatedRoomSettings(), seed=1))
    >>> for step in session.steps():  # doctest: +SKIP
    ...     if isinstance(step, Registered):
    ...         print(step.said)
    """

    def __init__(self, room: Room, *, plan: SessionPlan | None = None, record: SessionRecord | None = None) -> None:
        self._room = room
        self._record = record
        # The same session gives the same places: only possible poses are drawn.
        self._rng = np.random.default_rng(0)
        self.view = SessionView() if record is None else record.view
        """The session after its steps so far."""
        self._plan = self.view.continue_plan(plan or SessionPlan())
        self._curve: MarkerCurve | None = None
        self._refused: tuple[str, str, int | None] | None = None
        """Name, reason and pulses of the spot that was refused last."""
        self._spots = SpotFinder(room) if record is None else SpotFinder(room, show=record.show)
        self._shown_s = -math.inf
        """When what moves was shown last, on the rig's clock."""
        self._clock: ClockOffset | None = None
        """Offset of the cameras' clock, as the searches so far show it."""
        self._watch: EndoscopeWatch | None = None
        """Compares the images of the markers; None: the endoscope is held."""
        if not (self._plan.endoscope_held or room.endoscope_held):
            self._watch = self._watch_of_markers()
        self._textureless = 0
        """How often in a row the images had no texture."""
        self._breath: TissueMoves | None = None
        """The tissue's breath, as the searches so far show it, at times of the rig's clock."""
        for marker in self.view.markers:
            if marker.scene is not None:
                self._breath = _newer_breath(self._breath, marker.scene, during_s=marker.rig_s)
        self._searches: dict[str, KeptSearch] = {}
        """Searches during which the tissue moved, by their markers."""
        self._rotations: dict[str, CameraRotation | None] = {}
        """The rotation with which each of them was answered last."""
        self._rests = False
        """Whether the tissue was watched, and did not move."""
        self._possible: Poses | None = None
        """Possible poses of the cameras; drawn after each marker."""

    def steps(self) -> Generator[Step, None, None]:
        """Run the session; if closed early, the rig stops.

        A session whose marker has moved ends at once: no registration of it holds any more.

        Raises as `markerseek.runs.Run.events`; what was taken stays recorded.
        """
        in_time = True
        if not self.view.moved:
            in_time = yield from self._markers()
            if in_time:
                yield from self._last_look()
            if self.view.registration is not None and self._plan.again:
                yield from self._again()
            if self.view.registration is not None and self._plan.check:
                in_time = yield from self._check()
        yield self._recorded(self._ended(in_time=in_time))

    def _markers(self) -> Generator[Step, None, bool]:
        """Take markers until they are enough; whether the person lit them in time."""
        if (continued := self._continued()) is not None:
            yield self._recorded(continued)
        state = self._state()
        if self.view.markers:
            yield self._recorded(state)
        while not state.done:
            waiting = Waiting(
                name=self.view.next_name,
                place=state.place,
                said=self._with_hold(asking_for(state.place)),
                dark=self._room.waits_dark,
            )
            yield self._recorded(waiting)
            taken = None
            while taken is None and not self._is_blind and self._room.ask(waiting):
                taken = yield from self._marker(waiting.name)
            if taken is None:
                return False
            yield from self._corrected()
            state = self._state()
            yield self._recorded(state)
        return True

    @property
    def _is_blind(self) -> bool:
        """Whether the images had no texture twice in a row, so that a move of the endoscope would not be seen."""
        return self._textureless >= MOST_TEXTURELESS

    def _last_look(self) -> Generator[Step, None, None]:
        """Look in the dark whether the endoscope has moved since the last marker; if so, all markers are carried."""
        if self._watch is None or not self.view.markers:
            return
        try:
            dark = self._spots.dark()
        except SpotError as problem:
            seen: SeenEndoscope | None = EndoscopeNotKnown(after=self.view.markers[-1].name, reason=str(problem))
        else:
            seen = self._less_breath(self._watch.look(dark[-1], after=self.view.markers[-1].name))
        if stands_elsewhere(self.view.markers, seen):
            yield self._recorded(self._state(seen))

    def _continued(self) -> Continued | None:
        """Return what is different from the session that is continued; None if nothing is."""
        view = self.view
        plan = self._plan
        changed = []
        if not math.isclose(view.goal_m, plan.goal_m, rel_tol=1e-9):
            changed.append(f"the goal is {1e3 * plan.goal_m:g} mm, and was {1e3 * view.goal_m:g} mm")
        if view.target_trus_m != plan.target_trus_m:
            changed.append(
                f"the target is {target_in_words(plan.target_trus_m)}, and was {target_in_words(view.target_trus_m)}"
            )
        if view.begun is None or not changed:
            return None
        return Continued(goal_m=plan.goal_m, target_trus_m=plan.target_trus_m, said="; ".join(changed))

    def _recorded(self, step: _Recorded) -> _Recorded:
        if self._record is None:
            self.view = self.view.after(step)
        else:
            self._record.add(step)
            self.view = self._record.view
        return step

    def _watch_of_markers(self) -> EndoscopeWatch:
        """Return what compares images with those of the markers so far."""
        watch = EndoscopeWatch(self._room.stereo.cameras)
        scenes = {marker.name: marker.scene for marker in self.view.markers}
        for name in dict.fromkeys(station_names(self.view.markers).values()):
            scene = scenes[name]
            pair = None if self._record is None else self._record.kept_pair(name)
            watch.begin(name, pair, end=None if scene is None else scene.end)
        return watch

    def _endoscope(self, looked: Looked) -> SeenEndoscope | None:
        """Return whether the endoscope has moved since the markers so far, or the tissue at this moment."""
        if self._watch is None or not self.view.markers:
            return None
        return self._watch.look(looked.dark[-1], after=self.view.markers[-1].name)

    def _less_breath(self, endoscope: SeenEndoscope | None) -> SeenEndoscope | None:
        """Return what one pair shows of the endoscope, less what may be the tissue's breath."""
        seen = [marker.scene.tissue for marker in self.view.markers if marker.scene and marker.scene.tissue]
        breath = self._breath or (seen[-1] if seen else None)
        if breath is not None and isinstance(endoscope, EndoscopeMotion):
            return less_breath(endoscope, breath)
        return endoscope

    def _keep(self, taken: TakenMarker, looked: Looked) -> None:
        """Keep the images of a marker if the endoscope stands where it did not stand before."""
        endoscope = taken.endoscope
        if self._watch is None or (endoscope is not None and endoscope.state == "at rest"):
            return
        self._watch.begin(taken.name, looked.dark[-1], end=None if taken.scene is None else taken.scene.end)
        if self._record is not None:
            self._record.keep_pair(taken.name, looked.dark[-1])

    def _marker(
        self, name: str, *, again: TakenMarker | None = None, check: bool = False
    ) -> Generator[Step, None, TakenMarker | None]:
        """Take a marker; None if it has to be done once more.

        ``again``: earlier marker that is measured again. ``check``: whether it takes no part in the registration.

        Where the laser fires while the session waits, that is said once as long as the reason is the same.
        """
        try:
            return (yield from self._gated(name, again, check=check))
        except SpotError as problem:
            refused = SpotRefused(
                name=name,
                reason=str(problem),
                pulses=self._room.fired,
                left_px=list(problem.places.get("left", ())),
                right_px=list(problem.places.get("right", ())),
            )
        # The same reason is not said again where the same light is seen a tenth of a pixel beside.
        said = (refused.name, refused.reason, refused.pulses)
        if self._room.waits_dark or said != self._refused:
            self._refused = said
            yield self._recorded(refused)
        return None

    def _gated(self, name: str, again: TakenMarker | None, *, check: bool) -> Generator[Step, None, TakenMarker]:
        """Take a marker; once more in the pauses of the tissue's breath if its search shows that there is one."""
        try:
            return (yield from self._taken(name, again, check=check))
        except _TissueBreathesError as found:
            yield self._recorded(SpotRefused(name=name, reason=str(found), pulses=self._room.fired))
            return (yield from self._taken(name, again, check=check))

    def _taken(self, name: str, again: TakenMarker | None, *, check: bool) -> Generator[Step, None, TakenMarker]:
        """Look for the spot, search its marker, and look again; `SpotError` if it has to be done once more."""
        clock = self._room.rig.scanner.clock
        begun_s = clock.now_s()
        begin = self._begin(name, again)
        # What the registration says of a spot must not lead the search that checks it.
        prediction = None if check else self._prediction(begin.seen)
        journal = None if self._record is None else self._record.journal_path(name)
        yield self._recorded(
            SpotSeen(
                name=name,
                spot=begin.looked.spot,
                camera_m=as_vector(begin.seen.camera_m),
                prediction=prediction,
                journal=None if journal is None else journal.name,
                pulses=self._room.fired,
                endoscope=begin.endoscope,
            )
        )
        if begin.elsewhere and begin.endoscope is not None:
            _require_no_comparison(begin.endoscope, again, check=check)
        self._room.arm()
        watch = SearchWatch(begin.texture, looked=begin.looked, spot_m=begin.seen.camera_m, stereo=self._room.stereo)
        tissue = self._tissue(watch)
        plan = plan_on(self._room.rig, self._search_plan(prediction))
        search = new_run(self._room.rig, plan, tissue=tissue)
        if journal is not None:
            configuration = structs.replace(search.configuration, frames=not self._plan.no_frames)
            search = replace(search, configuration=configuration, journal=Journal.create(journal, configuration))
        kept: list[JournalEvent] = []
        scene = yield from self._followed(begin, search, watch, tissue, kept=kept)
        result = search.result()
        if isinstance(result.estimate, Found):
            self._curve = result.estimate.curve or self._curve
        if check and len(result.candidates) != 1:
            reason = f"the search answers {result.answer}, which checks nothing: light the spot elsewhere"
            raise SpotError.at(begin.looked.spot, reason)
        self._show_motion(name, watch, least_s=0.0)
        self._require_still(begin, watch, scene)
        seen = begin.seen
        endoscope = begin.endoscope
        if scene is not None and scene.end is not None:
            seen = watch.at_end(seen, scene.end, clock=self._clock)
            endoscope = begin.endoscope_at(scene.end)
        taken = TakenMarker(
            name=name,
            spot=begin.looked.spot,
            camera_m=seen.camera_m.tolist(),
            camera_covariance_m2=seen.camera_covariance_m2.tolist(),
            camera_shared_m=seen.camera_shared_m.tolist(),
            answer=result.answer,
            reason=result.reason,
            candidates=list(result.candidates),
            acquisitions=result.acquisitions,
            rig_s=clock.now_s() - begun_s,
            prior=None
            if prediction is None
            else f"{prediction.prior.mean_deg:.1f} ± {prediction.prior.sigma_deg:.1f} deg",
            journal=None if journal is None else journal.name,
            at=datetime.now(UTC).isoformat(timespec="seconds"),
            again=None if again is None else again.name,
            check=check,
            endoscope=endoscope,
            scene=scene,
        )
        if again is None and not check:
            self._keep(taken, begin.looked)
            self._keep_search(name, search.configuration, kept, watch, scene)
        yield self._recorded(taken)
        return taken

    def _begin(self, name: str, again: TakenMarker | None) -> _Begin:
        """Look for the spot, and whether the endoscope has moved; `SpotError` if there is no new spot."""
        looked = self._look()
        seen = self._spots.seen(name, looked.spot)
        texture = scene_texture(looked.dark[-1], self._room.stereo.cameras)
        self._require_texture(texture)
        at_once = self._endoscope(looked)
        endoscope = self._less_breath(at_once)
        markers = carry(self.view.markers, now=endoscope)
        if again is None:
            _require_new(looked.spot, seen, markers.seen)
        elsewhere = stands_elsewhere(self.view.markers, endoscope)
        if elsewhere or self.view.displaced is not None:
            # What the markers say of this spot, they say in the frame of the camera as it stands now.
            self._possible = self._poses(markers.seen, self._choose(markers.seen))
        return _Begin(
            looked=looked, seen=seen, texture=texture, at_once=at_once, endoscope=endoscope, elsewhere=elsewhere
        )

    def _require_no_breath(self, name: str, watch: SearchWatch, scene: SearchScene | None) -> None:
        """Raise `_TissueBreathesError` if a search that knew of no breath has shown one for which light can wait."""
        if scene is None or scene.tissue is None or self._plan.gate == "never" or self._tissue(watch) is None:
            return
        moves = scene.tissue
        raise _TissueBreathesError(
            f"the tissue moves by ± {moves.amplitude_mm:.2f} mm: marker {name} is searched again, in the pauses of the "
            "breath"
        )

    def _require_texture(self, texture: SceneTexture | NotKnown) -> None:
        """Refuse images without texture, unless the endoscope is held."""
        if self._watch is None or isinstance(texture, SceneTexture):
            self._textureless = 0
            return
        self._textureless += 1
        raise SpotError(
            f"it would not be seen if the endoscope moved: {texture.reason}; light the tissue, focus on it, or say "
            "that the endoscope is held"
        )

    def _require_still(self, begin: _Begin, watch: SearchWatch, scene: SearchScene | None) -> None:
        """Refuse a spot that has slid during its search; where tissue or endoscope move, it moves with them.

        Tissue that breathes is taken to move, also where this search was seen in its pauses only.
        """
        breathed = self._breath is not None
        if scene is None or not (scene.moved or (scene.is_known and breathed)):
            self._spots.require_still(begin.looked, watch.later)
        elif scene.spot is not None:
            reason = f"{scene.said}: light marker {begin.seen.name} again, and hold laser and tissue still"
            raise SpotError.at(begin.looked.spot, reason)

    def _tissue(self, watch: SearchWatch) -> CameraTissue | None:
        """Return the tissue for a search; None if it was not seen to breathe."""
        breath = self._breath
        offset = self._clock or watch.clock()
        if breath is None or offset is None or not watch.follows:
            return None
        return CameraTissue(
            watch=watch,
            clock=self._room.rig.scanner.clock,
            offset=offset,
            breath=breath,
            rotation=CameraRotation.of(self._possible),
            waits=self._plan.gate != "never",
        )

    def _look(self) -> Looked:
        """Look for the spot in a pause of the tissue's breath; where it is refused, find out whether there is one."""
        if self._plan.gate == "always" and self._breath is None:
            self._watch_tissue()
        self._await_pause()
        try:
            return self._spots.look()
        except SpotError:
            if not self._watch_tissue():
                raise
        self._await_pause()
        return self._spots.look()

    def _watch_tissue(self) -> bool:
        """Watch the tissue in the dark for up to two breaths; whether it was seen to breathe.

        It is watched again only if it moved.
        """
        if self._rests or self._plan.gate == "never":
            return False
        try:
            texture = scene_texture(self._spots.dark()[-1], self._room.stereo.cameras)
        except SpotError:
            return False
        if isinstance(texture, NotKnown):
            return False
        places_m = texture.points.positions_m
        middle = int(np.argmin(np.linalg.norm(places_m - np.median(places_m, axis=0), axis=1)))
        watch = SceneWatch(texture, spot_m=places_m[middle], rng=np.random.default_rng(0))
        clock = self._room.rig.scanner.clock
        ahead_s = [-math.inf]

        def look(pair: StereoPair) -> None:
            ahead_s[0] = max(ahead_s[0], pair.at_s - clock.now_s())
            watch.look(pair)

        begun_s = clock.now_s()
        breath: TissueMoves | None = None
        with self._room.following(look):
            while clock.now_s() - begun_s < MOST_LOOK_ON_S:
                clock.wait(_LOOK_ON_S)
                tissue = watch.told().tissue
                if tissue and tissue[-1].breaths >= _WATCHED_BREATHS:
                    breath = tissue[-1]
                    break
                if not tissue and clock.now_s() - begun_s >= _GLANCE_S:
                    break
        if breath is None or breath.pause_at_s is None:
            self._rests = not watch.told().tissue
            return False
        # Without flashes, what comes last came now.
        by_s = ahead_s[0] if self._clock is None else self._clock.offset_s
        self._breath = structs.replace(
            breath,
            from_s=breath.from_s - by_s,
            until_s=breath.until_s - by_s,
            pause_at_s=breath.pause_at_s - by_s,
        )
        return True

    def _await_pause(self) -> None:
        """Wait for a pause of the tissue's breath: a spot that moves is not measured."""
        breath = self._breath
        if breath is None or breath.period_s is None:
            return
        clock = self._room.rig.scanner.clock
        until_s = clock.now_s() + 2 * breath.period_s
        # Most of the pause must be left for the look.
        while not (breath.in_pause(clock.now_s()) and breath.in_pause(clock.now_s() + 0.8 * breath.pause_s)):
            if clock.now_s() >= until_s:
                return
            clock.wait(_LOOK_ON_S / 10)

    def _await_rest(self, tissue: CameraTissue) -> None:
        """Wait in the dark until the tissue was seen at its rest, for two breaths at most."""
        clock = self._room.rig.scanner.clock
        until_s = clock.now_s() + 2 * (tissue.breath.period_s or 0.0)
        while not tissue.rest_is_known and clock.now_s() < until_s:
            clock.wait(_LOOK_ON_S / 5)

    def _searched(
        self, name: str, search: Run, watch: SearchWatch, tissue: CameraTissue | None, *, kept: list[JournalEvent]
    ) -> Generator[Step, None, None]:
        """Run a search while the cameras look on, and then until it can be told what moved.

        ``kept``: takes its events, without frames.
        """
        try:
            # Closed here, so that an interrupt also stops the stage and disarms the laser.
            with (
                self._room.following(watch.look) if watch.follows else nullcontext(),
                closing(search.events()) as events,
            ):
                if tissue is not None:
                    self._await_rest(tissue)
                for event in self._looked_on(events, watch):
                    lit = isinstance(event, Measured) and not event.sample.dark
                    if not watch.follows and (lit or isinstance(event, Swept | Finished)):
                        watch.keep(self._room.images.newest())
                    if isinstance(event, Measured) and event.sample.frame is not None:
                        watch.fire(event.sample.frame.header)
                    kept.append(with_header(event))
                    self._show_motion(name, watch)
                    yield Searching(name=name, view=search.view)
        except (KeyboardInterrupt, GeneratorExit) as stop:
            search.interrupt(str(stop) or "the user")
            raise
        finally:
            if search.journal is not None:
                search.journal.close()

    def _followed(
        self, begin: _Begin, search: Run, watch: SearchWatch, tissue: CameraTissue | None, *, kept: list[JournalEvent]
    ) -> Generator[Step, None, SearchScene | None]:
        """Run a search, and return what the cameras saw move; None if nothing was followed.

        ``kept``: as of `_searched`.

        Raises `_TissueBreathesError` if it knew of no breath and there is one, and `SpotError` if what the breath does
        to its sweeps makes them useless.
        """
        name = begin.seen.name
        begun_s = self._room.rig.scanner.clock.now_s()
        problem: AcquisitionError | None = None
        try:
            yield from self._searched(name, search, watch, tissue, kept=kept)
        except AcquisitionError as error:
            if self._room.rig.scanner.guard.state is State.FAULT:
                # A person must look at the rig.
                raise
            problem = error
        scene = self._told(watch, during_s=self._room.rig.scanner.clock.now_s() - begun_s)
        if tissue is None and (problem is not None or not search.result().candidates):
            self._require_no_breath(name, watch, scene)
        if problem is not None and tissue is None:
            raise problem
        if problem is not None:
            raise SpotError.at(begin.looked.spot, str(problem)) from problem
        return scene

    def _keep_search(
        self,
        name: str,
        configuration: Configuration,
        events: list[JournalEvent],
        watch: SearchWatch,
        scene: SearchScene | None,
    ) -> None:
        """Keep a search during which the tissue moved, to answer it again once more is known."""
        if scene is None or scene.tissue is None or self._clock is None:
            return
        tissue = CameraTissue(
            watch=SeenScene(moments=watch.moments),
            clock=self._room.rig.scanner.clock,
            offset=self._clock,
            breath=scene.tissue,
            rotation=None,
        )
        self._searches[name] = KeptSearch(configuration=configuration, events=events, tissue=tissue)

    def _corrected(self) -> Generator[Step, None, None]:
        """Answer the searches in moving tissue again, with the rotation that the markers so far tell."""
        if not self._searches:
            return
        seen = carry(self.view.markers).seen
        poses = self._poses(seen, self._choose(seen))
        rotation = CameraRotation.of(poses)
        stations = station_names(self.view.markers)
        here = stations[self.view.markers[-1].name]
        for marker in self.view.markers:
            search = self._searches.get(marker.name)
            # Where the endoscope stood elsewhere, its rotation was another one.
            if search is None or stations[marker.name] != here or not self._is_news(marker.name, rotation):
                continue
            answered = search.answered(rotation)
            if answered is not None and (answered.candidates or not marker.candidates):
                yield self._recorded(_correction(marker, answered))
            self._rotations[marker.name] = rotation

    def _is_news(self, name: str, rotation: CameraRotation | None) -> bool:
        """Whether a search was not answered again yet, or less was known of the rotation then."""
        return name not in self._rotations or _is_better(rotation, self._rotations[name])

    def _looked_on(
        self, events: Generator[JournalEvent, None, None], watch: SearchWatch
    ) -> Generator[JournalEvent, None, None]:
        """Give the events of a search, and look on after it, also where it is given up."""
        try:
            yield from events
        except AcquisitionError:
            self._look_on(watch)
            raise
        self._look_on(watch)

    def _show_motion(self, name: str, watch: SearchWatch, *, least_s: float = SHOWN_S) -> None:
        """Show what the cameras have seen move so far, if it was not shown for so many seconds."""
        now_s = self._room.rig.scanner.clock.now_s()
        if self._record is None or not watch.follows or now_s - self._shown_s < least_s:
            return
        self._shown_s = now_s
        breath = on_cameras_clock(self._breath, self._clock)
        show_motion(self._record.folder, watch.motion(name, breath=breath))

    def _told(self, watch: SearchWatch, *, during_s: float) -> SearchScene | None:
        """Return what moved during a search of so many seconds; None if nothing was followed."""
        if not watch.follows:
            return None
        shown = watch.clock()
        if shown is not None and (self._clock is None or shown.sigma_s < self._clock.sigma_s):
            self._clock = shown
        scene = watch.told(self._clock)
        self._breath = _newer_breath(self._breath, scene, during_s=during_s)
        return scene

    def _look_on(self, watch: SearchWatch) -> None:
        """Look on after a search, in the dark, until it can be told what moved."""
        clock = self._room.rig.scanner.clock
        until_s = clock.now_s() + MOST_LOOK_ON_S
        while not watch.is_settled and clock.now_s() < until_s:
            clock.wait(_LOOK_ON_S)

    def _prediction(self, seen: SeenMarker) -> Prediction | None:
        """Prediction for a spot from the markers so far; None if they allow none."""
        if not self._plan.guided or self._possible is None:
            return None
        return self._possible.predict(seen.camera_m, seen.camera_covariance_m2, limits=self._room.rig.limits.search)

    def _search_plan(self, prediction: Prediction | None) -> SearchPlan:
        near = None if prediction is None else prediction.prior
        # The next marker is searched from where this search ends, and the camera confirms.
        search = self._plan.search
        # A spot out of reach is not worth a minute: the next one is lit elsewhere.
        acquisitions = MOST_AT_REST if search.sweep and search.acquisitions is None else search.acquisitions
        return structs.replace(search, prior=self._curve, near=near, stay=True, acquisitions=acquisitions)

    def _state(self, now: SeenEndoscope | None = None) -> Registered:
        """Registration from all markers; ``now``: how the endoscope was seen to move after the last of them."""
        rig = self._room.rig
        markers = carry(self.view.markers, now=now)
        choice = self._choose(markers.seen)
        self._possible = self._poses(markers.seen, choice)
        place = None
        if self._possible is not None:
            place = self._possible.best_place(
                self._room.stereo,
                reach_of(rig),
                target_trus_m=self._plan.target_trus_m,
                probe_deg=rig.scanner.angle_deg,
                avoid_m=_missed_m(markers.seen),
            )
        return Registered(
            **structs.asdict(choice),
            place=place,
            done=(self.view.displaced is None or now is not None) and self._is_done(choice, place),
            said="; ".join(
                [
                    state_in_words(choice, place, goal_m=self._plan.goal_m),
                    *endoscope_in_words(self.view.markers, markers, now),
                ]
            ),
            lost=markers.lost,
            endoscope=now,
        )

    def _choose(self, markers: Sequence[SeenMarker]) -> Choice:
        return choose(markers, target_trus_m=self._plan.target_trus_m, spot=self._room.rig.spot)

    def _poses(self, markers: Sequence[SeenMarker], choice: Choice) -> Poses | None:
        """Return the poses of the camera that the markers allow."""
        rig = self._room.rig
        return Poses.of(markers, choice, reach_of(rig), missed_m=_missed_m(markers), spot=rig.spot, rng=self._rng)

    def _is_done(self, choice: Choice, place: Place | None) -> bool:
        """Whether the session ends: the goal is reached, or another marker would not help."""
        if choice.over or len(self.view.markers) >= MOST_MARKERS:
            return True
        if not choice.decided or choice.report is None or self.view.refutation(choice.chosen) is not None:
            return False
        used = len(choice.report.points)
        if self._plan.markers is not None:
            return used >= self._plan.markers
        if used < LEAST_MARKERS:
            return False
        return is_enough(choice.report.tre_m, place, goal_m=self._plan.goal_m)

    def _with_hold(self, said: str) -> str:
        """Add what to ask of the anaesthetist, if the ventilation is to be held."""
        return with_hold(said, self.view.markers) if self._plan.hold else said

    def _again(self) -> Generator[Step, None, None]:
        """Measure the first marker that was chosen again."""
        assert self.view.last is not None  # noqa: S101  a registration holds
        chosen = self.view.last.chosen
        first = next(marker for marker in self.view.markers if marker.name in chosen)
        place = Place(
            left_px=first.spot.left_px,
            right_px=first.spot.right_px,
            camera_m=as_vector(np.array(first.camera_m)),
            tre_m=None,
        )
        waiting = Waiting(
            name=first.name,
            place=place,
            said=self._with_hold(f"light the spot of marker {first.name} again, to see whether it has moved"),
            dark=self._room.waits_dark,
        )
        yield self._recorded(waiting)
        if not self._room.ask(waiting):
            return
        taken = yield from self._marker(f"{first.name}-again", again=first)
        if taken is not None and stands_elsewhere(self.view.markers, taken.endoscope):
            yield self._recorded(self._state(taken.endoscope))
        if taken is not None and taken.candidates:
            markers = carry(self.view.markers, now=taken.endoscope).seen
            yield self._recorded(marker_movement(first, taken, markers, chosen=chosen, spot=self._room.rig.spot))

    def _check(self) -> Generator[Step, None, bool]:
        """Compare the registration with one more spot; whether the person lit it in time."""
        assert self.view.last is not None  # noqa: S101  a registration holds
        chosen = self.view.last.chosen
        name = f"check-{1 + len(self.view.checks)}"
        place = None
        if self._possible is not None:
            place = self._possible.check_place(self._room.stereo, reach_of(self._room.rig))
        waiting = Waiting(
            name=name,
            place=place,
            said=self._with_hold(f"{asking_for(place)}; it takes no part in the registration, and checks it"),
            dark=self._room.waits_dark,
        )
        yield self._recorded(waiting)
        taken = None
        while taken is None and self.view.displaced is None and self._room.ask(waiting):
            taken = yield from self._marker(name, check=True)
        if taken is None:
            return self.view.displaced is not None
        pairs = chosen_pairs(carry(self.view.markers).seen, chosen)
        check = check_spot(taken.seen.pair(0), pairs, spot=self._room.rig.spot)
        yield self._recorded(SpotChecked(check=check, chosen=chosen))
        return True

    def _ended(self, *, in_time: bool) -> Ended:
        late = "" if in_time else "no new spot was accepted in the time allowed; "
        if self._is_blind and self._refused is not None:
            _, reason, _ = self._refused
            late = f"{reason}; "
        took = f"{counted(len(self.view.markers), 'marker')} in {self.view.rig_s:.0f} s of the rig"
        registered = self.view.registration is not None
        go_on = f"; {GO_ON}" if self._plan.hold else ""
        return Ended(registered=registered, said=f"{late}{self.view.said}; {took}{go_on}", rig_s=self.view.rig_s)


_BETTER = 0.7
_TURNED_RAD = 0.01
"""Standard deviation of a rotation over that of the former one, and angle from it, with which a search is answered
again."""


def _is_better(rotation: CameraRotation | None, former: CameraRotation | None) -> bool:
    """Whether more is known of a rotation than when a search was answered last."""
    if rotation is None or former is None:
        return rotation is not former
    turned = Rotation.from_matrix(rotation.matrix @ former.matrix.T).magnitude()
    return rotation.sigma_rad < _BETTER * former.sigma_rad or float(turned) > _TURNED_RAD


def _correction(marker: TakenMarker, answered: Answered) -> CorrectedMarker:
    """Return the step by which a marker gets another answer."""
    name = answer_name(answered.estimate)
    candidates = list(answered.candidates)
    moved = ""
    if candidates and marker.candidates:
        way_m = np.subtract(candidates[0].position.position_m, marker.candidates[0].position.position_m)
        moved = f", {1e3 * float(np.linalg.norm(way_m)):.2f} mm from before"
    where = f" at {candidates[0].angle_deg:.2f} deg" if candidates else ""
    return CorrectedMarker(
        name=marker.name,
        answer=name,
        reason=answer_reason(answered.estimate),
        candidates=candidates,
        said=f"marker {marker.name} again, with the tissue's motion taken out: {name}{where}{moved}",
    )


def _newer_breath(breath: TissueMoves | None, scene: SearchScene, *, during_s: float) -> TissueMoves | None:
    """Return the breath after a search: the one that was known, another one, or none.

    A search that saw a part of a breath does not replace what is known; one that saw none for longer than a breath ends
    it.
    """
    tissue = scene.tissue
    if not scene.is_known:
        return breath
    if tissue is None:
        over = breath is not None and during_s > _OVER_BREATHS * (breath.period_s or math.inf)
        return None if over else breath
    if tissue.period_s is None or scene.clock is None:
        return breath
    return tissue if breath is None or tissue.breaths >= min(breath.breaths, _ENOUGH_BREATHS) else breath


class _TissueBreathesError(Exception):
    """A search that waited for no pause has shown that the tissue breathes."""


def is_enough(tre_m: float, place: Place | None, *, goal_m: float) -> bool:
    """Return whether an expected error reaches the goal, or another marker at a place would not help.

    ``place``: None: there is none in reach.
    """
    better_m = tre_m if place is None or place.tre_m is None else place.tre_m
    return tre_m <= goal_m or better_m > (1 - _WORTH) * tre_m


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Begin:
    """What the cameras saw before a search."""

    looked: Looked
    seen: SeenMarker
    texture: SceneTexture | NotKnown
    """What can be followed of the scene."""
    at_once: SeenEndoscope | None
    """Motion of the scene since the markers before, of which the tissue's breath may be a part."""
    endoscope: SeenEndoscope | None
    """The same without what may be the breath."""
    elsewhere: bool
    """Whether the endoscope has moved since the last marker, or may have."""

    def endoscope_at(self, end: SceneMove) -> SeenEndoscope | None:
        """Return whether the endoscope has moved by the end of the search."""
        return self.at_once.until(end) if isinstance(self.at_once, EndoscopeMotion) else self.at_once


def _require_no_comparison(endoscope: SeenEndoscope, again: TakenMarker | None, *, check: bool) -> None:
    """Refuse to compare a marker with what was measured where the endoscope stood before."""
    if again is not None and isinstance(endoscope, EndoscopeNotKnown):
        raise SpotError(f"{endoscope.said}, so that marker {again.name} cannot be compared with where it was")
    if check:
        raise SpotError(f"{endoscope.said}, so that there is no registration to be checked: light one more marker")


def _require_new(spot: Spot, seen: SeenMarker, markers: Sequence[SeenMarker]) -> None:
    """Refuse a spot whose marker was taken before."""
    for marker in markers:
        if marker.candidates and np.linalg.norm(marker.camera_m - seen.camera_m) < APART_M:
            reason = f"this is the spot of marker {marker.name}: move it by more than {1e3 * APART_M:g} mm"
            raise SpotError.at(spot, reason)


def _missed_m(markers: Sequence[SeenMarker]) -> list[Float64[np.ndarray, " 3"]]:
    """Return the spots whose markers were not found."""
    return [marker.camera_m for marker in markers if not marker.candidates]
