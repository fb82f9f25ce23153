"""A serial port that may not be opened."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest
import serial

from markerseek.core import NotConnectedError
from markerseek.drivers import (
    SerialPort,
)


@pytest.mark.parametrize(("group", "named"), [("uucp", "uucp"), (None, "dialout"), ("root", "dialout")])
def test_a_port_that_may_not_be_opened_names_the_group(
    monkeypatch: pytest.MonkeyPatch, group: str | None, named: str
) -> None:
    def refuse(**_arguments: object) -> None:
        raise serial.SerialException(errno.EACCES, "could not open port: Permission denied")

    def group_of(_path: Path) -> str:
        if group is None:
            raise KeyError("no name")
        return group

    monkeypatch.setattr(serial, "Serial", refuse)
    monkeypatch.setattr(Path, "group", group_of)
    with pytest.raises(NotConnectedError, match=rf"Permission denied.*usermod -aG {named} \$USER, then log out and in"):
        SerialPort("/dev/ttyUSB0")
