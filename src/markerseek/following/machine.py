"""Decides when the probe turns while it follows, and when it does not: pure, in the time that it is told.

A target that is out of reach, lost, that jumps, or whose link is silent holds the probe until the target has been back
for `BACK_S`. All other conditions hold it until a person says that it may go on.
"""

from __future__ import annotations

import math
from collections import deque

import msgspec
import numpy as np

from markerseek.core import ConfigError
from markerseek.following.aim import Aim, ProbeReach
from markerseek.following.plan import FollowPlan
from markerseek.following.words import BY_A_PERSON, BY_ITSELF, Word
from markerseek.scan import rest_to_rest_s

LOST_S = 1.0
"""Time without the target after which it is lost, in seconds."""

FASTEST_HAND_M_S = 0.3
"""Speed beyond which a target jumps: no hand moves an instrument so fast in tissue."""

STALE_S = 0.2
"""Silence of a link after which it is stale, in seconds."""

BACK_S = 0.5
"""Time for which a target must be back before the probe goes on, in seconds."""

STEP_DEG = 4.5
"""Longest turn: half a degree of room for the backlash, below what the guard permits."""

READINGS_S = 0.15
"""Time that a turn takes longer than its way: three readings show that the probe is at rest."""

LEAST_TURN_DEG = 0.2
"""Shortest turn: twice what a readback may be off by."""

SPEED_OVER_S = 1.0
"""Time over which the speed of a target is estimated, in seconds."""


class Decision(msgspec.Struct, frozen=True, kw_only=True):
    """What is to be done now."""

    word: Word
    said: str
    """The state in a sentence."""
    turn_to_deg: float | None = None
    """Where the probe is to turn; None: it stays."""

    @property
    def stays(self) -> bool:
        """Whether the probe stays and the laser is dark: it looks for the target at most."""
        return self.word in BY_ITSELF or self.word in BY_A_PERSON


class FollowMachine:
    """The state of following.

    ``acceleration_deg_s2``: of the stage. ``lit``: whether the target is seen by the laser's light, and so only with
    the probe at rest. ``begun_s``: when it begins, on the rig's clock.
    """

    def __init__(
        self, plan: FollowPlan, reach: ProbeReach, *, acceleration_deg_s2: float, lit: bool, begun_s: float
    ) -> None:
        self._acceleration_deg_s2 = acceleration_deg_s2
        self._plan = plan
        self._reach = reach
        self._lit = lit
        self.aim: Aim | None = None
        """Where the target was last."""
        self._aims: deque[Aim] = deque()
        self._dark_until_s = begun_s
        self._looked_s = -math.inf
        self._heard_s = begun_s
        self._ends_s = begun_s + 60 * plan.minutes
        self._rests_until_s = -math.inf
        self._back_since_s: float | None = None
        self._jumped = ""
        self._cause = ""
        self._waits = True
        self._on_its_way = False
        """Whether the last turn ended before a place that a person named."""
        self._doubt = ""
        self._unseen: tuple[Decision, Aim | None] | None = None
        self._held: tuple[Word, str] | None = None

    @property
    def held(self) -> Word | None:
        """What only a person ends; None if nothing holds it so."""
        return None if self._held is None else self._held[0]

    def see(self, aim: Aim) -> None:
        """Take a target."""
        before = self.aim
        if before is not None and not aim.at_s > before.at_s:
            return
        self.aim = aim
        if before is not None and before.named != aim.named:
            # A person has named another place.
            self._jumped = ""
            self._on_its_way = False
            self._aims.clear()
            self._back_since_s = None
        elif before is not None:
            apart_m = float(np.linalg.norm(aim.trus_m - before.trus_m))
            elapsed_s = aim.at_s - before.at_s
            noise_m = 3 * math.sqrt(float(np.trace(aim.noise_m2 + before.noise_m2)))
            if not apart_m <= FASTEST_HAND_M_S * elapsed_s + noise_m:
                self._jumped = (
                    f"the target jumped by {1e3 * apart_m:.0f} mm in {elapsed_s:.2f} s, a hand moves with "
                    f"{1e3 * FASTEST_HAND_M_S:g} mm/s at most"
                )
                self._aims.clear()
                self._back_since_s = None
        if self._back_since_s is None:
            self._back_since_s = aim.at_s
        self._aims.append(aim)
        while aim.at_s - self._aims[0].at_s > SPEED_OVER_S:
            self._aims.popleft()

    def looked(self, now_s: float) -> None:
        """Note that a look which showed the target is over: until now nothing newer can be known."""
        self._looked_s = now_s

    def hear(self, heard_s: float) -> None:
        """Note of when the newest message of the target's link is."""
        self._heard_s = max(self._heard_s, heard_s)

    def rest(self, now_s: float) -> None:
        """Note that the probe has come to rest: a lit target can be seen from now on."""
        self._rests_until_s = now_s + self._plan.rest_s
        self._dark_until_s = now_s

    def doubt(self, said: str) -> None:
        """Begin no turn as long as this is in doubt; empty: nothing is."""
        self._doubt = said

    def hold(self, word: Word, said: str) -> None:
        """Hold the probe until a person lets it go on; the first cause is kept."""
        if word not in BY_A_PERSON:
            raise ConfigError(f"follow: {word!r} is not held until a person comes; one of {sorted(BY_A_PERSON)} is")
        self._held = self._held or (word, said)

    def go_on(self, *, by: str, now_s: float) -> None:
        """Go on after what only a person ends, in the name of a person; the permit begins anew."""
        if not by.strip():
            raise ConfigError("follow: by is empty; name the person who has looked at rig and patient")
        self._held = None
        self._waits = True
        self._cause = f"{by} lets it go on"
        self._back_since_s = None
        self._jumped = ""
        self._doubt = ""
        self._unseen = None
        self._ends_s = now_s + 60 * self._plan.minutes
        self._dark_until_s = now_s
        self._heard_s = now_s

    def decide(self, now_s: float, *, probe_deg: float, turning: bool = False) -> Decision:
        """Decide what is to be done; ``turning``: the probe turns, so that a lit target cannot be seen."""
        if not now_s <= self._ends_s:
            self.hold("expired", f"the permit of {self._plan.minutes:g} min is over; a person must renew it")
        if self._held is not None:
            word, said = self._held
            self._waits = True
            self._cause = said
            return Decision(word=word, said=said)
        if self._unseen is not None:
            # Of a lit target in the dark nothing is known until it is seen again: the time does not count.
            decision, unseen = self._unseen
            if unseen is self.aim:
                return decision
            self._unseen = None
            self._dark_until_s = now_s
        if (objection := self._objection(now_s, turning=turning)) is not None:
            word, said = objection
            if word != "jumped":
                # After a jump the time counts from the place to which it jumped.
                self._back_since_s = None
            self._waits = True
            self._cause = said
            decision = Decision(word=word, said=said)
            self._unseen = (decision, self.aim) if self._lit else None
            return decision
        aim = self.aim
        if self._waits or aim is None:
            if aim is None or not self._back_s >= BACK_S:
                why = f", after: {self._cause}" if self._cause else ""
                seen = f"waits until the target has been seen for {BACK_S:g} s, {self._back_s:.1f} s so far{why}"
                return Decision(word="waiting", said=seen)
            self._waits = False
        if self._doubt and not turning:
            return Decision(word="waiting", said=f"waits: {self._doubt}")
        return self._within(aim, now_s, probe_deg=probe_deg, turning=turning)

    @property
    def _back_s(self) -> float:
        """Time for which the target is back."""
        return 0.0 if self.aim is None or self._back_since_s is None else self.aim.at_s - self._back_since_s

    def _objection(self, now_s: float, *, turning: bool) -> tuple[Word, str] | None:
        """Return why the probe stays until the target is back; None if nothing speaks against it."""
        if not self._lit and not now_s - self._heard_s <= STALE_S:
            return "stale", f"the link of the target has sent nothing new for {now_s - self._heard_s:.2f} s"
        if self._jumped:
            if not self._back_s >= BACK_S:
                return "jumped", self._jumped
            self._jumped = ""
        seen_s = -math.inf if self.aim is None else self.aim.at_s
        if self._lit:
            seen_s = max(seen_s, self._looked_s, now_s if turning else self._dark_until_s)
        elif self.aim is None:
            seen_s = self._dark_until_s
        if not now_s - seen_s <= LOST_S:
            return "lost", f"the target has not been seen for {now_s - seen_s:.1f} s"
        objection = None if self.aim is None else self._reach.objection(self.aim)
        return None if objection is None else ("out of reach", objection)

    def _within(self, aim: Aim, now_s: float, *, probe_deg: float, turning: bool) -> Decision:
        """Decide whether to turn to a target that is followed."""
        off_deg = aim.angle_deg - probe_deg
        speed_deg_s = self._speed_deg_s
        band_deg = max(self._plan.within_deg, aim.sigma_deg)
        where = f"{abs(off_deg):.1f} deg from the image plane"
        if turning:
            return Decision(word="turning", said=f"turns, the target is {where}")
        later_deg = off_deg + speed_deg_s * (now_s - aim.at_s + self._turn_s(self._plan.within_deg))
        if not self._on_its_way and max(abs(off_deg), abs(later_deg)) <= band_deg:
            return Decision(word="there", said=f"there: the target is {where}, within {band_deg:.1f} deg")
        if now_s < self._rests_until_s or (self._lit and aim.at_s < self._dark_until_s):
            # A lit target may have gone while the probe turned in the dark: it is seen before the next turn.
            return Decision(word="resting", said=f"rests between two turns, the target is {where}")
        # To where a target that moves on will be: at the end of the turn, and half the range further.
        lead_s = now_s - aim.at_s + self._turn_s(abs(off_deg) + self._plan.within_deg)
        lead_deg = speed_deg_s * lead_s + math.copysign(self._plan.within_deg / 2, speed_deg_s) * (speed_deg_s != 0)
        most_deg = 2 * self._plan.within_deg
        to_deg = aim.angle_deg + min(max(lead_deg, -most_deg), most_deg)
        # The lead alone may leave the angles: the target itself is in reach.
        way_deg = self._reach.angles.nearest(to_deg) - probe_deg
        if abs(way_deg) < LEAST_TURN_DEG:
            nearer = "" if aim.named is not None else ", and comes nearer"
            self._on_its_way = False
            return Decision(word="there", said=f"there: the target is {where}{nearer}")
        # The first of two turns may end inside the range, which is not yet the place that was named.
        self._on_its_way = aim.named is not None and abs(way_deg) > STEP_DEG
        if abs(way_deg) > STEP_DEG:
            way_deg = math.copysign(STEP_DEG, way_deg)
        return Decision(word="turning", said=f"turns, the target is {where}", turn_to_deg=probe_deg + way_deg)

    def _turn_s(self, way_deg: float) -> float:
        """Return the time of a turn from rest to rest, which is known once it was read."""
        way_s = rest_to_rest_s(
            way_deg, speed_deg_s=self._plan.speed_deg_s, acceleration_deg_s2=self._acceleration_deg_s2
        )
        return way_s + READINGS_S

    @property
    def _speed_deg_s(self) -> float:
        """Speed of the target about the axis, by least squares; 0 below twice its standard deviation."""
        if len(self._aims) < 3:
            return 0.0
        at_s = np.array([aim.at_s for aim in self._aims])
        angles_deg = np.array([aim.angle_deg for aim in self._aims])
        at_s -= at_s.mean()
        angles_deg -= angles_deg.mean()
        spread_s2 = float(at_s @ at_s)
        speed = float(at_s @ angles_deg) / spread_s2
        left_deg = angles_deg - speed * at_s
        sigma = math.sqrt(float(left_deg @ left_deg) / (len(at_s) - 2) / spread_s2)
        return speed if abs(speed) > 2 * sigma else 0.0
