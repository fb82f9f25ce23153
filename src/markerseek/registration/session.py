"""A registration as one session: from the first spot to a transform, with the next place and an end.

For each marker: both cameras look for the laser spot, what the markers so far say of it guides its search, the cameras
look again whether it has stood still, and all markers together give the transform, or say what is missing.

What it knows of the tissue's breath is in `known_breath`, what it sees of its endoscope in `session_endoscope`, and the
search of one marker under the cameras' eyes in `watched_search`.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from typing import TypeVar

import numpy as np
from msgspec import structs

from markerseek.core import Float64, Found, MarkerCurve, SearchPlan, as_vector, counted
from markerseek.records.journal import Journal
from markerseek.registration.answered_again import KeptSearch, KeptSearches
from markerseek.registration.camera_tissue import CameraRotation
from markerseek.registration.choice import Choice, SeenMarker, choose, chosen_pairs
from markerseek.registration.endoscope_motion import EndoscopeMotion, EndoscopeNotKnown, EndoscopeWatch, SeenEndoscope
from markerseek.registration.known_breath import KnownBreath
from markerseek.registration.marker_movement import marker_movement
from markerseek.registration.plan import MOST_MARKERS, SessionPlan
from markerseek.registration.poses import Place, Poses, Prediction, reach_of
from markerseek.registration.record import SessionRecord
from markerseek.registration.room import SHOWN_S, Room
from markerseek.registration.search_scene import SearchScene
from markerseek.registration.search_watch import SearchWatch
from markerseek.registration.session_endoscope import SessionEndoscope, require_no_comparison
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
from markerseek.registration.stations import carry, stands_elsewhere
from markerseek.registration.steps import (
    Continued,
    Ended,
    RecordedStep,
    Registered,
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
from markerseek.registration.watched_search import TissueBreathesError, WatchedSearch
from markerseek.runs import new_run, plan_on
from markerseek.vision import NotKnown, SceneMove, SceneTexture, scene_texture

LEAST_MARKERS = 4
"""Markers before which a session does not end by itself: three cannot show that one is wrong."""

_WORTH = 0.05
"""Share of the expected TRE by which another marker must lower it, or a session above its goal ends: a marker takes
some 20 s with its spot, and who has named a goal wants to reach it."""

MOST_AT_REST = 6
"""Most acquisitions at rest of a search by sweeps that has detected nothing."""

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
        held = self._plan.endoscope_held or room.endoscope_held
        self._endoscope = SessionEndoscope(
            None if held else EndoscopeWatch(room.stereo.cameras), record=record, markers=self.view.markers
        )
        self._breath = KnownBreath(room, gate=self._plan.gate, markers=self.view.markers)
        self._searches = KeptSearches()
        """Searches during which the tissue moved, to answer them again once more is known."""
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
            while taken is None and not self._endoscope.is_blind and self._room.ask(waiting):
                taken = yield from self._marker(waiting.name)
            if taken is None:
                return False
            yield from self._corrected()
            state = self._state()
            yield self._recorded(state)
        return True

    def _last_look(self) -> Generator[Step, None, None]:
        """Look in the dark whether the endoscope has moved since the last marker; if so, all markers are carried."""
        markers = self.view.markers
        if self._endoscope.is_held or not markers:
            return
        try:
            dark = self._spots.dark()
        except SpotError as problem:
            seen: SeenEndoscope | None = EndoscopeNotKnown(after=markers[-1].name, reason=str(problem))
        else:
            seen = self._breath.taken_out_of(self._endoscope.look(dark[-1], markers), markers)
        if stands_elsewhere(markers, seen):
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
        except TissueBreathesError as found:
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
            require_no_comparison(begin.endoscope, again, check=check)
        self._room.arm()
        watch = SearchWatch(begin.texture, looked=begin.looked, spot_m=begin.seen.camera_m, stereo=self._room.stereo)
        tissue = self._breath.tissue(watch, rotation=CameraRotation.of(self._possible))
        run = new_run(self._room.rig, plan_on(self._room.rig, self._search_plan(prediction)), tissue=tissue)
        if journal is not None:
            configuration = structs.replace(run.configuration, frames=not self._plan.no_frames)
            run = replace(run, configuration=configuration, journal=Journal.create(journal, configuration))
        search = WatchedSearch(
            run,
            room=self._room,
            name=name,
            spot=begin.looked.spot,
            watch=watch,
            tissue=tissue,
            breath=self._breath,
            show=partial(self._show_motion, name, watch),
        )
        scene = yield from search.steps()
        result = run.result()
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
            seen = watch.at_end(seen, scene.end, clock=self._breath.offset)
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
            self._endoscope.keep(taken, begin.looked.dark[-1])
            moving = self._breath.seen(watch, scene)
            if moving is not None:
                kept = KeptSearch(configuration=run.configuration, events=search.events, tissue=moving)
                self._searches.keep(name, kept)
        yield self._recorded(taken)
        return taken

    def _begin(self, name: str, again: TakenMarker | None) -> _Begin:
        """Look for the spot, and whether the endoscope has moved; `SpotError` if there is no new spot."""
        looked = self._breath.look(self._spots)
        seen = self._spots.seen(name, looked.spot)
        texture = scene_texture(looked.dark[-1], self._room.stereo.cameras)
        self._endoscope.require_texture(texture)
        at_once = self._endoscope.look(looked.dark[-1], self.view.markers)
        endoscope = self._breath.taken_out_of(at_once, self.view.markers)
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

    def _require_still(self, begin: _Begin, watch: SearchWatch, scene: SearchScene | None) -> None:
        """Refuse a spot that has slid during its search; where tissue or endoscope move, it moves with them.

        Tissue that breathes is taken to move, also where this search was seen in its pauses only.
        """
        breathes = self._breath.moves is not None
        if scene is None or not (scene.moved or (scene.is_known and breathes)):
            self._spots.require_still(begin.looked, watch.later)
        elif scene.spot is not None:
            reason = f"{scene.said}: light marker {begin.seen.name} again, and hold laser and tissue still"
            raise SpotError.at(begin.looked.spot, reason)

    def _corrected(self) -> Generator[Step, None, None]:
        """Answer the searches in moving tissue again, with the rotation that the markers so far tell."""
        if self._searches.is_empty:
            return
        seen = carry(self.view.markers).seen
        poses = self._poses(seen, self._choose(seen))
        for step in self._searches.corrected(self.view.markers, CameraRotation.of(poses)):
            yield self._recorded(step)

    def _show_motion(self, name: str, watch: SearchWatch, *, least_s: float = SHOWN_S) -> None:
        """Show what the cameras have seen move so far, if it was not shown for so many seconds."""
        now_s = self._room.rig.scanner.clock.now_s()
        if self._record is None or not watch.follows or now_s - self._shown_s < least_s:
            return
        self._shown_s = now_s
        breath = on_cameras_clock(self._breath.moves, self._breath.offset)
        show_motion(self._record.folder, watch.motion(name, breath=breath))

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
        if self._endoscope.is_blind and self._refused is not None:
            _, reason, _ = self._refused
            late = f"{reason}; "
        took = f"{counted(len(self.view.markers), 'marker')} in {self.view.rig_s:.0f} s of the rig"
        registered = self.view.registration is not None
        go_on = f"; {GO_ON}" if self._plan.hold else ""
        return Ended(registered=registered, said=f"{late}{self.view.said}; {took}{go_on}", rig_s=self.view.rig_s)


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


def _require_new(spot: Spot, seen: SeenMarker, markers: Sequence[SeenMarker]) -> None:
    """Refuse a spot whose marker was taken before."""
    for marker in markers:
        if marker.candidates and np.linalg.norm(marker.camera_m - seen.camera_m) < APART_M:
            reason = f"this is the spot of marker {marker.name}: move it by more than {1e3 * APART_M:g} mm"
            raise SpotError.at(spot, reason)


def _missed_m(markers: Sequence[SeenMarker]) -> list[Float64[np.ndarray, " 3"]]:
    """Return the spots whose markers were not found."""
    return [marker.camera_m for marker in markers if not marker.candidates]
