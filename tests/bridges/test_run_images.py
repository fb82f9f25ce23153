"""The images of a run, handed on by the process that searches or made of the samples in its journal: the same ones."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from msgspec import structs

from markerseek import rigs
from markerseek.bridges import ChildRun, run_images
from markerseek.bridges.page.run_history import picture_of
from markerseek.bridges.run_images import PicturedEntry, with_images
from markerseek.core import ChannelFrame, Measured, PaImage, SearchPlan
from markerseek.records.journal import Journal, JournalItem, encode_entry, follow_journal, read_journal
from markerseek.runs import ImageRing, Run, hand_images_on, new_run, plan_on
from markerseek.signals import ImageReader, reader
from markerseek.sim import GaussianCurve

needs_memory_files = pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="no files in memory without a name")

SEARCH = ["search", "--method", "golden-section", "--acquisitions", "8", "--seed", "3"]


@pytest.fixture(autouse=True)
def _own_data_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


def written(journal: Path) -> Iterator[JournalItem]:
    """What a journal holds by now."""
    return follow_journal(journal, is_over=lambda: True, wait=lambda: None)


def entries_of(items: Iterator[object]) -> list[PicturedEntry]:
    return [item for item in items if isinstance(item, PicturedEntry)]


def images_of(entries: list[PicturedEntry]) -> dict[int, PaImage]:
    return {each.entry.number: each.image for each in entries if each.image is not None}


def require_equal(ours: list[PicturedEntry], others: list[PicturedEntry]) -> None:
    """The same entries with the same images to the bit, as page, OpenIGTLink and ROS 2 show them."""
    assert len(ours) == len(others)
    for one, other in zip(ours, others, strict=True):
        # As it is stored, because frames are compared by identity.
        assert encode_entry(one.entry) == encode_entry(other.entry)
        assert (one.brightest, one.problem) == (other.brightest, other.problem)
        assert (one.image is None) == (other.image is None)
        if one.image is not None and other.image is not None:
            assert np.array_equal(one.image.envelope, other.image.envelope)
            assert np.array_equal(one.image.lateral_m, other.image.lateral_m)
            assert np.array_equal(one.image.depth_m, other.image.depth_m)
            assert isinstance(one.entry.event, Measured)
            shown = [picture_of(one.entry.event.sample, each.image) for each in (one, other)]
            assert shown[0].drawn == shown[1].drawn


def refuse(*_: object) -> None:
    raise AssertionError("an image was made of the samples")


@needs_memory_files
def test_images_are_handed_on_and_are_those_that_a_later_reader_makes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal = tmp_path / "run.journal"
    child = ChildRun([*SEARCH, "--journal", str(journal)], journal=journal)
    with monkeypatch.context() as patched:
        patched.setattr(run_images, "rebuild_image_reader", refuse)
        handed = entries_of(with_images(child.items(), handed=child.images))
    assert child.outcome().answered
    measured = [each.entry.number for each in handed if isinstance(each.entry.event, Measured)]
    assert list(images_of(handed)) == measured
    assert len(measured) > 8
    require_equal(handed, entries_of(with_images(written(journal))))


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    """A search with a journal, not begun."""
    rig = rigs.simulated(seed=3)
    run = new_run(rig, plan_on(rig, SearchPlan(method="golden-section", acquisitions=6)))
    with Journal.create(tmp_path / "run.journal", run.configuration) as journal:
        run.journal = journal
        yield run


def followed_with(images: ImageRing, run: Run) -> list[PicturedEntry]:
    """The entries of a search in this process, each read as it is written."""
    assert run.journal is not None
    assert run.rig.imaging is not None
    hand_images_on(images, run.journal, run.rig.imaging)
    events = run.events()
    items = with_images(
        follow_journal(run.journal.path, is_over=lambda: next(events, None) is None, wait=lambda: None), handed=images
    )
    return entries_of(items)


@needs_memory_files
def test_a_frame_is_beamformed_once_on_its_way_to_its_reader(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    beamformed = []

    def counted(signals: np.ndarray, grid: object) -> np.ndarray:
        beamformed.append(signals)
        return plain(signals, grid)

    plain = reader.beamform
    monkeypatch.setattr(reader, "beamform", counted)
    with ImageRing.create() as images:
        entries = followed_with(images, run)
    frames = sum(isinstance(each.entry.event, Measured) for each in entries)
    assert len(images_of(entries)) == frames == len(beamformed)


@needs_memory_files
def test_a_record_without_frames_has_images_for_whoever_follows_it_and_none_later(tmp_path: Path, run: Run) -> None:
    path = tmp_path / "bare.journal"
    with Journal.create(path, structs.replace(run.configuration, frames=False)) as bare, ImageRing.create() as images:
        run.journal = bare
        entries = followed_with(images, run)
    numbers = [each.entry.number for each in entries if isinstance(each.entry.event, Measured)]
    assert list(images_of(entries)) == numbers
    later = entries_of(with_images(written(path)))
    assert len(later) == len(entries)
    assert images_of(later) == {}
    assert {each.problem for each in later} == {""}


def test_of_intensities_there_are_no_images_and_nothing_is_wrong(tmp_path: Path) -> None:
    rig = rigs.of_intensities(seed=3, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=3.0)
    run = new_run(rig, plan_on(rig, SearchPlan(method="ternary", acquisitions=4)))
    with Journal.create(tmp_path / "run.journal", run.configuration) as run.journal:
        list(run.events())
    entries = entries_of(with_images(written(tmp_path / "run.journal")))
    assert len(entries) > 4
    assert {(each.image, each.brightest, each.problem) for each in entries} == {(None, 0.0, "")}


def test_a_frame_that_gives_no_image_says_why_until_one_does(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    list(run.events())
    plain = ImageReader.picture
    calls = []

    def second_fails(imaging: ImageReader, frame: ChannelFrame) -> PaImage:
        calls.append(frame)
        return plain(imaging, shortened(frame) if len(calls) == 2 else frame)

    def shortened(frame: ChannelFrame) -> ChannelFrame:
        return ChannelFrame(header=frame.header, samples=frame.samples[:, :90].copy(), sampling_hz=frame.sampling_hz)

    monkeypatch.setattr(ImageReader, "picture", second_fails)
    entries = entries_of(with_images(written(run.journal.path)))
    measured = [each for each in entries if isinstance(each.entry.event, Measured)]
    assert [each.image is None for each in measured[:3]] == [False, True, False]
    assert measured[1].problem.startswith("frame of 90 samples")
    between = [each for each in entries if measured[1].entry.number <= each.entry.number < measured[2].entry.number]
    assert {each.problem for each in between} == {measured[1].problem}
    assert measured[2].problem == ""


def test_counts_are_kept_by_nobody_who_shows_a_run(run: Run) -> None:
    list(run.events())
    shown = entries_of(with_images(written(run.journal.path)))
    for one, other in zip(shown, read_journal(run.journal.path).entries, strict=True):
        if isinstance(one.entry.event, Measured) and isinstance(other.event, Measured):
            assert not isinstance(one.entry.event.sample.frame, ChannelFrame)
            assert one.entry.event.sample.frame.header == other.event.sample.frame.header
            assert one.entry.event == other.event


@needs_memory_files
def test_brightest_is_that_of_all_images_so_far(run: Run) -> None:
    with ImageRing.create() as images:
        entries = followed_with(images, run)
    assert all(one.brightest <= other.brightest for one, other in pairwise(entries))
    largest = [0.0]
    for each in entries:
        largest.append(max(largest[-1], float(each.image.envelope.max()) if each.image is not None else 0.0))
    assert [each.brightest for each in entries] == largest[1:]
    assert largest[-1] > 0


@needs_memory_files
def test_a_search_whose_images_nobody_reads_is_the_same_search(tmp_path: Path) -> None:
    plain = tmp_path / "plain.journal"
    unread = tmp_path / "unread.journal"
    command = [sys.executable, "-P", "-m", "markerseek", "search", "--seed", "3", "--json", "--journal"]
    alone = subprocess.run([*command, str(plain)], capture_output=True, check=True)
    with ImageRing.create() as images:
        handed = subprocess.run(
            [*command, str(unread), "--image-ring", f"/dev/fd/{images.fileno()}"],
            pass_fds=[images.fileno()],
            capture_output=True,
            check=True,
        )
        assert handed.stdout == alone.stdout
        # A page that starts late gets what is left, and makes the rest itself.
        late = entries_of(with_images(written(unread), handed=images))
        require_equal(late, entries_of(with_images(written(unread))))
    assert [each.event for each in read_journal(unread).entries] == [each.event for each in read_journal(plain).entries]


@needs_memory_files
def test_only_the_bridge_of_a_search_names_where_its_images_go(tmp_path: Path) -> None:
    named = tmp_path / "images"
    named.write_bytes(b"mine")
    command = [sys.executable, "-P", "-m", "markerseek", "search", "--seed", "3", "--no-journal", "--json"]
    events = ["--events", str(tmp_path / "events")]
    refused = subprocess.run([*command, *events, "--image-ring", str(named)], capture_output=True, check=False)
    assert refused.returncode == 2
    assert b"in a file without a name" in refused.stdout
    assert named.read_bytes() == b"mine"


def test_without_memory_files_a_bridge_makes_the_images_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(_name: str) -> int:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(os, "memfd_create", refused, raising=False)
    journal = tmp_path / "run.journal"
    child = ChildRun([*SEARCH, "--journal", str(journal)], journal=journal)
    assert child.images is None
    entries = entries_of(with_images(child.items(), handed=child.images))
    assert child.outcome().answered
    assert len(images_of(entries)) > 8


def test_a_system_without_memory_files_has_no_ring(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "memfd_create", raising=False)
    assert ImageRing.create() is None


def open_files() -> set[str]:
    """What this process has open, and what lies in the places for temporary files."""
    links = [each for each in Path("/proc/self/fd").iterdir() if each.is_symlink()]
    held = {str(each.readlink()) for each in links if os.path.lexists(each)}
    places = [Path("/dev/shm"), Path(tempfile.gettempdir())]
    return held | {str(each) for place in places if place.is_dir() for each in place.glob("markerseek-*")}


@needs_memory_files
@pytest.mark.long
@pytest.mark.real_time
def test_a_child_that_is_killed_at_any_moment_loses_nothing_and_is_continued_with_all_its_images(
    tmp_path: Path,
) -> None:
    number = 0
    before = open_files()

    @given(items=st.integers(1, 24), more_s=st.floats(0, 0.02))
    # Not shrunk: each example is two processes.
    @settings(max_examples=6, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
    def killed(items: int, more_s: float) -> None:
        nonlocal number
        number += 1
        journal = tmp_path / f"{number}.journal"
        child = ChildRun([*SEARCH, "--journal", str(journal)], journal=journal)
        seen = with_images(child.items(), handed=child.images)
        shown = [each for _, each in zip(range(items), seen, strict=False)]
        # At any moment.
        time.sleep(more_s)
        child.kill()
        shown += seen
        child.outcome()
        kept = entries_of(with_images(written(journal)))
        # All that was acknowledged is in the record, with the image that was shown.
        require_equal(entries_of(iter(shown)), kept)
        again = ChildRun(["resume", str(journal), "--arm"], journal=journal)
        continued = entries_of(with_images(again.items(), handed=again.images))
        again.outcome()
        require_equal(continued, entries_of(with_images(written(journal))))
        require_equal(continued[: len(kept)], kept)
        assert {each for each in open_files() - before if "markerseek" in each} == set()

    killed()
