"""The result of a run, from its journal."""

from __future__ import annotations

from markerseek.core import Failed, Finished, Measured, Refused, Started
from markerseek.records.journal.configuration import Configuration
from markerseek.records.journal.reader import Recording
from markerseek.records.result import Recorder, SearchResult


def result_of(held: Recording) -> tuple[Recorder, SearchResult]:
    """Result of a run that is over, and the recorder that heard it.

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
            recorder.hear(entry.event)
    return recorder, result_with(recorder, held.configuration)


def result_with(recorder: Recorder, begun_with: Configuration) -> SearchResult:
    """Result of a run that a recorder heard.

    Parameters
    ----------
    recorder
        It heard the run to its end.
    begun_with
        What the run was begun with.

    Raises
    ------
    SearchError
        If the run is not over, or ended with a fault.
    """
    return recorder.result(
        method=begun_with.method,
        as_published=begun_with.as_published,
        rig=begun_with.rig,
        face_radius_m=begun_with.face_radius_m,
        truth_deg=begun_with.truth_deg,
        reference_deg=begun_with.reference_deg,
        seed=begun_with.seed,
        configuration=begun_with.fingerprint,
    )
