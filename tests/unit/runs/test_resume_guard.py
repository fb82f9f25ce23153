"""The guard of a resumed run knows the admitted frames, and counts the pulses already permitted."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from markerseek import rigs
from markerseek.core import Frame, LimitError, Measured, Permit, Reader, Reading, Receiver, Refused
from markerseek.guard import FiringLimits
from markerseek.records.journal import Journal, read_journal, verify
from markerseek.rigs import Rig
from markerseek.runs import rebuild_policy
from markerseek.runs.journalled import journalled
from markerseek.runs.resume import pulses_before, resumed
from markerseek.sim import GaussianCurve
from tests.unit.runs.journalled_runs import ACQUISITIONS, configured, times_and_events

FAULTY = 7
"""Number of the frame that is not as it should be: the first one after the death."""


class Stuck:
    """A receiver whose frame of that number holds the data of the one before."""

    def __init__(self, receiver: Receiver, data: float) -> None:
        self._receiver, self._data = receiver, data

    def settle(self) -> None:
        self._receiver.settle()

    def arm(self, permit: Permit) -> None:
        self._receiver.arm(permit)

    def acquire(self, permit: Permit) -> Frame:
        frame = self._receiver.acquire(permit)
        return replace(frame, intensity=self._data) if frame.header.sequence == FAULTY else frame


class Noisy:
    """A reader that measures a burst of noise in the frame of that number."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    def read(self, frame: Frame) -> Reading:
        reading = self._reader.read(frame)
        assert reading.noise_sigma is not None
        return replace(reading, noise_sigma=3 * reading.noise_sigma) if frame.header.sequence == FAULTY else reading


def rig_of() -> Rig:
    return rigs.of_intensities(seed=5, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=-9.4)


def run_until(path: Path, inject: Callable[[Rig], None], *, measured: int | None) -> None:
    rig = rig_of()
    inject(rig)
    begun_with = configured(rig)
    with (
        Journal.create(path, begun_with) as journal,
        closing(journalled(rebuild_policy(begun_with), rig, journal)) as events,
    ):
        for event in events:
            if isinstance(event, Measured) and measured is not None:
                measured -= 1
                if measured == 0:
                    break


def resume_run(path: Path, inject: Callable[[Rig], None]) -> Rig:
    rig = rig_of()
    journal, held = Journal.reopen(path)
    with journal, closing(resumed(rebuild_policy(held.configuration), rig, journal, held, by="a person")) as events:
        for event in events:
            # The checks are over when the last event that was kept has been repeated.
            if event == held.entries[-1].event:
                inject(rig)
    return rig


@pytest.mark.parametrize("fault", ["stale", "noisy"])
def test_a_faulty_frame_after_a_crash_is_refused_as_without_one(fault: str, tmp_path: Path) -> None:
    run_until(tmp_path / "sound", lambda rig: None, measured=None)
    before = [entry.event for entry in read_journal(tmp_path / "sound").entries if isinstance(entry.event, Measured)]

    def inject(rig: Rig) -> None:
        if fault == "stale":
            rig.scanner._receiver = Stuck(rig.scanner._receiver, before[FAULTY - 2].sample.reading.intensity)
        else:
            rig.scanner._reader = Noisy(rig.scanner._reader)

    run_until(tmp_path / "whole", inject, measured=None)
    run_until(tmp_path / "part", inject, measured=FAULTY - 1)
    resume_run(tmp_path / "part", inject)
    wanted, held = read_journal(tmp_path / "whole"), read_journal(tmp_path / "part")
    refusals = [entry.event for entry in held.entries if isinstance(entry.event, Refused)]
    assert len(refusals) == 1
    assert ("those of the frame before" if fault == "stale" else "the noise is") in refusals[0].reason
    assert times_and_events(held) == times_and_events(wanted)
    assert verify(tmp_path / "part").faults == []


def test_the_pulses_of_all_sessions_are_counted_together(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    run_until(path, lambda rig: None, measured=6)
    rig = resume_run(path, lambda rig: None)
    fired = [
        entry.event.sample.frame.header.pulses
        for entry in read_journal(path).entries
        if isinstance(entry.event, Measured) and entry.event.sample.frame is not None
    ]
    assert sum(fired) == ACQUISITIONS * rig.scanner.pulses
    # Those of the search, before and after, and of two checks.
    assert rig.scanner.guard.pulses_permitted == sum(fired) + 2 * rig.scanner.pulses
    total = pulses_before(read_journal(path).entries, pulses=rig.scanner.pulses, attempts=3)
    assert total >= rig.scanner.guard.pulses_permitted


def test_refused_acquisitions_were_permitted_as_well(whole: Path) -> None:
    """Each fourth frame of this run was refused and taken again; dark frames need no pulses."""
    events = [entry.event for entry in read_journal(whole).entries]
    lit = [event for event in events if isinstance(event, Measured) and not event.sample.dark]
    refused = [event for event in events if isinstance(event, Refused)]
    assert len(refused) >= 3
    of_dark = [event for event in refused if event.frame is not None and event.frame.header.pulses == 0]
    assert pulses_before(read_journal(whole).entries, pulses=16, attempts=3) == 16 * (
        len(lit) + len(refused) - len(of_dark)
    )


def test_a_budget_that_is_used_up_stays_used_up_after_a_crash(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    run_until(path, lambda rig: None, measured=6)
    rig = rig_of()
    spent = pulses_before(read_journal(path).entries, pulses=rig.scanner.pulses, attempts=3)
    assert spent == 3 * rig.scanner.pulses
    rig.scanner.guard._permits._limits = FiringLimits(pulses_per_session=spent + rig.scanner.pulses)
    journal, held = Journal.reopen(path)
    with journal, pytest.raises(LimitError, match="64 pulses were permitted in this session and 16 more"):
        list(resumed(rebuild_policy(held.configuration), rig, journal, held, by="a person"))
