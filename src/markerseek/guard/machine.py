"""The guard: a state machine that must permit every move and every firing before it is made."""

from __future__ import annotations

import math
from enum import Enum

from markerseek.core import (
    SWEEP_READING_S,
    AcquisitionError,
    ConfigError,
    DeviceError,
    FollowPermit,
    Frame,
    LaserError,
    LimitError,
    MoveError,
    Permit,
    Reading,
    SweepPermit,
    is_finite,
    is_whole,
)
from markerseek.guard.admission import Admission
from markerseek.guard.limits import Limits
from markerseek.guard.permits import FiringLimits, Permits

AHEAD_DEG = 5.0
"""Longest turn from rest to rest while it follows, in degrees: whoever dies, the probe stops so near."""

FASTER = 1.25
"""Speed from which on a turn is a fault, over the permitted one: two readings tell a speed no better."""

TURN_SPARE_S = 5.0
"""Time that a turn may take longer than its way at the permitted speed, in seconds: it runs up and brakes."""


class State(Enum):
    """State of a rig: ARMED begins steps, MOVING, FIRING and SWEEPING are steps, FAULT needs a person's reset.

    FOLLOWING is at rest under a permit to follow, which begins firings and turns of its own; TURNING is such a turn.
    """

    DISARMED = "disarmed"
    ARMED = "armed"
    MOVING = "moving"
    FIRING = "firing"
    SWEEPING = "sweeping"
    FOLLOWING = "following"
    TURNING = "turning"
    FAULT = "fault"


class Guard:
    """The safety kernel of one rig: it begins DISARMED, and only a person's `reset` leaves FAULT.

    It touches no device. A step that is refused by a `LimitError` changes nothing; evidence that a device did not do
    its part is raised after the state has become FAULT.

    ``arrival_deg``: most that the readback may differ from the angle asked for.
    """

    def __init__(self, *, limits: Limits, firing: FiringLimits, admission: Admission, arrival_deg: float = 0.1) -> None:
        if not (is_finite(arrival_deg) and 0 < arrival_deg < limits.travel.width_deg):
            raise ConfigError(f"guard: arrival_deg is {arrival_deg} deg, it must be positive and less than the travel")
        self.limits = limits
        self._admission = admission
        self._arrival_deg = arrival_deg
        self._permits = Permits(firing)
        self._state = State.DISARMED
        self._fault: str | None = None
        self._issued_s = math.nan
        self._read = (math.nan, math.nan)
        self._following: FollowPermit | None = None
        self._previous: Frame | None = None
        self._usual_sigma: dict[int, float | None] = {}

    @property
    def state(self) -> State:
        """State of the rig now."""
        return self._state

    @property
    def fault(self) -> str | None:
        """Why it is in FAULT; None in every other state."""
        return self._fault

    @property
    def pulses_permitted(self) -> int:
        """Pulses permitted in this session so far."""
        return self._permits.pulses_permitted

    def recall(self, frame: Frame, reading: Reading) -> None:
        """Take over the last frame that this run admitted under an earlier guard; only while DISARMED."""
        self._require("recall", State.DISARMED)
        self._previous = frame
        self._usual_sigma.setdefault(frame.header.pulses, reading.noise_sigma)

    def charge(self, pulses: int) -> None:
        """Count pulses that an earlier guard permitted in this session."""
        self._permits.charge(pulses)

    def arm(self, *, by: str) -> None:
        """DISARMED -> ARMED, in the name of a person; refused in FAULT and in mid-step."""
        _require_name(by)
        self._require("arm", State.DISARMED, State.ARMED)
        self._state = State.ARMED

    def disarm(self) -> None:
        """Any state but FAULT -> DISARMED; open permits are void, and the next run starts fresh."""
        self._permits.void()
        self._following = None
        self._previous = None
        self._usual_sigma = {}
        if self._state is not State.FAULT:
            self._state = State.DISARMED

    def fail(self, reason: str) -> None:
        """Any state -> FAULT; the first reason is kept."""
        self._permits.void()
        self._following = None
        self._state = State.FAULT
        self._fault = self._fault or reason

    def reset(self, *, by: str) -> None:
        """FAULT -> DISARMED, in the name of a person who has looked at the rig."""
        _require_name(by)
        self._require("reset", State.FAULT)
        self._state = State.DISARMED
        self._fault = None

    def readback(self, angle_deg: float) -> float:
        """Return the stage's readback in degrees, checked against the travel range wherever it is read."""
        try:
            self.limits.require_travel(angle_deg)
        except LimitError as error:
            raise self._failed(error) from None
        return float(angle_deg)

    def begin_move(self, angle_deg: float) -> None:
        """ARMED -> MOVING, to an angle of the search range."""
        self._require("move", State.ARMED)
        self.limits.require_search(angle_deg)
        self._permits.void()
        self._state = State.MOVING
        self._target_deg = float(angle_deg)

    def end_move(self, reached_deg: float) -> None:
        """MOVING -> ARMED, when the readback says that the probe has arrived."""
        self._require("end a move", State.MOVING)
        reached_deg = self.readback(reached_deg)
        self._require_at(self._target_deg, reached_deg, "the stage was sent to", "check for an obstacle")
        self._state = State.ARMED

    def issue(self, *, angle_deg: float, pulses: int, now_s: float) -> Permit:
        """Return the permit for one acquisition at one angle, as `Permits.issue`.

        The state stays ARMED or FOLLOWING.
        """
        self._require("permit pulses", State.ARMED, State.FOLLOWING)
        if self._following is not None:
            self._require_following(now_s)
            if not pulses <= self._following.pulses:
                why = f"{pulses} pulses at once while it follows; the limit of the permit to follow is"
                raise LimitError(f"{why} {self._following.pulses}: ask for fewer")
        permit = self._permits.issue(angle_deg=angle_deg, pulses=pulses, now_s=now_s)
        self._issued_s = now_s
        return permit

    def issue_sweep(self, wanted: SweepPermit, *, now_s: float) -> SweepPermit:
        """Return the permit that is wanted for one sweep, which must stay in the search range.

        The state stays ARMED.
        """
        self._require("permit pulses", State.ARMED)
        self.limits.require_search(wanted.to_deg)
        self.limits.require_search(wanted.end_deg)
        self._issued_s = now_s
        return self._permits.issue_sweep(wanted, now_s=now_s)

    def redeem(self, permit: Permit, *, angle_deg: float, now_s: float) -> None:
        """ARMED -> FIRING or SWEEPING, FOLLOWING -> FIRING, if the permit holds here and now; it is used up then."""
        self._require("fire", State.ARMED, State.FOLLOWING)
        most = None
        if self._following is not None:
            self._require_following(now_s)
            most = self._following.pulses_per_second
        try:
            self._permits.redeem(permit, now_s=now_s, most_in_1_s=most)
        except LaserError as error:
            raise self._failed(error) from None
        angle_deg = self.readback(angle_deg)
        self._require_at(permit.angle_deg, angle_deg, "the permit holds at", "nothing was fired; check what moved it")
        self._state = State.FIRING
        self._firing = permit.pulses
        if isinstance(permit, SweepPermit):
            self._state = State.SWEEPING
            self._sweep = permit
            self._read = (angle_deg, now_s)
            self._turned_s = math.inf

    def read_sweep(self, angle_deg: float, *, now_s: float) -> bool:
        """Return whether the probe may be lit at this readback of a sweep: not while it is slower than permitted.

        Faster, backwards, out of its angles, or later than `SWEEP_READING_S` after the readback before ends in FAULT.
        A sweep that may turn back may be slow where it does, and turns the other way from there on.
        """
        self._require("sweep", State.SWEEPING)
        sweep = self._sweep
        before_deg, before_s = self._read
        if turning := sweep.turns_at(before_deg, within_deg=self._arrival_deg):
            self._turned_s = min(self._turned_s, before_s)
        turned_deg = self._read_on_way(angle_deg, now_s=now_s)
        elapsed_s = now_s - before_s
        turning = turning or sweep.turns_at(angle_deg, within_deg=self._arrival_deg)
        return turned_deg >= sweep.slowest_deg_s * elapsed_s or (turning and now_s <= self._turned_s + sweep.turn_s)

    def _read_on_way(self, angle_deg: float, *, now_s: float) -> float:
        """Return how far the probe has turned along its way; one that is not where its permit allows ends in FAULT."""
        angle_deg = self.readback(angle_deg)
        before_deg, before_s = self._read
        way = self._sweep
        turned_deg, beyond_deg = way.turned(before_deg, angle_deg, back=self._turned_s < math.inf)
        elapsed_s = now_s - before_s
        in_time = 0 < elapsed_s <= SWEEP_READING_S and now_s <= way.expires_s
        most_deg = way.fastest_deg_s * elapsed_s + self._arrival_deg
        if not (in_time and beyond_deg <= self._arrival_deg and -self._arrival_deg <= turned_deg <= most_deg):
            why = f"the probe turned by {turned_deg:.3f} deg in {elapsed_s:.3f} s to {angle_deg:.3f} deg"
            raise self._failed(MoveError(f"{why} at {now_s:.3f} s, outside {way.words}; check stage and host"))
        self._read = angle_deg, now_s
        return turned_deg

    def end_sweep(self, angle_deg: float, *, pulses: int, now_s: float) -> None:
        """SWEEPING -> ARMED, at rest at that readback, after no more pulses than permitted."""
        before_deg, _ = self._read
        self.read_sweep(angle_deg, now_s=now_s)
        self._require_at(before_deg, angle_deg, "the sweep ended at", "the stage does not stop")
        self._permits.count(self._sweep, now_s=now_s)
        self._require_fired(pulses, least=0)
        self._state = State.ARMED
        self._firing = pulses

    def admit_sweep(self, frames: int) -> None:
        """Refuse a sweep as a whole unless as many frames came as pulses were fired; the state stays."""
        if frames != self._firing:
            raise AcquisitionError(f"{frames} frames of {self._firing} pulses: no angle is known; check the trigger")

    def begin_following(self, permit: FollowPermit, *, by: str, now_s: float) -> None:
        """ARMED -> FOLLOWING, or renew it, in the name of a person; the angles must lie in the search range."""
        _require_name(by)
        self._require("follow", State.ARMED, State.FOLLOWING)
        self.limits.require_search(permit.angles.low_deg)
        self.limits.require_search(permit.angles.high_deg)
        if not is_finite(now_s):
            raise LimitError(f"guard: it is {now_s!r} s, no number; nothing was permitted")
        self._permits.void()
        self._following = permit
        self._follows_until_s = now_s + permit.duration_s
        self._state = State.FOLLOWING

    def end_following(self) -> None:
        """FOLLOWING -> ARMED."""
        self._require("end following", State.FOLLOWING)
        self._permits.void()
        self._following = None
        self._state = State.ARMED

    def begin_turn(self, to_deg: float, *, from_deg: float, now_s: float) -> None:
        """FOLLOWING -> TURNING in the dark, from a readback to an angle at most `AHEAD_DEG` away."""
        self._require("turn", State.FOLLOWING)
        permit = self._require_following(now_s)
        from_deg = self.readback(from_deg)
        for name, angle_deg in (("to", to_deg), ("from", from_deg)):
            if angle_deg not in permit.angles:
                why = f"a turn {name} {angle_deg} deg, outside {permit.angles} of the permit to follow"
                raise LimitError(f"{why}; nothing was moved; ask for an angle inside")
        way_deg = abs(to_deg - from_deg)
        if not 0 < way_deg <= AHEAD_DEG:
            why = f"a turn from {from_deg:.3f} to {to_deg:.3f} deg; the longest while it follows is {AHEAD_DEG:g} deg"
            raise LimitError(f"{why}; nothing was moved; go there in shorter ones")
        self._sweep = permit.turn(
            from_deg,
            to_deg,
            fastest_deg_s=FASTER * permit.speed_deg_s,
            expires_s=now_s + way_deg / permit.speed_deg_s + TURN_SPARE_S,
        )
        self._permits.void()
        self._read = (from_deg, now_s)
        self._turned_s = math.inf
        self._state = State.TURNING

    def read_turn(self, angle_deg: float, *, now_s: float) -> None:
        """Check a readback of a turn: faster, backwards, beyond its end or late ends in FAULT, as in a sweep."""
        self._require("turn", State.TURNING)
        self._read_on_way(angle_deg, now_s=now_s)

    def end_turn(self, angle_deg: float, *, now_s: float) -> None:
        """TURNING -> FOLLOWING, at rest at that readback."""
        before_deg, _ = self._read
        self.read_turn(angle_deg, now_s=now_s)
        self._require_at(before_deg, angle_deg, "the turn ended at", "the stage does not stop")
        self._state = State.FOLLOWING

    def end_fire(self, fired: int) -> None:
        """FIRING -> ARMED or FOLLOWING, when as many pulses were fired as were permitted."""
        self._require("end a firing", State.FIRING)
        self._require_fired(fired, least=self._firing)
        self._state = State.ARMED if self._following is None else State.FOLLOWING

    def admit_frame(self, frame: Frame, *, permit: Permit, now_s: float) -> None:
        """Refuse a frame that does not belong to this permit, as `Admission.admit_frame`; the state stays."""
        self._admission.admit_frame(frame, permit=permit, issued_s=self._issued_s, now_s=now_s, previous=self._previous)
        self._previous = frame

    def admit_reading(self, reading: Reading, *, frame: Frame) -> None:
        """Refuse a reading that cannot be a measurement, as `Admission.admit_reading`; the state stays.

        A dark frame that holds a source ends in FAULT: if frames come late, a second try would hide it.
        """
        pulses = frame.header.pulses
        known = self._usual_sigma
        # The first lit frame may be stronger than a dark one, and the first dark one quieter than those with light.
        others = [sigma for of, sigma in known.items() if sigma and bool(of) != bool(pulses)]
        usual_sigma = known.get(pulses) or (max if pulses else min)([reading.noise_sigma or 0, *others])
        self._admission.admit_reading(reading, frame=frame, usual_sigma=usual_sigma)
        if not pulses and (source := self._admission.source_in_dark(reading)) is not None:
            raise self._failed(AcquisitionError(source))
        known.setdefault(pulses, reading.noise_sigma)

    def _failed(self, error: DeviceError) -> DeviceError:
        self.fail(str(error))
        return error

    def _require(self, step: str, *states: State) -> None:
        """Refuse a step in any other state."""
        if self._state not in states:
            cure = f"a person must reset it after: {self._fault}" if self._fault else "arm it, and end each step first"
            raise LimitError(f"guard: {self._state.value}, not allowed to {step}; {cure}")

    def _require_following(self, now_s: float) -> FollowPermit:
        """Return the permit to follow; `LimitError` if it has expired."""
        permit = self._following
        if permit is None or not now_s <= self._follows_until_s:
            raise LimitError(
                f"guard: the permit to follow has expired at {self._follows_until_s:.1f} s, it is {now_s:.1f} s; a "
                "person must renew it"
            )
        return permit

    def _require_fired(self, fired: int, *, least: int) -> None:
        if not (is_whole(fired) and least <= fired <= self._firing):
            reason = f"the laser fired {fired} pulses, {self._firing} were permitted; check the laser and its trigger"
            raise self._failed(LaserError(reason))

    def _require_at(self, wanted_deg: float, angle_deg: float, what: str, cure: str) -> None:
        # `not <=` and never `>`: a NaN must fail.
        if not abs(angle_deg - wanted_deg) <= self._arrival_deg:
            apart = f"more than {self._arrival_deg} deg away; {cure}"
            raise self._failed(
                MoveError(f"{what} {wanted_deg:.3f} deg and the probe is at {angle_deg:.3f} deg, {apart}")
            )


def _require_name(by: str) -> None:
    """Refuse a step that a person must take without the name of the person."""
    if not (isinstance(by, str) and by.strip()):
        raise ConfigError("guard: by is empty; name the person who arms or resets it")
