"""Reconstruction from a journal: the result from its frames, the rig, a run on a recording."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from markerseek import rigs
from markerseek.core import ChannelFrame, Event, Frame, Measured, Policy, PolicyPlan, Reader, Reading, RecordError
from markerseek.records.journal import Configuration, Entry, Journal, read_journal
from markerseek.rigs import Rig
from markerseek.runs import rebuild_policy, rebuild_reader, rebuild_rig, recompute_differences, scan_bank
from markerseek.runs.journalled import journalled
from markerseek.runs.resume import resumed
from markerseek.search import build
from markerseek.sim import SimulatedSettings
from tests.unit.runs.journalled_runs import ACQUISITIONS, begin, configured, times_and_events


def test_the_result_is_worked_out_again_from_the_frames(whole: Path) -> None:
    held = read_journal(whole)
    assert recompute_differences(held, begin()[0], rebuild_reader(held.configuration)) == []
    assert (
        recompute_differences(
            held, build(PolicyPlan(method="ternary", acquisitions=ACQUISITIONS)), rebuild_reader(held.configuration)
        )
        != []
    )


class Amplified:
    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    def read(self, frame: Frame) -> Reading:
        reading = self._reader.read(frame)
        return replace(reading, intensity=reading.intensity * (1 + 1e-15))


def test_a_last_bit_that_differs_is_reported(tmp_path: Path) -> None:
    rig = rigs.simulated(seed=2, marker_deg=4.0)
    path = tmp_path / "run.journal"
    configuration = configured(rig, dark_frames=1)
    policy = rebuild_policy(configuration)
    with Journal.create(path, configuration) as journal, closing(journalled(policy, rig, journal)) as events:
        for _ in range(8):
            next(events)
    held = read_journal(path)
    reader = rebuild_reader(configuration)
    assert recompute_differences(held, rebuild_policy(configuration), reader) == []
    found = recompute_differences(held, rebuild_policy(configuration), Amplified(reader))
    assert found
    assert "its frame is read as" in found[0]


def test_a_rig_is_put_together_again_from_its_settings(tmp_path: Path) -> None:
    settings = SimulatedSettings(tissue="liver", start_deg=3.0)
    rig = rigs.simulated(seed=9, settings=settings)
    again = rebuild_rig(configured(rig))
    assert again.facts == rig.facts
    assert again.stage.angle_deg == rig.stage.angle_deg
    with pytest.raises(RecordError, match="from Python, with the rig"):
        rebuild_rig(configured(rigs.of_intensities(seed=1, curve=None, marker_deg=0.0)))


def test_a_replayed_run_is_resumed_only_if_its_recording_is_unchanged(tmp_path: Path) -> None:
    scan = tmp_path / "scan.csv"
    rows = [f"{angle},{1 + 90 * 2.0 ** -((angle - 8) ** 2 / 9)}" for angle in range(-35, 36)]
    scan.write_text("angle_deg,intensity\n" + "\n".join(rows) + "\n")

    def begin_replay() -> tuple[Policy, Rig, Configuration]:
        rig = rigs.replayed(scan)
        configuration = configured(rig, start_deg=rig.stage.angle_deg)
        return rebuild_policy(configuration), rig, configuration

    def run_until(path: Path, until: int) -> None:
        policy, rig, configuration = begin_replay()
        with Journal.create(path, configuration) as journal:
            events: Generator[Event, None, None] = journalled(policy, rig, journal)
            with closing(events):
                for count, _ in enumerate(events, start=1):
                    if count == until:
                        break

    whole, part = tmp_path / "whole.journal", tmp_path / "part.journal"
    run_until(whole, 1000)
    run_until(part, 7)
    journal, held = Journal.reopen(part)
    with journal:
        rig = rebuild_rig(held.configuration)
        list(resumed(rebuild_policy(held.configuration), rig, journal, held, by="a person"))
    assert times_and_events(read_journal(part)) == times_and_events(read_journal(whole))
    elsewhere = scan.rename(tmp_path / "elsewhere.csv")
    assert recompute_differences(held, rebuild_policy(held.configuration), rebuild_reader(held.configuration)) == []
    elsewhere.rename(scan)
    scan.write_text(scan.read_text().replace("0,", "0,1", 1))
    with pytest.raises(RecordError, match="the recording has changed since the run began"):
        rebuild_rig(held.configuration)


def test_a_replay_of_a_bank_continues_with_the_remaining_dark_frames(tmp_path: Path) -> None:
    bank = tmp_path / "scan.hdf5"
    for _ in scan_bank(rigs.simulated(seed=3, marker_deg=6.3), bank, step_deg=5.0):
        pass
    whole = tmp_path / "whole.journal"
    rig = rigs.replayed(bank)
    begun_with = configured(rig, method="posterior", acquisitions=None, dark_frames=3, start_deg=rig.stage.angle_deg)

    def run_until(path: Path, until: int | None) -> None:
        again = rebuild_rig(begun_with)
        with Journal.create(path, begun_with) as journal:
            events = journalled(rebuild_policy(begun_with), again, journal)
            with closing(events):
                for count, _ in enumerate(events, start=1):
                    if count == until:
                        break

    run_until(whole, None)
    for until in (2, 3, 5, 8):
        path = tmp_path / f"{until}.journal"
        run_until(path, until)
        journal, held = Journal.reopen(path)
        with journal:
            list(resumed(rebuild_policy(begun_with), rebuild_rig(begun_with), journal, held, by="a person"))
        assert times_and_events(read_journal(path)) == times_and_events(read_journal(whole))
        counts = [
            [entry.event.sample.frame.samples.tobytes() for entry in read_journal(each).entries if _has_counts(entry)]
            for each in (path, whole)
        ]
        assert counts[0] == counts[1] != []
    bank.unlink()
    assert recompute_differences(read_journal(whole), rebuild_policy(begun_with), rebuild_reader(begun_with)) == []


def _has_counts(entry: Entry) -> bool:
    return isinstance(entry.event, Measured) and isinstance(entry.event.sample.frame, ChannelFrame)
