"""Runs of a study give the same files on any machine and after any interruption."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest
from msgspec import structs

from markerseek.core import RecordError
from markerseek.studies import (
    Axis,
    CurveSettings,
    Study,
    Summary,
    run_study,
    runner,
    study_policy,
)
from markerseek.studies.runner import chunks

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
    study = structs.replace(STUDY, level="frames", curve=CurveSettings(), trials=3)
    assert [list(trials) for trials in chunks(study)] == [[each] for each in range(6)]


def test_a_table_torn_anywhere_is_continued_from_its_last_whole_trial(whole: dict[str, bytes], tmp_path: Path) -> None:
    study = structs.replace(STUDY, trials=3)
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
        run_study(structs.replace(STUDY, seed=2), tmp_path)
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
    with pytest.raises(RecordError, match="with `out`"):
        run_study(STUDY, tmp_path / "file" / "below")
