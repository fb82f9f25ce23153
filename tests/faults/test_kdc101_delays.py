"""A sound stage behind a busy computer, which holds up host, relay and emulator anywhere: no move is refused."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from markerseek.drivers import Kdc101Settings, Kdc101Stage
from markerseek.drivers.kdc101 import AptLine
from markerseek.emulators import EmulatedKdc101
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.sim import VirtualClock
from markerseek.wire import apt
from tests.faults.late_lines import DelayedBench, DelayedClock, Delays

MAX_S = (0.02, 0.05, 0.1)
SPEEDS = (1.0, 2.0, 5.0, 10.0, 20.0, 25.0)
ACCELERATIONS = (2.0, 5.0, 10.0, 20.0, 25.0)


def move_there(number: int, *, share: float, most_s: float | None = None, begin_s: float = 0.5) -> None:
    """Two moves of one stage, drawn at random with all that holds it up; raises if a sound one is refused.

    ``share``: of the steps of relay and emulator that are held up; of the host's steps a tenth of it. ``most_s``:
    longest time that a step is held up; drawn where it is None. ``begin_s``: how long a stage may stand before it is
    taken to be stuck.
    """
    rng = np.random.Generator(np.random.PCG64(number))
    start_deg, *targets_deg = rng.uniform(-34, 34, 3).tolist()
    most_s = most_s or float(rng.choice(MAX_S))
    clock = DelayedClock(Delays(rng=rng, share=share / 10, most_s=most_s))
    mirrored = number % 3 == 0
    emulated = EmulatedKdc101(play_deg=0.3, mirrored=mirrored, settle_deg=float(rng.choice((0.0, 0.02, 0.05))))
    emulator = Kdc101Emulator(probe=SimpleNamespace(angle_deg=start_deg), settings=emulated)
    port = DelayedBench(clock=clock, delays=Delays(rng=rng, share=share, most_s=most_s)).port(emulator)
    settings = Kdc101Settings(
        port="",
        zero_deg=0.0,
        speed_deg_s=float(rng.choice(SPEEDS)),
        acceleration_deg_s2=float(rng.choice(ACCELERATIONS)),
        approach_from="above" if number % 2 else "below",
        direction="reverse" if mirrored else "forward",
        begin_s=begin_s,
        # Silence longer than this ends a move, and is tested elsewhere: three ways of 0.1 s are within it.
        age_s=1.0,
    )
    stage = Kdc101Stage(port=port, clock=clock, settings=settings)
    for target_deg in targets_deg:
        assert stage.move_to(target_deg) == pytest.approx(target_deg, abs=0.011)


@pytest.mark.long
@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
def test_no_sound_move_is_refused_whatever_holds_it_up(share: float) -> None:
    for number in range(20):
        move_there(number, share=share)


def test_a_stage_that_receives_its_target_late_is_not_taken_to_be_stuck() -> None:
    """The relay holds back the target, and all questions after it, for longer than the stage may stand still."""
    for number in range(20):
        move_there(number, share=0.05, most_s=0.25, begin_s=0.1)


class LatePort:
    """Answers each question later by another time, in their order; what it answers with is the number of questions."""

    def __init__(self, clock: VirtualClock, late_s: list[float]) -> None:
        self._clock = clock
        self._late_s = iter(late_s)
        self._under_way: list[tuple[float, bytes]] = []
        self._questions = 0

    def write(self, data: bytes) -> None:
        self._questions += 1
        answer = apt.set_target(self._questions)
        answer = apt.TARGET.to_bytes(2, "little") + answer[2:4] + bytes((0x81, 0x50)) + answer[6:]
        self._under_way.append((self._clock.now_s() + next(self._late_s), answer))

    def read(self, size: int, *, timeout_s: float) -> bytes:
        now_s = self._clock.now_s()
        arrived = b"".join(data for due_s, data in self._under_way if due_s <= now_s)
        self._under_way = [(due_s, data) for due_s, data in self._under_way if due_s > now_s]
        return arrived

    def close(self) -> None:
        pass


def ask(line: AptLine) -> int:
    return line.ask(apt.ask(apt.TARGET), apt.TARGET, apt.Counts).counts


def test_an_answer_that_may_be_to_an_earlier_question_is_taken_to_be_as_old() -> None:
    clock = VirtualClock()
    line = AptLine(port=LatePort(clock, [0.15, 0.15, 0.15, 0.15, 0.0]), clock=clock, answer_s=0.1, age_s=0.3)
    assert ask(line) == 1
    assert line.since_s == 0.0
    # Asked again after 0.1 s: the answer to that comes after the next question.
    clock.wait(0.05)
    assert ask(line) == 2
    assert line.since_s == pytest.approx(0.1)
    assert ask(line) == 3
    assert line.since_s == pytest.approx(0.2)
    # Once nothing can be under way any more, an answer is to the question just asked.
    clock.wait(1.0)
    asked_s = clock.now_s()
    assert ask(line) == 5
    assert line.since_s == pytest.approx(asked_s)
