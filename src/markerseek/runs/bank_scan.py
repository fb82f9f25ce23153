"""Scans the search range of a rig through the same loop as a search, and makes banks of the records of runs."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Generator, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import cast

import msgspec
from msgspec.structs import replace

from markerseek._version import __version__
from markerseek.core import (
    MAX_ACQUISITIONS,
    ChannelFrame,
    ConfigError,
    DeviceError,
    Measured,
    RecordError,
    RigFacts,
    Sample,
    SearchPlan,
)
from markerseek.files import quoted
from markerseek.records.banks import (
    MIN_ANGLES,
    BankFacts,
    FrameBank,
    IntensityBank,
    record_of,
    require_angles,
    require_new_bank,
    require_room,
    whole_bank,
)
from markerseek.records.journal import (
    Configuration,
    Journal,
    JournalEntry,
    JournalEvent,
    RecordedRun,
    RunView,
    has_begun,
    read_journal,
    salvage,
)
from markerseek.rigs import Rig
from markerseek.runs.journalled import configuration_of, is_scan, journalled, limits_of
from markerseek.runs.resume import resumed
from markerseek.search import Exhaustive

_LOG = logging.getLogger(__name__)

MAX_ANGLES = 5000
"""Most angles of one scan."""


def scan_angles(rig: Rig, *, step_deg: float) -> int:
    """Return the number of angles of a scan with steps of at most that size, both ends of the search range included."""
    width_deg = rig.limits.search.width_deg
    if not width_deg / (MAX_ANGLES - 1) <= step_deg <= width_deg / 2:
        raise ConfigError(
            f"step_deg is {step_deg:g} deg, it must lie between {width_deg / (MAX_ANGLES - 1):.3g} and "
            f"{width_deg / 2:g} deg for the search range {rig.limits.search}"
        )
    hand = rig.by_hand
    if hand is not None and step_deg < 2 * hand.reach_deg + hand.step_deg:
        raise ConfigError(
            f"step_deg is {step_deg:g} deg, and the probe is turned by hand, to within {hand.reach_deg:g} deg: take "
            f"steps of at least {2 * hand.reach_deg + hand.step_deg:g} deg, or the angles reached would change places"
        )
    # Rounding can make 70 / 0.1 slightly larger than 700, and ceil would add a step.
    return math.ceil(width_deg / step_deg * (1 - 1e-12)) + 1


def _facts_from_rig(facts: RigFacts, *, description: str, clock_zero_unix_s: float) -> BankFacts:
    """Return the bank facts from rig facts; the true angle of a simulated marker becomes the reference.

    ``clock_zero_unix_s``: Unix time at which the clock of the rig read 0.
    """
    return BankFacts(
        description=description,
        probe=facts.probe,
        probe_settings=facts.probe_settings,
        sampling_hz=facts.sampling_hz,
        sound_speed_m_s=facts.sound_speed_m_s,
        pitch_m=facts.pitch_m,
        face_radius_m=facts.face_radius_m,
        reference_angle_deg=facts.known_deg,
        clock_zero_unix_s=clock_zero_unix_s,
        simulated=facts.kind == "simulated" or bool(facts.emulated),
        seed=facts.seed,
        configuration=facts.fingerprint,
        made_with=f"markerseek {__version__}",
    )


def scan_configuration(rig: Rig, *, step_deg: float) -> Configuration:
    """Return the configuration of a scan: that of an exhaustive search which does not end at the marker.

    `scan_bank` adds the facts of its bank, for the record. Arguments and errors as of `scan_angles`.
    """
    angles = scan_angles(rig, step_deg=step_deg)
    plan = SearchPlan(
        method="exhaustive",
        # A scan may have more angles than a search, whose plan then names no number.
        acquisitions=angles if angles <= MAX_ACQUISITIONS else None,
        start_deg=rig.stage.angle_deg,
        dark_frames=rig.dark_frames,
        stay=True,
        by_hand=rig.by_hand,
    )
    return configuration_of(rig, plan)


def require_new_scan(path: Path, *, goes_on: bool = False) -> None:
    """Refuse a path where no bank can be written, or beside which a scan that was killed is kept.

    ``goes_on``: whether that scan is to be continued, and must be there.
    """
    record = record_of(path)
    if goes_on and not record.is_file():
        raise RecordError(
            f"{path}: it is a bank already, also where its scan was stopped early; only a killed scan goes on: "
            "scan into a new file"
            if path.exists()
            else f"{record}: there is no scan to go on with; scan anew, or check the name"
        )
    if record.exists() and not has_begun(record):
        raise RecordError(f"{record}: its scan was killed before it had begun, and there is nothing in it; delete it")
    require_new_bank(path)
    if record.exists() and not goes_on:
        raise RecordError(
            f"{record}: it holds a scan that was killed; go on with it: "
            f"`scan_bank({quoted(path)})`, make a bank of it: `journal_bank({quoted(record)}, {quoted(path)})`, or "
            "delete it"
        )


def scan_bank(
    rig: Rig,
    path: Path,
    *,
    step_deg: float = 0.5,
    wavelength_m: float | None = None,
    pulse_energy_j: float | None = None,
    goes_on: bool = False,
    by: str = "",
) -> Generator[JournalEvent, None, None]:
    """Scan the search range; each acquisition is on disk before the next is made, and at the end all become a bank.

    If closed or interrupted, the stage stops, the laser is disarmed, and the bank has all acquisitions so far. Until
    it is written they are in a journal beside it (`record_of`), which outlives a process that is killed: it can be
    imported (`journal_bank`), or resumed; one of one or two angles, which make no bank, is kept as well. Times start at
    this computer's date; the clock of a simulated rig is virtual, and runs faster or slower from there.

    ``rig``: every acquisition passes its guard. ``path``: new file, ``.hdf5`` or ``.h5``; it must not exist.
    ``step_deg``: largest step. ``wavelength_m``, ``pulse_energy_j``: wavelength in metres and energy of one laser pulse
    in joules, where they are known. ``goes_on``: whether a scan that was killed goes on with the angles that its record
    does not have; ``by``: who armed the rig for that. Yields as `markerseek.scan.run`; a `Measured` follows once it is
    on disk.
    """
    angles = scan_angles(rig, step_deg=step_deg)
    facts = _facts_from_rig(
        rig.facts,
        description=f"{rig.facts.rig_name}: {rig.facts.description}",
        clock_zero_unix_s=time.time() - rig.scanner.clock.now_s(),
    )
    facts = replace(facts, wavelength_m=wavelength_m, pulse_energy_j=pulse_energy_j)
    # A scan is a search that never decides, so that guard, journal events and errors are the same.
    policy = Exhaustive(limits=rig.limits.search, acquisitions=angles, start_deg=rig.stage.angle_deg)
    known = msgspec.Raw(msgspec.json.encode(facts))
    configuration = msgspec.structs.replace(scan_configuration(rig, step_deg=step_deg), bank=known)
    limits = limits_of(configuration, angles=angles)
    require_new_scan(path, goes_on=goes_on)
    if goes_on:
        journal, recorded = Journal.reopen(record_of(path))
        with ExitStack() as undo:
            undo.callback(journal.close)
            _require_same_scan(recorded, configuration)
            undo.pop_all()
        facts = _scan_facts(recorded) or facts
        # One that was killed while its bank was made has all its angles.
        events = _nothing()
        if RunView.of(recorded).state != "finished":
            events = resumed(policy, rig, journal, recorded, by=by, anew=lambda: policy, check=False, limits=limits)
    else:
        journal = Journal.create(record_of(path), configuration)
        events = journalled(policy, rig, journal, limits=limits)
    room_is_known = False
    # The outer block: the rig is stopped before the bank is written.
    with _exported(journal, path, facts), closing(events):
        for event in events:
            if isinstance(event, Measured) and isinstance(event.sample.frame, ChannelFrame) and not room_is_known:
                room_is_known = True
                # For the record, and for the bank that is made of it: a disk that is full later would end the scan.
                require_room(path, 2 * event.sample.frame.samples.nbytes * (angles + rig.dark_frames))
            yield event


def _nothing() -> Generator[JournalEvent, None, None]:
    yield from ()


def _require_same_scan(recorded: RecordedRun, now: Configuration) -> None:
    """Refuse to go on with a scan of another rig, or with other steps."""
    was = recorded.configuration
    view = RunView.of(recorded)
    if view.state == "fault":
        # Only a person's reset leaves a fault, and a record of so few angles is soon made again.
        raise DeviceError(
            f"{recorded.path}: the scan ended with a fault: {view.fault}; look at the rig, delete this file, "
            "and scan again"
        )
    if not is_scan(was):
        raise ConfigError(
            f"{recorded.path}: it is the journal of a search; go on with it: `resumed_run({quoted(recorded.path)})`"
        )
    if (was.plan.acquisitions, was.facts.fingerprint, was.facts.seed) != (
        now.plan.acquisitions,
        now.facts.fingerprint,
        now.facts.seed,
    ):
        raise ConfigError(
            f"{recorded.path}: it is a scan of {was.plan.acquisitions} angles of {was.facts.description}, and the "
            f"command asks for {now.plan.acquisitions} angles of {now.facts.description}; give the rig, the seed and "
            "the step of the first scan"
        )


@contextmanager
def _exported(journal: Journal, path: Path, facts: BankFacts) -> Iterator[None]:
    """Make a bank of the record of a scan when the block ends, however it ends."""
    try:
        with journal:
            yield
    except BaseException:
        try:
            _export(journal.path, path, facts)
        except RecordError as problem:
            # It must not hide what ended the scan.
            _LOG.warning("%s", problem)
        raise
    _export(journal.path, path, facts)


def _export(record: Path, path: Path, facts: BankFacts) -> None:
    """Make a bank of a record, frame by frame, and delete the record; `RecordError` where the record is damaged.

    A record of too few angles for a bank stays as it is, so that its scan can be continued; one of none is deleted.
    """
    recorded, damage = salvage(record, frames=False)
    measured = [entry.event.sample for entry in recorded.entries if isinstance(entry.event, Measured)]
    angles = len({sample.angle_deg for sample in measured if not sample.dark})
    enough = angles >= MIN_ANGLES
    if enough:
        try:
            with whole_bank(path, facts=facts) as writer:

                def add(entry: JournalEntry) -> None:
                    if isinstance(entry.event, Measured):
                        writer.add(entry.event.sample)

                salvage(record, frames=False, on_entry=add)
        except RecordError as problem:
            raise RecordError(
                f"{problem}; what was measured is in {record}: `journal_bank({quoted(record)}, NEW.hdf5)`"
            ) from problem
    if damage is not None:
        held = f"{path} holds the {angles} angles" if enough else f"{angles} angles, too few for a bank, were read"
        # It may still hold more than could be read.
        raise RecordError(f"{damage}; {held} before that, and the record is kept: scan again for the others")
    if enough or not angles:
        record.unlink()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JournalBank(FrameBank):
    """Frames of a run, in memory."""

    samples: tuple[Sample, ...] = field(repr=False)
    """Acquisitions with light, in the order of the angles."""
    dark: tuple[Sample, ...] = field(repr=False)
    """Acquisitions without light, in the order of time."""

    def frame(self, index: int) -> ChannelFrame:
        """Return the channel data of one angle, with the recorded header."""
        return cast("ChannelFrame", self.samples[index].frame)

    def dark_frame(self, index: int) -> ChannelFrame:
        """Return one frame without laser, counted from 0."""
        return cast("ChannelFrame", self.dark[index].frame)


def journal_bank(path: Path) -> IntensityBank | JournalBank:
    """Return the bank of all acquisitions of a run, with the confirmation; of several at one angle the last.

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
        or _facts_from_rig(
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
    )


def _scan_facts(recorded: RecordedRun) -> BankFacts | None:
    """Return the facts of the bank that a scan was to become; None of a search."""
    try:
        known: BankFacts | None = msgspec.json.decode(recorded.configuration.bank, type=BankFacts | None)
    except msgspec.MsgspecError as problem:
        raise RecordError(f"{recorded.path}: what its bank is to hold cannot be read: {problem}") from problem
    return known


def _clock_zero_unix_s(recorded: RecordedRun) -> float:
    """Return the Unix time at which the clock of the run read 0, from the date of its first entry."""
    first = recorded.entries[0]
    return datetime.fromisoformat(first.written).timestamp() - first.clock_s
