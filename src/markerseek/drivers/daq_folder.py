"""The folder of channel files: its state, and reading one acquisition from it."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeAlias

import numpy as np

from markerseek.core import AcquisitionError, Int16, NotConnectedError, RecordError
from markerseek.files import MIB, open_input, read_input
from markerseek.wire import sonixdaq as wire

_MAX_BYTES = 64 * MIB
"""Largest channel file that is read: 800 pulses of 40,000 samples."""

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
                        status, is_file = entry.stat(), entry.is_file()
                    except FileNotFoundError:  # replaced between listing and stat
                        continue
                    if is_file:
                        state[entry.name] = (status.st_mtime_ns, status.st_size, status.st_ino)
        except OSError as error:
            raise self._unreadable(error) from error
        return state

    def incomplete(self, name: str) -> str:
        """Why a file does not have the size given by its header, or cannot be opened yet; empty if it is complete."""
        try:
            # Of any size: a file that is too large is complete, and reading the file says what is wrong.
            with open_input(self._path / name, most_bytes=sys.maxsize) as file:
                size = os.fstat(file.fileno()).st_size
                wire.decode_header(file.read(wire.HEADER_BYTES), size=size, name=name)
        except RecordError as error:
            return str(error)
        except OSError as error:
            # On a share with Windows, a file that its writer has open cannot be opened by others.
            return f"{name} cannot be read ({_reason(error)})"
        return ""

    def read(self, names: Collection[str], *, pulses: int) -> Int16[np.ndarray, "channels samples"]:
        """Samples of all channels by element, averaged over the pulses.

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
        """Samples of each pulse, all channels by element; refused as by `read`."""
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
            f"sonixdaq: the folder {self._path} cannot be read{of} ({_reason(error)}); "
            "check its name, the rights, and the network drive"
        )


def _reason(error: OSError) -> str:
    """Name of an error of the file system, and what it says."""
    return f"{errno.errorcode.get(error.errno or 0, 'error')}: {error.strerror or error}"
