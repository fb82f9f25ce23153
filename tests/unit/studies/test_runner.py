"""Runs of a study give the same files on any machine and after any interruption."""

from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import importlib
import json
import multiprocessing
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import msgspec
import pytest

from markerseek.core import MarkerseekError, MissingExtraError, RecordError
from markerseek.studies import (
    Axis,
    CurveSettings,
    Study,
    Summary,
    run_study,
    runner,
    study_policy,
    workers,
)
from markerseek.studies.runner import chunks, run_chunk
from markerseek.studies.workers import in_order

STUDY = Study(
    name="small",
    policies=(
        study_policy(method="ternary", acquisitions=4, as_published=True),
        study_policy(method="weighted-average", acquisitions=3, as_published=True),
    ),
    trials=150,
    curve=CurveSettings(family="sech", fwhm_deg=12.0),
    vary=(Axis(key="rig.noise.peak_snr_db", values=(20.0, 40.0)),),
)


Compute = Callable[[range], bytes]


class KilledError(Exception):
    """Stands in for a process that has died."""


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix in (".csv", ".json")}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Files of a study that was not interrupted."""
    folder = tmp_path_factory.mktemp("whole")
    run_study(STUDY, folder, workers=1)
    return files(folder)


def test_two_processes_give_the_same_files_and_progress_rises_to_the_end(
    whole: dict[str, bytes], tmp_path: Path
) -> None:
    reported: list[int] = []
    finish = run_study(STUDY, tmp_path / "two", workers=2, progress=reported.append)
    assert files(tmp_path / "two") == whole
    assert reported == sorted(reported)
    assert reported[0] == 0
    assert reported[-1] == STUDY.rows
    assert finish.summary == msgspec.json.decode(whole["summary.json"], type=Summary)


@pytest.mark.parametrize("after", [0, 1, 2])
def test_a_study_that_ends_in_the_middle_is_continued_and_nothing_is_computed_twice(
    whole: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    computed: list[range] = []

    def mortal(compute: Compute, pieces: Iterator[range], **_where: object) -> Iterator[bytes]:
        for count, piece in enumerate(pieces):
            if count == after:
                raise KilledError
            computed.append(piece)
            yield compute(piece)

    assert len(list(chunks(STUDY))) == 3
    monkeypatch.setattr(runner, "in_order", mortal)
    with pytest.raises(KilledError):
        run_study(STUDY, tmp_path)
    with (tmp_path / "rows.part.csv").open("ab") as table:
        table.write(whole["rows.csv"].splitlines(keepends=True)[1 + 250 * after][:-5])
    (tmp_path / ".summary.json.0123abcd.part").write_bytes(b"half a summary")
    assert "rows.csv" not in files(tmp_path)

    def counted(compute: Compute, pieces: Iterator[range], **_where: object) -> Iterator[bytes]:
        for piece in pieces:
            computed.append(piece)
            yield compute(piece)

    monkeypatch.setattr(runner, "in_order", counted)
    run_study(STUDY, tmp_path)
    assert files(tmp_path) == whole
    assert computed == list(chunks(STUDY))
    assert sorted(path.name for path in tmp_path.iterdir()) == [".lock", "rows.csv", "study.json", "summary.json"]


def test_of_frames_each_search_is_kept_as_it_ends() -> None:
    study = dataclasses.replace(STUDY, level="frames", curve=CurveSettings(), trials=3)
    assert [list(trials) for trials in chunks(study)] == [[each] for each in range(6)]


def test_a_table_torn_anywhere_is_continued_from_its_last_whole_trial(whole: dict[str, bytes], tmp_path: Path) -> None:
    study = dataclasses.replace(STUDY, trials=3)
    run_study(study, tmp_path, workers=1)
    table = (tmp_path / "rows.csv").read_bytes()
    step = len(table) // 60
    for kept in [*range(0, len(table), step), len(table)]:
        (tmp_path / "rows.csv").unlink()
        (tmp_path / "rows.part.csv").write_bytes(table[:kept] + b"\0" * (kept % 3))
        run_study(study, tmp_path, workers=1)
        assert (tmp_path / "rows.csv").read_bytes() == table


def test_a_changed_study_or_another_version_is_refused_and_the_folder_left_as_it_is(
    whole: dict[str, bytes], tmp_path: Path
) -> None:
    for name, content in whole.items():
        (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordError, match=f"holds another study .hash {STUDY.digest}.*choose another folder"):
        run_study(dataclasses.replace(STUDY, seed=2), tmp_path)
    claim = json.loads(whole["study.json"])
    (tmp_path / "study.json").write_text(json.dumps({**claim, "version": "0.0.1", "hash": "0" * 16}))
    with pytest.raises(RecordError, match=r"was begun by version 0\.0\.1"):
        run_study(STUDY, tmp_path)
    (tmp_path / "study.json").write_text("{")
    with pytest.raises(RecordError, match="cannot be read"):
        run_study(STUDY, tmp_path)
    assert files(tmp_path)["rows.csv"] == whole["rows.csv"]


def test_a_folder_in_use_cannot_be_used_and_one_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    with runner._alone(tmp_path), pytest.raises(RecordError, match="another process is running this study"):
        run_study(STUDY, tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="with --out"):
        run_study(STUDY, tmp_path / "file" / "below")


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="Windows sends Ctrl-C otherwise")
def test_ctrl_c_that_a_librarys_thread_takes_does_not_interrupt_the_start_of_a_worker() -> None:
    started: list[str] = []
    starting, interrupted = threading.Event(), threading.Event()

    def interrupt() -> None:
        starting.wait()
        signal.raise_signal(signal.SIGINT)
        interrupted.set()

    def start(_function: object, job: str) -> None:
        starting.set()
        interrupted.wait()
        started.append(job)

    threading.Thread(target=interrupt).start()
    mask, handler = signal.pthread_sigmask(signal.SIG_BLOCK, ()), signal.getsignal(signal.SIGINT)
    pool = cast("ProcessPoolExecutor", SimpleNamespace(submit=start))
    with pytest.raises(KeyboardInterrupt):
        workers._submit(pool, "job")
    assert started == ["job"]
    assert (signal.pthread_sigmask(signal.SIG_BLOCK, ()), signal.getsignal(signal.SIGINT)) == (mask, handler)


def test_without_dask_the_answer_is_the_command_that_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        raise ModuleNotFoundError(name, name=name)

    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(MissingExtraError, match=r"pip install 'markerseek\[cluster\]'"):
        run_study(STUDY, tmp_path, scheduler="tcp://127.0.0.1:1")


ENTRY = """
import fcntl, os, sys, time
held = open(os.path.join(sys.argv[1], f"entry-{os.getpid()}"), "w")
fcntl.flock(held, fcntl.LOCK_EX)
sys.stdin.readline()
print('{"answer": "not found"}', flush=True)
# Its own child shares the lock: it is free when both have ended.
os.fork()
time.sleep(300)
"""
"""Answers its first search and hears nothing afterwards, not even the end of its input."""


def study_of_entries(folder: Path) -> Study:
    command = (sys.executable, "-c", ENTRY, str(folder))
    return dataclasses.replace(
        STUDY, policies=(study_policy(method="slow", acquisitions=3, command=command),), trials=10, vary=()
    )


def one_by_one(study: Study) -> Iterator[bytes]:
    return in_order(partial(run_chunk, study), [range(trial, trial + 1) for trial in range(10)], workers=2)


def wait_for_the_end_of_entries(folder: Path) -> None:
    entries = list(folder.glob("entry-*"))
    assert entries
    ends_s = time.monotonic() + 20
    for path in entries:
        with path.open() as held:
            while True:
                with contextlib.suppress(BlockingIOError):
                    fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                assert time.monotonic() < ends_s, f"{path.name} goes on"
                time.sleep(0.05)


@pytest.mark.real_time
def test_workers_whose_results_nobody_takes_any_more_are_ended_with_their_entries_and_not_waited_for(
    tmp_path: Path,
) -> None:
    """As at Ctrl-C: each of the searches that are left takes minutes."""
    results = one_by_one(study_of_entries(tmp_path))
    assert b"not found" in next(results)
    began_s = time.monotonic()
    results.close()
    assert time.monotonic() - began_s < 15
    assert not multiprocessing.active_children()
    wait_for_the_end_of_entries(tmp_path)


@pytest.mark.real_time
def test_entries_end_when_their_worker_is_killed(tmp_path: Path) -> None:
    """They have sessions of their own, and do not hear the end of their input."""
    results = one_by_one(study_of_entries(tmp_path))
    next(results)
    for worker in multiprocessing.active_children():
        worker.kill()
    with pytest.raises(MarkerseekError, match="a worker process was ended from outside"):
        list(results)
    wait_for_the_end_of_entries(tmp_path)


@pytest.mark.real_time
def test_entries_end_when_the_process_of_the_study_is_killed(tmp_path: Path) -> None:
    program = (
        "import sys; from pathlib import Path\n"
        "from tests.unit.studies.test_runner import one_by_one, study_of_entries\n"
        "results = one_by_one(study_of_entries(Path(sys.argv[1])))\n"
        "print(len(next(results)), flush=True); next(results); next(results)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(tmp_path)], stdout=subprocess.PIPE, cwd=Path(__file__).parents[3]
    ) as parent:
        assert parent.stdout is not None
        said = parent.stdout.readline()
        parent.kill()
    assert said.strip().isdigit()
    wait_for_the_end_of_entries(tmp_path)
