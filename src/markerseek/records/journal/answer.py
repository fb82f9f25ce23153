"""The result of a run, from its journal."""

from __future__ import annotations

from markerseek.core import Failed, Finished, Measured, Refused, Started
from markerseek.records.journal.reader import Recording
from markerseek.records.result import Recorder, SearchResult


def result_of(held: Recording) -> tuple[Recorder, SearchResult]:
    """Result of a run that is over, and the recorder that collected it.

    Parameters
    ----------
    held
        Its journal.

    Raises
    ------
    SearchError
        If the run is not over, or ended with a fault.
    """
    recorder = Recorder()
    for entry in held.entries:
        if isinstance(entry.event, Started | Measured | Refused | Finished | Failed):
            recorder.add(entry.event)
    return recorder, recorder.result(held.configuration.plan, held.configuration.facts)
