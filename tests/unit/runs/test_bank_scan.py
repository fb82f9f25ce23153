"""A scan is a run with a record, which becomes a bank when the scan ends, however it ends."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from markerseek import rigs
from markerseek.core import Measured, RecordError, Sample
from markerseek.records.banks import FrameBank, read_bank, record_of
from markerseek.records.banks.ipasc.writer import BankWriter
from markerseek.records.journal import read_journal
from markerseek.runs import journal_bank, scan_bank


def scanned(path: Path, *, stop_after: int = 99) -> int:
    """Scan 8 angles, and stop early after some acquisitions; returns how many were made with light."""
    taken, lit = 0, 0
    scan = scan_bank(rigs.simulated(seed=3), path, step_deg=10.0, pulse_energy_j=2e-3)
    for event in scan:
        if isinstance(event, Measured):
            taken, lit = taken + 1, lit + (not event.sample.dark)
            assert isinstance(read_journal(record_of(path)).entries[-1].event, Measured)
            if taken == stop_after:
                scan.close()
    return lit


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


def test_a_bank_that_cannot_be_written_leaves_the_record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.hdf5"

    def taken_meanwhile(*_: object, **__: object) -> None:
        raise RecordError(f"{path}: there is a file already")

    monkeypatch.setattr("markerseek.runs.bank_scan.whole_bank", taken_meanwhile)
    with pytest.raises(RecordError, match=r"what was measured is in .*a\.hdf5\.journal: 'markerseek bank import"):
        scanned(path)
    assert [each.name for each in tmp_path.iterdir()] == ["a.hdf5.journal"]
    with pytest.raises(RecordError, match=r"no such file or folder; its scan was killed, and is kept: 'markerseek"):
        read_bank(path)
    held = journal_bank(record_of(path))
    assert (len(held.angles_deg), held.dark_frames, held.facts.pulse_energy_j) == (8, 3, 2e-3)
    with pytest.raises(RecordError, match="it holds a scan that was killed; make a bank of it"):
        scanned(path)


def test_a_disk_without_room_for_record_and_bank_ends_the_scan_at_its_first_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shutil.disk_usage", lambda _path: SimpleNamespace(free=10_000_000))
    with pytest.raises(RecordError, match=r"the bank needs 12\.\d MB, 10\.0 MB are free"):
        scanned(tmp_path / "a.hdf5")
    assert list(tmp_path.iterdir()) == []


def test_a_bank_that_fills_the_disk_names_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    add = BankWriter.add

    def full(writer: BankWriter, sample: Sample) -> None:
        if writer.taken == 2:
            raise RecordError("the bank cannot be written: No space left on device")
        add(writer, sample)

    monkeypatch.setattr(BankWriter, "add", full)
    with pytest.raises(RecordError, match=r"^the bank cannot be written: No space left on device; what was measured"):
        scanned(tmp_path / "a.hdf5")
    assert [each.name for each in tmp_path.iterdir()] == ["a.hdf5.journal"]


def test_a_record_that_is_damaged_meanwhile_gives_a_bank_of_the_angles_before_and_says_so(tmp_path: Path) -> None:
    path, taken = tmp_path / "a.hdf5", 0
    end = 0
    with pytest.raises(
        RecordError,
        match=r"a\.hdf5\.journal: entry .*; .*a\.hdf5 holds the 3 angles before that, and the record is kept",
    ):
        for event in scan_bank(rigs.simulated(seed=3), path, step_deg=10.0):
            taken += isinstance(event, Measured)
            if isinstance(event, Measured) and taken == 6:
                end = record_of(path).stat().st_size
            elif isinstance(event, Measured) and taken == 7:
                with record_of(path).open("r+b") as file:
                    file.seek(end + 100_000)
                    before = file.read(1)[0]
                    file.seek(end + 100_000)
                    file.write(bytes([before ^ 1]))
    assert len(read_bank(path).angles_deg) == 3
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.hdf5", "a.hdf5.journal"]
