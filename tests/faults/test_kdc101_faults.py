"""Every fault of the emulated stage against its driver: refused by name, within limits, never a wrong angle."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

from markerseek.core import (
    DeviceError,
    DeviceTimeoutError,
    LimitError,
    MoveError,
    NotConnectedError,
)
from markerseek.drivers import Kdc101Stage
from markerseek.emulators import EmulatedKdc101
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.sim import VirtualClock
from markerseek.wire import apt
from tests.emulated_lines import DirectPort, FaultyLine

PLAY_DEG = 0.1
TARGETS = (-35.0, 35.0, 12.3, -7.0, 20.5)


@dataclass(kw_only=True)
class Outcome:
    """The result of a tour under a fault."""

    error: DeviceError | None
    misses_deg: list[float]
    truth_deg: tuple[float, float]
    lead_deg: float
    elapsed_s: float


def tour(
    name: str | None = None,
    amount: float | None = None,
    *,
    from_step: int = 0,
    line: FaultyLine | None = None,
    targets: tuple[float, ...] = TARGETS,
) -> Outcome:
    """Connect, go from target to target until something is refused, and leave the stage alone for a while.

    ``name``, ``amount``, ``line``: fault of the stage, or of its line, from a step on.
    """
    clock = VirtualClock()
    probe = SimpleNamespace(angle_deg=0.0)
    emulator = Kdc101Emulator(probe=probe, settings=EmulatedKdc101(play_deg=PLAY_DEG))
    if name is not None:
        emulator.faults.inject(name, amount, from_step=from_step)
    line = line or FaultyLine()
    line.holds = lambda: emulator.moves >= from_step
    misses: list[float] = []
    error: DeviceError | None = None
    try:
        stage = Kdc101Stage(port=DirectPort(device=emulator, clock=clock, line=line), clock=clock)
        for target in targets:
            reached = stage.move_to(target)
            assert abs(reached - target) <= 0.01
            clock.wait(0.3)  # an acquisition
            assert abs(stage.angle_deg - reached) <= 0.01
            misses.append(probe.angle_deg - reached)
    except DeviceError as refusal:
        error = refusal
    elapsed_s = clock.now_s()
    emulator.advance(elapsed_s + 20.0)
    return Outcome(
        error=error,
        misses_deg=misses,
        truth_deg=emulator.truth_range_deg,
        lead_deg=emulator.largest_lead_deg,
        elapsed_s=elapsed_s,
    )


REFUSED: dict[str, tuple[type[DeviceError] | tuple[type[DeviceError], ...], str]] = {
    "silent": (DeviceTimeoutError, "no answer"),
    "power cut": (DeviceTimeoutError, "no answer"),
    "power cycle": (MoveError, "homed"),
    "stall": (MoveError, "motion error"),
    "frozen motor": (MoveError, "did not begin"),
    "frozen readback": (MoveError, "did not begin"),
    "obstacle": (MoveError, "motion error"),
    "says it is there": (MoveError, "faster than"),
    "says done": (MoveError, "did not begin"),
    "readback jump": ((MoveError, LimitError), "not on its way|faster than|left its travel"),
    "jump on its way": (MoveError, "fell back|its acceleration allows|faster than|not on its way"),
    "overshoot": (MoveError, "not on its way"),
    "too fast": (MoveError, "faster than"),
    "slow": (MoveError, "too slow"),
}
"""Fault to the error that names it."""


@pytest.mark.parametrize("from_step", [0, 4])
@pytest.mark.parametrize("name", sorted(REFUSED))
def test_a_fault_is_refused_by_name_and_does_no_harm(name: str, from_step: int) -> None:
    outcome = tour(name, from_step=from_step)
    error, words = REFUSED[name]
    assert isinstance(outcome.error, error)
    assert any(word in str(outcome.error) for word in words.split("|"))
    require_harmless(outcome)


@pytest.mark.parametrize(("amount", "words"), [(-0.5, "fell back by"), (-0.2, "its acceleration allows")])
def test_an_encoder_that_loses_half_a_degree_fell_back_and_one_that_loses_less_slowed_down_too_soon(
    amount: float, words: str
) -> None:
    outcome = tour("jump on its way", amount, targets=(20.0,))
    assert isinstance(outcome.error, MoveError)
    assert words in str(outcome.error)


@pytest.mark.parametrize("from_step", [0, 4])
@pytest.mark.parametrize("bad", [{"late_s": 0.4}, {"cut": 0.3}], ids=str)
def test_a_line_that_is_late_or_drops_out_is_refused_and_does_no_harm(bad: dict[str, float], from_step: int) -> None:
    outcome = tour(line=FaultyLine(**bad), from_step=from_step)  # type: ignore[arg-type]
    assert isinstance(outcome.error, DeviceTimeoutError)
    assert "no answer" in str(outcome.error)
    require_harmless(outcome)


@pytest.mark.parametrize("share", [1e-3, 1e-2, 1e-1])
@pytest.mark.parametrize("name", ["answers", "commands", "lost"])
def test_a_bad_line_gives_the_right_angle_or_none(name: str, share: float) -> None:
    line = FaultyLine(**{name: share}, seed=1)  # type: ignore[arg-type]
    require_harmless(tour(line=line, from_step=1, targets=TARGETS[:3]))


def test_a_byte_lost_now_and_then_does_not_end_a_search() -> None:
    outcome = tour(line=FaultyLine(lost=3e-4, seed=3))
    assert outcome.error is None
    assert len(outcome.misses_deg) == len(TARGETS)


def test_a_stage_that_reports_done_before_it_moves_is_waited_for() -> None:
    outcome = tour("done too early")
    assert outcome.error is None
    require_harmless(outcome)
    late = tour("done too early", 1.0)
    assert isinstance(late.error, MoveError)
    require_harmless(late)


def test_a_stage_that_reports_rest_is_not_believed_before_its_angle_is_steady() -> None:
    outcome = tour("hides its moves", targets=tuple(np.linspace(-35, 35, 15).tolist()))
    assert outcome.error is None
    # Where it was read is where it came to rest, to the count.
    assert max(abs(miss) for miss in outcome.misses_deg) <= 1.5 / apt.COUNTS_PER_DEG
    require_harmless(outcome)


def test_a_stage_that_does_not_stop_is_reported_as_moving() -> None:
    clock = VirtualClock()
    probe = SimpleNamespace(angle_deg=0.0)
    emulator = Kdc101Emulator(probe=probe)
    port = DirectPort(device=emulator, clock=clock)
    stage = Kdc101Stage(port=port, clock=clock)
    emulator.faults.inject("ignores stop")
    port.write(apt.set_target(apt.counts_of(30.0)) + apt.move())
    clock.wait(0.5)
    with pytest.raises(MoveError, match="cut its power"):
        stage.stop()
    emulator.faults.heal()
    stage.stop()
    there = probe.angle_deg
    clock.wait(5.0)
    emulator.advance(clock.now_s())
    assert probe.angle_deg == there


@pytest.mark.parametrize(("late_s", "most_deg"), [(0.0, 0.02), (0.02, 0.05), (0.05, 0.1)])
def test_a_stage_that_only_reports_arrival_is_not_believed_over_short_moves_either(
    late_s: float, most_deg: float
) -> None:
    """Way by way: what it would be off by, and whether that is noticed, also where the answers come late."""
    said = {way_deg: _lie(way_deg, late_s=late_s, lies=True) for way_deg in np.linspace(0.005, 1.2, 40).tolist()}
    assert max((way_deg for way_deg, refusal in said.items() if refusal is None), default=0.0) <= most_deg
    assert all("faster than" in str(refusal) for refusal in said.values() if refusal is not None)


@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.09, 0.12])
def test_a_sound_stage_is_believed_however_late_its_answers_are(late_s: float) -> None:
    for way_deg in np.linspace(-1.3, 1.3, 14).tolist():
        assert _lie(way_deg, late_s=late_s, lies=False) is None


def _lie(way_deg: float, *, late_s: float, lies: bool) -> DeviceError | None:
    """The refusal of a short move that a stage claims to have made; None if it is accepted."""
    clock = VirtualClock()
    probe = SimpleNamespace(angle_deg=-1.5)
    emulator = Kdc101Emulator(probe=probe, settings=EmulatedKdc101(play_deg=0.0))
    line = FaultyLine(late_s=late_s)
    stage = Kdc101Stage(port=DirectPort(device=emulator, clock=clock, line=line), clock=clock)
    stage.move_to(0.0)
    if lies:
        emulator.faults.inject("says it is there")
    try:
        stage.move_to(way_deg)
    except MoveError as refusal:
        return refusal
    return None


def require_harmless(outcome: Outcome) -> None:
    """The probe never left its limits, no target was far ahead, every angle reported was true, and it ended."""
    low_deg, high_deg = outcome.truth_deg
    assert low_deg >= -36.5
    assert high_deg <= 36.5
    assert outcome.lead_deg <= 5.0
    assert all(abs(miss) <= 0.01 for miss in outcome.misses_deg)
    assert not isinstance(outcome.error, NotConnectedError) or not outcome.misses_deg
    assert outcome.elapsed_s <= 120.0
