"""A study in pieces: chunks of whole trials, each of which is computed anywhere and gives the same lines."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.studies.study import Study, cells
from markerseek.studies.table import as_csv, values_of
from markerseek.studies.trial import run_trial

_ROWS = {"curves": 250, "readings": 64, "frames": 16}
"""Rows of a chunk, about: a second of work or less, so that little is lost when a study is killed, and no worker waits
long for the last one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Chunk:
    """Trials of a study that are computed together.

    Attributes
    ----------
    index
        Its number, from 0.
    first, last
        First trial, and the one behind the last, counted through all cells.
    """

    index: int
    first: int
    last: int


def chunk_count(study: Study) -> int:
    """Number of chunks of a study; it depends on the study alone, so that a restart finds the same ones."""
    return -(-_trials(study) // _size(study))


def chunk(study: Study, index: int) -> Chunk:
    """Chunk of that number.

    Parameters
    ----------
    study, index
        Whose, and which, from 0.
    """
    first = index * _size(study)
    return Chunk(index=index, first=first, last=min(first + _size(study), _trials(study)))


def chunk_rows(study: Study, piece: Chunk) -> int:
    """Number of rows of a chunk."""
    return (piece.last - piece.first) * len(study.policies)


def run_chunk(study: Study, piece: Chunk) -> bytes:
    """Lines of a chunk's rows, as they stand in the table."""
    everything = cells(study)
    lines = []
    for place in range(piece.first, piece.last):
        cell, trial = divmod(place, study.trials)
        for policy in range(len(study.policies)):
            lines.append(values_of(run_trial(study, everything[cell], trial, policy)))  # noqa: PERF401  two loops deep
    return as_csv(lines)


def _trials(study: Study) -> int:
    return len(cells(study)) * study.trials


def _size(study: Study) -> int:
    return max(1, _ROWS[study.level] // len(study.policies))
