"""The folder of channel files: its state, and reading one acquisition from it."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TypeAlias

import numpy as np

from markerseek.core import AcquisitionError, Int16, NotConnectedError, RecordError
from markerseek.files import channel_files, is_complete, read_channels
from markerseek.wire import sonixdaq as wire

FolderState: TypeAlias = dict[str, tuple[int, int, int]]
"""Channel files by name: time of the last change in ns, size in bytes, inode."""


class DaqFolder:
    """Channel files in a folder that another program writes."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def state(self) -> FolderState:
        """State of the channel files that are there now.

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
                    except FileNotFoundError:  # replaced between listing and stat
                        continue
                    if entry.is_file():
                        state[entry.name] = (status.st_mtime_ns, status.st_size, status.st_ino)
        except OSError as error:
            raise self._unreadable(error) from error
        return state

    def is_complete(self, names: Iterable[str]) -> bool:
        """Whether all of these files have the size given by their headers."""
        try:
            return all(is_complete(self._path / name) for name in names)
        except OSError as error:
            raise self._unreadable(error) from error

    def numbered(self, names: Iterable[str]) -> dict[int, str]:
        """Channel files by number; `AcquisitionError` if two new ones are of one channel."""
        try:
            return {number: path.name for number, path in channel_files(self._path, names).items()}
        except RecordError as error:
            raise AcquisitionError(f"sonixdaq: {error}") from error

    def read(self, names: Mapping[int, str], *, pulses: int) -> Int16[np.ndarray, "channels samples"]:
        """Samples of all channels by element, averaged over the pulses.

        ``pulses``: how many each must hold. Raises `AcquisitionError` if the files are not one acquisition of that many
        pulses.
        """
        try:
            samples, found = read_channels({number: self._path / name for number, name in names.items()})
        except RecordError as error:
            raise AcquisitionError(f"sonixdaq: {error}") from error
        except FileNotFoundError as error:
            raise AcquisitionError(
                f"sonixdaq: {Path(error.filename).name} was deleted while it was read; take the frame again"
            ) from None
        except OSError as error:
            raise self._unreadable(error) from error
        if found != pulses:
            raise AcquisitionError(
                f"sonixdaq: the files hold {found} pulses, {pulses} were triggered; they answer another trigger, or "
                'the device is set to another number: set it to this one, and receiver.frames to "fixed" if it cannot '
                "vary"
            )
        return samples

    def _unreadable(self, error: OSError) -> NotConnectedError:
        return NotConnectedError(
            f"sonixdaq: the folder {self._path} cannot be read ({error.strerror or error}); "
            "check its name, the rights, and the network drive"
        )
