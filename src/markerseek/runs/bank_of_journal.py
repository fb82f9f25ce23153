"""Converts the acquisitions of a journal to a bank, which other programs can open."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

import msgspec

from markerseek.core import ChannelFrame, Measured, RecordError, Sample
from markerseek.records.banks import BankFacts, FrameBank, IntensityBank, require_angles
from markerseek.records.journal import RecordedRun, read_journal
from markerseek.runs.bank_scan import bank_facts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JournalBank(FrameBank):
    """Frames of a run, in memory."""

    samples: tuple[Sample, ...] = field(repr=False)
    """Acquisitions with light, in the order of the angles."""
    dark: tuple[Sample, ...] = field(repr=False)
    """Acquisitions without light, in the order of time."""

    def frame(self, index: int) -> ChannelFrame:
        """Channel data of one angle, with the recorded header."""
        return _channels(self.samples[index])

    def dark_frame(self, index: int) -> ChannelFrame:
        """One frame without laser, counted from 0; `RecordError` where there is none."""
        if not 0 <= index < self.dark_frames:
            raise RecordError(f"there is no dark frame {index + 1}, the journal holds {self.dark_frames}")
        return _channels(self.dark[index])


def journal_bank(path: Path) -> IntensityBank | JournalBank:
    """Bank of all acquisitions of a run, with the confirmation; of several at one angle the last.

    ``path``: the journal; its run need not be over.
    """
    recorded = read_journal(path)
    known = recorded.configuration.facts
    samples = [entry.event.sample for entry in recorded.entries if isinstance(entry.event, Measured)]
    # A bank has one acquisition per angle; the last one is nearest in time to the answer.
    by_angle = {each.angle_deg: each for each in samples if not each.dark}
    repeated = sum(not each.dark for each in samples) - len(by_angle)
    require_angles(path, sorted(by_angle))
    lit = tuple(by_angle[angle_deg] for angle_deg in sorted(by_angle))
    bank = IntensityBank(
        angles_deg=tuple(each.angle_deg for each in lit),
        intensities=tuple(each.reading.intensity for each in lit),
        facts=_scan_facts(recorded)
        or bank_facts(
            known,
            description=f"journal of {recorded.configuration.plan.method} on a {known.rig_name}: {known.description}"
            + (f", without {repeated} at repeated angles" if repeated else ""),
            clock_zero_unix_s=_clock_zero_unix_s(recorded),
        ),
    )
    # A bank of frames needs channel data at every angle; of other frames only the intensities are taken.
    if not all(isinstance(each.frame, ChannelFrame) for each in lit):
        return bank
    dark = tuple(each for each in samples if each.dark and isinstance(each.frame, ChannelFrame))
    return JournalBank(
        angles_deg=bank.angles_deg,
        intensities=bank.intensities,
        facts=bank.facts,
        dark_frames=len(dark),
        samples=lit,
        dark=dark,
        started_s=tuple(each.frame.header.started_s for each in lit if each.frame is not None),
        pulses=tuple(each.frame.header.pulses for each in lit if each.frame is not None),
    )


def _scan_facts(recorded: RecordedRun) -> BankFacts | None:
    """Facts of the bank that a scan was to become; None of a search."""
    try:
        known: BankFacts | None = msgspec.json.decode(recorded.configuration.bank, type=BankFacts | None)
    except msgspec.MsgspecError as problem:
        raise RecordError(f"{recorded.path}: what its bank is to hold cannot be read: {problem}") from problem
    return known


def _clock_zero_unix_s(recorded: RecordedRun) -> float:
    """Unix time at which the clock of the run read 0, from the date of its first entry."""
    first = recorded.entries[0]
    return datetime.fromisoformat(first.written).timestamp() - first.clock_s


def _channels(sample: Sample) -> ChannelFrame:
    assert isinstance(sample.frame, ChannelFrame)  # noqa: S101 - only such samples are put into a bank of frames
    return sample.frame
