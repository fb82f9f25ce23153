"""A trace: bytes both ways in one line each, with increasing times, in a file of the user's and in no other."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

import pytest

from markerseek.core import ConfigError, RecordError
from markerseek.drivers import bench_settings_from, trace_to, traced
from markerseek.drivers.trace import readable
from tests.notes import noted


class EchoPort:
    """A line that answers each question with itself."""

    def __init__(self) -> None:
        self.waiting = b""
        self.closed = False

    def write(self, data: bytes) -> None:
        self.waiting += data

    def read(self, size: int, *, timeout_s: float) -> bytes:
        read = self.waiting[:size]
        self.waiting = self.waiting[size:]
        return read

    def close(self) -> None:
        self.closed = True


def test_what_crosses_a_line_is_in_the_file_in_order_and_reaches_the_device(tmp_path: Path) -> None:
    file = tmp_path / "devices.txt"
    port = EchoPort()
    with trace_to(file):
        line = traced(port, "laser")
        line.write(b"PERMIT 7\r\n")
        assert line.read(6, timeout_s=0.0) == b"PERMIT"
        assert line.read(100, timeout_s=0.0) == b" 7\r\n"
        # Nothing came: nothing to write.
        assert line.read(100, timeout_s=0.0) == b""
        line.write(bytes([0x53, 0x04, 0xFF]))
        line.close()
    assert port.closed
    first, *lines = file.read_text(encoding="utf-8").splitlines()
    assert first.startswith("# trace of markerseek")
    assert [each.split(maxsplit=2)[2] for each in lines] == [
        r"laser > 'PERMIT 7\r\n'", "laser < 'PERMIT'", r"laser < ' 7\r\n'", "laser > 53 04 ff",
    ]  # fmt: skip
    times_s = [float(each.split()[0]) for each in lines]
    assert times_s == sorted(times_s)


def test_without_a_trace_a_port_is_itself_and_nothing_is_logged_after_one(tmp_path: Path) -> None:
    port = EchoPort()
    with trace_to(tmp_path / "devices.txt"):
        pass
    assert traced(port, "stage") is port
    size = (tmp_path / "devices.txt").stat().st_size
    logging.getLogger("markerseek.scan").debug("not written")
    assert (tmp_path / "devices.txt").stat().st_size == size


def test_a_second_trace_is_appended(tmp_path: Path) -> None:
    file = tmp_path / "devices.txt"
    for word in ("first", "second"):
        with trace_to(file):
            logging.getLogger("markerseek.anything").debug("%s\nline", word)
    lines = file.read_text(encoding="utf-8").splitlines()
    assert [each.split(maxsplit=2)[2] for each in lines if not each.startswith("#")] == ["first line", "second line"]


def test_a_link_is_not_followed_and_a_missing_folder_is_named(tmp_path: Path) -> None:
    theirs = tmp_path / "theirs.txt"
    theirs.write_text("of someone else")
    link = tmp_path / "link.txt"
    link.symlink_to(theirs)
    with pytest.raises(RecordError, match="link"), trace_to(link):
        pass
    with (
        pytest.raises(ConfigError, match=r"the trace cannot be written.*name another file"),
        trace_to(tmp_path / "missing" / "devices.txt"),
    ):
        pass
    assert theirs.read_text() == "of someone else"


def _trace_to_full_disk(file: Path) -> None:
    import resource

    log = logging.getLogger("markerseek.anything")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with trace_to(file):
        log.debug("in the file")
        # A file of this size is as little able to grow as one on a full disk; Python ignores the signal of it.
        resource.setrlimit(resource.RLIMIT_FSIZE, (file.stat().st_size, limits[1]))
        try:
            log.debug("lost")
            log.debug("lost too")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        log.debug("after the end")


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit of the size of files")
def test_a_full_disk_ends_the_trace_with_one_warning_and_not_the_run(tmp_path: Path) -> None:
    file = tmp_path / "devices.txt"
    with noted(r"devices\.txt: the trace ends here.*another disk") as said:
        _trace_to_full_disk(file)
    assert len(said) == 1
    assert file.read_text(encoding="utf-8").splitlines()[-1].endswith("in the file")


@pytest.mark.parametrize(
    ("data", "text"),
    [(b"POS? 1.5\n", r"'POS? 1.5\n'"), (b"\x00", "00"), (b"ok\xb0", "6f 6b b0"), (b"it's", '"it\'s"')],
)
def test_text_is_shown_as_text_and_other_bytes_as_numbers(data: bytes, text: str) -> None:
    assert readable(data) == text


def test_the_key_of_a_rig_file_is_relative_to_it_and_does_not_change_what_is_measured(tmp_path: Path) -> None:
    table = {
        "stage": {"driver": "kdc101", "port": "/dev/ttyUSB0", "zero_deg": 0.0},
        "laser": {"driver": "laserbox", "port": "/dev/ttyACM0"},
        "receiver": {"driver": "sonixdaq", "folder": "daq"},
    }
    settings = bench_settings_from(table | {"trace": "logs/devices.txt"}, beside=str(tmp_path))
    assert settings.trace == str(tmp_path / "logs" / "devices.txt")
    assert settings.table() == bench_settings_from(table, beside=str(tmp_path)).table()
