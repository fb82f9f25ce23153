"""Frames of a journal exported as a bank: the same counts at the same angles, with the same facts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from markerseek import rigs
from markerseek.core import ChannelFrame, Measured, Sample, SearchPlan
from markerseek.records.journal import Journal, RecordedRun, read_journal
from markerseek.runs import configuration_of, journal_bank
from markerseek.runs.bank_scan import JournalBank
from markerseek.runs.journalled import journalled
from markerseek.search import build


def measured(held: RecordedRun) -> Iterator[Sample]:
    return (entry.event.sample for entry in held.entries if isinstance(entry.event, Measured))


def test_frames_of_a_run_come_back_with_their_angles_and_headers(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    rig = rigs.simulated(seed=3)
    policy = build(SearchPlan(method="ternary", acquisitions=6, as_published=True), limits=rig.limits.search)
    kept = configuration_of(
        rig, SearchPlan(method="ternary", acquisitions=6, as_published=True, start_deg=0.0, dark_frames=2, stay=False)
    )
    with Journal.create(path, kept) as journal, closing(journalled(policy, rig, journal)) as events:
        for _ in events:
            pass
    samples = list(measured(read_journal(path)))
    at = {each.angle_deg: each for each in samples if not each.dark}
    lit = [at[angle_deg] for angle_deg in sorted(at)]
    bank = journal_bank(path)
    assert isinstance(bank, JournalBank)
    # The confirmation is made where the last acquisition of the search was; it is the one that is kept.
    assert (len(bank.angles_deg), bank.dark_frames, len(samples)) == (6, 2, 9)
    assert samples[-1] in lit
    assert list(bank.angles_deg) == [each.angle_deg for each in lit]
    assert list(bank.intensities) == [each.reading.intensity for each in lit]
    for index, sample in enumerate(lit):
        assert isinstance(sample.frame, ChannelFrame)
        assert bank.frame(index).header == sample.frame.header
        np.testing.assert_array_equal(bank.frame(index).samples, sample.frame.samples)
    for index, sample in enumerate(each for each in samples if each.dark):
        assert isinstance(sample.frame, ChannelFrame)
        np.testing.assert_array_equal(bank.dark_frame(index).samples, sample.frame.samples)
    facts = bank.facts
    assert rig.imaging is not None
    assert (facts.reference_angle_deg, facts.face_radius_m) == (rig.facts.truth_deg, rig.facts.face_radius_m)
    assert (facts.sampling_hz, facts.pitch_m) == (40e6, rig.imaging.preset.array.pitch_m)
    assert (facts.simulated, facts.seed, facts.configuration) == (True, 3, rig.facts.fingerprint)
    assert {bank.frame(index).header.pulses for index in range(6)} == {16}
    first = read_journal(path).entries[0]
    assert facts.clock_zero_unix_s is not None
    began = datetime.fromtimestamp(facts.clock_zero_unix_s + first.clock_s, tz=UTC)
    assert abs((began - datetime.fromisoformat(first.written)).total_seconds()) < 1e-3
    assert facts.description.startswith("journal of ternary on a simulated rig")
    assert facts.description.endswith(", without 1 at repeated angles")
