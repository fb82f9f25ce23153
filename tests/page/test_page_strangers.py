"""Programs that connect to the page without its token, in any number: STOP is answered within a second."""

from __future__ import annotations

import contextlib
import os
import resource
import socket
import threading
import time
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import websockets.sync.client as websockets

from markerseek.bridges.page.connections import MAX_STRANGERS
from tests.page.page_browser import START, served
from tests.waiting import wait_until

pytestmark = pytest.mark.real_time

STRANGERS = 2000

FILES = f"import resource; resource.setrlimit(resource.RLIMIT_NOFILE, (1024, 1024)); {START}"
"""The page with as many files as a usual shell allows."""

STOP_S = 1.0

QUEUE_S = 6.0
"""Longest time until a new connection is taken from a queue of 2,000, on a busy computer."""

SENT = {
    "nothing": b"",
    "a byte": b"P",
    "half a head": b"POST /stop HTTP/1.1\r\nHost: 127.0.0.1\r\n",
    "a body that never ends": b"POST /stop HTTP/1.1\r\nHost: HOST\r\nContent-Length: 1000000\r\n\r\nx",
    "a wrong token": b"GET / HTTP/1.1\r\nHost: HOST\r\nCookie: markerseek=guess\r\n\r\n",
}


@pytest.fixture(autouse=True)
def _files():
    """Files enough for the strangers."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < STRANGERS + 200:
        pytest.skip("this user may open too few files")
    resource.setrlimit(resource.RLIMIT_NOFILE, (STRANGERS + 200, hard))
    yield
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def place_of(page):
    place = urlsplit(page.address)
    return place.hostname, place.port


def stopped_in_s(page):
    """Time until STOP is answered, on a connection of its own."""
    host, port = place_of(page)
    began_s = time.monotonic()
    with socket.create_connection((host, port), timeout=20) as connection:
        connection.sendall(
            f"POST /stop HTTP/1.1\r\nHost: {host}:{port}\r\nOrigin: {page.address}\r\n"
            f"Cookie: markerseek_{port}={page.token}\r\nContent-Length: 0\r\n\r\n".encode()
        )
        assert connection.recv(4096).startswith(b"HTTP/1.1 204")
    return time.monotonic() - began_s


@contextlib.contextmanager
def line_of(page):
    """The line that a tab keeps for STOP, as a function that stops and returns the seconds until the answer."""
    host, port = place_of(page)
    with websockets.connect(
        f"ws://{host}:{port}/stop",
        origin=page.address,
        additional_headers={"Cookie": f"markerseek_{port}={page.token}"},
        open_timeout=20,
        close_timeout=1,
        proxy=None,
    ) as line:

        def stop():
            began_s = time.monotonic()
            line.send("stop")
            assert line.recv(20) == "stopped"
            return time.monotonic() - began_s

        yield stop


@contextlib.contextmanager
def strangers(page, sent, *, many=STRANGERS):
    """Connections that stay open at this end."""
    host, port = place_of(page)
    sent = sent.replace(b"HOST", f"{host}:{port}".encode())
    with contextlib.ExitStack() as stack:
        for _ in range(many):
            connection = stack.enter_context(socket.create_connection((host, port), timeout=20))
            with contextlib.suppress(OSError):
                connection.sendall(sent)
        yield


def files_of(page):
    return len(list(Path(f"/proc/{page.process.pid}/fd").iterdir()))


@pytest.mark.parametrize("sent", SENT.values(), ids=SENT)
def test_stop_is_answered_within_a_second_beside_any_number_of_strangers(tmp_path, sent):
    with served(tmp_path, start=FILES) as page:
        stopped_in_s(page)
        before = files_of(page)
        with line_of(page) as stop, strangers(page, sent):
            by_line_s = stop()
            taken_s = [stopped_in_s(page) for _ in range(5)]
            assert files_of(page) <= before + MAX_STRANGERS + 20
            # They are turned away after `STRANGER_S`.
            wait_until(lambda: files_of(page) <= before + 5)
            taken_s.append(stopped_in_s(page))
        assert by_line_s < STOP_S
        # The first has all of them before it in the queue of the system; a busy computer needs a millisecond for each.
        assert taken_s[0] < QUEUE_S, taken_s
        assert max(taken_s[1:]) < STOP_S, taken_s
        assert len((page.data / "page.stderr").read_bytes()) < 2000


@pytest.mark.long
def test_stop_is_answered_while_strangers_come_and_come(tmp_path):
    over = threading.Event()

    def flood(page):
        while not over.is_set():
            with contextlib.suppress(OSError), strangers(page, b"P", many=300):
                pass

    with served(tmp_path, start=FILES) as page, line_of(page) as stop:
        before = files_of(page)
        flooding = threading.Thread(target=flood, args=[page], daemon=True)
        flooding.start()
        try:
            wait_until(lambda: files_of(page) > before + 20)
            taken_s = [stopped_in_s(page) for _ in range(10)]
            by_line_s = [stop() for _ in range(10)]
        finally:
            over.set()
            flooding.join()
        assert max(by_line_s) < STOP_S, by_line_s
        assert max(taken_s) < QUEUE_S, taken_s
        assert len((page.data / "page.stderr").read_bytes()) < 2000


def test_with_no_file_left_a_newcomer_is_refused_and_nothing_is_written(tmp_path):
    few = FILES.replace("1024", "MOST")
    with served(tmp_path) as page:
        stopped_in_s(page)
        usual = files_of(page)
    folder = tmp_path / "few"
    folder.mkdir()
    with served(folder, start=few.replace("MOST", str(usual + 40))) as page:
        with strangers(page, b"", many=400):
            taken_s = [stopped_in_s(page) for _ in range(3)]
        assert max(taken_s) < QUEUE_S, taken_s
        assert len((page.data / "page.stderr").read_bytes()) < 2000
        # It has not been left busy: two seconds of rest, which must pass, cost little processor time.
        used_s = cpu_s(page)
        time.sleep(2)
        assert cpu_s(page) - used_s < 1


def cpu_s(page):
    fields = Path(f"/proc/{page.process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
