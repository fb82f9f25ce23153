"""What a registration session is to reach, as a person chooses it: on the command line, on the page, in Python."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import msgspec

from markerseek.core import ConfigError, Help, SearchPlan, is_finite, is_whole, require_range

REGISTRATION_TOLERANCE_MM = 0.3
"""Tolerance of searches for a registration: with the usual 1 mm markers are twice as far off along the turn, for two
acquisitions less each. A search that does not reach it counts by its sigma."""

MOST_MARKERS = 12
"""Markers after which a session ends in any case."""

USUAL_TRE_MM = 1.0
"""Expected error at the target at which a session ends, in mm, where nobody names one: what four to six good markers
reach."""


Gate: TypeAlias = Literal["found", "always", "never"]
"""Whether light waits for the pauses of the tissue's breath: where cameras find a breath; also for the first marker,
before which they watch the tissue; or not at all."""


class SessionPlan(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of a session.

    The fields with `Help` are what a person chooses.

    Raises
    ------
    ConfigError
        If a number cannot be used.
    """

    sweep: Annotated[bool, Help("Search each marker by sweeps: an answer in seconds.")] = False
    tre_mm: Annotated[
        float | None,
        Help(
            "Expected error at the target at which the session ends, in mm.",
            shown="1, or that of the session that is continued",
        ),
    ] = None
    markers: Annotated[
        int | None,
        Help(
            "Number of markers after which the session ends, whatever the error: 3 to 12.", shown="as many as it takes"
        ),
    ] = None
    again: Annotated[bool, Help("Measure the first marker again at the end, to see whether it has moved.")] = False
    check: Annotated[
        bool,
        Help(
            "At the end, light one more spot that takes no part in the registration: the error at it, beside the one "
            "that was expected there."
        ),
    ] = False
    wait_s: Annotated[float, Help("Longest wait for a spot, in seconds.")] = 300.0
    idle_s: Annotated[
        float | None,
        Help(
            "Time in the dark after which the session looks for a spot although nobody has said that it is set, "
            "in seconds.",
            shown="never",
        ),
    ] = None
    light_while_waiting: Annotated[
        bool,
        Help(
            "Fire once a second while the session waits, until the cameras see a spot, instead of waiting in the "
            "dark until somebody says that the spot is set."
        ),
    ] = False
    hold: Annotated[
        bool,
        Help(
            "Ask to hold the ventilation while each marker is taken, count the seconds, and say when to go on: for "
            "tissue that moves."
        ),
    ] = False
    gate: Annotated[
        Gate,
        Help(
            "Whether light waits for the pauses of the tissue's breath: found, once the cameras have seen a breath; "
            "always, also for the first marker, before which they watch the tissue for some 8 s; never."
        ),
    ] = "found"
    no_frames: Annotated[
        bool,
        Help(
            "Keep the samples of each search only, without the receiver's frames, of which a marker has some 50 "
            "MB: its answer can then not be computed again from its frames."
        ),
    ] = False

    endoscope_held: Annotated[
        bool,
        Help("The endoscope is held so that it cannot move: its images are not compared from marker to marker."),
    ] = False

    target_trus_m: tuple[float, float, float] | None = None
    """Point of the expected error, in the TRUS frame; None: 20 mm under the middle of the points, or that of the
    session that is continued."""
    tolerance_mm: float = REGISTRATION_TOLERANCE_MM
    """Tolerance of the search of a marker."""
    guided: bool = True
    """Whether the markers so far guide the search of the next one."""

    def __post_init__(self) -> None:
        if self.tre_mm is not None:
            require_range("tre_mm", self.tre_mm, low=0.01, high=20, unit="mm")
        if self.markers is not None and not (is_whole(self.markers) and 3 <= self.markers <= MOST_MARKERS):
            raise ConfigError(f"markers is {self.markers}, it must be a whole number from 3 to {MOST_MARKERS}")
        require_range("wait_s", self.wait_s, low=1, high=3600, unit="s")
        if self.idle_s is not None:
            require_range("idle_s", self.idle_s, low=1, high=3600, unit="s")
        if self.idle_s is not None and self.light_while_waiting:
            raise ConfigError(
                f"idle_s is {self.idle_s:g} s, a time in the dark; with light while it waits there is none"
            )
        require_target(self.target_trus_m)

    @property
    def goal_m(self) -> float:
        """Expected TRE at which the session ends, in metres."""
        return (USUAL_TRE_MM if self.tre_mm is None else self.tre_mm) / 1e3

    @property
    def search(self) -> SearchPlan:
        """How a marker is searched."""
        return SearchPlan(tolerance_mm=self.tolerance_mm, sweep=self.sweep)


def require_target(target_trus_m: tuple[float, float, float] | None) -> None:
    """Refuse a target that is no place; None is the usual one."""
    if target_trus_m is not None and not all(is_finite(each) for each in target_trus_m):
        given = " ".join(f"{1e3 * each:g}" for each in target_trus_m)
        raise ConfigError(f"`target_mm` is {given}, its coordinates must be finite")
