"""The folder of channel files: its state, and reading one acquisition from it."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO, TypeAlias

import numpy as np

from markerseek.core import AcquisitionError, Int16, NotConnectedError, RecordError
from markerseek.wire import sonixdaq as wire

_LARGEST_BYTES = 1 << 26
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
                        status = entry.stat()
                    except FileNotFoundError:  # replaced between listing and stat
                        continue
                    if entry.is_file():
                        state[entry.name] = (status.st_mtime_ns, status.st_size, status.st_ino)
        except OSError as error:
            raise self._unreadable(error) from error
        return state

    def is_complete(self, name: str) -> bool:
        """Whether a file has the size given by its header."""
        try:
            with _opened(self._path / name) as file:
                wire.decode_header(file.read(wire.HEADER_BYTES), size=os.fstat(file.fileno()).st_size, name=name)
        except (RecordError, FileNotFoundError):
            return False
        except OSError as error:
            raise self._unreadable(error) from error
        return True

    def read(self, names: dict[int, str], *, pulses: int) -> Int16[np.ndarray, "channels samples"]:
        """Samples of all channels by element, averaged over the pulses.

        ``pulses``: how many each must hold. Raises `AcquisitionError` if the files are not one acquisition of that many
        pulses.
        """
        averaged: list[Int16[np.ndarray, " samples"]] = [np.empty(0, np.int16)] * wire.CHANNELS
        first: wire.DaqHeader | None = None
        for number, name in sorted(names.items()):
            header, body = self._read_file(name)
            first = first or header
            _require_sound(name, header, number=number, first=first, pulses=pulses)
            every_pulse = wire.decode_samples(body, header)
            # Averaged in float64 and rounded: int16 sums would overflow after 16 pulses of 12 bits.
            averaged[wire.element_of_file(number)] = np.rint(every_pulse.mean(axis=0, dtype=np.float64)).astype(
                np.int16
            )
        return np.stack(averaged)

    def _read_file(self, name: str) -> tuple[wire.DaqHeader, bytes]:
        try:
            with _opened(self._path / name) as file:
                data = file.read(_LARGEST_BYTES + 1)
        except FileNotFoundError:
            raise AcquisitionError(f"sonixdaq: {name} was deleted while it was read; take the frame again") from None
        except OSError as error:
            raise self._unreadable(error) from error
        if len(data) > _LARGEST_BYTES:
            raise AcquisitionError(f"sonixdaq: {name} has more than {_LARGEST_BYTES} bytes; record fewer pulses")
        try:
            header = wire.decode_header(data[: wire.HEADER_BYTES], size=len(data), name=name)
        except RecordError as error:
            raise AcquisitionError(f"sonixdaq: {error}") from error
        return header, data[header.length :]

    def _unreadable(self, error: OSError) -> NotConnectedError:
        return NotConnectedError(
            f"sonixdaq: the folder {self._path} cannot be read ({error.strerror or error}); "
            "check its name, the rights, and the network drive"
        )


def _opened(path: Path) -> BinaryIO:
    """Open an ordinary file for reading; `FileNotFoundError` if there is none, or a pipe or device in its place."""
    # O_NONBLOCK: opening a pipe without a writer would wait for ever. O_BINARY: Windows would translate line ends.
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise FileNotFoundError(path)
    return os.fdopen(descriptor, "rb")


def numbered(names: list[str]) -> dict[int, str]:
    """Channel files by number.

    Raises `AcquisitionError` if two are of one channel.
    """
    by_number: dict[int, str] = {}
    for name in names:
        number = wire.file_number(name)
        if number is None:
            continue
        if number in by_number:
            raise AcquisitionError(
                f"sonixdaq: {by_number[number]} and {name} are both new and both channel {number}; "
                "let one program of one SDK write there"
            )
        by_number[number] = name
    return by_number


def _require_sound(name: str, header: wire.DaqHeader, *, number: int, first: wire.DaqHeader, pulses: int) -> None:
    """Refuse a file that is not of one acquisition of that many pulses."""
    if not header.samples <= wire.MAX_SAMPLES:
        raise AcquisitionError(
            f"sonixdaq: {name} holds {header.samples} samples of each pulse, at most {wire.MAX_SAMPLES} are read; "
            "record a shorter time"
        )
    if header != first:
        raise AcquisitionError(
            f"sonixdaq: {name} holds {header.frames} pulses of {header.samples} samples, the files before it "
            f"{first.frames} of {first.samples}; they are not of one acquisition: take it again"
        )
    if header.channel is not None and header.channel != number:
        raise AcquisitionError(
            f"sonixdaq: {name} has channel {header.channel} in its header; the files are out of order: take it again"
        )
    if header.frames != pulses:
        raise AcquisitionError(
            f"sonixdaq: {name} holds {header.frames} pulses, {pulses} were triggered; it answers another trigger, or "
            'the device is set to another number: set it to this one, and receiver.frames to "fixed" if it cannot vary'
        )
