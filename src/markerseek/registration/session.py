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

from markerseek.core import (
    Finished,
    Float64,
    Found,
    MarkerCurve,
    Measured,
    SearchPlan,
    Swept,
    as_vector,
    counted,
)
from markerseek.records.journal import Journal
from markerseek.registration.camera_tissue import CameraRotation, CameraTissue
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
from markerseek.registration.room import Room
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
from markerseek.runs import Run, new_run, plan_on
from markerseek.vision import ClockOffset, NotKnown, SceneMove, SceneTexture, scene_texture

LEAST_MARKERS = 4
"""Markers before which a session does not end by itself: three cannot show that one is wrong."""

_WORTH = 0.1
"""Share of the expected TRE by which another marker must lower it, or the session ends."""

MOST_AT_REST = 6
"""Most acquisitions at rest of a search by sweeps that has detected nothing."""

MOST_TEXTURELESS = 2
"""How often in a row images without texture are accepted where somebody may move the endoscope."""

MOST_LOOK_ON_S = 13.0
"""Longest time after a search in which the cameras look on: one and a half of the longest breaths."""

_LOOK_ON_S = 0.5

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
        self._clock: ClockOffset | None = None
        """Offset of the cameras' clock, as the searches so far show it."""
        self._watch: EndoscopeWatch | None = None
        """Compares the images of the markers; None: the endoscope is held."""
        if not (self._plan.endoscope_held or room.endoscope_held):
            self._watch = self._watch_of_markers()
        self._textureless = 0
        """How often in a row the images had no texture."""
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
        breaths = [marker.scene.tissue for marker in self.view.markers if marker.scene and marker.scene.tissue]
        if breaths and isinstance(endoscope, EndoscopeMotion):
            return less_breath(endoscope, breaths[-1])
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
            return (yield from self._taken(name, again, check=check))
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
        yield from self._searched(name, search, watch, tissue)
        result = search.result()
        if isinstance(result.estimate, Found):
            self._curve = result.estimate.curve or self._curve
        if check and len(result.candidates) != 1:
            reason = f"the search answers {result.answer}, which checks nothing: light the spot elsewhere"
            raise SpotError.at(begin.looked.spot, reason)
        scene = self._told(watch)
        self._require_still(begin, watch, scene)
        seen = begin.seen
        endoscope = begin.endoscope
        if scene is not None and scene.end is not None:
            seen = watch.at_end(seen, scene.end)
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
        yield self._recorded(taken)
        return taken

    def _begin(self, name: str, again: TakenMarker | None) -> _Begin:
        """Look for the spot, and whether the endoscope has moved; `SpotError` if there is no new spot."""
        self._await_pause()
        looked = self._spots.look()
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

        Tissue that breathed during the last search is taken to move, also where this one was seen in its pauses only.
        """
        last = self._last_scene
        breathed = last is not None and last.tissue is not None
        if scene is None or not (scene.moved or (scene.is_known and breathed)):
            self._spots.require_still(begin.looked, watch.later)
        elif scene.spot is not None:
            reason = f"{scene.said}: light marker {begin.seen.name} again, and hold laser and tissue still"
            raise SpotError.at(begin.looked.spot, reason)

    def _tissue(self, watch: SearchWatch) -> CameraTissue | None:
        """Return the tissue for a search; None if it was not seen to breathe during the last one."""
        scene = self._last_scene
        if scene is None or scene.tissue is None or scene.tissue.period_s is None or self._clock is None:
            return None
        if not watch.follows or scene.clock is None:
            return None
        return CameraTissue(
            watch=watch,
            clock=self._room.rig.scanner.clock,
            offset=self._clock,
            breath=scene.tissue,
            rotation=CameraRotation.of(self._possible),
        )

    @property
    def _last_scene(self) -> SearchScene | None:
        """What the cameras saw during the last search; None: nothing was followed."""
        return self.view.markers[-1].scene if self.view.markers else None

    def _await_pause(self) -> None:
        """Wait for a pause of the tissue's breath, as the last search showed it: a spot that moves is not measured."""
        scene = self._last_scene
        if scene is None or scene.clock is None or scene.tissue is None or scene.tissue.period_s is None:
            return
        breath = scene.tissue
        clock = self._room.rig.scanner.clock
        until_s = clock.now_s() + 2 * scene.tissue.period_s
        # Most of the pause must be left for the look.
        while not (breath.in_pause(clock.now_s()) and breath.in_pause(clock.now_s() + 0.8 * breath.pause_s)):
            if clock.now_s() >= until_s:
                return
            clock.wait(_LOOK_ON_S / 10)

    def _await_rest(self, tissue: CameraTissue) -> None:
        """Wait in the dark until the tissue was seen at its rest, for two breaths at most."""
        clock = self._room.rig.scanner.clock
        until_s = clock.now_s() + 2 * (tissue.breath_s or 0.0)
        while not tissue.rest_is_known and clock.now_s() < until_s:
            clock.wait(_LOOK_ON_S / 5)

    def _searched(
        self, name: str, search: Run, watch: SearchWatch, tissue: CameraTissue | None
    ) -> Generator[Step, None, None]:
        """Run a search while the cameras look on, and then until it can be told what moved."""
        try:
            # Closed here, so that an interrupt also stops the stage and disarms the laser.
            with (
                self._room.following(watch.look) if watch.follows else nullcontext(),
                closing(search.events()) as events,
            ):
                if tissue is not None:
                    self._await_rest(tissue)
                for event in events:
                    lit = isinstance(event, Measured) and not event.sample.dark
                    if not watch.follows and (lit or isinstance(event, Swept | Finished)):
                        watch.keep(self._room.images.newest())
                    if isinstance(event, Measured) and event.sample.frame is not None:
                        watch.fire(event.sample.frame.header)
                    yield Searching(name=name, view=search.view)
                self._look_on(watch)
        except (KeyboardInterrupt, GeneratorExit) as stop:
            search.interrupt(str(stop) or "the user")
            raise
        finally:
            if search.journal is not None:
                search.journal.close()

    def _told(self, watch: SearchWatch) -> SearchScene | None:
        """Return what moved during a search; None if nothing was followed."""
        if not watch.follows:
            return None
        shown = watch.clock()
        if shown is not None and (self._clock is None or shown.sigma_s < self._clock.sigma_s):
            self._clock = shown
        return watch.told(self._clock)

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
        better_m = choice.report.tre_m if place is None or place.tre_m is None else place.tre_m
        return choice.report.tre_m <= self._plan.goal_m or better_m > (1 - _WORTH) * choice.report.tre_m

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
