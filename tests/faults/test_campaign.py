"""The fault campaign in short, with its bound; `python -m tests.faults.campaign` is the long one."""

from __future__ import annotations

import math
import re
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import islice
from multiprocessing import get_context
from pathlib import Path

import pytest
from msgspec import structs

from markerseek.core import Found, Interval, Sweep
from markerseek.guard import Guard, State
from markerseek.sim import GaussianCurve

pytest.importorskip("serial", reason="the supervisor's lines need the extra devices")

from tests.faults.campaign import runs as campaign_runs  # type: ignore[import-not-found, unused-ignore]
from tests.faults.campaign.checker import OFF_DEG, check  # type: ignore[import-not-found, unused-ignore]
from tests.faults.campaign.faulty import HostKilled  # type: ignore[import-not-found, unused-ignore]
from tests.faults.campaign.held_lines import HeldLines  # type: ignore[import-not-found, unused-ignore]
from tests.faults.campaign.report import observable_keys, promises  # type: ignore[import-not-found, unused-ignore]
from tests.faults.campaign.tally import readings, summed, upper95  # type: ignore[import-not-found, unused-ignore]
from tests.faults.campaign.vocabulary import FAULTS, FaultKind  # type: ignore[import-not-found, unused-ignore]

RUNS = 1400
DOCS = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("page", ["validation/faults.md", "data/fault-tables.md"])
def test_b10_a_page_says_the_error_that_is_judged(page: str) -> None:
    rows = [line for line in (DOCS / page).read_text(encoding="utf-8").splitlines() if line.startswith("| P10 ")]
    assert rows
    assert all(f"off by more than {OFF_DEG:g}° (twice the tolerance of intensities" in row for row in rows)


@pytest.mark.long
def test_no_promise_is_broken_and_every_fault_that_acts_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    # In a process of its own, in which types and shapes are not checked: that halves its time. Warnings are errors.
    strict = {"initializer": warnings.simplefilter, "initargs": ("error",)}
    with ProcessPoolExecutor(1, mp_context=get_context("spawn"), **strict) as child:
        tally = child.submit(readings, 2, 0, RUNS).result()
    with capsys.disabled():
        sys.stdout.write("\n" + "\n".join(promises(tally)) + "\n")
    broken = [broken for broken in tally.broken if broken.promise != "P10"]
    assert broken == []
    single, swept = (summed(rows, observable_keys()) for rows in (tally.rows, tally.swept))
    assert tally.runs == RUNS
    assert single.acted > 0.5 * single.runs
    assert single.reported == single.acted
    assert single.off == tally.rows["none"].off == 0
    assert single.found > 100
    answered = tally.swept["none"]
    assert swept.runs > 5
    assert answered.found > 0.6 * answered.runs > 3


@pytest.mark.long
def test_the_long_campaign_counts_the_same_on_one_process_and_on_two() -> None:
    root = Path(__file__).parents[2]
    command = [sys.executable, "-m", "tests.faults.campaign", "--runs", "4"]
    pages = [
        subprocess.run([*command, "--workers", workers], cwd=root, capture_output=True, text=True, check=True).stdout
        for workers in ("2", "1")
    ]
    timed = re.compile(r"The slowest run took .* of real time")
    assert timed.sub("", pages[0]) == timed.sub("", pages[1])
    assert "| P1 | the probe never leaves its limits, nor the permit of its sweep when the host has died" in pages[0]
    assert ", in truth | 0 | 4 |" in pages[0]


def test_a_control_loop_that_hangs_is_cut_off_by_the_supervisor(tmp_path: Path) -> None:
    """In real time, unlike the rest: the lease of the supervisor's process lapses, and the search ends in FAULT."""

    def hang(_permit: object) -> None:
        nonlocal fired
        fired += 1
        if fired == 5:
            # Until it is cut off.
            assert lines.receives_safe_command(within_s=30.0)

    fired = 0
    plan = next(plan for plan in (campaign_runs.draw_plan(1, number) for number in range(500)) if not plan.faults)
    with HeldLines(period_s=0.1) as lines:
        send = lines.send_permit
        lines.send_permit = lambda permit: (send(permit), hang(permit))[0]
        trace = campaign_runs.Campaign(tmp_path, lines).perform(plan)
    assert fired == 5
    assert "released the devices" in str(trace.raised)
    assert trace.guard.state is State.FAULT
    assert len(trace.sent_permits) <= 5
    assert check(trace).broken == []


def test_a_computer_that_is_held_up_ends_no_run_of_the_campaign(
    healthy_plan: campaign_runs.Plan, tmp_path: Path
) -> None:
    """Unlike the one above: its runs are on virtual time, and the computer takes as long as it needs."""
    held_up = iter([1.3])
    with HeldLines() as lines:
        send = lines.send_permit
        lines.send_permit = lambda permit: (send(permit), time.sleep(next(held_up, 0.0)))[0]
        trace = campaign_runs.Campaign(tmp_path, lines).perform(healthy_plan)
    assert trace.raised is None
    assert check(trace).broken == []


ENDS: dict[str, dict[str, tuple[float, str]]] = {
    "at rest": {
        "stage NaN readback": (0.0, "the stage reads nan deg"),
        "stage stops short": (1.5, "the stage was sent to"),
        "laser fewer pulses": (1.0, "pulses, 21 were permitted"),
        "receiver NaN": (0.0, "stale frame"),
        "receiver saturated": (0.5, "saturated: 50% of the channels"),
        "receiver old frames": (6.0, "the limit of age is 5.0 s"),
    },
    "streaming": {
        "stage late readings": (0.25, "the probe turned by"),
        "stage stall": (0.0, "the probe stopped at"),
        "stage fast": (2.0, "the probe turned by"),
        "stage slow": (20.0, "has not begun the sweep"),
        "laser clock step": (1.0, "its clock is wrong"),
        "laser dead lamp": (0.0, "no pulse came"),
        "laser hidden misfire": (1.0, "no angle is known"),
        "laser extra pulses": (1.0, "pulses have a time"),
        "receiver lost frames": (0.3, "a trigger was lost or doubled"),
        "receiver trigger lost": (0.0, "no angle is known"),
        "receiver trigger doubled": (0.0, "stale frame"),
    },
    "in bursts": {
        "receiver lost frames": (0.3, "a trigger was lost or doubled"),
        "receiver trigger lost": (0.0, "no angle is known"),
        "receiver trigger doubled": (0.0, "no angle is known"),
    },
}
"""By rig: a fault from the first step on, how much of it, and what the run that it ends says."""


def sound_plan(rig: str) -> campaign_runs.Plan:
    """A plan without a fault; one of sweeps begins with a long one."""
    for plan in (campaign_runs.draw_plan(2, number) for number in range(5000)):
        if plan.faults or plan.marker_deg is None:
            continue
        if rig == "at rest" and plan.method == "golden-section":
            return plan
        if plan.method == campaign_runs.SWEEPS and rig == ("in bursts" if plan.readout_s > 0.1 else "streaming"):
            first = campaign_runs.Sweeps(plan, fastest_deg_s=10.0).ask()
            if isinstance(first, Sweep) and abs(first.to_deg - plan.start_deg) > 20:
                return replace(plan, dies_at=None)
    raise AssertionError


@pytest.mark.parametrize("rig", ENDS)
def test_a_fault_ends_a_run_by_its_name_and_breaks_no_promise(rig: str, tmp_path: Path) -> None:
    plan = sound_plan(rig)
    with HeldLines() as lines:
        for name, (amount, words) in ENDS[rig].items():
            device, _, fault = name.partition(" ")
            held = replace(FAULTS[device, fault], amount=amount, from_step=1)
            trace = campaign_runs.Campaign(tmp_path, lines).perform(replace(plan, faults=(held,)))
            assert words in str(trace.raised), name
            assert check(trace).broken == [], name
            assert trace.guard.state is (State.DISARMED if fault == "saturated" else State.FAULT), name


def test_each_device_fails_in_each_of_the_seven_ways() -> None:
    ways = {(each.device, each.kind) for each in FAULTS.values()}
    assert ways == {(device, kind) for device in ("stage", "laser", "receiver") for kind in FaultKind}
    assert all(each.covered_by for each in FAULTS.values() if each.harm != "none")


def test_the_bound_is_the_rule_of_three_where_nothing_was_seen() -> None:
    assert upper95(0, 100_000) == pytest.approx(-math.log(0.05) / 100_000, rel=1e-4)
    assert upper95(0, 3_000) < 1e-3
    assert upper95(5, 100) == pytest.approx(0.10225, abs=1e-4)


@pytest.fixture
def healthy_plan() -> campaign_runs.Plan:
    plan = next(plan for plan in (campaign_runs.draw_plan(1, number) for number in range(500)) if not plan.faults)
    return replace(plan, method="golden-section", acquisitions=16)


@pytest.fixture
def healthy(healthy_plan: campaign_runs.Plan, tmp_path: Path) -> campaign_runs.Trace:
    with HeldLines() as lines:
        return campaign_runs.Campaign(tmp_path, lines).perform(healthy_plan)


def seen(trace: campaign_runs.Trace) -> set[str]:
    return {promise for promise, _ in check(trace).broken}


def test_the_checker_sees_each_broken_promise_and_nothing_in_a_healthy_run(
    healthy: campaign_runs.Trace,
) -> None:
    world = healthy.world
    lights = world.lights
    received = world.received
    assert seen(healthy) == set()
    for name, value, promise in (
        ("highest_deg", healthy.plan.limits.travel.high_deg + 0.2, "P1"),
        ("lights", [*lights, replace(lights[-1], pulses=1)], "P3"),
        ("lights", [*lights[:-1], replace(lights[-1], moving=True)], "P3"),
        *(
            ("received", [*received[:-1], replace(received[-1], **change)], "P6")
            for change in ({"token": "x"}, {"intensity": 1.0}, {"angle_deg": 80.0}, {"pulses": 1})
        ),
    ):
        before = getattr(world, name)
        setattr(world, name, value)
        assert seen(healthy) == {promise}
        setattr(world, name, before)
    for changes, promise in (
        ({"sent_permits": (*healthy.sent_permits, ("permit-99", 1))}, "P3"),
        ({"acted": (replace(FAULTS["stage", "stall"], from_step=1),)}, "P6"),
        ({"left_fault": True}, "P7"),
        ({"virtual_s": 1e5}, "P8"),
        ({"journal": replace(healthy.journal, entries=healthy.journal.entries[:-1])}, "P8"),
    ):
        assert seen(replace(healthy, **changes)) == {promise}


def sound_sweeps() -> Iterator[campaign_runs.Plan]:
    """Plans with sweeps and without a fault."""
    for number in range(2000):
        plan = campaign_runs.draw_plan(2, number)
        if plan.method == campaign_runs.SWEEPS and not plan.faults:
            yield replace(plan, dies_at=None)


def test_sweeps_without_a_fault_end_with_an_answer(tmp_path: Path) -> None:
    with HeldLines() as lines:
        campaign = campaign_runs.Campaign(tmp_path, lines)
        traces = [campaign.perform(plan) for plan in islice(sound_sweeps(), 6)]
    assert all(trace.raised is None for trace in traces)
    # Some plans ask for angles alone.
    assert sum(bool(trace.sweeps) for trace in traces) >= 3
    assert set().union(*map(seen, traces)) == set()


def test_a_host_that_dies_in_mid_sweep_leaves_the_probe_in_its_permit_and_the_checker_sees_where_not(
    tmp_path: Path,
) -> None:
    with HeldLines() as lines:
        campaign = campaign_runs.Campaign(tmp_path, lines)
        traces = (campaign.perform(replace(plan, dies_at=20)) for plan in sound_sweeps())
        trace = next(trace for trace in traces if trace.left_deg)
    assert seen(trace) == set()
    assert trace.left_deg[0] != trace.left_deg[-1] == trace.left_deg[-2]
    permit, began_s = trace.sweeps[-1]
    late = [light for light in trace.world.lights if light.sweeping and light.at_s > began_s]
    assert late
    low_deg, *_, high_deg = sorted((permit.angle_deg, permit.to_deg, permit.end_deg))
    for beyond_deg in (low_deg - 0.3, high_deg + 0.3):
        assert seen(replace(trace, left_deg=(*trace.left_deg, beyond_deg))) == {"P1"}


def test_the_checker_sees_light_that_no_sweep_permits(tmp_path: Path) -> None:
    plan = next(sound_sweeps())
    with HeldLines() as lines:
        trace = campaign_runs.Campaign(tmp_path, lines).perform(plan)
    assert seen(trace) == set()
    lights = trace.world.lights
    index = next(index for index, light in enumerate(lights) if light.sweeping)
    (permit, _) = trace.sweeps[0]
    late_s = 1e3
    for change in (
        {"angle_deg": max(permit.angle_deg, permit.to_deg) + 2.0},
        {"at_s": lights[index].at_s - late_s},
        {"at_s": lights[index + 1].at_s - permit.period_s / 2},
        {"pulses": 2},
        {"moving": True},
    ):
        trace.world.lights = [*lights[:index], replace(lights[index], **change), *lights[index + 1 :]]
        assert seen(trace) == {"P3"}, change


def test_the_checker_sees_light_after_the_end_after_a_fault_and_on_a_probe_that_stands_or_runs(tmp_path: Path) -> None:
    """By the truth alone: the guard's permits allow all of it."""
    plan = next(sound_sweeps())
    with HeldLines() as lines:
        trace = campaign_runs.Campaign(tmp_path, lines).perform(plan)
    assert seen(trace) == set()
    world = trace.world
    lights = world.lights
    swept = [light for light in lights if light.sweeping]
    world.lights = [*lights, replace(swept[-1], at_s=trace.ended_s + 0.05)]
    assert "P2" in seen(trace)
    # The laser cannot be told, and its lease ends the light.
    unplugged = replace(FAULTS["laser", "unplugged"], from_step=1)
    assert "P2" not in seen(replace(trace, acted=(unplugged,)))
    world.lights = lights
    fault_s = swept[-1].at_s - 0.4
    assert sum(light.at_s > fault_s + 0.31 for light in swept) > 0
    assert seen(replace(trace, fault_s=fault_s)) == {"P2"}
    first = lights.index(swept[5])
    for turn in (0.0, 3.0):
        # For half a second it stands, or turns three times as fast as was asked for.
        begins = lights[first]
        held = [
            replace(light, angle_deg=begins.angle_deg + turn * (light.angle_deg - begins.angle_deg))
            if begins.at_s <= light.at_s < begins.at_s + 1.4
            else light
            for light in lights
        ]
        world.lights = held
        assert seen(trace) == {"P3"}, turn


def test_light_after_the_death_of_the_host_is_judged_by_its_lease_alone(tmp_path: Path) -> None:
    """The host of this run dies as a sweep comes to rest, so that the last pulses fall on a probe that stands."""
    with HeldLines() as lines:
        trace = campaign_runs.Campaign(tmp_path, lines).perform(campaign_runs.draw_plan(1, 90994))
    assert isinstance(trace.raised, HostKilled)
    assert trace.world.lights[-1].at_s - trace.ended_s == pytest.approx(campaign_runs.LEASE_S, abs=0.1)
    assert seen(trace) == set()
    trace.world.lights = [replace(light, at_s=light.at_s + 0.3) for light in trace.world.lights]
    assert "P2" in seen(trace)


def test_a_search_by_sweeps_answers_in_the_campaign_and_is_judged_by_the_marker(
    tmp_path: Path,
) -> None:
    plan = next(plan for plan in sound_sweeps() if plan.readout_s < 0.1)
    curve = GaussianCurve(fwhm_deg=6.0)
    plan = replace(plan, method=campaign_runs.SWEPT_POSTERIOR, marker_deg=4.0, curve=curve, peak_snr_db=45.0)
    with HeldLines() as lines:
        trace = campaign_runs.Campaign(tmp_path, lines).perform(plan)
    verdict = check(trace)
    assert (verdict.found, verdict.off, verdict.covered, verdict.broken) == (True, False, True, [])
    assert check(replace(trace, plan=replace(plan, marker_deg=1.5))).off


def test_the_checker_sees_a_wrong_angle(healthy: campaign_runs.Trace) -> None:
    last = healthy.journal.entries[-1]
    for off_deg, wrong in ((1.9, False), (2.1, True)):
        mean_deg = (healthy.plan.marker_deg or 0.0) + off_deg
        found = Found(
            mean_deg=mean_deg, sigma_deg=0.1, interval95_deg=Interval(low_deg=-1, high_deg=1), interval_kind="bracket"
        )
        ended = structs.replace(last, event=structs.replace(last.event, estimate=found))
        verdict = check(
            replace(healthy, journal=replace(healthy.journal, entries=(*healthy.journal.entries[:-1], ended)))
        )
        assert (verdict.found, verdict.off) == (True, wrong)


def test_a_guard_that_leaves_fault_by_itself_is_noticed(monkeypatch: pytest.MonkeyPatch, healthy) -> None:
    guard = healthy.guard
    guard.fail("a test")
    assert not campaign_runs.leaves_fault(guard)
    monkeypatch.setattr(Guard, "disarm", lambda self: setattr(self, "_state", State.DISARMED))
    assert campaign_runs.leaves_fault(guard)
