"""Full disks, folders that cannot be written, torn and flipped files: one kind of error, and nothing is lost."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek import rigs
from markerseek.core import (
    Asked,
    ChannelFrame,
    FrameHeader,
    Interval,
    Measured,
    Policy,
    Reading,
    RecordError,
    Sample,
    Started,
)
from markerseek.guard import State
from markerseek.records.journal import Configuration, Journal, read_journal, result_of, salvage, verify
from markerseek.rigs import Rig
from markerseek.rigs.journalled import configuration_of, journalled
from markerseek.rigs.resuming import resumed
from markerseek.search import build
from markerseek.sim import GaussianCurve

RANGE = Interval(low_deg=-35.0, high_deg=35.0)
NOBODY = 65534


def configuration() -> Configuration:
    rig = rigs.of_intensities(seed=1, curve=None, marker_deg=0.0)
    return configuration_of(
        rig,
        method="ternary",
        acquisitions=6,
        as_published=False,
        start_deg=0.0,
        dark_frames=0,
        stay=False,
        seed=1,
    )


def measured(index: int, *, channels: int = 32) -> Measured:
    header = FrameHeader(sequence=index, token="t", pulses=1, commanded_deg=0.0, started_s=0.0, ended_s=1.0)
    counts = np.random.default_rng(index).integers(-2048, 2048, (channels, 520)).astype(np.int16)
    frame = ChannelFrame(header=header, samples=counts, sampling_hz=40e6)
    sample = Sample(angle_deg=0.0, reading=Reading(intensity=1.0), frame=frame)
    return Measured(role="search", index=index, sample=sample)


def commit(journal: Journal, index: int, *, channels: int = 32) -> None:
    """One acquisition, asked for and made."""
    journal.commit(Asked(role="search", index=index, angle_deg=0.0), clock_s=float(index))
    journal.commit(measured(index, channels=channels), clock_s=float(index))


def fill(path: Path, *, most: int = 10_000) -> int:
    """Commit frames until it fails; the number of those that were acknowledged comes back."""
    acknowledged = 0
    try:
        with Journal.create(path, configuration()) as journal:
            journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
            for index in range(1, most):
                commit(journal, index)
                acknowledged += 1
    except RecordError as problem:
        said = str(problem)
    else:
        said = "all of it was written"
    assert "cannot be written" in said
    assert "make room on the disk" in said
    return acknowledged


def kept(path: Path) -> list[Measured]:
    return [entry.event for entry in read_journal(path).entries if isinstance(entry.event, Measured)]


def require_all(path: Path, acknowledged: int) -> None:
    events = kept(path)
    assert len(events) >= acknowledged > 5
    for event in events:
        wanted = measured(event.index).sample.frame
        assert isinstance(wanted, ChannelFrame)
        assert isinstance(event.sample.frame, ChannelFrame)
        np.testing.assert_array_equal(event.sample.frame.samples, wanted.samples)


def in_a_process(work: Callable[[], object]) -> None:
    """Do work in a forked process, and fail if it does."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            work()
            code = 0
        except BaseException:  # noqa: BLE001  pytest shows what a forked process writes
            traceback.print_exc()
        finally:
            os._exit(code)
    _, status = os.waitpid(child, 0)
    assert os.WIFEXITED(status)
    assert os.WEXITSTATUS(status) == 0


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of one megabyte."""
    folder = tmp_path / "small"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("needs leave to mount a small disk")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_ends_the_run_with_an_error_and_loses_nothing(small_disk: Path) -> None:
    path = small_disk / "run.journal"
    acknowledged = fill(path)
    require_all(path, acknowledged)
    # with room the run goes on in the same file
    grown = small_disk.parent / "run.journal"
    for each in small_disk.iterdir():
        shutil.copyfile(each, small_disk.parent / each.name)
    journal, held = Journal.reopen(grown)
    with journal:
        journal.interrupt("made up")
    assert len(read_journal(grown).entries) == len(held.entries) + 1
    assert verify(grown).faults == []


def test_a_file_that_may_not_grow_ends_the_run_with_an_error_and_loses_nothing(tmp_path: Path) -> None:
    def work() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (700_000, 700_000))
        (tmp_path / "acknowledged").write_text(str(fill(tmp_path / "run.journal")))

    in_a_process(work)
    require_all(tmp_path / "run.journal", int((tmp_path / "acknowledged").read_text()))


def test_a_search_on_a_full_disk_stops_the_rig_and_is_resumed_with_room(small_disk: Path, tmp_path: Path) -> None:
    def begin() -> tuple[Policy, Rig]:
        rig = rigs.of_intensities(seed=3, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=4.0)
        return build("ternary", limits=rig.limits.search, acquisitions=16), rig

    policy, rig = begin()
    path = small_disk / "run.journal"
    (small_disk / "ballast").write_bytes(b"0" * (900 << 10))
    with pytest.raises(RecordError, match="make room on the disk"), Journal.create(path, configuration()) as journal:
        for _ in journalled(policy, rig, journal):
            pass
    assert rig.scanner.guard.state is State.DISARMED
    assert len(read_journal(path).entries) >= 2
    (small_disk / "ballast").unlink()
    policy, rig = begin()
    journal, held = Journal.reopen(path)
    with journal:
        list(resumed(policy, rig, journal, held, by="a person"))
    policy, rig = begin()
    whole = tmp_path / "whole.journal"
    with Journal.create(whole, configuration()) as journal:
        list(journalled(policy, rig, journal))
    results = [msgspec.json.encode(result_of(read_journal(each))[1]) for each in (path, whole)]
    assert results[0] == results[1]


def test_a_folder_that_cannot_be_written_is_an_error_and_its_journals_are_still_read(tmp_path: Path) -> None:
    folder = tmp_path / "shelf"
    folder.mkdir()
    with Journal.create(folder / "closed.journal", configuration()) as journal:
        journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
        commit(journal, 1)
        for name in ("dead.journal", "dead.journal-wal"):
            shutil.copyfile(folder / name.replace("dead", "closed"), folder / name)

    def work() -> None:
        if os.getuid() == 0:
            os.setuid(NOBODY)
        for name in ("closed.journal", "dead.journal"):
            assert len(read_journal(folder / name).entries) == 3, name
            assert verify(folder / name).faults == [], name
        for attempt in (
            lambda: Journal.create(folder / "new.journal", configuration()),
            lambda: Journal.reopen(folder / "closed.journal"),
            lambda: Journal.reopen(folder / "dead.journal"),
        ):
            with pytest.raises(RecordError, match="cannot be written"):
                attempt()

    for each in folder.iterdir():
        each.chmod(0o444)
    folder.chmod(0o555)
    for parent in (tmp_path, *tmp_path.parents[:3]):
        if parent.stat().st_uid == os.getuid() and parent != Path("/tmp"):
            parent.chmod(0o755)
    in_a_process(work)
    folder.chmod(0o755)


@pytest.fixture(scope="module")
def closed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A journal of 25 entries, closed as it should be."""
    path = tmp_path_factory.mktemp("closed") / "run.journal"
    with Journal.create(path, configuration()) as journal:
        journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
        for index in range(1, 13):
            commit(journal, index, channels=8)
    return path


def looked_at(path: Path) -> int:
    """Number of entries that can be read, each of which is what was written."""
    try:
        held, damage = salvage(path)
        faults = verify(path).faults
    except RecordError:
        with pytest.raises(RecordError):
            read_journal(path)
        with pytest.raises(RecordError):
            Journal.reopen(path)
        return 0
    if damage is not None:
        assert faults
        with pytest.raises(RecordError):
            read_journal(path)
        with pytest.raises(RecordError):
            Journal.reopen(path)
    for index, entry in enumerate(held.entries[2::2], start=1):
        assert isinstance(entry.event, Measured)
        assert isinstance(entry.event.sample.frame, ChannelFrame)
        wanted = measured(index, channels=8).sample.frame
        assert isinstance(wanted, ChannelFrame)
        np.testing.assert_array_equal(entry.event.sample.frame.samples, wanted.samples)
    return len(held.entries)


@settings(max_examples=60, deadline=None)
@given(share=st.floats(0, 1))
def test_a_torn_file_is_noticed(share: float, closed: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    data = closed.read_bytes()
    size = round(share * len(data))
    path = tmp_path_factory.mktemp("torn") / "run.journal"
    path.write_bytes(data[:size])
    entries = looked_at(path)
    if size < len(data) - 16_384:
        assert entries < 25


@settings(max_examples=120, deadline=None)
@given(places=st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 7)), min_size=1, max_size=3))
def test_flipped_bits_never_change_what_is_read(
    places: list[tuple[float, int]], closed: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = bytearray(closed.read_bytes())
    for share, bit in places:
        data[int(share * len(data))] ^= 1 << bit
    path = tmp_path_factory.mktemp("flipped") / "run.journal"
    path.write_bytes(data)
    assert 0 <= looked_at(path) <= 25


@settings(max_examples=60, deadline=None)
@given(
    rubbish=st.binary(min_size=1, max_size=300),
    share=st.floats(0, 1, exclude_max=True),
    log=st.one_of(st.none(), st.binary(max_size=300)),
)
def test_rubbish_in_a_journal_is_one_kind_of_error(
    rubbish: bytes, share: float, log: bytes | None, closed: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    data = bytearray(closed.read_bytes())
    place = int(share * (len(data) - len(rubbish)))
    data[place : place + len(rubbish)] = rubbish
    path = tmp_path_factory.mktemp("rubbish") / "run.journal"
    path.write_bytes(data)
    if log is not None:
        Path(f"{path}-wal").write_bytes(log)
    assert 0 <= looked_at(path) <= 25


def test_every_flipped_bit_of_a_frame_is_noticed(closed: Path, tmp_path: Path) -> None:
    """Bits of the samples themselves, one at a time: what SQLite does not protect, the checksums do."""
    wanted = measured(6, channels=8).sample.frame
    assert isinstance(wanted, ChannelFrame)
    data = closed.read_bytes()
    start = data.index(wanted.samples.tobytes()[1000:1100])
    path = tmp_path / "run.journal"
    for bit in range(0, 800, 37):
        flipped = bytearray(data)
        flipped[start + bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        held, damage = salvage(path)
        assert len(held.entries) == 12
        assert damage is not None
        assert "entry 13 (measured) does not agree with its checksum" in str(damage)
