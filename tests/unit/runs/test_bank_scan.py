"""A scan is a run with a record, which becomes a bank when the scan ends, however it ends; so can any other record."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from markerseek import rigs
from markerseek.core import ByHand, ChannelFrame, ConfigError, DeviceError, Measured, RecordError, Sample, SearchPlan
from markerseek.records.banks import FrameBank, read_bank, record_of
from markerseek.records.banks.ipasc_writer import BankWriter
from markerseek.records.journal import Journal, read_journal
from markerseek.runs import configuration_of, journal_bank, scan_bank
from markerseek.runs.bank_scan import JournalBank, scan_configuration
from markerseek.runs.journalled import journalled
from markerseek.search import build
from tests.notes import noted


def scanned(path: Path, *, stop_after: int = 99) -> int:
    """Scan 8 angles, and stop early after some acquisitions; returns how many were made with light."""
    taken = 0
    lit = 0
    scan = scan_bank(rigs.simulated(seed=3), path, step_deg=10.0, pulse_energy_j=2e-3)
    for event in scan:
        if isinstance(event, Measured):
            taken = taken + 1
            lit = lit + (not event.sample.dark)
            kept = read_journal(record_of(path)).entries[-1].event
            assert isinstance(kept, Measured)
            assert kept.sample.angle_deg == event.sample.angle_deg
            if taken == stop_after:
                scan.close()
    return lit


def sticking(at: int) -> rigs.Rig:
    """A simulated rig whose stage sticks at an acquisition."""
    rig = rigs.simulated(seed=3)
    measure = rig.scanner.measure
    calls = iter(range(99))

    def failing(angle_deg: float, **_: object) -> Sample:
        if next(calls) == at:
            raise DeviceError("the stage is stuck")
        return measure(angle_deg)

    rig.scanner.measure = failing  # type: ignore[method-assign]
    return rig


@pytest.mark.parametrize("stop_after", [7, 99])
def test_a_scan_that_ends_leaves_a_bank_and_no_record(tmp_path: Path, stop_after: int) -> None:
    path = tmp_path / "a.hdf5"
    lit = scanned(path, stop_after=stop_after)
    bank = read_bank(path)
    assert isinstance(bank, FrameBank)
    assert (len(bank.angles_deg), bank.dark_frames) == (lit, 3)
    assert bank.facts.pulse_energy_j == 2e-3
    assert list(tmp_path.iterdir()) == [path]


def test_a_scan_that_is_stopped_before_its_first_angle_leaves_nothing(tmp_path: Path) -> None:
    assert scanned(tmp_path / "a.hdf5", stop_after=2) == 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("lit", [1, 2])
def test_a_scan_that_died_goes_on_with_the_angles_that_are_missing(tmp_path: Path, lit: int) -> None:
    path = tmp_path / "a.hdf5"
    assert scanned(path, stop_after=3 + lit) == lit
    assert list(tmp_path.iterdir()) == [record_of(path)]
    with pytest.raises(RecordError, match="go on with it: `scan_bank\\("):
        scanned(path)
    rig = rigs.simulated(seed=3, resumed_after=9)
    events = list(scan_bank(rig, path, step_deg=10.0, goes_on=True, by="a person"))
    assert sum(isinstance(event, Measured) for event in events) == 8 - lit
    bank = read_bank(path)
    assert isinstance(bank, FrameBank)
    assert (len(bank.angles_deg), bank.dark_frames, bank.facts.pulse_energy_j) == (8, 3, 2e-3)
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(("seed", "step_deg"), [(4, 10.0), (3, 5.0)])
def test_a_scan_of_another_rig_or_step_is_not_continued(tmp_path: Path, seed: int, step_deg: float) -> None:
    path = tmp_path / "a.hdf5"
    scanned(path, stop_after=4)
    before = record_of(path).read_bytes()
    with pytest.raises(ConfigError, match="give the rig, the seed and the step of the first scan"):
        list(scan_bank(rigs.simulated(seed=seed), path, step_deg=step_deg, goes_on=True, by="a person"))
    assert record_of(path).read_bytes() == before


@pytest.mark.parametrize("held", [b"", b'{"crc":"00000000","record":2'])
@pytest.mark.parametrize("goes_on", [True, False])
def test_the_record_of_a_scan_that_never_began_is_to_be_deleted(tmp_path: Path, held: bytes, goes_on: bool) -> None:
    path = tmp_path / "a.hdf5"
    record_of(path).write_bytes(held)
    with pytest.raises(RecordError, match="killed before it had begun, and there is nothing in it; delete it"):
        next(iter(scan_bank(rigs.simulated(seed=3), path, goes_on=goes_on)))


def test_without_a_record_there_is_nothing_to_go_on_with(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="there is no scan to go on with; scan anew"):
        list(scan_bank(rigs.simulated(seed=3), tmp_path / "a.hdf5", goes_on=True, by="a person"))


def test_a_bank_that_cannot_be_written_does_not_hide_the_fault_that_ended_the_scan(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.hdf5"
    rig = sticking(4)
    monkeypatch.setattr(BankWriter, "finish", lambda _writer: (_ for _ in ()).throw(RecordError("the disk is full")))
    with (
        noted(r"the disk is full; what was measured is in .*a\.hdf5\.journal"),
        pytest.raises(DeviceError, match="the stage is stuck"),
    ):
        list(scan_bank(rig, path, step_deg=10.0))
    assert list(tmp_path.iterdir()) == [record_of(path)]


def test_a_bank_that_cannot_be_written_leaves_the_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.hdf5"

    def taken_meanwhile(*_: object, **__: object) -> None:
        raise RecordError(f"{path}: there is a file already")

    monkeypatch.setattr("markerseek.runs.bank_scan.whole_bank", taken_meanwhile)
    with pytest.raises(RecordError, match=r"what was measured is in .*a\.hdf5\.journal: `journal_bank\("):
        scanned(path)
    assert [each.name for each in tmp_path.iterdir()] == ["a.hdf5.journal"]
    with pytest.raises(RecordError, match=r"its scan did not become a bank, and is kept: `journal_bank"):
        read_bank(path)
    held = journal_bank(record_of(path))
    assert (len(held.angles_deg), held.dark_frames, held.facts.pulse_energy_j) == (8, 3, 2e-3)
    with pytest.raises(RecordError, match=r"it holds a scan that was killed; go on with it: .*, make a bank of it"):
        scanned(path)


@pytest.mark.parametrize("dark_frames", [0, 3])
def test_a_disk_without_room_for_record_and_bank_ends_the_scan_at_its_first_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, dark_frames: int
) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _path: SimpleNamespace(free=8_000_000))
    rig = replace(rigs.simulated(seed=3), dark_frames=dark_frames)
    with pytest.raises(RecordError, match=r"the bank needs \d+\.\d MB, 8\.0 MB are free; make room"):
        list(scan_bank(rig, tmp_path / "a.hdf5", step_deg=10.0))
    # An angle that was measured is kept, and the scan goes on with the others once there is room.
    assert [each.name for each in tmp_path.iterdir()] == ["a.hdf5.journal"] * (dark_frames == 0)


def scanned_with_damage(path: Path) -> None:
    """Scan 8 angles, while another program flips a bit in the record of the fourth."""
    taken = 0
    begins = 0
    for event in scan_bank(rigs.simulated(seed=3), path, step_deg=10.0):
        taken += isinstance(event, Measured)
        if isinstance(event, Measured) and taken == 6:
            begins = record_of(path).stat().st_size
        elif isinstance(event, Measured) and taken == 7:
            with record_of(path).open("r+b") as file:
                file.seek(begins + 100_000)
                before = file.read(1)[0]
                file.seek(begins + 100_000)
                file.write(bytes([before ^ 1]))


def test_a_record_that_is_damaged_meanwhile_gives_a_bank_of_the_angles_before_and_says_so(tmp_path: Path) -> None:
    path = tmp_path / "a.hdf5"
    said = r"a\.hdf5\.journal: entry .*; .*a\.hdf5 holds the 3 angles before that, and the record is kept: scan again"
    with pytest.raises(RecordError, match=said):
        scanned_with_damage(path)
    assert len(read_bank(path).angles_deg) == 3
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.hdf5", "a.hdf5.journal"]


def test_the_record_of_a_scan_by_hand_says_so() -> None:
    """It is resumed by that: a hand comes to rest beside the angle of before, and drifts."""
    rig = replace(rigs.simulated(seed=1), by_hand=ByHand())
    assert scan_configuration(rig, step_deg=5.0).plan.by_hand == rig.by_hand


def test_a_scan_that_died_while_its_bank_was_made_needs_no_more_angles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.hdf5"
    with monkeypatch.context() as patched:
        patched.setattr("markerseek.runs.bank_scan._export", lambda *_: None)
        scanned(path)
    assert list(tmp_path.iterdir()) == [record_of(path)]
    rig = rigs.simulated(seed=3, resumed_after=9)
    assert list(scan_bank(rig, path, step_deg=10.0, goes_on=True, by="a person")) == []
    assert len(read_bank(path).angles_deg) == 8
    assert list(tmp_path.iterdir()) == [path]


def test_a_scan_that_ended_with_a_fault_does_not_go_on_by_itself(tmp_path: Path) -> None:
    path = tmp_path / "a.hdf5"
    rig = sticking(1)
    with pytest.raises(DeviceError, match="the stage is stuck"):
        list(scan_bank(rig, path, step_deg=10.0))
    before = record_of(path).read_bytes()
    again = rigs.simulated(seed=3, resumed_after=9)
    with pytest.raises(DeviceError, match=r"ended with a fault: the stage is stuck; look at the rig, delete this file"):
        list(scan_bank(again, path, step_deg=10.0, goes_on=True, by="a person"))
    assert record_of(path).read_bytes() == before


def test_frames_of_a_run_come_back_with_their_angles_and_headers(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    rig = rigs.simulated(seed=3)
    policy = build(SearchPlan(method="ternary", acquisitions=6, as_published=True), limits=rig.limits.search)
    kept = configuration_of(
        rig, SearchPlan(method="ternary", acquisitions=6, as_published=True, start_deg=0.0, dark_frames=2, stay=False)
    )
    with Journal.create(path, kept) as journal, closing(journalled(policy, rig, journal)) as events:
        for _ in events:
            pass
    samples = [entry.event.sample for entry in read_journal(path).entries if isinstance(entry.event, Measured)]
    at = {each.angle_deg: each for each in samples if not each.dark}
    lit = [at[angle_deg] for angle_deg in sorted(at)]
    bank = journal_bank(path)
    assert isinstance(bank, JournalBank)
    # The confirmation is made where the last acquisition of the search was; it is the one that is kept.
    assert (len(bank.angles_deg), bank.dark_frames, len(samples)) == (6, 2, 9)
    assert samples[-1] in lit
    assert list(bank.angles_deg) == [each.angle_deg for each in lit]
    assert list(bank.intensities) == [each.reading.intensity for each in lit]
    for index, sample in enumerate(lit):
        assert isinstance(sample.frame, ChannelFrame)
        assert bank.frame(index).header == sample.frame.header
        np.testing.assert_array_equal(bank.frame(index).samples, sample.frame.samples)
    for index, sample in enumerate(each for each in samples if each.dark):
        assert isinstance(sample.frame, ChannelFrame)
        np.testing.assert_array_equal(bank.dark_frame(index).samples, sample.frame.samples)
    facts = bank.facts
    assert rig.imaging is not None
    assert (facts.reference_angle_deg, facts.face_radius_m) == (rig.facts.truth_deg, rig.facts.face_radius_m)
    assert (facts.sampling_hz, facts.pitch_m) == (40e6, rig.imaging.preset.array.pitch_m)
    assert (facts.simulated, facts.seed, facts.configuration) == (True, 3, rig.facts.fingerprint)
    assert {bank.frame(index).header.pulses for index in range(6)} == {16}
    first = read_journal(path).entries[0]
    assert facts.clock_zero_unix_s is not None
    began = datetime.fromtimestamp(facts.clock_zero_unix_s + first.clock_s, tz=UTC)
    assert abs((began - datetime.fromisoformat(first.written)).total_seconds()) < 1e-3
    assert facts.description.startswith("journal of ternary on a simulated rig")
    assert facts.description.endswith(", without 1 at repeated angles")
