"""Follows a target with the probe: looks or listens for it, turns where it must, and says how it stands.

The loop of `Follower.steps` is for a tip, a point or a spot; `FollowMachine` decides, the guard permits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import replace

import msgspec
import numpy as np

from markerseek.core import (
    AcquisitionError,
    ConfigError,
    DeviceError,
    FollowPermit,
    Sample,
)
from markerseek.following.aim import Aim, HeldRegistration, ProbeReach
from markerseek.following.confirmation import ASIDE_DEG, NotConfirmed, compare, confirm
from markerseek.following.endoscope_check import GoingOn
from markerseek.following.machine import STEP_DEG, Decision, FollowMachine
from markerseek.following.plan import FollowPlan
from markerseek.following.target import ErrorLinks, LitSource, Look, Target, TargetSource
from markerseek.following.words import BY_A_PERSON, BY_ITSELF, Word
from markerseek.registration import EndoscopeMotion, SeenEndoscope
from markerseek.rigs import Rig
from markerseek.scan import Scanner

TICK_S = 0.05
"""Time from one look at a target to the next, in seconds, where no light is needed."""

WATCH_S = 0.5
"""Time from one look at the endoscope's own motion to the next, in seconds."""

ASKED_S = 3.0
"""Time for which it looks for a spot after the person has said that it is set, in seconds."""

BETWEEN_S = 1.0
"""Time between two looks for a spot that is not there, in seconds, where light is allowed meanwhile."""

STILL_M = 1e-3
"""Most that a spot may move while a registration is confirmed by it."""

TWICE = 2
"""Frames in a row that must speak against the registration, and looks that must not show the endoscope's motion."""


class FollowStep(msgspec.Struct, frozen=True, kw_only=True, tag="follow"):
    """How it stands at a time."""

    at_s: float
    """On the rig's clock."""
    word: Word
    said: str
    """The state in a sentence."""
    probe_deg: float
    target_deg: float | None
    """Angle at which the probe sees the target; None: it was not seen yet."""
    sigma_deg: float | None
    """Standard deviation of that angle."""
    within_deg: float
    """Range inside which the probe does not turn."""
    turning: bool
    davinci_to_trus: list[list[float]] | None
    """The registration as it is carried along; None: it does not hold."""
    tre_m: float | None
    """Its expected error."""
    confirmed: str = ""
    """What the last comparison of the probe's image with the registration said."""
    target_camera_m: list[float] | None = None
    """The target in the frame of the left camera as it stands now; None: as of ``target_deg``."""
    refused: str = ""
    """Why the place that a person has named last is not followed; empty if it is."""
    counted: tuple[str, ...] = ()
    not_counted: tuple[str, ...] = ()
    """``counted``, ``not_counted``: errors that ``sigma_deg`` holds beside that of the registration, and those that it
    does not hold."""


class Follower:
    """Follows one target; iterate over `steps`.

    Parameters
    ----------
    rig
        The rig, armed.
    registration
        Of the camera to the probe; it is carried along, and confirmed.
    source
        Where the target is: a `TargetSource`, or a `LitSource`, which needs light.
    plan
        Settings.
    by
        Who permits it.
    reach
        What the probe can see; None: its search range, whatever the depth.
    endoscope
        Looks whether the endoscope has moved since the registration, also while the probe turns: it must not take long
        then, and says "going on" until it knows; None: the endoscope is held.
    is_set
        Whether the person has said, since this was called last, that the spot is set; None: nobody says so.
    alive
        Whether the program that watches over this one is alive.
    links
        Errors that the targets of the source hold, for the steps.
    """

    def __init__(
        self,
        rig: Rig,
        registration: HeldRegistration,
        source: TargetSource | LitSource,
        *,
        plan: FollowPlan,
        by: str,
        reach: ProbeReach,
        endoscope: Callable[[], SeenEndoscope | GoingOn | None] | None = None,
        is_set: Callable[[], bool] | None = None,
        alive: Callable[[], bool] = lambda: True,
        links: ErrorLinks | None = None,
    ) -> None:
        self._rig = rig
        self._scanner: Scanner = rig.scanner
        self._clock = self._scanner.clock
        self._registration = registration
        self._spot = source if isinstance(source, LitSource) else None
        self._target = None if isinstance(source, LitSource) else source
        self._plan = plan
        self._by = by
        self._endoscope = endoscope
        self._is_set = is_set
        self._alive = alive
        self._links = ErrorLinks(counted=()) if links is None else links
        self._machine = FollowMachine(
            plan,
            reach,
            acceleration_deg_s2=self._scanner.turning_acceleration_deg_s2,
            lit=self._spot is not None,
            begun_s=self._clock.now_s(),
        )
        self._reach = reach
        self._watched_s = -math.inf
        self._not_known = 0
        self._looked_s = -math.inf
        self._asked_s = -math.inf
        self._against = 0
        self._confirmed = ""
        self._named: Aim | None = None
        """The place that a person has named, where it was then."""
        self._angle_deg = math.nan

    @property
    def permit(self) -> FollowPermit:
        """The permit that it asks of the guard."""
        return self._plan.permit(self._rig.limits.search, lit=self._spot is not None)

    def stop(self, by: str) -> None:
        """Hold the probe in the dark until a person lets it go on; taken at the next reading of the stage."""
        self._machine.hold("stopped", f"stopped by {by}")

    def go_on(self, by: str) -> None:
        """Go on after what only a person ends, and renew the permit; a fault of the guard needs its reset before."""
        self._machine.go_on(by=by, now_s=self._clock.now_s())
        self._against = self._not_known = 0
        self._scanner.begin_following(self.permit, by=by)

    def steps(self) -> Generator[FollowStep, None, None]:
        """Follow until it is closed; the rig stops then.

        Raises `DeviceError` where a device does not do its part; the guard is in FAULT then, and the last step said so.
        """
        self._scanner.begin_following(self.permit, by=self._by)
        try:
            self._angle_deg = self._scanner.probe_deg
            while True:
                yield from self._step()
        except (DeviceError, OSError) as problem:
            self._machine.hold("fault", str(problem))
            yield self._now(self._decide())
            raise
        finally:
            self._scanner.stop()

    def _step(self) -> Generator[FollowStep, None, None]:
        """Sense, decide and act once."""
        self._watch()
        self._listen()
        decision = self._decide()
        yield self._now(decision)
        if decision.turn_to_deg is not None:
            yield from self._turn(decision.turn_to_deg)
        elif self._spot is not None and self._may_look(decision):
            self._take(self._look(self._spot))
            if not self._registration.confirmed and self._decide().word == "there":
                yield from self._confirm(self._spot)
        else:
            self._clock.wait(TICK_S)

    def _decide(self, *, turning: bool = False) -> Decision:
        if not self._alive():
            self._machine.hold("heartbeat", "the program that watches over this one is silent")
        return self._machine.decide(self._clock.now_s(), probe_deg=self._angle_deg, turning=turning)

    def _turn(self, to_deg: float) -> Generator[FollowStep, None, None]:
        """Turn the probe in the dark, and break off where something speaks against it."""
        decision = self._decide(turning=True)

        def goes_on() -> bool:
            return not decision.stays

        turning = self._scanner.turn_to(to_deg, speed_deg_s=self._plan.speed_deg_s, goes_on=goes_on)
        while True:
            try:
                self._angle_deg = next(turning)
            except StopIteration as end:
                self._angle_deg = float(end.value)
                break
            self._watch()
            self._listen()
            decision = self._decide(turning=True)
            try:
                yield self._now(decision, turning=True)
            except GeneratorExit:
                turning.close()
                raise
        self._machine.rest(self._clock.now_s())

    def _listen(self) -> None:
        """Take the newest target, if its source needs no light."""
        source = self._target
        if source is None:
            return
        target = source.newest()
        self._machine.hear(source.heard_s)
        if target is not None:
            self._machine.see(self._aim(target))

    def _aim(self, target: Target) -> Aim:
        """Return where a target is in the frame of the probe; a place that was named stays there.

        It rests on the tissue: an endoscope that moves afterwards sees it elsewhere, and does not take it along.
        """
        if target.named is None:
            return self._registration.aim(target)
        if self._named is None or self._named.named != target.named:
            self._named = self._registration.aim(target)
        return replace(self._named, at_s=target.at_s)

    def _watch(self) -> None:
        """Look whether the endoscope has moved, and carry the registration along."""
        now_s = self._clock.now_s()
        if self._endoscope is None or now_s - self._watched_s < WATCH_S:
            return
        seen = self._endoscope()
        if seen == "going on":
            return
        self._watched_s = now_s
        if seen is None:
            self._not_known = 0
            self._machine.doubt("")
            return
        if isinstance(seen, EndoscopeMotion):
            self._not_known = 0
            self._machine.doubt("")
            if seen.state == "moved":
                self._registration.carry(seen)
            return
        self._not_known += 1
        self._machine.doubt(seen.said)
        if self._not_known >= TWICE:
            self._machine.hold("endoscope", seen.said)

    def _may_look(self, decision: Decision) -> bool:
        """Whether light is due: never where a person must come, and else where there may be a spot."""
        now_s = self._clock.now_s()
        if decision.word in BY_A_PERSON:
            return False
        if decision.word in BY_ITSELF:
            if self._is_set is not None and self._is_set():
                self._asked_s = now_s
            asked = now_s - self._asked_s <= ASKED_S
            return asked or (self._plan.light_while_waiting and now_s - self._looked_s >= BETWEEN_S)
        return now_s - self._looked_s >= 1 / self._plan.looks_per_second

    def _look(self, spot: LitSource) -> Look:
        """Look for the spot once."""
        self._looked_s = self._clock.now_s()
        try:
            return spot.look(self._plan.pulses)
        except AcquisitionError as refused:
            return Look(target=None, reason=str(refused))

    def _take(self, look: Look) -> None:
        """Take what a look gave: where the spot is, and whether the probe sees it there."""
        if look.target is None:
            return
        aim = self._registration.aim(look.target, depth_m=self._rig.spot.depth_m)
        self._machine.see(aim)
        self._machine.looked(self._clock.now_s())
        if look.sample is None or not self._registration.confirmed:
            return
        face_m = self._face_radius_m
        off_deg = abs(aim.angle_deg - look.sample.angle_deg)
        if off_deg > ASIDE_DEG:
            # So far from the plane the source may be below the noise; the probe turns first.
            return
        compared = compare(look.sample, aim, face_radius_m=face_m, spot=self._rig.spot)
        self._confirmed = compared.said
        self._against = 0 if compared.agrees else self._against + 1
        if self._against >= TWICE:
            self._machine.hold("tissue", f"{compared.said}: the tissue has moved away from the registration")

    @property
    def _face_radius_m(self) -> float:
        radius_m = self._rig.facts.face_radius_m
        if radius_m is None:
            raise ConfigError("follow: the rig states no face_radius_m, so that no image can confirm a registration")
        return radius_m

    def _confirm(self, spot: LitSource) -> Generator[FollowStep, None, None]:
        """Look at the spot from its angle and from both sides, and say whether the registration is right."""
        samples: list[Sample] = []
        aim = self._machine.aim
        assert aim is not None  # noqa: S101  it is followed
        angles = self._reach.angles
        for off_deg in (-ASIDE_DEG, 0.0, ASIDE_DEG):
            to_deg = aim.angle_deg + off_deg
            if to_deg not in angles:
                reason = f"the spot is at {aim.angle_deg:.1f} deg, too near to the end of {angles}; light another one"
                self._machine.hold("unconfirmed", reason)
                return
            while abs(way_deg := to_deg - self._angle_deg) > 0.1:
                step_deg = to_deg if abs(way_deg) <= STEP_DEG else self._angle_deg + math.copysign(STEP_DEG, way_deg)
                yield from self._turn(step_deg)
                if self._decide().stays:
                    return
            look = self._look(spot)
            if look.target is None or look.sample is None:
                return
            seen = self._registration.aim(look.target, depth_m=self._rig.spot.depth_m)
            self._machine.see(seen)
            self._machine.looked(self._clock.now_s())
            if not float(np.linalg.norm(seen.trus_m - aim.trus_m)) <= STILL_M:
                # Of a spot that moves, three frames are no three frames of one source: it begins again.
                return
            samples.append(look.sample)
            yield self._now(self._decide())
            self._clock.wait(1 / self._plan.looks_per_second)
        lower, middle, upper = samples
        verdict = confirm((lower, middle, upper), aim, face_radius_m=self._face_radius_m, spot=self._rig.spot)
        self._confirmed = verdict.said
        if isinstance(verdict, NotConfirmed):
            self._machine.hold("unconfirmed", verdict.said)
        else:
            self._registration.confirmed = True
        yield self._now(self._decide())

    def _now(self, decision: Decision, *, turning: bool = False) -> FollowStep:
        """Say how it stands."""
        aim = self._machine.aim
        registration = self._registration
        holds = registration.confirmed and decision.word not in ("endoscope", "tissue", "unconfirmed")
        return FollowStep(
            at_s=self._clock.now_s(),
            word=decision.word,
            said=decision.said,
            probe_deg=self._angle_deg,
            target_deg=None if aim is None else aim.angle_deg,
            sigma_deg=None if aim is None else aim.sigma_deg,
            within_deg=self._plan.within_deg,
            turning=turning,
            davinci_to_trus=registration.transform.matrix.tolist() if holds else None,
            tre_m=registration.tre_m if holds else None,
            confirmed=self._confirmed,
            target_camera_m=None if aim is None else registration.to_camera.apply(aim.trus_m).tolist(),
            refused="" if self._target is None else getattr(self._target, "refused", ""),
            counted=self._links.counted,
            not_counted=self._links.not_counted,
        )
