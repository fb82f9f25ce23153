"""Driver of a SonixDAQ: it watches the folder into which the device's software writes one file per channel.

An acquisition is complete when all 128 files are new since `arm`, have the size given by their headers, and stay
unchanged for a while. A file is new when its time, size or inode has changed; the clocks of the two computers are never
compared.

No file contains which trigger it answers. Whenever files of an earlier trigger may still come, `settle` waits for
longer than a readout takes before anything is triggered again. The number of pulses in the files must be that
of the permit; the scanner varies it where the device allows.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, ClassVar, Literal, TypeAlias, TypeVar

import numpy as np

from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    Clock,
    ConfigError,
    DeviceTimeoutError,
    Frame,
    Int16,
    NotConnectedError,
    Permit,
    RecordError,
    SweepPermit,
    Within,
)
from markerseek.drivers.clock import polls
from markerseek.drivers.entry import Entry, Opening, ReceiverKeys
from markerseek.drivers.standard_receiver import Frames, armed_for, in_the_dark
from markerseek.files import MIB, FileVersion, open_input, os_reason, read_input, version_of
from markerseek.wire import sonixdaq as wire

_POLL_S = 0.05
_EXIT_POLL_S = 0.02

ReadT = TypeVar("ReadT", bound=np.ndarray)


class SonixDaqSettings(ReceiverKeys, frozen=True, kw_only=True, tag="sonixdaq"):
    """Keys of a SonixDAQ in a rig file."""

    channels: ClassVar[int | None] = wire.CHANNEL_COUNT

    folder: str
    """Where its software writes the channel files, of either SDK, over those of the acquisition before."""
    timeout_s: Annotated[float, Within(0, 600, "s", open_low=True)] = 60.0
    """Longest time from the trigger to the complete files; they take about 10 s (paper, section 4)."""
    stable_s: float = 0.2
    """Time for which complete files must stay unchanged before they are read."""
    readout_s: Annotated[float, Within(0, 600, "s", open_low=True)] = 12.0
    """Longest time from a trigger to the last file: a folder unchanged for that long is settled."""
    frames: Literal["triggered", "fixed"] = "fixed"
    """How many pulses the device records: as many as it is triggered, or a fixed number. With ``triggered`` the number
    varies from acquisition to acquisition, so that a file shows which trigger it answers."""
    sweep_period_s: Annotated[float, Within(1e-3, 10, "s")] = 0.05
    """Least time between two triggers of a sweep; each gives a frame."""
    start_command: tuple[str, ...] | None = None
    """Program and arguments that prepare the device for a trigger; no shell is involved, and ``{frames}`` in them is
    replaced by the number of pulses to come. None: it is always ready."""
    start_timeout_s: Annotated[float, Within(0, 600, "s", open_low=True)] = 10.0
    """Longest duration of that command."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.stable_s < self.timeout_s:
            raise ConfigError(f"receiver: stable_s is {self.stable_s} s, it must lie in [0, {self.timeout_s:g}) s")
        if self.start_command is not None and not (self.start_command and self.start_command[0]):
            raise ConfigError("receiver: start_command is empty; leave it out, or name a program and its arguments")

    @property
    def varied(self) -> bool:
        """Whether the number of pulses may vary."""
        return self.frames == "triggered"


_MAX_BYTES = 64 * MIB
"""Largest channel file that is read: 800 pulses of 40,000 samples."""

FolderState: TypeAlias = dict[str, FileVersion]
"""Channel files by name: time of the last change in ns, size in bytes, inode."""


class DaqFolder:
    """Channel files in a folder that another program writes."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def state(self) -> FolderState:
        """Return the state of the channel files that are there now.

        Raises `NotConnectedError` if the folder cannot be read.
        """
        state: FolderState = {}
        try:
            with os.scandir(self._path) as entries:
                for entry in entries:
                    if wire.file_number(entry.name) is None:
                        continue
                    try:
                        status = entry.stat()
                        is_file = entry.is_file()
                    except FileNotFoundError:  # replaced between listing and stat
                        continue
                    if is_file:
                        state[entry.name] = version_of(status)
        except OSError as error:
            raise self._unreadable(error) from error
        return state

    def incomplete(self, name: str) -> str:
        """Return why a file is not complete, or cannot be opened yet.

        Empty if it has the size and contents of its header.
        """
        try:
            # Of any size: a file that is too large is complete, and reading the file says what is wrong.
            with open_input(self._path / name, most_bytes=sys.maxsize) as file:
                size = os.fstat(file.fileno()).st_size
                wire.decode_header(file.read(wire.HEADER_BYTES), size=size, name=name)
                file.seek(max(0, size - wire.TAIL_BYTES))
                # Nearly always there is something: the rest is read only where there is nothing.
                if any(file.read(wire.TAIL_BYTES)):
                    return ""
                file.seek(0)
                return wire.unwritten(file.read(_MAX_BYTES), name=name)
        except RecordError as error:
            return str(error)
        except OSError as error:
            # On a share with Windows, a file that its writer has open cannot be opened by others.
            return f"{name} cannot be read ({os_reason(error)})"

    def read(self, names: Collection[str], *, pulses: int) -> Int16[np.ndarray, "channels samples"]:
        """Return the samples of all channels by element, averaged over the pulses.

        ``pulses``: how many each must hold. Raises `AcquisitionError` if the files are not one acquisition of that many
        pulses. Raises `NotConnectedError` if one cannot be read now.
        """
        with self._refused():
            samples, found = wire.averaged(self._files(names))
        if found != pulses:
            raise AcquisitionError(
                f"sonixdaq: the files hold {found} pulses, {pulses} were triggered; they answer another trigger, or "
                'the device is set to another number: set it to this one, and receiver.frames to "fixed" if it cannot '
                "vary"
            )
        return samples

    def read_singles(self, names: Collection[str], *, pulses: int) -> Int16[np.ndarray, "pulses channels samples"]:
        """Return the samples of each pulse, all channels by element; refused as by `read`."""
        with self._refused():
            return wire.singles(self._files(names), pulses=pulses)

    def _files(self, names: Collection[str]) -> Iterator[tuple[str, bytes]]:
        return ((name, read_input(self._path / name, most_bytes=_MAX_BYTES)) for name in names)

    @contextmanager
    def _refused(self) -> Iterator[None]:
        """Refuse files that cannot be read as one acquisition."""
        try:
            yield
        except RecordError as error:
            raise AcquisitionError(f"sonixdaq: {error}") from error
        except FileNotFoundError as error:
            raise AcquisitionError(
                f"sonixdaq: {Path(error.filename).name} was deleted while it was read; take the frame again"
            ) from None
        except OSError as error:
            raise self._unreadable(error) from error

    def _unreadable(self, error: OSError) -> NotConnectedError:
        of = "" if error.filename in (None, self._path) else f", {Path(error.filename).name}"
        return NotConnectedError(
            f"sonixdaq: the folder {self._path} cannot be read{of} ({os_reason(error)}); "
            "check its name, the rights, and the network drive"
        )


class SonixDaqReceiver:
    """Reads the channel files that a SonixDAQ writes.

    ``dark_triggers``: triggers of a dark acquisition, and so the pulses that it averages. Raises `NotConnectedError` if
    the folder cannot be read.
    """

    def __init__(self, *, settings: SonixDaqSettings, clock: Clock, dark_triggers: int = 16) -> None:
        if dark_triggers < 1:
            raise ConfigError(f"sonixdaq: dark_triggers is {dark_triggers}, at least 1 is needed")
        self._settings = settings
        self._clock = clock
        self._dark_triggers = dark_triggers
        self._folder = DaqFolder(Path(settings.folder))
        self._frames = Frames(clock, settings.sampling_hz)
        self._armed: tuple[Permit, FolderState, float] | None = None
        self._untouched: tuple[FolderState, float] | None = (self._folder.state(), clock.now_s())

    def settle(self) -> None:
        """Wait until the folder is unchanged for a readout's time, so that no file of an earlier trigger can follow.

        Raises `AcquisitionError` if files arrived meanwhile: they are stale and not used, and the folder is unchanged
        since. Raises `DeviceTimeoutError` if files keep arriving. Raises `NotConnectedError` if the folder cannot be
        read.
        """
        before, since_s = self._untouched or (self._state(), self._clock.now_s())
        seen = before
        longest_s = self._settings.timeout_s + self._settings.readout_s
        for _ in polls(self._clock, within_s=longest_s, every_s=_POLL_S):
            state = self._state()
            now_s = self._clock.now_s()
            if state != seen:
                seen = state
                since_s = now_s
            if now_s - since_s >= self._settings.readout_s:
                break
        else:
            raise DeviceTimeoutError(
                f"sonixdaq: files keep arriving in {self._settings.folder} although nothing is triggered; end the "
                "other program that writes or triggers there"
            )
        self._untouched = seen, since_s
        arrived = sorted(name for name, file in seen.items() if before.get(name) != file)
        if arrived:
            raise AcquisitionError(
                f"sonixdaq: stale files: {len(arrived)} channel files, {arrived[0]} to {arrived[-1]}, arrived in "
                f"{self._settings.folder} although nothing was triggered; they belong to an earlier acquisition and "
                "are not used"
            )

    def arm(self, permit: Permit) -> None:
        """Prepare for a trigger: check that no program writes, run the start command, and note the state of the files.

        Raises `AcquisitionError` if files change although nothing was triggered. Raises `NotConnectedError` if the
        folder cannot be read, or the start command cannot be run or fails. Raises `DeviceTimeoutError` if the start
        command takes too long.
        """
        self._armed = None
        self._untouched = None
        before = self._state()
        self._clock.wait(self._settings.stable_s)
        if self._state() != before:
            raise AcquisitionError(
                f"sonixdaq: files in {self._settings.folder} change although nothing was triggered; is an earlier "
                "frame still being written, or does another program write there?"
            )
        if self._settings.start_command is not None:
            run_to_its_end(
                [word.replace("{frames}", str(self._triggers(permit))) for word in self._settings.start_command],
                timeout_s=self._settings.start_timeout_s,
                clock=self._clock,
            )
        # Noted after the start command, which may itself write or delete files.
        self._armed = (permit, self._state(), self._clock.now_s())

    def acquire(self, permit: Permit) -> ChannelFrame:
        """Return the frame of the files written since `arm`, their pulses averaged.

        Raises `AcquisitionError` if it was not armed for this permit, or the files are not one acquisition of the
        permitted pulses. Raises `DeviceTimeoutError` if the files are not complete in time. Raises `NotConnectedError`
        if the folder cannot be read.
        """
        _, before, started_s = armed_for(permit, self._armed, driver="sonixdaq")
        # Disarmed before reading: a frame that was refused cannot be asked for again.
        self._armed = None
        triggers = self._triggers(permit)
        samples = self._await_files(before, lambda names: self._folder.read(names, pulses=triggers), permit=permit)
        return self._frames.made_of(samples, permit, pulses=permit.pulses, started_s=started_s)

    @property
    def frame_period_s(self) -> float:
        """Least time between two triggers of a sweep; `ConfigError` if it records a fixed number of them."""
        if not self._settings.varied:
            raise ConfigError(
                "this rig cannot sweep: its SonixDAQ records a fixed number of pulses, so that a trigger that is lost "
                'or doubled would not show; have it record as many as it is triggered (receiver.frames = "triggered"), '
                "or leave `sweep` out"
            )
        return self._settings.sweep_period_s

    @property
    def sweep_readout_s(self) -> float:
        """Longest time from the last trigger to the files."""
        return self._settings.readout_s

    def begin_sweep(self, permit: SweepPermit) -> None:
        """Prepare for as many triggers as pulses are permitted, as `arm`: all are recorded as one acquisition.

        Raises `AcquisitionError` also if files have arrived since it was connected.
        """
        untouched = self._untouched
        self._untouched = None
        if untouched is not None and self._state() != untouched[0]:
            raise AcquisitionError(
                f"sonixdaq: files have arrived in {self._settings.folder} although nothing was triggered; they belong "
                "to an earlier acquisition and are not used"
            )
        self.arm(permit)

    def frames(self) -> Sequence[Frame]:
        """Return nothing: the files come after the last trigger."""
        return ()

    def end_sweep(self, *, pulses: int) -> Sequence[Frame]:
        """Return a frame for each pulse; the files must hold as many triggers as were permitted, then a dark one.

        The laser box completes them without light: the last of them are averaged into a dark frame. Raises as
        `acquire`, and if light came with these as well.
        """
        if self._armed is None or not isinstance(self._armed[0], SweepPermit):
            raise AcquisitionError("sonixdaq: it was not armed for a sweep; arm it before firing")
        permit, before, started_s = self._armed
        self._armed = None
        samples = self._await_files(
            before, lambda names: self._folder.read_singles(names, pulses=permit.pulses), permit=permit
        )
        lit = samples[:pulses]
        dark = samples[-self._dark_triggers :]
        if len(lit) + len(dark) > len(samples):
            raise AcquisitionError(
                f"sonixdaq: {len(lit)} of {len(samples)} triggers had light, and the last {self._dark_triggers} must "
                "be dark: the sweep took longer than it should; check the stage's speed"
            )
        pulses_seen = [*((each, 1) for each in lit), (wire.mean_of(dark), 0)]
        return [self._frames.made_of(each, permit, pulses=seen, started_s=started_s) for each, seen in pulses_seen]

    def _triggers(self, permit: Permit) -> int:
        """Return the number of triggers that the laser box sends under a permit."""
        return permit.pulses or self._dark_triggers

    def _state(self) -> FolderState:
        """Return the state of the folder, once no other program holds it, and its share is there."""
        ends_s = self._clock.now_s() + self._settings.timeout_s
        while True:
            try:
                return self._folder.state()
            except NotConnectedError:
                if not self._clock.now_s() <= ends_s:
                    raise
            self._clock.wait(_POLL_S)

    def _await_files(self, before: FolderState, read: Callable[[list[str]], ReadT], *, permit: Permit) -> ReadT:
        """Return what is read of the new files, by their names, once they are complete and unchanged."""
        seen = before
        since_s = self._clock.now_s()
        for _ in polls(self._clock, within_s=self._settings.timeout_s, every_s=_POLL_S):
            names: list[str] = []
            # What cannot be read now may still be held by its writer: it is not complete yet.
            try:
                # Polled: change notices of the system (inotify) do not cross a network drive.
                state = self._folder.state()
                now_s = self._clock.now_s()
                if state != seen:
                    seen = state
                    since_s = now_s
                names = _numbered(name for name, file in state.items() if before.get(name) != file)
                missing = next(filter(None, map(self._folder.incomplete, names)), "")
                if len(names) == wire.CHANNEL_COUNT and not missing and now_s - since_s >= self._settings.stable_s:
                    samples = read(names)
                    if self._folder.state() != state:
                        raise AcquisitionError("sonixdaq: the files changed while they were read; take the frame again")
                    if np.any(samples):
                        return samples
                    missing = "all samples of all files are 0; their contents have not come"
            except NotConnectedError as problem:
                missing = str(problem)
        missing_text = f" and not all are complete: {missing}" if missing else ""
        dark_text = "" if names else in_the_dark(permit, self._triggers(permit))
        raise DeviceTimeoutError(
            f"sonixdaq: after {self._settings.timeout_s:g} s {len(names)} of {wire.CHANNEL_COUNT} channel files in "
            f"{self._settings.folder} are new{missing_text}{dark_text}; check trigger, folder and free space, or raise "
            "timeout_s"
        )


def _numbered(names: Iterable[str]) -> list[str]:
    """Return the channel files by their number; `AcquisitionError` if two new ones are of one channel."""
    try:
        return [name for _, name in sorted(wire.by_number(names).items())]
    except RecordError as error:
        raise AcquisitionError(f"sonixdaq: new files: {error}") from error


def run_to_its_end(command: Sequence[str], *, timeout_s: float, clock: Clock) -> None:
    """Run a program, waiting on the clock; it is killed if that takes too long, or if the search is interrupted.

    ``command``: program and arguments; no shell reads them. ``timeout_s``: longest time that it may take. Raises
    `NotConnectedError` if it cannot be run, or ends with another code than 0; its last line of output is in the
    message. Raises `DeviceTimeoutError` if it takes too long.
    """
    # A file and no pipe: a program that prints more than a pipe holds would block for ever.
    with tempfile.TemporaryFile() as output:
        try:
            # S603: the program is named by the owner of the rig file, who may run any program anyway.
            process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=output, stderr=output)  # noqa: S603
        except (OSError, ValueError) as error:
            raise NotConnectedError(
                f"sonixdaq: the start command {command[0]!r} cannot be run ({error}); check start_command in the rig "
                "file"
            ) from error
        try:
            # Polled, since `Popen.wait` would block this thread, whose waits on the clock renew the lease.
            for _ in polls(clock, within_s=timeout_s, every_s=_EXIT_POLL_S):
                if process.poll() is not None:
                    break
            else:
                raise DeviceTimeoutError(
                    f"sonixdaq: the start command {command[0]!r} took more than {timeout_s:g} s and was ended; try it "
                    "by hand or raise start_timeout_s"
                )
        finally:
            process.kill()
            process.wait()
        if process.returncode != 0:
            output.seek(max(0, output.seek(0, os.SEEK_END) - 500))
            last = output.read().decode("utf-8", "replace").strip().rpartition("\n")[2]
            raise NotConnectedError(
                f"sonixdaq: the start command {command[0]!r} ended with code {process.returncode}"
                f"{': ' + last if last else ''}; try it by hand"
            )


def _open(settings: SonixDaqSettings, opening: Opening) -> SonixDaqReceiver:
    return SonixDaqReceiver(settings=settings, clock=opening.clock, dark_triggers=opening.pulses)


ENTRY: Entry[SonixDaqSettings, SonixDaqReceiver] = Entry(
    settings=SonixDaqSettings,
    open=_open,
    describe=lambda settings, _receiver: (
        f"SonixDAQ in {settings.folder}" + ("" if settings.varied else " (a fixed number of pulses, no watermark)")
    ),
    paths=("folder",),
)
