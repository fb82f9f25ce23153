"""Simulated runs that keep a journal, for tests: begun, stopped after some event, and resumed."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import TypeAlias

from markerseek import rigs
from markerseek.core import (
    AcquisitionError,
    AnyPolicy,
    Event,
    Frame,
    Policy,
    Reader,
    Reading,
    SearchPlan,
)
from markerseek.records.journal import Checked, Configuration, Journal, RecordedRun, Resuming
from markerseek.rigs import Rig
from markerseek.runs import configuration_of
from markerseek.runs.journalled import journalled
from markerseek.runs.resume import resumed
from markerseek.search import build
from markerseek.sim import GaussianCurve, NoiseSettings, SimulatedSettings
from tests.unit.records.journal.synthetic_journals import changed

Begin: TypeAlias = Callable[[], tuple[AnyPolicy, Rig, Configuration]]

METHOD = "golden-section"
ACQUISITIONS = 8
SEED = 5
MARKER_DEG = -9.4


class Refusing:
    """A reader that refuses each fourth frame."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    def read(self, frame: Frame) -> Reading:
        if frame.header.sequence % 4 == 0:
            raise AcquisitionError("a frame that this test refuses")
        return self._reader.read(frame)


def begin(*, marker_deg: float = MARKER_DEG, snr_db: float = 40.0) -> tuple[Policy, Rig, Configuration]:
    rig = rigs.of_intensities(
        seed=SEED,
        curve=GaussianCurve(fwhm_deg=12.0),
        marker_deg=marker_deg,
        settings=SimulatedSettings(noise=NoiseSettings(peak_snr_db=snr_db)),
    )
    rig.scanner._reader = Refusing(rig.scanner._reader)
    start_deg = rig.stage.angle_deg
    policy = build(SearchPlan(method=METHOD, acquisitions=ACQUISITIONS, start_deg=start_deg), limits=rig.limits.search)
    return policy, rig, configured(rig)


def configured(rig: Rig, **changes: object) -> Configuration:
    plain = configuration_of(
        rig,
        SearchPlan(
            method=METHOD,
            acquisitions=ACQUISITIONS,
            as_published=False,
            start_deg=rig.stage.angle_deg,
            dark_frames=rig.dark_frames,
            stay=False,
        ),
    )
    return changed(plain, **changes)


def live(path: Path, *, until: int | None = None, begun: Begin = begin) -> list[Event]:
    """The events of a run, up to its end or to the `until`-th."""
    policy, rig, configuration = begun()
    handed_on: list[Event] = []
    with Journal.create(path, configuration) as journal, closing(journalled(policy, rig, journal)) as events:
        for event in events:
            handed_on.append(event)
            if len(handed_on) == until:
                break
    return handed_on


def resume_run(path: Path, *, rig: Rig | None = None, reset_fault: bool = False, begun: Begin = begin) -> list[Event]:
    policy, same, _ = begun()
    journal, held = Journal.reopen(path)
    with journal:
        return list(
            resumed(policy, rig or same, journal, held, by="a person", anew=lambda: begun()[0], reset_fault=reset_fault)
        )


def times_and_events(held: RecordedRun) -> list[tuple[object, float]]:
    return [(entry.event, entry.clock_s) for entry in held.entries if not isinstance(entry.event, Resuming | Checked)]
