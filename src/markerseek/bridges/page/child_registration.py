"""A registration session that runs as a child: its steps, its camera images, and the search that goes on in it."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from markerseek.bridges.asked import AskedRegistration
from markerseek.bridges.child import ChildRun
from markerseek.bridges.page.child_search import ChildSearch, Launch
from markerseek.bridges.page.registration_state import RegistrationState
from markerseek.records.journal import follow
from markerseek.registration import CAMERA_IMAGES, SpotSeen, follow_session


class ChildRegistration(ChildSearch[AskedRegistration]):
    """One session, followed by a thread of its own until it ends; `run` is the search that goes on, or the last one.

    ``folder``: folder of its record; a new one, but for a session that is ``continued``.
    """

    def __init__(
        self,
        launch: Launch,
        arguments: Sequence[str],
        *,
        asked: AskedRegistration,
        folder: Path,
        continued: bool = False,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        self.arguments = tuple(arguments)
        self.goes_on = f"markerseek {shlex.join(arguments)} --continue {shlex.quote(str(folder))}"
        """The command that goes on with it in a terminal."""
        self.state = RegistrationState()
        """What its steps say together."""
        self.images_ns = 0
        """When the newest camera images were written; 0 before the first."""
        option = f"--continue={folder}" if continued else f"--record={folder}"
        super().__init__(launch, [*arguments, option], asked=asked, journal=folder, on_change=on_change)

    PICTURES = False

    @property
    def can_go_on(self) -> bool:
        """Whether it was broken off after its beginning."""
        return self.status == "ended" and self._has_begun and self.state.ended is None

    @property
    def _has_begun(self) -> bool:
        return self.state.begun is not None

    def _take(self, child: ChildRun) -> None:
        assert self.journal is not None  # noqa: S101  the folder
        folder = self.journal
        for step in child.beating(follow_session(folder, is_over=lambda: not child.running, wait=child.wait)):
            with suppress(FileNotFoundError):
                # The right one is the last to be written.
                self.images_ns = (folder / CAMERA_IMAGES[1]).stat().st_mtime_ns
            self.state = self.state.add(step)
            self._on_change()
            if isinstance(step, SpotSeen) and step.journal is not None:
                self.run = None
                search = follow(folder / step.journal, is_over=lambda: self._is_searched(child), wait=child.wait)
                self._add(child.beating(search))

    def _is_searched(self, child: ChildRun) -> bool:
        return not child.running or (self.run is not None and self.run.last.over)
