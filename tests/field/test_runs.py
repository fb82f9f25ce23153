"""Runs that are lost: a terminal or disk that has gone, a user without a home, signals that are inherited, tunnels."""

from __future__ import annotations

import http.client
import importlib
import json
import os
import pwd
import queue
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from markerseek.bmode.series import _read_png
from markerseek.bridges import Outcome, Searches, SearchOptions, SearchRequest
from markerseek.bridges.page.server import Address
from markerseek.bridges.run_images import PicturedEntry, PicturedItem
from markerseek.cli import doctor
from markerseek.core import ConfigError, MissingExtraError, RecordError, needs_package
from markerseek.records.journal import Interrupted, read_journal
from tests.emulated import markerseek

Shell = Callable[..., tuple[int, str, str]]

QUICK = ("search", "--seed", "1", "--method", "weighted-average", "--acquisitions", "4", "--as-published")
SLOW = ("search", "--seed", "1", "--method", "weighted-average", "--pace", "0.2")
HUNG_UP = """
import contextlib, os, signal
signal.signal(signal.SIGHUP, signal.SIG_IGN)
os.write(2, b"ready")
with contextlib.suppress(OSError):
    os.read(0, 1)
"""
"""Ignores the end of its terminal, as nohup has it, and waits for it."""


def ends(journal: Path) -> object:
    return read_journal(journal).entries[-1].event


def on_a_terminal(*words: object, before: str = "", answer: Path | None = None) -> tuple[subprocess.Popen[bytes], int]:
    """A command with a terminal of its own, and the other end of that; standard output is a file if one is named."""
    ours, theirs = os.openpty()
    command = markerseek(*words, before=before)
    out = theirs if answer is None else os.open(answer, os.O_WRONLY | os.O_CREAT)
    # A session of its own, whose terminal this is: its end is SIGHUP.
    taking = (
        "import fcntl, os, sys, termios; os.setsid(); fcntl.ioctl(2, termios.TIOCSCTTY, 0); "
        "os.execv(sys.argv[1], sys.argv[1:])"
    )
    process = subprocess.Popen([sys.executable, "-c", taking, *command], stdin=theirs, stdout=out, stderr=theirs)
    os.close(theirs)
    if answer is not None:
        os.close(out)
    return process, ours


def code_of(process: subprocess.Popen[bytes]) -> int:
    try:
        return process.wait(timeout=120)
    finally:
        process.kill()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    "command", [(*QUICK, "--json"), ("bank", "scan"), ("doctor", "--json")], ids=lambda words: words[0]
)
def test_b4_messages_on_a_full_disk_cost_no_answer(command: tuple[str, ...], tmp_path: Path) -> None:
    if command[0] == "bank":
        command = (*command, str(tmp_path / "scan.hdf5"), "--json")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(markerseek(*command), stdout=subprocess.PIPE, stderr=full, text=True, check=False)
    assert done.returncode == 0
    assert json.loads(done.stdout)


def test_b4_an_error_whose_message_nobody_sees_keeps_its_exit_code(tmp_path: Path) -> None:
    with Path("/dev/full").open("w") as full:
        words = ("search", "--rig", tmp_path / "none.toml", "--json")
        done = subprocess.run(markerseek(*words), stdout=subprocess.PIPE, stderr=full, text=True, check=False)
    assert done.returncode == 2
    assert "none.toml" in json.loads(done.stdout)["error"]


def test_b4_a_search_outlives_its_terminal_where_sighup_is_ignored(tmp_path: Path) -> None:
    answer, journal = tmp_path / "answer.json", tmp_path / "run.journal"
    process, terminal = on_a_terminal(*QUICK, "--json", "--journal", journal, before=HUNG_UP, answer=answer)
    os.read(terminal, 5)
    os.close(terminal)
    assert code_of(process) == 0
    assert json.loads(answer.read_text())["answer"] == "found"


def test_b4_an_answer_that_went_to_the_terminal_is_in_the_journal_and_the_exit_code_says_so(
    tmp_path: Path, shell: Shell
) -> None:
    journal = tmp_path / "run.journal"
    process, terminal = on_a_terminal(*QUICK, "--journal", journal, before=HUNG_UP)
    os.read(terminal, 5)
    os.close(terminal)
    assert code_of(process) == 74
    code, out, _ = shell("resume", journal, "--json")
    assert (code, json.loads(out)["answer"]) == (0, "found")


@pytest.mark.real_time
@pytest.mark.parametrize("words", [(), ("--json",)], ids=["text", "json"])
def test_b4_the_end_of_the_terminal_is_129_and_interrupted_in_the_record(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    journal = tmp_path / "run.journal"
    process, terminal = on_a_terminal(*SLOW, "--journal", journal, *words)
    while not (journal.exists() and journal.stat().st_size > 100_000):
        assert process.poll() is None
        # What it prints is read, as a terminal does.
        if select.select([terminal], [], [], 0.02)[0]:
            os.read(terminal, 4096)
    os.close(terminal)
    assert code_of(process) == 128 + signal.SIGHUP
    assert ends(journal) == Interrupted(reason="the end of its terminal (SIGHUP)")


INHERITED = {
    "ignored": "signal.signal(signal.SIGTERM, signal.SIG_IGN)",
    "blocked": "signal.pthread_sigmask(signal.SIG_BLOCK, set(signal.Signals))",
}


@pytest.mark.real_time
@pytest.mark.parametrize("how", INHERITED)
def test_b8_a_search_ends_with_its_bridge_whatever_it_has_inherited(how: str, tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    beats, beating = os.pipe()
    inheriting = f"import os, signal, sys; {INHERITED[how]}; os.execv(sys.argv[1], sys.argv[1:])"
    command = markerseek(*SLOW, "--journal", journal, "--heartbeat", f"/dev/fd/{beats}", "--json")
    process = subprocess.Popen(
        [sys.executable, "-c", inheriting, *command],
        pass_fds=(beats,),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(beats)
    while not (journal.exists() and journal.stat().st_size > 100_000):
        assert process.poll() is None
        os.write(beating, b".")
        time.sleep(0.02)
    os.close(beating)
    began_s = time.monotonic()
    assert code_of(process) == 128 + signal.SIGTERM
    # At once, and 1 s where the end hangs; the rest is for a busy computer.
    assert time.monotonic() - began_s < 3
    assert ends(journal) == Interrupted(reason="another program (SIGTERM)")


HUNG = """
import signal, time
import markerseek.runs.run as module
def hang(*_):
    print("hangs", flush=True)
    # As a library of a vendor that returns to Python only once its device answers.
    signal.pthread_sigmask(signal.SIG_BLOCK, set(signal.Signals))
    time.sleep(60)
module.Run.events = hang
"""


@pytest.mark.real_time
def test_b8_an_end_that_hangs_is_ended_after_a_second() -> None:
    beats, beating = os.pipe()
    words = (*QUICK, "--no-journal", "--heartbeat", f"/dev/fd/{beats}")
    process = subprocess.Popen(
        markerseek(*words, before=HUNG), pass_fds=(beats,), stderr=subprocess.PIPE, stdout=subprocess.PIPE
    )
    os.close(beats)
    while not select.select([process.stdout], [], [], 0.1)[0]:
        assert process.poll() is None
        os.write(beating, b".")
    os.close(beating)
    began_s = time.monotonic()
    process.communicate(timeout=55)
    assert process.returncode == 128 + signal.SIGTERM
    assert time.monotonic() - began_s < 30


@pytest.fixture
def nobody(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A user number without a name and without a home folder, as of ``docker run -u 12345``."""
    for name in ("HOME", "XDG_DATA_HOME", "USER", "LOGNAME"):
        monkeypatch.delenv(name, raising=False)

    def unknown(number: int) -> None:
        raise KeyError(f"getpwuid(): uid not found: {number}")

    monkeypatch.setattr(pwd, "getpwuid", unknown)
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("nobody")
def test_b5_a_user_without_a_home_gets_the_answer_and_is_told_where_a_journal_could_be(
    shell: Shell, tmp_path: Path
) -> None:
    code, out, err = shell(*QUICK, "--json")
    assert (code, json.loads(out)["answer"]) == (0, "found")
    assert "no journal is kept: this user has no home folder" in err
    assert "XDG_DATA_HOME" in err
    assert "--journal FILE" in err
    code, _, err = shell(*QUICK, "--journal", tmp_path / "run.journal")
    assert (code, "no journal is kept" in err) == (0, False)
    code, _, err = shell("journal", "list")
    assert code == 2
    assert "this user has no home folder; set XDG_DATA_HOME" in err
    assert not (tmp_path / "~").exists()


@pytest.mark.usefixtures("nobody")
def test_b5_exposure_without_a_record_is_refused_with_the_cure(shell: Shell, tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    parts = "".join(f'[{each}]\ndriver = "simulated"\n' for each in ("stage", "laser", "receiver"))
    rig.write_text(f'kind = "bench"\n{parts}')
    code, _, err = shell("search", "--rig", rig, "--arm")
    assert code == 2
    assert "this user has no home folder; set XDG_DATA_HOME" in err
    assert "--no-journal" in err


@pytest.mark.usefixtures("nobody")
def test_b5_a_search_that_a_client_asks_for_runs_without_a_home() -> None:
    asked = SearchRequest().changed(method="ternary", acquisitions=4, as_published=True)
    items: list[PicturedItem] = []
    ends: queue.Queue[Outcome] = queue.Queue()
    searches = Searches(SearchOptions(), on_start=lambda _: None, on_item=items.append, on_end=ends.put)
    with closing(searches):
        searches.start(asked)
        assert ends.get(timeout=60).answered
    assert any(isinstance(each, PicturedEntry) for each in items)


class Broken:
    """Finds a module whose import fails as one does whose library of the system is missing."""

    def __init__(self, name: str, error: Exception) -> None:
        self.name, self.error = name, error

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name == self.name:
            raise self.error


BROKEN = {
    "a library of the system": ImportError("libGL.so.1: cannot open shared object file: No such file or directory"),
    "another package": ModuleNotFoundError("No module named 'libgl_bindings'", name="libgl_bindings"),
    "a module of it": ModuleNotFoundError("No module named 'cv2.cv2'", name="cv2.cv2"),
}


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch) -> Callable[[str, Exception], None]:
    def breaks(module: str, error: Exception) -> None:
        for name in [each for each in sys.modules if each.partition(".")[0] == module]:
            monkeypatch.delitem(sys.modules, name)
        monkeypatch.setattr(sys, "meta_path", [Broken(module, error), *sys.meta_path])

    return breaks


@pytest.mark.parametrize("error", BROKEN.values(), ids=BROKEN)
def test_c_a_package_that_is_there_and_broken_is_not_called_missing(
    error: Exception, broken: Callable[[str, Exception], None]
) -> None:
    broken("cv2", error)
    with (
        pytest.raises(ConfigError, match="installed and cannot be imported") as raised,
        needs_package("opencv-python-headless", extra="vision", purpose="a picture", module="cv2"),
    ):
        import cv2  # noqa: F401
    assert str(error) in str(raised.value)
    assert not isinstance(raised.value, MissingExtraError)


@pytest.mark.parametrize(("package", "module"), [("opencv-python-headless", "cv2"), ("pyserial", "serial")])
def test_c_a_package_that_is_absent_is_called_missing(
    package: str, module: str, broken: Callable[[str, Exception], None]
) -> None:
    broken(module, ModuleNotFoundError(f"No module named {module!r}", name=module))
    with (
        pytest.raises(MissingExtraError, match="which is not installed"),
        needs_package(package, extra="vision", purpose="a picture", module=module),
    ):
        importlib.import_module(f"{module}.tools")


def test_c_doctor_shows_what_is_broken_with_its_cause_and_goes_on(
    shell: Shell, broken: Callable[[str, Exception], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(doctor, "EXTRAS", {each: doctor.EXTRAS[each] for each in ("vision", "igtl", "records")})
    broken("cv2", BROKEN["a library of the system"])
    broken("pyigtl", ValueError("numpy.dtype size changed, may indicate binary incompatibility"))
    code, out, _ = shell("doctor", "--json")
    findings = {each["what"]: each for each in json.loads(out)["findings"]}
    assert (code, findings["cv2"]["state"], findings["pyigtl"]["state"]) == (0, "broken", "broken")
    assert "libGL.so.1: cannot open shared object file" in findings["cv2"]["detail"]
    assert "numpy.dtype size changed" in findings["pyigtl"]["detail"]
    assert (findings["h5py"]["state"], findings["simulated search, posterior"]["state"]) == ("ok", "ok")


def test_c_an_image_whose_library_is_broken_is_not_called_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cv2.py").write_text("raise ImportError('libGL.so.1: cannot open shared object file')\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "cv2", raising=False)
    image = tmp_path / "tip.png"
    image.write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(RecordError, match="because of a library: ImportError: libGL") as raised:
        _read_png(image)
    assert "damaged" not in str(raised.value)


def asked(port: int, path: str, **headers: str) -> tuple[int, dict[str, str], str]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    text = answer.read().decode("utf-8", "replace")
    connection.close()
    return answer.status, {name.lower(): value for name, value in answer.getheaders()}, text


@pytest.mark.real_time
def test_c_the_page_behind_a_tunnel_is_refused_with_the_option_and_served_with_it(tmp_path: Path) -> None:
    for public in (False, True):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        options = ("--public-url", "http://localhost:9000/") if public else ()
        process = subprocess.Popen(
            markerseek("page", "--port", port, *options), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        try:
            link = process.stdout.readline().split()[1]
            path = link[link.index("/?") :]
            status, headers, text = asked(port, path, Host="localhost:9000")
            if public:
                assert link.startswith("http://localhost:9000/?token=")
                cookie = headers["set-cookie"].partition(";")[0]
                assert status == 303
                assert asked(port, "/", Host="localhost:9000", Cookie=cookie, Origin="http://localhost:9000")[0] == 200
                # At this end of the tunnel it is as before.
                assert asked(port, "/", Host=f"localhost:{port}", Cookie=cookie)[0] == 200
                assert asked(port, "/", Host="localhost:9001", Cookie=cookie)[0] == 403
                assert asked(port, "/", Host="localhost:9000", Cookie=cookie, Origin="http://evil.example")[0] == 403
            else:
                assert status == 403
                assert "start markerseek page with --public-url" in text
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=60)


@pytest.mark.parametrize(
    ("url", "origin"),
    [
        ("http://localhost:9000", "http://localhost:9000"),
        ("http://127.0.0.1:80/", "http://127.0.0.1"),
        ("https://Name.example", "https://name.example"),
        ("https://name.example:443/", "https://name.example"),
        ("https://name.example:8443", "https://name.example:8443"),
    ],
)
def test_c_a_public_url_is_an_origin_as_browsers_send_it(url: str, origin: str) -> None:
    assert Address(public_url=url).public == origin


@pytest.mark.parametrize(
    "url",
    [
        "localhost:9000",
        "http://lab.example:9000",
        "http://localhost:9000/page?view=1",
        "ftp://localhost",
        "http://a@localhost",
        "",
    ],
)
def test_c_a_public_url_that_cannot_be_is_wrong_usage(url: str, shell: Shell) -> None:
    code, _, err = shell("page", "--public-url", url)
    assert (code, "name what stands in the browser" in err) == (2, True)


@pytest.mark.real_time
def test_b4_a_bridge_that_ignores_sighup_outlives_its_terminal() -> None:
    process, terminal = on_a_terminal("igtl", "--port", "0", before=HUNG_UP)
    os.read(terminal, 5)
    os.write(terminal, b"\n")
    said = b""
    while b"Ctrl-C ends the bridge" not in said:
        said += os.read(terminal, 4096)
    os.close(terminal)
    process.send_signal(signal.SIGHUP)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(timeout=1)
    process.send_signal(signal.SIGTERM)
    assert code_of(process) == 128 + signal.SIGTERM
