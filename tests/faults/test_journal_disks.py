"""Full disks, folders that cannot be written, and kills: no acknowledged event is lost, and the next run starts."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import traceback
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import numpy as np
import pytest

from markerseek import rigs
from markerseek.core import ChannelFrame, Measured, Policy, RecordError, SearchPlan, Started
from markerseek.guard import State
from markerseek.records.journal import Journal, RunView, read_journal
from markerseek.rigs import Rig
from markerseek.runs.journalled import journalled
from markerseek.runs.resume import resumed
from markerseek.search import build
from markerseek.show import SearchResult
from markerseek.sim import GaussianCurve
from tests.faults.kills import kill
from tests.unit.records.journal.synthetic_journals import RANGE, configuration, counts, measured


def fill(path: Path) -> int:
    """Commit frames until it fails; the number of those that were acknowledged comes back."""
    acknowledged: list[int] = []

    def commit_for_ever() -> None:
        with Journal.create(path, configuration()) as journal:
            journal.commit(Started(start_deg=0.0, limits=RANGE), clock_s=0.0)
            for index in count(1):
                journal.commit(measured(index, counts=counts(32, 520, seed=index)), clock_s=float(index))
                acknowledged.append(index)

    with pytest.raises(RecordError, match=r"cannot be written.*the room on the disk"):
        commit_for_ever()
    return len(acknowledged)


def require_all(path: Path, acknowledged: int) -> None:
    events = [entry.event for entry in read_journal(path).entries if isinstance(entry.event, Measured)]
    assert len(events) >= acknowledged > 5
    for event in events:
        assert isinstance(event.sample.frame, ChannelFrame)
        np.testing.assert_array_equal(event.sample.frame.samples, counts(32, 520, seed=event.index))


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
def small_disk(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Path]:
    """A disk of one megabyte, or of the parameter's size."""
    folder = tmp_path / "small"
    folder.mkdir()
    size = f"size={getattr(request, 'param', 1)}m"
    mount = ["mount", "-t", "tmpfs", "-o", size, "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("needs leave to mount a small disk")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


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
        return build(SearchPlan(method="ternary", acquisitions=16), limits=rig.limits.search), rig

    policy, rig = begin()
    path = small_disk / "run.journal"
    (small_disk / "ballast").write_bytes(b"0" * (1012 << 10))
    with pytest.raises(RecordError, match="the room on the disk"), Journal.create(path, configuration()) as journal:
        for _ in journalled(policy, rig, journal):
            pass
    assert rig.scanner.guard.state is State.DISARMED
    assert len(read_journal(path).entries) >= 2
    (small_disk / "ballast").unlink()
    policy, rig = begin()
    journal, held = Journal.reopen(path)
    with journal:
        list(resumed(policy, rig, journal, held, by="a person", anew=lambda: begin()[0]))
    result = SearchResult.of(RunView.of(read_journal(path)))
    assert result.acquisitions == len(result.samples) == 16
    assert result.angle_deg == pytest.approx(4.0, abs=2.0)


def test_a_journal_that_cannot_be_begun_leaves_no_file(small_disk: Path) -> None:
    """Or the same command, with room again, would find a file of this name that is none of its own."""
    (small_disk / "ballast").write_bytes(b"0" * (1 << 20))
    with pytest.raises(RecordError, match=r"cannot be written: .*the room on the disk"):
        Journal.create(small_disk / "run.journal", configuration())
    assert [each.name for each in small_disk.iterdir()] == ["ballast"]
    (small_disk / "ballast").unlink()
    Journal.create(small_disk / "run.journal", configuration()).close()
    assert read_journal(small_disk / "run.journal").entries == ()


@pytest.mark.parametrize("number", range(6))
def test_a_run_that_is_killed_keeps_what_it_acknowledged_and_goes_on(number: int) -> None:
    kill(number, seed=0)
