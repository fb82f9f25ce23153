"""Values that JSON cannot hold: non-finite numbers are refused anywhere, unusual texts are escaped."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest

from markerseek.core import (
    ChannelFrame,
    Failed,
    Finished,
    Measured,
    MoveError,
    NotFound,
    RecordError,
    Refused,
    Sample,
    Started,
)
from markerseek.records.journal import (
    Checked,
    Configuration,
    Interrupted,
    Journal,
    JournalEvent,
    Resuming,
    decode,
    encode,
    read_journal,
)
from tests.unit.records.journal.every_kind_of_entry import frame
from tests.unit.records.journal.synthetic_journals import EVENTS, FULL_READING, HEADER, RANGE, configuration

FULL = {
    **EVENTS,
    "resuming": Resuming(by="a person", check_deg=1.1, fault_reset=True, versions={}),
    "checked": Checked(reading=FULL_READING, difference="weaker", frame=frame(1)),
}
"""Events with a number wherever there can be one."""


def fields_of(value: object) -> list[str]:
    if isinstance(value, msgspec.Struct):
        return list(value.__struct_fields__)
    return [field.name for field in dataclasses.fields(value)] if dataclasses.is_dataclass(value) else []


def replaced(value: object, name: str, part: object) -> object:
    if isinstance(value, msgspec.Struct):
        return msgspec.structs.replace(value, **{name: part})
    assert dataclasses.is_dataclass(value)
    # Made without its own check, as a device's wrapper or an older program might.
    made = object.__new__(type(value))
    for field in dataclasses.fields(value):
        object.__setattr__(made, field.name, part if field.name == name else getattr(value, field.name))
    return made


def with_each_float(value: object, number: float, *, where: str = "") -> Iterator[tuple[str, object]]:
    """The value with each of its floats replaced in turn, found by looking at every field of every part."""
    if isinstance(value, float):
        yield where, number
    elif isinstance(value, tuple):
        for index, part in enumerate(value):
            for place, made in with_each_float(part, number, where=f"{where}[{index}]"):
                yield place, (*value[:index], made, *value[index + 1 :])
    else:
        for name in fields_of(value):
            for place, made in with_each_float(getattr(value, name), number, where=f"{where}.{name}"):
                yield place, replaced(value, name, made)


def all_places() -> list[tuple[str, str]]:
    return [(kind, place) for kind, event in FULL.items() for place, _ in with_each_float(event, 0.5)]


def test_the_search_for_floats_finds_those_that_are_known() -> None:
    found = set(all_places())
    assert len(found) > 60
    assert {
        ("measured channels", ".sample.reading.noise_sigma"),
        ("measured channels", ".sample.frame.header.angle_before_deg"),
        ("measured intensity", ".sample.frame.noise_sigma"),
        ("Found", ".estimate.floor.level"),
        ("Found", ".estimate.interval95_deg.high_deg"),
        ("Ambiguous", ".estimate.modes_deg[1]"),
        ("checked", ".frame.sampling_hz"),
    } <= found


@pytest.mark.parametrize("number", [float("nan"), float("inf"), -float("inf")])
def test_no_number_that_is_not_finite_passes_at_any_place(number: float) -> None:
    for kind, event in FULL.items():
        for place, made in with_each_float(event, number):
            with pytest.raises(RecordError, match="not finite and cannot be recorded") as refused:
                encode(made)  # type: ignore[arg-type]
            assert place.rsplit(".", 1)[-1].split("[")[0] in str(refused.value), (kind, place)


def test_a_refused_frame_whose_numbers_are_why_it_was_refused_is_left_out() -> None:
    for _, broken in with_each_float(frame(1), float("nan")):
        assert isinstance(broken, ChannelFrame)
        row = encode(Refused(angle_deg=1.0, reason="not finite", frame=broken))
        assert decode(row.kind, row.body, row.samples, confirmation=None) == Refused(angle_deg=1.0, reason="not finite")
        assert row.samples is None


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_a_configuration_that_is_not_finite_is_refused_and_no_file_is_left(number: float, tmp_path: Path) -> None:
    whole = configuration(truth_deg=1.0, reference_deg=1.0, face_radius_m=0.01)
    places = dict(with_each_float(whole, number))
    assert {
        ".plan.start_deg",
        ".facts.search.low_deg",
        ".facts.truth_deg",
        ".facts.reference_deg",
        ".facts.face_radius_m",
    } <= set(places)
    for made in places.values():
        assert isinstance(made, Configuration)
        with pytest.raises(RecordError, match="not finite"):
            Journal.create(tmp_path / "run.journal", made)
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_a_clock_that_is_not_finite_is_refused(number: float, tmp_path: Path) -> None:
    with Journal.create(tmp_path / "run.journal", configuration()) as journal:
        with pytest.raises(RecordError, match=r"the rig's clock is .* not finite"):
            journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=number)
        journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
    assert len(read_journal(tmp_path / "run.journal").entries) == 1


ODD, ESCAPED = "the stage said \udcff\ud800 \N{DEGREE SIGN}", "the stage said \\udcff\\ud800 \N{DEGREE SIGN}"

WITH_ODD_TEXTS: list[tuple[JournalEvent, JournalEvent]] = [
    (Refused(angle_deg=1.0, reason=ODD), Refused(angle_deg=1.0, reason=ESCAPED)),
    (Interrupted(reason=ODD), Interrupted(reason=ESCAPED)),
    (
        Checked(reading=FULL_READING, difference=ODD),
        Checked(reading=FULL_READING, difference=ESCAPED),
    ),
    (
        Resuming(by=ODD, check_deg=None, fault_reset=False, versions={ODD: ODD}),
        Resuming(by=ESCAPED, check_deg=None, fault_reset=False, versions={ESCAPED: ESCAPED}),
    ),
    (
        Finished(
            estimate=NotFound(mean_deg=1.0, reason=ODD),
            confirmation=None,
            acquisitions=1,
            travel_deg=0.0,
            elapsed_s=0.0,
        ),
        Finished(
            estimate=NotFound(mean_deg=1.0, reason=ESCAPED),
            confirmation=None,
            acquisitions=1,
            travel_deg=0.0,
            elapsed_s=0.0,
        ),
    ),
]


@pytest.mark.parametrize(("event", "wanted"), WITH_ODD_TEXTS, ids=lambda event: type(event).__name__)
def test_texts_that_are_no_unicode_are_kept_as_escapes(
    event: JournalEvent, wanted: JournalEvent, tmp_path: Path
) -> None:
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration(description=ODD)) as journal:
        journal.commit(event, clock_s=0.0)
    held = read_journal(path)
    assert held.configuration.facts.description == ESCAPED
    assert [entry.event for entry in held.entries] == [wanted]


def test_an_error_whose_text_is_no_unicode_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    with Journal.create(path, configuration()) as journal:
        journal.commit(Failed(error=MoveError(ODD)), clock_s=0.0)
    (entry,) = read_journal(path).entries
    assert isinstance(entry.event, Failed)
    assert str(entry.event.error) == ESCAPED


def test_a_token_that_is_no_unicode_is_kept_as_escapes(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    kept = ChannelFrame(
        header=dataclasses.replace(HEADER, token=ODD), samples=np.ones((2, 3), dtype=np.int16), sampling_hz=40e6
    )
    with Journal.create(path, configuration()) as journal:
        sample = Sample(angle_deg=0.0, reading=FULL_READING, frame=kept)
        journal.commit(Measured(role="search", index=1, sample=sample), clock_s=0.0)
    (entry,) = read_journal(path).entries
    assert isinstance(entry.event, Measured)
    assert entry.event.sample.frame is not None
    assert entry.event.sample.frame.header.token == ESCAPED


def test_a_configuration_that_could_not_be_read_again_is_refused_and_no_file_is_left(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match=r"the configuration cannot be recorded: .*versions"):
        Journal.create(tmp_path / "run.journal", configuration(versions={"numpy": 2}))
    assert list(tmp_path.iterdir()) == []


def test_a_search_without_acquisitions_is_recorded(tmp_path: Path) -> None:
    Journal.create(tmp_path / "run.journal", configuration(acquisitions=0)).close()
    assert read_journal(tmp_path / "run.journal").configuration.plan.acquisitions == 0
