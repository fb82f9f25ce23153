"""The acquisition at the angle found confirms it, or the answer is Unsure."""

from __future__ import annotations

import pytest
from msgspec import structs

from markerseek.core import (
    PAPER_RANGE,
    Arrival,
    Finished,
    Floor,
    Found,
    Measured,
    OtherSource,
    Reading,
    RigFacts,
    Sample,
    SearchPlan,
    Unsure,
)
from markerseek.records.journal import RunView
from markerseek.scan import run
from markerseek.scan.confirmation import apply_confirmation
from markerseek.show import SearchResult
from tests.unit.scan.scan_bench import FOUND, Bench, Tour, scanner

RIG = RigFacts(kind="simulated", description="", fingerprint="", search=PAPER_RANGE)
CHECKED = structs.replace(FOUND, floor=Floor(level=40.0, source="dark frames"))
STRONGEST = Reading(intensity=1274.0, noise_sigma=10.0, lateral_m=2e-3, depth_m=30e-3)
SAMPLES = [
    Sample(angle_deg=2.0, reading=structs.replace(STRONGEST, intensity=300.0)),
    Sample(angle_deg=4.1, reading=STRONGEST),
]


def confirmed_by(**changes: float) -> Found | Unsure:
    answer = apply_confirmation(CHECKED, Sample(angle_deg=4.0, reading=structs.replace(STRONGEST, **changes)), SAMPLES)
    assert isinstance(answer, Found | Unsure)
    return answer


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"intensity": 51.0}, r"intensity of 51, 1274 was expected and 979\.2 is the least"),
        ({"intensity": 979.0}, "intensity of 979, 1274 was expected"),
        ({"lateral_m": 3.6e-3}, r"lateral_m is 3\.60 mm and was 2\.00 mm, 1\.5 mm is the limit"),
        ({"depth_m": 28.4e-3}, r"depth_m is 28\.40 mm and was 30\.00 mm"),
    ],
)
def test_a_weaker_or_moved_source_makes_the_answer_unsure_with_both_numbers(
    changes: dict[str, float], reason: str
) -> None:
    answer = confirmed_by(**changes)
    assert isinstance(answer, Unsure)
    assert (answer.mean_deg, answer.sigma_deg, answer.floor) == (4.0, 0.1, CHECKED.floor)
    with pytest.raises(AssertionError, match=reason):
        raise AssertionError(answer.reason)


@pytest.mark.parametrize(
    "changes", [{}, {"intensity": 980.0}, {"intensity": 3000.0}, {"lateral_m": 3.4e-3, "depth_m": 31.4e-3}]
)
def test_an_acquisition_as_expected_confirms(changes: dict[str, float]) -> None:
    assert confirmed_by(**changes) == CHECKED


def test_noise_is_allowed_for_but_what_is_below_the_floor_never_confirms() -> None:
    noisy = structs.replace(STRONGEST, intensity=60.0, noise_sigma=10.0)
    samples = [Sample(angle_deg=4.1, reading=noisy)]
    for intensity, kind in ((41.0, Found), (39.0, Unsure)):
        now = Sample(angle_deg=4.0, reading=structs.replace(noisy, intensity=intensity, lateral_m=9e-3))
        assert isinstance(apply_confirmation(CHECKED, now, samples), kind)  # too weak for its position to be compared


def test_the_paper_s_form_keeps_its_answer_and_other_answers_stay() -> None:
    weak = Sample(angle_deg=4.0, reading=structs.replace(STRONGEST, intensity=1.0))
    assert apply_confirmation(FOUND, weak, SAMPLES) == FOUND
    unsure = apply_confirmation(CHECKED, weak, SAMPLES)
    assert apply_confirmation(unsure, weak, SAMPLES) == unsure


class Fading(Bench):
    """A bench whose signal vanishes after a number of acquisitions."""

    def acquire(self, permit):  # type: ignore[no-untyped-def]
        frame = super().acquire(permit)
        return (
            structs.replace(frame, intensity=51.0)
            if self.sequence == 4
            else structs.replace(frame, intensity=1274.0 - self.sequence)
        )


@pytest.mark.parametrize(("answer", "found", "confirmed"), [(CHECKED, False, False), (FOUND, True, None)])
def test_a_run_never_says_found_beside_an_angle_that_is_not_confirmed(
    answer: Found, found: bool, confirmed: bool | None
) -> None:
    view = RunView(plan=SearchPlan(method="test"), facts=RIG)
    events = list(run(Tour(-30.0, 2.0, 4.1, answer=answer), scanner(Fading())))
    for event in events:
        view = view.add(event, clock_s=0.0)
    last = events[-1]
    assert isinstance(last, Finished)
    assert last.confirmation is not None
    assert [event.role for event in events if isinstance(event, Measured)] == ["search"] * 3 + ["confirmation"]
    result = SearchResult.of(view)
    assert (result.found, result.confirmed, result.angle_deg) == (found, confirmed, 4.0)


class Weighing(Tour):
    """A tour that asks for one more angle after a weak confirmation."""

    def confirm(self, sample: Sample) -> None:
        self.samples.append(sample)
        if sample.reading.intensity < 1000.0:
            self.left.append(5.0)


def test_after_a_weak_confirmation_the_search_goes_on_and_is_confirmed_again() -> None:
    view = RunView(plan=SearchPlan(method="test"), facts=RIG)
    policy = Weighing(-30.0, 2.0, 4.1, answer=CHECKED)
    events = list(run(policy, scanner(Fading())))
    for event in events:
        view = view.add(event, clock_s=0.0)
    roles = [(event.role, event.index) for event in events if isinstance(event, Measured)]
    assert roles == [
        ("search", 1),
        ("search", 2),
        ("search", 3),
        ("confirmation", 1),
        ("search", 4),
        ("confirmation", 2),
    ]
    last = events[-1]
    assert isinstance(last, Finished)
    assert (last.acquisitions, last.estimate) == (4, CHECKED)
    assert len(policy.samples) == 6
    result = SearchResult.of(view)
    assert result.confirmed is True
    # The first confirmation was weighed as a sample of the search.
    assert [sample.angle_deg for sample in result.samples] == [-30.0, 2.0, 4.1, 4.0, 5.0]


def test_a_long_pulse_that_arrives_twice_has_not_moved() -> None:
    """The later of two arrivals is the stronger now, and the one of before is still there."""
    before = Arrival(lateral_m=2e-3, depth_m=30e-3, arrival_s=20e-6, intensity=1200.0, coherence=0.9)
    later = structs.replace(before, depth_m=31.7e-3, intensity=1270.0)
    seen = structs.replace(STRONGEST, depth_m=31.7e-3)
    for arrivals, kind in (
        ((later,), Unsure),
        ((later, before), Found),
        ((later, structs.replace(before, intensity=500.0)), Unsure),
    ):
        now = Sample(angle_deg=4.0, reading=structs.replace(seen, arrivals=arrivals))
        assert isinstance(apply_confirmation(CHECKED, now, SAMPLES), kind)


def test_what_else_an_answer_says_is_kept_when_it_is_not_confirmed() -> None:
    other = OtherSource(angle_deg=9.0, sigma_deg=0.2, relative_db=-12.0, lateral_m=1e-3, depth_m=40e-3)
    found = structs.replace(CHECKED, others=(other,), surveyed=0.995)
    answer = apply_confirmation(
        found, Sample(angle_deg=4.0, reading=structs.replace(STRONGEST, intensity=51.0)), SAMPLES
    )
    assert isinstance(answer, Unsure)
    assert (answer.others, answer.surveyed) == ((other,), 0.995)
