"""The search of one marker while the cameras look on, and what they saw move meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import closing, nullcontext

from markerseek.core import AcquisitionError, Finished, Measured, Swept
from markerseek.guard import State
from markerseek.records.journal import JournalEvent
from markerseek.registration.answered_again import with_header
from markerseek.registration.camera_tissue import CameraTissue
from markerseek.registration.known_breath import MOST_LOOK_ON_S, KnownBreath
from markerseek.registration.room import Room
from markerseek.registration.search_scene import SearchScene
from markerseek.registration.search_watch import SearchWatch
from markerseek.registration.spots import SpotError
from markerseek.registration.steps import Searching, Spot
from markerseek.runs import Run

_LOOK_ON_S = 0.5
"""Time between two questions whether it can be told what moved."""

_REST_POLL_S = 0.1
"""Time between two questions whether the tissue was seen at its rest."""


class TissueBreathesError(Exception):
    """A search that waited for no pause has shown that the tissue breathes."""


class WatchedSearch:
    """A search of a marker, and what watches the scene meanwhile; run it by iterating over `steps`.

    Parameters
    ----------
    run
        The search.
    room
        Where it takes place.
    name, spot
        Marker, and its spot before the search.
    watch
        Follows the scene.
    tissue
        The tissue for whose pauses the search waits; None: it was not seen to breathe.
    breath
        What the session knows of the breath; it learns from this search.
    show
        Called after each event, for those who look on.
    """

    def __init__(
        self,
        run: Run,
        *,
        room: Room,
        name: str,
        spot: Spot,
        watch: SearchWatch,
        tissue: CameraTissue | None,
        breath: KnownBreath,
        show: Callable[[], None],
    ) -> None:
        self._run = run
        self._room = room
        self._clock = room.rig.scanner.clock
        self._name = name
        self._spot = spot
        self._watch = watch
        self._tissue = tissue
        self._breath = breath
        self._show = show
        self.events: list[JournalEvent] = []
        """Those so far, whose samples have the headers of their frames alone."""

    def steps(self) -> Generator[Searching, None, SearchScene | None]:
        """Run the search, and return what the cameras saw move; None if nothing was followed.

        Raises `TissueBreathesError` if it knew of no breath and there is one, and `SpotError` if what the breath does
        to its sweeps makes them useless.
        """
        begun_s = self._clock.now_s()
        problem: AcquisitionError | None = None
        try:
            yield from self._searched()
        except AcquisitionError as error:
            if self._room.rig.scanner.guard.state is State.FAULT:
                # A person must look at the rig.
                raise
            problem = error
        scene = self._breath.learn(self._watch, during_s=self._clock.now_s() - begun_s)
        if self._tissue is None:
            if problem is not None or not self._run.result().candidates:
                self._require_no_breath(scene)
            if problem is not None:
                raise problem
        elif problem is not None:
            raise SpotError.at(self._spot, str(problem)) from problem
        return scene

    def _searched(self) -> Generator[Searching, None, None]:
        """Run the search while the cameras look on, and then until it can be told what moved."""
        watch = self._watch
        try:
            # Closed here, so that an interrupt also stops the stage and disarms the laser.
            with (
                self._room.following(watch.look) if watch.follows else nullcontext(),
                closing(self._run.events()) as events,
            ):
                self._await_rest()
                for event in self._looked_on(events):
                    lit = isinstance(event, Measured) and not event.sample.dark
                    if not watch.follows and (lit or isinstance(event, Swept | Finished)):
                        watch.keep(self._room.images.newest())
                    if isinstance(event, Measured) and event.sample.frame is not None:
                        watch.fire(event.sample.frame.header)
                    self.events.append(with_header(event))
                    self._show()
                    yield Searching(name=self._name, view=self._run.view)
        except (KeyboardInterrupt, GeneratorExit) as stop:
            self._run.interrupt(str(stop) or "the user")
            raise
        finally:
            if self._run.journal is not None:
                self._run.journal.close()

    def _await_rest(self) -> None:
        """Wait in the dark until tissue that breathes was seen at its rest, for two breaths at most."""
        tissue = self._tissue
        if tissue is None:
            return
        until_s = self._clock.now_s() + 2 * (tissue.breath.period_s or 0.0)
        while not tissue.rest_is_known and self._clock.now_s() < until_s:
            self._clock.wait(_REST_POLL_S)

    def _looked_on(self, events: Generator[JournalEvent, None, None]) -> Generator[JournalEvent, None, None]:
        """Yield the events of the search, and then watch the scene, also after a search that was given up."""
        try:
            yield from events
        except AcquisitionError:
            self._look_on()
            raise
        self._look_on()

    def _look_on(self) -> None:
        """Look on after the search, in the dark, until it can be told what moved."""
        until_s = self._clock.now_s() + MOST_LOOK_ON_S
        while not self._watch.is_settled and self._clock.now_s() < until_s:
            self._clock.wait(_LOOK_ON_S)

    def _require_no_breath(self, scene: SearchScene | None) -> None:
        """Raise `TissueBreathesError` if a search that knew of no breath has shown one for which light can wait."""
        if scene is None or scene.tissue is None or not self._breath.waits:
            return
        if self._breath.tissue(self._watch, rotation=None) is None:
            return
        raise TissueBreathesError(
            f"the tissue moves by ± {scene.tissue.amplitude_mm:.2f} mm: marker {self._name} is searched again, in the "
            "pauses of the breath"
        )
