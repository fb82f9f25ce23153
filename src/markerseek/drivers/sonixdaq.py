"""Driver of a SonixDAQ: it watches the folder into which the device's software writes one file per channel.

An acquisition is complete when all 128 files are new since `arm`, have the size given by their headers, and stay
unchanged for a while. A file is new when its time, size or inode has changed; the clocks of the two computers are never
compared.

No file contains which trigger it answers. Whenever files of an earlier trigger may still come, `settle` waits for
longer than a readout takes before anything is triggered again. The number of pulses in the files must be that
of the permit; the scanner varies it where the device allows (decision 16).
"""

from __future__ import annotations

from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    Clock,
    DeviceTimeoutError,
    Permit,
)
from markerseek.drivers._receivers import acquired_frame
from markerseek.drivers._sonixdaq_settings import SonixDaqSettings
from markerseek.drivers.daq_folder import DaqFolder, FolderState, numbered
from markerseek.drivers.program import run_to_its_end
from markerseek.wire import sonixdaq as wire

__all__ = ["SonixDaqReceiver", "SonixDaqSettings"]

_POLL_S = 0.05


class SonixDaqReceiver:
    """Reads the channel files that a SonixDAQ writes.

    Raises `NotConnectedError` if the folder cannot be read.
    """

    def __init__(self, *, settings: SonixDaqSettings, clock: Clock) -> None:
        self._settings = settings
        self._clock = clock
        self._folder = DaqFolder(settings.folder)
        self._sequence = 0
        self._armed: tuple[Permit, FolderState, float] | None = None
        self._untouched: tuple[FolderState, float] | None = (self._folder.state(), clock.now_s())

    def settle(self) -> None:
        """Wait until the folder is unchanged for a readout's time, so that no file of an earlier trigger can follow.

        Raises `AcquisitionError` if files arrived meanwhile: they are stale and not used, and the folder is unchanged
        since. Raises `DeviceTimeoutError` if files keep arriving. Raises `NotConnectedError` if the folder cannot be
        read.
        """
        before, since_s = self._untouched or (self._folder.state(), self._clock.now_s())
        ends_s = self._clock.now_s() + self._settings.timeout_s + self._settings.readout_s
        seen = before
        while True:
            state, now_s = self._folder.state(), self._clock.now_s()
            if state != seen:
                seen, since_s = state, now_s
            if now_s - since_s >= self._settings.readout_s:
                break
            if not now_s <= ends_s:
                raise DeviceTimeoutError(
                    f"sonixdaq: files keep arriving in {self._settings.folder} although nothing is triggered; end the "
                    "other program that writes or triggers there"
                )
            self._clock.wait(_POLL_S)
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
        self._armed = self._untouched = None
        before = self._folder.state()
        self._clock.wait(self._settings.stable_s)
        if self._folder.state() != before:
            raise AcquisitionError(
                f"sonixdaq: files in {self._settings.folder} change although nothing was triggered; is an earlier "
                "frame still being written, or does another program write there?"
            )
        if self._settings.start_command is not None:
            run_to_its_end(
                [word.replace("{frames}", str(self._triggers(permit))) for word in self._settings.start_command],
                timeout_s=self._settings.start_timeout_s,
                clock=self._clock,
                what="sonixdaq",
            )
        # Noted after the start command, which may itself write or delete files.
        self._armed = (permit, self._folder.state(), self._clock.now_s())

    def acquire(self, permit: Permit) -> ChannelFrame:
        """Frame of the files written since `arm`, their pulses averaged.

        Raises `AcquisitionError` if it was not armed for this permit, or the files are not one acquisition of the
        permitted pulses. Raises `DeviceTimeoutError` if the files are not complete in time. Raises `NotConnectedError`
        if the folder cannot be read.
        """
        if self._armed is None or self._armed[0] != permit:
            raise AcquisitionError(f"sonixdaq: it was not armed for the permit {permit.token!r}; arm it before firing")
        _, before, started_s = self._armed
        # Disarmed before reading: a frame that was refused cannot be asked for again.
        self._armed = None
        names, state = self._await_files(before)
        samples = self._folder.read(names, pulses=self._triggers(permit))
        if self._folder.state() != state:
            raise AcquisitionError("sonixdaq: the files changed while they were read; take the frame again")
        self._sequence += 1
        return acquired_frame(
            samples,
            permit,
            sequence=self._sequence,
            pulses=permit.pulses,
            started_s=started_s,
            clock=self._clock,
            sampling_hz=self._settings.sampling_hz,
        )

    def _triggers(self, permit: Permit) -> int:
        """Number of triggers that the laser box sends under a permit."""
        return permit.pulses or self._settings.dark_triggers

    def _await_files(self, before: FolderState) -> tuple[dict[int, str], FolderState]:
        """Names of the new files by number, once they are complete and unchanged, and the folder's state then."""
        ends_s = self._clock.now_s() + self._settings.timeout_s
        seen, since_s = before, self._clock.now_s()
        while True:
            # Polled: change notices of the system (inotify) do not cross a network drive.
            state, now_s = self._folder.state(), self._clock.now_s()
            if state != seen:
                seen, since_s = state, now_s
            names = numbered([name for name, file in state.items() if before.get(name) != file])
            complete = len(names) == wire.CHANNELS and all(self._folder.is_complete(name) for name in names.values())
            if complete and now_s - since_s >= self._settings.stable_s:
                return names, state
            if not now_s <= ends_s:
                raise DeviceTimeoutError(
                    f"sonixdaq: after {self._settings.timeout_s:g} s {len(names)} of {wire.CHANNELS} channel files in "
                    f"{self._settings.folder} are new{'' if complete else ' and not all are complete'}; check trigger, "
                    "folder and free space, or raise timeout_s"
                )
            self._clock.wait(_POLL_S)
