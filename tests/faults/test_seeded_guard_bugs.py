"""Bugs seeded into guard and scan, each detected by its check; see `seeded_bugs`."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable

import pytest

from guarded_rig import Rig, Twice, armed, refused, scanner
from markerseek.core import AcquisitionError, DeviceError, FrameHeader, LimitError, Measured, ReadingFrame
from markerseek.guard import Lease, State
from markerseek.scan import run
from seeding import Bug, caught


def nothing_moves_outside_the_search() -> None:
    for angle_deg in (35.5, -35.001):
        rig = Rig()
        with contextlib.suppress(DeviceError):
            scanner(rig).measure(angle_deg)
        assert rig.true_deg == 0.0


def no_limit_lets_nan_pass() -> None:
    rig = Rig()
    with contextlib.suppress(DeviceError):
        scanner(rig).measure(math.nan)
    assert rig.true_deg == 0.0


def a_permit_fires_once() -> None:
    guard = armed()
    permit = guard.issue(angle_deg=0.0, pulses=4, now_s=0.0)
    guard.redeem(permit, angle_deg=0.0, now_s=0.0)
    guard.end_fire(4)
    assert refused(lambda: guard.redeem(permit, angle_deg=0.0, now_s=0.0))


def a_permit_expires() -> None:
    guard = armed()
    permit = guard.issue(angle_deg=0.0, pulses=4, now_s=0.0)
    assert refused(lambda: guard.redeem(permit, angle_deg=0.0, now_s=1e6))


def a_permit_holds_at_its_angle() -> None:
    guard = armed()
    permit = guard.issue(angle_deg=0.0, pulses=4, now_s=0.0)
    assert refused(lambda: guard.redeem(permit, angle_deg=5.0, now_s=0.0))


def nothing_fires_while_the_probe_moves() -> None:
    guard = armed()
    guard.begin_move(10.0)
    with contextlib.suppress(DeviceError):
        guard.redeem(guard.issue(angle_deg=0.0, pulses=4, now_s=0.0), angle_deg=0.0, now_s=0.0)
    assert guard.state is not State.FIRING


def more_pulses_than_permitted_are_a_fault() -> None:
    rig = Rig()
    rig.extra_pulses = 1
    made = scanner(rig)
    assert refused(lambda: made.measure(0.0))
    assert made.guard.state is State.FAULT


def the_session_has_a_dose() -> None:
    rig = Rig()
    made = scanner(rig)
    for _ in range(100):
        rig.now += 1.0
        with contextlib.suppress(LimitError):
            made.measure(0.0)
    assert rig.true_pulses <= 100


def old_frames_are_refused() -> None:
    guard = armed()
    answer = None
    for sequence, token, sound in ((1, "permit-1", True), (1, "permit-2", False), (2, "permit-1", False)):
        permit = guard.issue(angle_deg=0.0, pulses=4, now_s=0.0)
        header = FrameHeader(
            sequence=sequence,
            token=token if token == "permit-1" else permit.token,
            pulses=4,
            commanded_deg=0.0,
            started_s=0.0,
            ended_s=0.0,
            angle_before_deg=0.0,
            angle_after_deg=0.0,
        )
        intensity = 1.0 if answer is None else answer.intensity + 1
        answer = ReadingFrame(header=header, intensity=intensity)
        step = lambda answer=answer, permit=permit: guard.admit_frame(answer, permit=permit, now_s=0.0)  # noqa: E731
        assert refused(step, AcquisitionError) is not sound


def only_a_person_leaves_fault() -> None:
    guard = armed()
    guard.fail("a test")
    refused(lambda: guard.arm(by="a program"))
    guard.disarm()
    refused(lambda: guard.arm(by="a program"))
    assert guard.state is State.FAULT


def a_device_that_raises_is_a_fault() -> None:
    rig = Rig()
    rig.error = OSError("cable pulled")
    made = scanner(rig)
    assert refused(lambda: made.measure(0.0), OSError)
    assert made.guard.state is State.FAULT


def a_sample_carries_the_angle_reached() -> None:
    rig = Rig()
    rig.off_deg = 0.0625
    assert scanner(rig).measure(10.0).angle_deg == rig.true_deg


def the_record_comes_before_the_policy() -> None:
    policy = Twice()
    for event in run(policy, scanner(Rig())):
        if isinstance(event, Measured):
            assert event.sample not in policy.samples


def devices_act_under_the_lease_alone() -> None:
    rig = Rig()
    scanner(rig).measure(0.0)
    assert rig.unheld == []
    assert not rig.held


def a_repeated_step_renews_nothing() -> None:
    lease = Lease(period_s=0.1)
    lease.hold(now_s=0.0)
    lease.beat(1, now_s=0.05)
    lease.beat(1, now_s=0.1)
    assert lease.lapsed(now_s=0.16)


GUARD_BUGS = {
    "clamp for reject": Bug(
        where="guard.machine:Guard.begin_move",
        old="self.limits.require_search(angle_deg)",
        new="angle_deg = max(-35.0, min(35.0, angle_deg))",
        check=nothing_moves_outside_the_search,
    ),
    "a limit that NaN passes": Bug(
        where="core.interval:Interval.__contains__",
        old="is_finite(angle_deg) and bool(self.low_deg <= angle_deg <= self.high_deg)",
        new="not (angle_deg < self.low_deg or angle_deg > self.high_deg)",
        check=no_limit_lets_nan_pass,
    ),
    ">= for > in the order of frames": Bug(
        where="guard.admission:Admission.admit_frame",
        old="header.sequence > previous",
        new="header.sequence >= previous",
        check=old_frames_are_refused,
    ),
    "a frame's token not looked at": Bug(
        where="guard.admission:Admission.admit_frame",
        old="header.token != permit.token",
        new="False",
        check=old_frames_are_refused,
    ),
    "a permit that is not used up": Bug(
        where="guard.permits:Permits.redeem", old="self._open.clear()", new="pass", check=a_permit_fires_once
    ),
    "a permit that does not expire": Bug(
        where="guard.permits:Permits.redeem",
        old="not (is_finite(now_s) and now_s <= permit.expires_s)",
        new="now_s < 0",
        check=a_permit_expires,
    ),
    "a permit that holds anywhere": Bug(
        where="guard.machine:Guard.redeem",
        old="self._require_at(permit.angle_deg, ",
        new="self._require_at(angle_deg, ",
        check=a_permit_holds_at_its_angle,
    ),
    "FAULT alone forbids, MOVING does not": Bug(
        where="guard.machine:Guard._require",
        old="if self._state in states:",
        new="if self._state is not State.FAULT:",
        check=nothing_fires_while_the_probe_moves,
    ),
    "< for != in the pulses fired": Bug(
        where="guard.machine:Guard._require_fired",
        old="least <= fired <= self._firing",
        new="least <= fired",
        check=more_pulses_than_permitted_are_a_fault,
    ),
    "a dose that is not counted": Bug(
        where="guard.permits:Permits._charge", old="self._pulses += pulses", new="pass", check=the_session_has_a_dose
    ),
    "arming leaves FAULT": Bug(
        where="guard.machine:Guard.arm",
        old="State.DISARMED, State.ARMED)",
        new="State.DISARMED, State.ARMED, State.FAULT)",
        check=only_a_person_leaves_fault,
    ),
    "a device's error swallowed by the state": Bug(
        where="scan.scanner:_FaultOnError.__exit__",
        old='self._guard.fail(f"{type(error).__name__}: {error}")',
        new="pass",
        check=a_device_that_raises_is_a_fault,
    ),
    "the angle asked for recorded as the one reached": Bug(
        where="scan.scanner:Scanner._acquire",
        old="angle_deg=(before_deg + after_deg) / 2",
        new="angle_deg=commanded_deg",
        check=a_sample_carries_the_angle_reached,
    ),
    "acknowledgement before commit": Bug(
        where="scan.loop:run",
        old='sample = yield from _measured(scanner, "search", acquisitions, asked_deg, limits.attempts)',
        new="sample = scanner.measure(asked_deg); policy.tell(sample); "
        'yield Measured(role="search", index=acquisitions, sample=sample)',
        check=the_record_comes_before_the_policy,
    ),
    "a move and a firing without the lease": Bug(
        where="scan.scanner:_WatchdogHeld.__enter__",
        old="self._watchdog.hold()",
        new="pass",
        check=devices_act_under_the_lease_alone,
    ),
    "a lease that any beat renews": Bug(
        where="guard.lease:Lease.beat",
        old="is_whole(step) and step > self._step",
        new="True",
        check=a_repeated_step_renews_nothing,
    ),
}


@pytest.mark.parametrize("name", GUARD_BUGS)
def test_the_bug_is_caught_by_its_check(name: str) -> None:
    assert caught(GUARD_BUGS[name])


@pytest.mark.parametrize(
    "check", dict.fromkeys(bug.check for bug in GUARD_BUGS.values()), ids=lambda check: check.__name__
)
def test_the_check_has_nothing_to_say_about_sound_code(check: Callable[[], None]) -> None:
    check()
