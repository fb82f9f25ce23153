"""The guard within a run: each device acts in its state and under the lease, nothing unarmed, nothing outside."""

from __future__ import annotations

import pytest

from markerseek.core import Finished, Frame, LimitError, Permit, RunPlan
from markerseek.guard import State
from markerseek.scan import Scanner, run
from tests.unit.scan.scan_bench import Bench, Tour, drain, kinds, scanner


@pytest.mark.parametrize("angle_deg", [35.001, -36.0, float("nan"), float("inf")])
def test_an_angle_outside_is_refused_before_anything_moves(angle_deg: float) -> None:
    bench = Bench()
    made = scanner(bench)
    drain(run(Tour(angle_deg), made), LimitError)
    assert bench.log == ["disarm", "stop"]
    # It is the policy's fault and not the rig's.
    assert made.guard.state is State.DISARMED


def states(bench: Bench, **changes: object) -> tuple[Scanner, list[str]]:
    """A scanner, and what the guard's state was at each verb of a device, the watchdog's among them."""
    seen: list[str] = []
    held = [False]

    class Watched(Bench):
        def _note(self, verb: str) -> None:
            seen.append(f"{verb} {made.guard.state.value}{' held' if held[0] else ''}")

        def move_to(self, angle_deg: float) -> float:
            self._note("move")
            return super().move_to(angle_deg)

        def arm(self, permit: Permit) -> None:
            self._note("arm")

        def fire(self, permit: Permit) -> int:
            self._note("fire")
            return super().fire(permit)

        def acquire(self, permit: Permit) -> Frame:
            self._note("acquire")
            return super().acquire(permit)

        def disarm(self) -> None:
            self._note("disarm")

        def stop(self) -> None:
            self._note("stop")

        def hold(self) -> None:
            held[0] = True

        def release(self) -> None:
            held[0] = False

    watched = Watched(**{name: getattr(bench, name) for name in bench.__dataclass_fields__})
    made = scanner(watched, watchdog=watched, **changes)
    return made, seen


def test_each_device_acts_in_its_state_and_under_the_lease() -> None:
    made, seen = states(Bench())
    events = list(run(Tour(0.0), made, RunPlan(stay=True)))
    assert isinstance(events[-1], Finished)
    assert seen == [
        "move moving held",
        "arm armed",
        "fire firing held",
        "acquire armed",
        "disarm disarmed",
        "stop disarmed",
    ]
    assert made.guard.state is State.DISARMED


def test_an_unarmed_guard_moves_and_fires_nothing() -> None:
    bench = Bench()
    made = scanner(bench, arms_itself=False)
    drain(run(Tour(0.0), made), LimitError)
    with pytest.raises(LimitError, match="not allowed to permit pulses"):
        made.measure_dark()
    assert bench.log == ["disarm", "stop"]
    made.guard.arm(by="a test")
    assert made.measure(0.0).angle_deg == 0.0


def test_a_run_leaves_the_guard_disarmed_and_the_next_needs_a_person() -> None:
    made = scanner(Bench(), arms_itself=False)
    made.guard.arm(by="a test")
    list(run(Tour(0.0), made, RunPlan(stay=True)))
    with pytest.raises(LimitError, match="arm it"):
        made.measure(0.0)


def test_a_probe_outside_its_travel_ends_the_run_before_it_begins() -> None:
    bench = Bench(angle_deg=-40.0)
    made = scanner(bench)
    events = drain(run(Tour(0.0), made), LimitError)
    assert kinds(events) == ["Failed"]
    assert made.guard.state is State.FAULT
    assert bench.log == ["disarm", "stop"]
