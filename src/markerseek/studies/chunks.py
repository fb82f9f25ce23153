"""Chunks of a study: whole trials that are computed together, in any process, with the same result."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.studies.study import Study, cells
from markerseek.studies.table import as_csv, values_of
from markerseek.studies.trial import run_trial

_ROWS = {"curves": 250, "readings": 64, "frames": 16}
"""Rows of a chunk, about: at most a second of work, so that little is lost when a study is interrupted, and no worker
waits long for the last one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Chunk:
    """Trials of a study that are computed together.

    Attributes
    ----------
    index
        Its index, from 0.
    first, last
        First trial, and the one after the last, counted through all cells.
    """

    index: int
    first: int
    last: int


def chunk_count(study: Study) -> int:
    """Number of chunks of a study; it depends on the study only, so that a continued study has the same ones."""
    return -(-_trials(study) // _size(study))


def chunk(study: Study, index: int) -> Chunk:
    """Chunk with that index.

    Parameters
    ----------
    study, index
        The study, and the index of the chunk, from 0.
    """
    first = index * _size(study)
    return Chunk(index=index, first=first, last=min(first + _size(study), _trials(study)))


def chunk_rows(study: Study, piece: Chunk) -> int:
    """Number of rows of a chunk."""
    return (piece.last - piece.first) * len(study.policies)


def run_chunk(study: Study, piece: Chunk) -> bytes:
    """Lines of a chunk's rows in the table."""
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
    # Whole trials: the policies of a trial share its window and its curve, which are cached.
    return max(1, _ROWS[study.level] // len(study.policies))
