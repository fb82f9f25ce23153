"""A permit for motion: angles, direction, speeds, pulses, readings of the stage, and one frame a pulse."""

from __future__ import annotations

import math

import pytest
from msgspec import structs

from markerseek.core import (
    SWEEP_READING_S,
    AcquisitionError,
    ConfigError,
    FrameHeader,
    LaserError,
    LimitError,
    MoveError,
    Reading,
    ReadingFrame,
    SweepPermit,
)
from markerseek.guard import FiringLimits, Guard, Permits, State
from tests.unit.guard.guards import WANTED, armed

BACK = structs.replace(WANTED, angle_deg=30.0, to_deg=-30.0)
THERE_AND_BACK = structs.replace(WANTED, angle_deg=28.0, back_deg=26.0)


def sweeping(wanted: SweepPermit = WANTED, *, now_s: float = 10.0) -> tuple[Guard, SweepPermit]:
    """A guard whose sweep begins at that time."""
    made = armed()
    permit = made.issue_sweep(wanted, now_s=now_s)
    made.redeem(permit, angle_deg=wanted.angle_deg, now_s=now_s)
    return made, permit


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"to_deg": -30.0}, "from -30.0 to -30.0 deg, these must be two different angles"),
        ({"to_deg": math.nan}, "two different angles"),
        ({"angle_deg": math.inf}, "two different angles"),
        ({"slowest_deg_s": 0.0}, "slowest_deg_s"),
        ({"slowest_deg_s": 12.1}, "slowest_deg_s"),
        ({"slowest_deg_s": math.nan}, "slowest_deg_s"),
        ({"fastest_deg_s": math.inf}, "fastest_deg_s"),
        ({"period_s": 0.0}, "period_s"),
        ({"back_deg": 30.0}, "from -30.0 to 30.0 and back to 30.0 deg, it must turn back there"),
        ({"back_deg": 31.0}, "it must turn back there"),
        ({"back_deg": math.nan}, "it must turn back there"),
    ],
)
def test_a_permit_that_bounds_nothing_is_refused(changes: dict[str, float], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        structs.replace(WANTED, **changes)


def test_a_sweep_permit_says_what_a_frame_of_it_is() -> None:
    assert (WANTED.forward, BACK.forward) == (1.0, -1.0)
    assert (WANTED.pulses_in_frame, WANTED.commanded_deg) == (1, 30.0)
    assert WANTED.turned_deg == pytest.approx(12.0 * SWEEP_READING_S)
    assert WANTED.pulses_in_1_s == 20
    assert structs.replace(WANTED, pulses=7).pulses_in_1_s == 7


def test_a_sweep_permit_is_issued_with_a_token_and_its_expiry_and_counted() -> None:
    permits = Permits(FiringLimits(lifetime_s=5.0, pulses_per_sweep=100))
    first = permits.issue_sweep(WANTED, now_s=10.0)
    assert first == structs.replace(WANTED, token="permit-1", expires_s=15.0)
    assert permits.pulses_permitted == 100
    permits.redeem(first, now_s=15.0)
    with pytest.raises(LimitError) as refusal:
        permits.issue_sweep(structs.replace(WANTED, pulses=101), now_s=10.0)
    assert str(refusal.value) == "101 pulses under one permit; the limit is 100: ask for fewer"
    with pytest.raises(LaserError, match="is not open"):
        permits.redeem(first, now_s=15.0)


def test_a_sweep_may_have_more_pulses_than_one_acquisition() -> None:
    assert Permits(FiringLimits()).issue_sweep(structs.replace(WANTED, pulses=10_000), now_s=0.0).pulses == 10_000


def test_the_rate_of_a_sweep_counts_when_it_begins_and_when_it_ends() -> None:
    permits = Permits(FiringLimits(pulses_per_second=30))
    permits.redeem(permits.issue_sweep(WANTED, now_s=0.0), now_s=0.0)
    with pytest.raises(LimitError, match="20 pulses within a second and 11 more"):
        permits.redeem(permits.issue(angle_deg=0.0, pulses=11, now_s=0.5), now_s=0.5)
    permits.redeem(permits.issue(angle_deg=0.0, pulses=10, now_s=1.0), now_s=1.0)
    made = armed(firing=FiringLimits(pulses_per_second=30))
    made.redeem(made.issue_sweep(WANTED, now_s=0.0), angle_deg=-30.0, now_s=0.0)
    for step in range(1, 21):
        made.read_sweep(-30.0, now_s=0.1 * step)
    made.end_sweep(-30.0, pulses=20, now_s=2.1)
    permit = made.issue(angle_deg=-30.0, pulses=11, now_s=3.0)
    with pytest.raises(LimitError, match="20 pulses within a second and 11 more"):
        made.redeem(permit, angle_deg=-30.0, now_s=3.0)
    permit = made.issue(angle_deg=-30.0, pulses=11, now_s=3.2)
    made.redeem(permit, angle_deg=-30.0, now_s=3.2)


@pytest.mark.parametrize(("to_deg", "back_deg"), [(35.01, None), (-35.01, None), (35.01, 0.0), (30.0, -35.01)])
def test_a_sweep_beyond_the_search_range_is_refused_and_changes_nothing(to_deg: float, back_deg: float | None) -> None:
    made = armed()
    with pytest.raises(LimitError, match="outside the search range"):
        made.issue_sweep(structs.replace(WANTED, to_deg=to_deg, back_deg=back_deg), now_s=0.0)
    assert made.pulses_permitted == 0
    assert made.state is State.ARMED


def test_a_sweep_begins_where_its_permit_says() -> None:
    made = armed()
    permit = made.issue_sweep(WANTED, now_s=0.0)
    with pytest.raises(MoveError, match="the permit holds at"):
        made.redeem(permit, angle_deg=-29.8, now_s=0.0)
    assert made.state is State.FAULT


def test_a_readback_that_is_no_number_ends_a_sweep() -> None:
    made, _ = sweeping()
    with pytest.raises(LimitError, match="outside its travel range"):
        made.read_sweep(math.nan, now_s=10.1)
    assert made.state is State.FAULT


def test_a_sweep_goes_through_its_states() -> None:
    made, _ = sweeping()
    assert made.state is State.SWEEPING
    assert not made.read_sweep(-29.95, now_s=10.1)
    assert made.read_sweep(-29.0, now_s=10.2)
    assert made.read_sweep(-28.0, now_s=10.3)
    assert not made.read_sweep(-27.9, now_s=10.4)
    made.end_sweep(-27.85, pulses=3, now_s=10.5)
    assert made.state is State.ARMED
    assert made.fault is None
    made.admit_sweep(3)


@pytest.mark.parametrize(("turned_deg", "lit"), [(0.25, True), (0.2499, False), (0.0, False), (-0.09, False)])
def test_the_probe_is_lit_only_as_fast_as_permitted(turned_deg: float, lit: bool) -> None:
    made, _ = sweeping(now_s=0.0)
    made.read_sweep(-29.0, now_s=0.125)
    # 2 deg/s for 0.125 s; powers of two, so that no rounding decides.
    assert made.read_sweep(-29.0 + turned_deg, now_s=0.25) == lit
    assert made.state is State.SWEEPING


@pytest.mark.parametrize(
    ("turned_deg", "elapsed_s"),
    [
        # 12 deg/s for 0.125 s, and 0.1 deg that two readings may differ by.
        (1.61, 0.125),
        (-0.11, 0.125),
        (0.0, 0.0),
        (1.0, -0.01),
        (1.0, SWEEP_READING_S + 0.001),
        (0.5, math.nan),
    ],
)
def test_a_reading_too_far_backwards_or_late_is_a_fault(turned_deg: float, elapsed_s: float) -> None:
    made, permit = sweeping(now_s=0.0)
    made.read_sweep(-29.5, now_s=0.1)
    with pytest.raises(MoveError) as refusal:
        made.read_sweep(-29.5 + turned_deg, now_s=0.1 + elapsed_s)
    why = f"the probe turned by {turned_deg:.3f} deg in {elapsed_s:.3f} s to {-29.5 + turned_deg:.3f} deg"
    when = f"at {0.1 + elapsed_s:.3f} s, outside {permit.words}; check stage and host"
    assert str(refusal.value) == f"{why} {when}"
    assert made.state is State.FAULT
    assert made.fault == str(refusal.value)


@pytest.mark.parametrize("angle_deg", [30.125, 28.375, 29.875, -30.125])
def test_the_limits_themselves_are_allowed(angle_deg: float) -> None:
    made = armed(arrival_deg=0.125)
    before_deg = {30.125: 29.5, 28.375: 26.75, 29.875: 30.0, -30.125: -30.0}[angle_deg]
    from_deg = min(before_deg, 0.0) if angle_deg < 0 else before_deg
    permit = made.issue_sweep(structs.replace(WANTED, angle_deg=min(from_deg, 29.5)), now_s=0.0)
    made.redeem(permit, angle_deg=permit.angle_deg, now_s=0.0)
    if before_deg == 30.0:
        made.read_sweep(before_deg, now_s=0.0625)
        made.read_sweep(angle_deg, now_s=0.125)
    else:
        made.read_sweep(angle_deg, now_s=0.125)
    assert made.state is State.SWEEPING


def read(guard: Guard, *angles_deg: float) -> list[bool]:
    """What the guard says to readings 0.125 s apart from time 0 on; powers of two, so that no rounding decides."""
    return [guard.read_sweep(angle_deg, now_s=0.125 * (1 + step)) for step, angle_deg in enumerate(angles_deg)]


def test_a_probe_that_rests_where_it_turns_is_lit_for_a_second() -> None:
    made, _ = sweeping(THERE_AND_BACK, now_s=0.0)
    # It is there 0.25 s after the beginning: up to 1.25 s, and no longer.
    lit = read(made, 29.0, *[30.0] * 10)
    assert lit == [True] * 10 + [False]
    assert made.state is State.SWEEPING


@pytest.mark.parametrize("mirrored", [1, -1])
def test_a_sweep_that_turns_back_is_slow_only_where_it_turns_and_goes_the_other_way_from_there(mirrored: int) -> None:
    wanted = structs.replace(
        THERE_AND_BACK,
        angle_deg=mirrored * 28.0,
        to_deg=mirrored * 30.0,
        back_deg=mirrored * 26.0,
    )
    made, _ = sweeping(wanted, now_s=0.0)
    # Slow at its beginning, on its way, at the turn, and at its end: only the turn may be slow.
    ways = (28.0, 28.5, 28.5, 29.75, 29.95, 30.0, 30.05, 30.0, 29.875, 29.5, 29.5, 28.0, 27.0, 26.0, 26.0, 25.95)
    lit = (False, True, False, True, True, True, True, True, True, True, False, True, True, True, False, False)
    assert read(made, *(mirrored * angle_deg for angle_deg in ways)) == list(lit)
    made.end_sweep(mirrored * 25.95, pulses=3, now_s=17 * 0.125)
    assert made.state is State.ARMED


@pytest.mark.parametrize(
    ("way_deg", "said"),
    [
        # Back before it was there, and on instead of back.
        ((29.0, 29.85, 29.7), "turned by -0.150 deg"),
        ((29.0, 29.95, 30.11), "to 30.110 deg"),
        ((29.0, 29.95, 29.0, 29.2), "turned by -0.200 deg"),
        ((29.0, 29.95, 29.0, 28.0, 27.0, 26.0, 25.89), "to 25.890 deg"),
        # Too fast on the way back.
        ((29.0, 30.0, 28.39), "turned by 1.610 deg"),
    ],
)
def test_a_sweep_that_turns_elsewhere_or_leaves_its_permit_on_the_way_back_is_a_fault(
    way_deg: tuple[float, ...], said: str
) -> None:
    made, _ = sweeping(THERE_AND_BACK, now_s=0.0)
    read(made, *way_deg[:-1])
    with pytest.raises(MoveError, match=said):
        made.read_sweep(way_deg[-1], now_s=0.125 * len(way_deg))
    assert made.state is State.FAULT


@pytest.mark.parametrize(("at_deg", "turns"), [(29.875, True), (29.8125, False), (30.125, True)])
def test_it_may_turn_within_the_arrival_of_the_angle_where_it_turns(at_deg: float, turns: bool) -> None:
    made = armed(arrival_deg=0.125)
    made.redeem(made.issue_sweep(THERE_AND_BACK, now_s=0.0), angle_deg=28.0, now_s=0.0)
    read(made, 29.0, at_deg)
    assert made.read_sweep(at_deg, now_s=0.375) == turns


def test_a_permit_that_does_not_turn_back_is_never_slow_and_lit() -> None:
    made, _ = sweeping(structs.replace(WANTED, angle_deg=28.0), now_s=0.0)
    assert read(made, 29.0, 30.0, 30.0, 29.95) == [True, True, False, False]
    with pytest.raises(MoveError):
        made.read_sweep(29.5, now_s=0.625)


def test_a_reading_may_come_as_late_as_the_guard_allows() -> None:
    made, _ = sweeping(now_s=0.0)
    assert not made.read_sweep(-30.0, now_s=SWEEP_READING_S)


def test_a_sweep_does_not_creep_away_from_its_beginning() -> None:
    made, _ = sweeping(now_s=0.0)
    made.read_sweep(-30.09, now_s=0.1)
    with pytest.raises(MoveError):
        made.read_sweep(-30.11, now_s=0.2)


def test_a_sweep_permit_expires_on_the_way() -> None:
    made = armed(firing=FiringLimits(lifetime_s=0.25))
    permit = made.issue_sweep(WANTED, now_s=0.0)
    made.redeem(permit, angle_deg=-30.0, now_s=0.125)
    made.read_sweep(-29.5, now_s=0.25)
    with pytest.raises(MoveError):
        made.read_sweep(-29.0, now_s=0.251)


def test_a_sweep_ends_at_rest() -> None:
    made, _ = sweeping()
    made.read_sweep(-29.0, now_s=10.1)
    with pytest.raises(MoveError) as refusal:
        made.end_sweep(-28.8, pulses=3, now_s=10.2)
    assert str(refusal.value) == (
        "the sweep ended at -29.000 deg and the probe is at -28.800 deg, more than 0.1 deg away; "
        "the stage does not stop"
    )
    assert made.state is State.FAULT


@pytest.mark.parametrize("pulses", [101, -1, 3.0, None])
def test_more_pulses_than_permitted_or_none_at_all_known_is_a_fault(pulses: int) -> None:
    made, _ = sweeping()
    with pytest.raises(LaserError) as refusal:
        made.end_sweep(-30.0, pulses=pulses, now_s=10.1)
    assert str(refusal.value) == (
        f"the laser fired {pulses} pulses, 100 were permitted; check the laser and its trigger"
    )
    assert made.state is State.FAULT


@pytest.mark.parametrize("pulses", [0, 100])
def test_a_sweep_may_end_after_any_number_of_pulses_permitted(pulses: int) -> None:
    made, _ = sweeping()
    made.end_sweep(-30.0, pulses=pulses, now_s=10.1)
    assert made.state is State.ARMED
    for frames in (pulses - 1, pulses + 1):
        with pytest.raises(AcquisitionError) as refusal:
            made.admit_sweep(frames)
        assert str(refusal.value) == f"{frames} frames of {pulses} pulses: no angle is known; check the trigger"
    made.admit_sweep(pulses)


def frame_of(permit: SweepPermit, **changes: object) -> ReadingFrame:
    header = FrameHeader(
        sequence=1,
        token=permit.token,
        pulses=1,
        commanded_deg=30.0,
        started_s=10.5,
        ended_s=10.5,
        angle_before_deg=-20.0,
        angle_after_deg=-18.21,
    )
    return ReadingFrame(header=structs.replace(header, **changes), intensity=1.0)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"pulses": 100}, "100 pulses were seen, 1 were permitted"),
        ({"commanded_deg": -30.0}, "the frame is of -30.0 deg, not of 30.0 deg"),
        ({"angle_after_deg": -18.19}, r"the probe moved by 1\.810 deg .*, the limit is 1\.7"),
        ({"token": "permit-2"}, "stale frame"),
        ({"started_s": 9.9}, "stale frame"),
    ],
)
def test_a_frame_of_a_sweep_is_one_pulse_between_two_readings(changes: dict[str, object], said: str) -> None:
    made, permit = sweeping()
    with pytest.raises(AcquisitionError, match=said):
        made.admit_frame(frame_of(permit, **changes), permit=permit, now_s=11.0)
    made.admit_frame(frame_of(permit), permit=permit, now_s=11.0)


def test_the_noise_of_one_pulse_is_not_compared_with_that_of_an_average() -> None:
    made, permit = sweeping()
    single = frame_of(permit)
    average = structs.replace(single, header=structs.replace(single.header, pulses=16))
    dark = structs.replace(single, header=structs.replace(single.header, pulses=0))
    for frame, sigma in ((dark, 1.0), (single, 4.0), (average, 1.0), (single, 4.0), (average, 1.9)):
        made.admit_reading(Reading(intensity=1.0, noise_sigma=sigma), frame=frame)
    with pytest.raises(AcquisitionError, match="was 4 at first"):
        made.admit_reading(Reading(intensity=1.0, noise_sigma=1.9), frame=single)
