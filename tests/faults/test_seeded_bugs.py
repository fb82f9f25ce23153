"""A checker of the checker: bugs that somebody might write into guard, scan and supervisor, each caught by its check.

A bug is one piece of source text replaced by another. ``python tests/faults/test_seeded_bugs.py`` prints the table.
"""

# ruff: noqa: T201 - the table is printed when this is run as a program

from __future__ import annotations

import contextlib
import math
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from markerseek.core import (
    AcquisitionError,
    ConfigError,
    DeviceError,
    Frame,
    FrameHeader,
    Interval,
    LimitError,
    Measured,
    NotFound,
    Permit,
    Reading,
    ReadingFrame,
    Sample,
)
from markerseek.guard import Admission, FiringLimits, Guard, Lease, Limits, State
from markerseek.scan import Scanner, run
from markerseek.supervisor import Line, Supervisor

sys.path.insert(0, str(Path(__file__).parent))
from seeding import Bug, caught, seeded, table
from test_seeded_driver_bugs import DRIVER_BUGS
from test_seeded_journal_bugs import JOURNAL_BUGS

FAREWELL = b"DISARM\n"
LEASE_S = 0.5
SOON_S = 3.0


class Rig:
    """Stage, laser, receiver, reader, clock and dead man in one; the truth stands beside what it reports."""

    def __init__(self) -> None:
        self.limits = Interval(low_deg=-36.5, high_deg=36.5)
        self.true_deg = 0.0
        self.off_deg = 0.0
        self.true_pulses = 0
        self.held = False
        self.unheld: list[str] = []
        self.extra_pulses = 0
        self.error: Exception | None = None
        self.sequence = 0
        self.now = 0.0

    @property
    def angle_deg(self) -> float:
        return self.true_deg

    def move_to(self, angle_deg: float) -> float:
        self._watch("move")
        self.true_deg = angle_deg + self.off_deg
        return self.true_deg

    def stop(self) -> None:
        pass

    def disarm(self) -> None:
        pass

    def hold(self) -> None:
        self.held = True

    def release(self) -> None:
        self.held = False

    def arm(self, permit: Permit) -> None:
        pass

    def fire(self, permit: Permit) -> int:
        self._watch("fire")
        if self.error is not None:
            raise self.error
        self.true_pulses += permit.pulses + self.extra_pulses
        return permit.pulses + self.extra_pulses

    def acquire(self, permit: Permit) -> Frame:
        self.sequence += 1
        return ReadingFrame(
            header=FrameHeader(
                sequence=self.sequence,
                token=permit.token,
                pulses=permit.pulses,
                commanded_deg=permit.angle_deg,
                started_s=self.now,
                ended_s=self.now,
            ),
            intensity=float(self.sequence),
        )

    def read(self, frame: Frame) -> Reading:
        assert isinstance(frame, ReadingFrame)
        return Reading(intensity=frame.intensity)

    def now_s(self) -> float:
        return self.now

    def wait(self, duration_s: float) -> None:
        self.now += duration_s

    def _watch(self, verb: str) -> None:
        if not self.held:
            self.unheld.append(verb)


class Twice:
    """A policy that looks at two angles."""

    def __init__(self) -> None:
        self.told: list[Sample] = []

    def ask(self) -> float | None:
        return float(len(self.told)) if len(self.told) < 2 else None

    def tell(self, sample: Sample) -> None:
        self.told.append(sample)

    def estimate(self) -> NotFound:
        return NotFound(mean_deg=0.0, reason="a test")


def armed() -> Guard:
    guard = Guard(limits=Limits(), firing=FiringLimits(pulses_per_session=100), admission=Admission())
    guard.arm(by="a test")
    return guard


def scanner(rig: Rig) -> Scanner:
    return Scanner(stage=rig, laser=rig, receiver=rig, reader=rig, clock=rig, guard=armed(), pulses=4, dead_man=rig)


def refused(step: Callable[[], object], error: type[Exception] = DeviceError) -> bool:
    try:
        step()
    except error:
        return True
    return False


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
            assert event.sample not in policy.told


def devices_act_under_the_lease_alone() -> None:
    rig = Rig()
    scanner(rig).measure(0.0)
    assert rig.unheld == []
    assert not rig.held


def a_step_told_twice_renews_nothing() -> None:
    lease = Lease(period_s=0.1)
    lease.hold(now_s=0.0)
    lease.beat(1, now_s=0.05)
    lease.beat(1, now_s=0.1)
    assert lease.lapsed(now_s=0.16)


class Far:
    """The far end of a line."""

    def __enter__(self) -> Far:
        self.fd, self.near = os.openpty()
        tty.setraw(self.near)
        self.line = Line(name="laser", path=os.ttyname(self.near), farewell=FAREWELL)
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self.fd)
        os.close(self.near)

    def hears_farewell(self, *, within_s: float = SOON_S) -> bool:
        data = b""
        ends_s = time.monotonic() + within_s
        while FAREWELL not in data:
            if not select.select([self.fd], [], [], max(ends_s - time.monotonic(), 0.0))[0]:
                return False
            data += os.read(self.fd, 4096)
        return True


HOLDER = """
import socket, struct, sys, time
control = socket.socket(fileno=int(sys.argv[1]))
control.sendall(struct.pack(">BBH", 0x48, 0, 0))
for step in range(1, 10**9):
    control.sendall(struct.pack(">BBHQ", 0x42, 0, 8, step))
    print(flush=True)
    time.sleep(0.01)
"""


@contextlib.contextmanager
def kept(far: Far) -> Iterator[subprocess.Popen[bytes]]:
    """A control process that holds and beats, and a supervisor with the bug that is seeded now, if any."""
    ours, theirs = socket.socketpair()
    orders = msgspec.json.encode({"lines": [far.line], "period_s": LEASE_S}).decode()
    command = [sys.executable, __file__, "supervisor", SEEDED[-1] if SEEDED else "", str(theirs.fileno()), orders]
    supervisor = subprocess.Popen(command, pass_fds=[theirs.fileno()])
    theirs.close()
    select.select([ours], [], [], 60)
    control = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(ours.fileno())], pass_fds=[ours.fileno()], stdout=subprocess.PIPE
    )
    ours.close()
    assert control.stdout is not None
    for _ in range(10):
        control.stdout.readline()
    try:
        yield control
    finally:
        control.kill()
        control.wait()
        control.stdout.close()
        supervisor.kill()
        supervisor.wait()


def a_line_is_silenced_at_the_start() -> None:
    with Far() as far, kept(far):
        assert far.hears_farewell()


def a_line_is_silenced_after_death() -> None:
    with Far() as far, kept(far) as control:
        far.hears_farewell(within_s=0.1)
        control.kill()
        assert far.hears_farewell()


def a_line_is_silenced_after_a_stop() -> None:
    with Far() as far, kept(far) as control:
        far.hears_farewell(within_s=0.1)
        control.send_signal(signal.SIGSTOP)
        assert far.hears_farewell()


def a_timer_cannot_stand_in_for_a_loop_that_hangs() -> None:
    with Far() as far, Supervisor(lines=[far.line], period_s=LEASE_S) as supervisor:
        assert far.hears_farewell()
        over = threading.Event()

        def timer() -> None:
            while not over.wait(0.02):
                with contextlib.suppress(ConfigError):
                    supervisor.beat()

        thread = threading.Thread(target=timer)
        supervisor.hold()
        thread.start()
        heard = far.hears_farewell(within_s=5 * LEASE_S)
        over.set()
        thread.join()
        assert heard


BUGS = {
    "clamp for reject": Bug(
        where="guard.machine:Guard.begin_move",
        old="self.limits.require_search(angle_deg)",
        new="angle_deg = max(-35.0, min(35.0, angle_deg))",
        check=nothing_moves_outside_the_search,
    ),
    "a limit that NaN passes": Bug(
        where="core.interval:Interval.__contains__",
        old="return self.low_deg <= angle_deg <= self.high_deg",
        new="return not (angle_deg < self.low_deg or angle_deg > self.high_deg)",
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
        old="not now_s <= permit.expires_s",
        new="now_s < 0",
        check=a_permit_expires,
    ),
    "a permit that holds anywhere": Bug(
        where="guard.machine:Guard.redeem",
        old="- permit.angle_deg",
        new="- angle_deg",
        check=a_permit_holds_at_its_angle,
    ),
    "FAULT alone forbids, MOVING does not": Bug(
        where="guard.machine:Guard._require",
        old="if self._state in states:",
        new="if self._state is not State.FAULT:",
        check=nothing_fires_while_the_probe_moves,
    ),
    "< for != in the pulses fired": Bug(
        where="guard.machine:Guard.end_fire",
        old="fired != self._firing",
        new="fired < self._firing",
        check=more_pulses_than_permitted_are_a_fault,
    ),
    "a dose that is not counted": Bug(
        where="guard.permits:Permits.issue", old="self._pulses += pulses", new="pass", check=the_session_has_a_dose
    ),
    "arming leaves FAULT": Bug(
        where="guard.machine:Guard.arm",
        old="State.DISARMED, State.ARMED)",
        new="State.DISARMED, State.ARMED, State.FAULT)",
        check=only_a_person_leaves_fault,
    ),
    "a device's error swallowed by the state": Bug(
        where="scan.scanner:_Trusted.__exit__",
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
        old='yield Measured(role="search", index=count, sample=sample)\n            policy.tell(sample)',
        new='policy.tell(sample)\n            yield Measured(role="search", index=count, sample=sample)',
        check=the_record_comes_before_the_policy,
    ),
    "a move and a firing without the lease": Bug(
        where="scan.scanner:_Held.__enter__",
        old="self._dead_man.hold()",
        new="pass",
        check=devices_act_under_the_lease_alone,
    ),
    "a lease that any beat renews": Bug(
        where="guard.lease:Lease.beat",
        old="if step > self._step:",
        new="if True:",
        check=a_step_told_twice_renews_nothing,
    ),
    "beat from a timer thread": Bug(
        where="supervisor.client:Supervisor.beat",
        old="if self._held_by != threading.get_ident():",
        new="if False:",
        check=a_timer_cannot_stand_in_for_a_loop_that_hangs,
    ),
    "lines left as they were found": Bug(
        where="supervisor.keeper:Keeper.__init__",
        old="line.let_go()",
        new="pass",
        check=a_line_is_silenced_at_the_start,
    ),
    "cleanup left to the control process": Bug(
        where="supervisor.keeper:Keeper.run",
        old='self._let_go("the supervisor ends")',
        new="pass",
        check=a_line_is_silenced_after_death,
    ),
    "a lease that nobody looks at": Bug(
        where="supervisor.keeper:Keeper._turn",
        old="if ends_s is not None and self._lease.lapsed(now_s=now_s):",
        new="if False:",
        check=a_line_is_silenced_after_a_stop,
    ),
}

SEEDED: list[str] = []
"""Name of the bug that is in the code now; the supervisor's process is told."""


@pytest.mark.parametrize("name", BUGS)
def test_the_bug_is_caught_by_its_check(name: str) -> None:
    SEEDED.append(name)
    try:
        assert caught(BUGS[name])
    finally:
        SEEDED.pop()


@pytest.mark.parametrize("check", {bug.check for bug in BUGS.values()}, ids=lambda check: check.__name__)
def test_the_check_has_nothing_to_say_about_sound_code(check: Callable[[], None]) -> None:
    check()


def main() -> None:
    """Print the table, or be the supervisor that a check asks for, with a bug in it."""
    if sys.argv[1:2] == ["supervisor"]:
        _, _, name, *arguments = sys.argv
        sys.argv = ["supervisor", *arguments]
        from markerseek.supervisor.__main__ import main as supervise

        with seeded(BUGS[name]) if name else contextlib.nullcontext():
            sys.exit(supervise())
    print("| bug | where | caught by | |\n|---|---|---|---|")
    for name, bug in BUGS.items():
        SEEDED.append(name)
        print(*table({name: bug}))
        SEEDED.pop()
    print(*table(JOURNAL_BUGS), *table(DRIVER_BUGS), sep="\n")


if __name__ == "__main__":
    main()
