"""Files of the DAQ that another program holds for a moment."""

from __future__ import annotations

import errno
import math
import os
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import Clock, DeviceTimeoutError
from markerseek.drivers.sonixdaq import DaqFolder
from tests.emulated_lines import permit
from tests.unit.drivers.test_sonixdaq import Bench as SonixDaqBench


class Held:
    """Files of a folder that cannot be opened, and a folder that cannot be listed, for a while of virtual time."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, clock: Clock, folder: Path) -> None:
        self._clock = clock
        self._folder = str(folder)
        self.number = errno.EACCES
        self.until_s = -1.0
        self.files = "CH"
        self.times = 0
        self._opened = os.open
        self._listed = os.scandir
        monkeypatch.setattr(os, "open", self._open)
        monkeypatch.setattr(os, "scandir", self._scandir)

    def _refuse(self, path: object) -> None:
        if self._clock.now_s() < self.until_s:
            self.times += 1
            raise OSError(self.number, os.strerror(self.number), path)

    def _open(self, path: object, *arguments: object, **named: object) -> int:
        # What writes the files is another computer.
        reads = int(str(arguments[0])) & os.O_ACCMODE == os.O_RDONLY if arguments else True
        if reads and str(path).startswith(self._folder) and Path(str(path)).name.startswith(self.files):
            self._refuse(path)
        return self._opened(path, *arguments, **named)  # type: ignore[arg-type]

    def _scandir(self, path: object) -> object:
        if self.files == "." and str(path) == self._folder:
            self._refuse(path)
        return self._listed(path)  # type: ignore[call-overload]


HOLDS = [
    (errno.EACCES, "CH", 0.15),
    (errno.EBUSY, "CH12", 0.15),
    (errno.ESTALE, "CH127", 0.15),
    (errno.EPERM, "CH000", 1.0),
    (errno.ENOENT, "CH05", 0.3),
    (errno.ESTALE, ".", 0.15),
    (errno.ENOENT, ".", 0.5),
    (errno.EIO, ".", 0.3),
    (errno.ENOTCONN, ".", 3.5),
    (errno.EIO, "CH0", 3.5),
]


@pytest.mark.parametrize(("number", "files", "for_s"), HOLDS)
def test_files_that_are_held_for_a_moment_are_not_complete_yet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, files: str, for_s: float
) -> None:
    daq = SonixDaqBench(tmp_path / "daq")
    held = Held(monkeypatch, daq.clock, tmp_path / "daq")
    held.number = number
    held.files = files
    # Also where the folder is looked at before the trigger.
    for token, begins_s in (("a", 1.0), ("b", 0.0)):
        held.until_s = daq.clock.now_s() + 0.2 + begins_s + for_s
        frame = daq.take(token)
        assert held.times
        np.testing.assert_array_equal(frame.samples, daq.received[-1])


@pytest.mark.parametrize(("number", "files", "said"), [(errno.EBUSY, "CH017", "CH017.daq"), (errno.ESTALE, ".", "daq")])
def test_files_that_stay_held_are_named_at_the_time_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, files: str, said: str
) -> None:
    daq = SonixDaqBench(tmp_path / "daq")
    held = Held(monkeypatch, daq.clock, tmp_path / "daq")
    daq.receiver.arm(permit(pulses=4))
    held.number = number
    held.files = files
    held.until_s = math.inf
    daq.daq.trigger(4)
    name = errno.errorcode[number]
    with pytest.raises(DeviceTimeoutError, match=rf"after 5 s .*{said} cannot be read \({name}: .*; check trigger"):
        daq.receiver.acquire(permit(pulses=4))


def test_files_that_are_held_again_while_they_are_read_are_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A scanner for viruses opens each file once its writer has closed it."""
    daq = SonixDaqBench(tmp_path / "daq")
    read = DaqFolder.read
    failures = iter([errno.EACCES, errno.EBUSY])

    def held_at_first(folder: DaqFolder, names: list[str], *, pulses: int) -> np.ndarray:
        with folder._refused():
            if (number := next(failures, None)) is not None:
                raise OSError(number, os.strerror(number), str(tmp_path / "daq" / "CH003.daq"))
        return read(folder, names, pulses=pulses)

    monkeypatch.setattr(DaqFolder, "read", held_at_first)
    np.testing.assert_array_equal(daq.take("a").samples, daq.received[-1])
