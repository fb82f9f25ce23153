"""The page as it is served: whom it lets in over HTTP and WebSocket, and where it listens."""

from __future__ import annotations

import json
import os
import resource
import select
import socket
import ssl
import sys
import time
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from markerseek.bridges.page.listener import MAX_UNPROVED, UNPROVED_S

from tests.page.page_browser import START, certified, served

pytestmark = pytest.mark.real_time

UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}
SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"


@contextmanager
def connected(page):
    """A connection to a page, with TLS where it has a certificate."""
    place = urlsplit(page.address)
    with socket.create_connection((place.hostname, place.port), timeout=30) as connection:
        if place.scheme == "http":
            yield connection
            return
        context = ssl.create_default_context(cafile=page.data / "page.pem")
        context.check_hostname = False
        with context.wrap_socket(connection) as wrapped:
            yield wrapped


def answer(page, path="/", *, method="GET", **headers):
    """Status and head of the answer to one request."""
    given = {"Host": urlsplit(page.address).netloc}
    given |= {name.replace("_", "-"): value for name, value in headers.items()}
    lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {value}" for name, value in given.items() if value is not None)]
    with connected(page) as connection:
        connection.sendall("\r\n".join([*lines, "", ""]).encode())
        head = b""
        while b"\r\n\r\n" not in head and (data := connection.recv(4096)):
            head += data
    text = head.split(b"\r\n\r\n")[0].decode()
    return int(text.split()[1]), text


def cookie(page):
    return f"markerseek_{urlsplit(page.address).port}={page.token}"


def test_first_link_and_then_the_cookie(page):
    status, head = answer(page, f"/?token={page.token}&seed=3")
    assert (status, "location: /?seed=3" in head) == (303, True)
    assert "HttpOnly; SameSite=Strict" in head
    assert answer(page, Cookie=cookie(page))[0] == 200


@pytest.mark.parametrize("path", ["/", "/race", "/stop", "/_nicegui/x", "/?token=wrong", SOCKET])
def test_wrong_token(page, path):
    assert answer(page, path)[0] == 403
    assert answer(page, path, Cookie="markerseek=guess")[0] == 403


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "127.0.0.1:1"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Host": None},
    ],
    ids=str,
)
def test_foreign_host_and_origin(page, headers):
    for path, more in (("/", {}), (SOCKET, UPGRADE)):
        given = {"Origin": page.address, "Cookie": cookie(page)} | more | headers
        status, _ = answer(page, path, **{name.replace("-", "_"): value for name, value in given.items()})
        # Without any Host header the server itself refuses.
        assert status in ((400, 403) if headers == {"Host": None} else (403,))


def test_websocket_needs_token_and_origin(page):
    upgrade = {name.replace("-", "_"): value for name, value in UPGRADE.items()}
    assert answer(page, SOCKET, **upgrade, Origin=page.address)[0] == 403
    assert answer(page, SOCKET, **upgrade, Cookie=cookie(page))[0] == 403
    assert answer(page, SOCKET, **upgrade, Cookie=cookie(page), Origin=page.address)[0] == 101


def test_stop_needs_origin(page):
    assert answer(page, "/stop", method="POST", Cookie=cookie(page))[0] == 403
    assert answer(page, "/stop", method="POST", Cookie=cookie(page), Origin=page.address)[0] == 204


def test_another_address_is_served_with_tls_only(tmp_path):
    with served(tmp_path, "--host", "127.0.0.2", *certified(tmp_path)) as page:
        assert page.address.startswith("https://")
        status, head = answer(page, f"/?token={page.token}")
        assert (status, "; Secure" in head) == (303, True)


def test_only_the_loopback_address_listens(page):
    sockets = {link.readlink().name for link in Path(f"/proc/{page.process.pid}/fd").iterdir() if link.is_symlink()}
    rows = []
    for table in ("tcp", "tcp6", "udp", "udp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            _, local, _, state, *rest = line.split()
            if f"socket:[{rest[5]}]" in sockets and (state == "0A" or table.startswith("udp")):
                rows.append(local)
    port = urlsplit(page.address).port
    # 127.0.0.1 as the system writes it, lowest byte first.
    assert rows == [f"0100007F:{port:04X}"]


FILES = 1024
"""Files that a process may open, on most systems."""

STRANGERS = 1100
"""Connections that show no token."""


@contextmanager
def strangers(page, sent):
    """Open connections that send no whole request."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, STRANGERS + 200), hard))
    place = urlsplit(page.address)
    with ExitStack() as stack:
        connections = []
        for _ in range(STRANGERS):
            connections.append(stack.enter_context(socket.create_connection((place.hostname, place.port))))
            connections[-1].sendall(sent)
        yield connections
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.long
@pytest.mark.parametrize(
    "sent", [b"", b"POST /stop HTTP/1.1\r\nHost: ", b"\x16\x03\x01\x02"], ids=["idle", "header", "TLS handshake"]
)
def test_26_8_stop_is_heard_within_1_s_among_1100_strangers(tmp_path, sent):
    tls = certified(tmp_path) if sent.startswith(b"\x16") else ()
    few = f"import resource; resource.setrlimit(resource.RLIMIT_NOFILE, ({FILES}, {FILES}))"
    with served(tmp_path, *tls, start=f"{few}; {START}") as page, strangers(page, sent) as connections:
        # The oldest have been ended, so that all have been taken in.
        for each in connections[: STRANGERS - MAX_UNPROVED]:
            each.settimeout(30)
            with suppress(ConnectionResetError):
                assert each.recv(1) == b""
        began_s = time.monotonic()
        status, _ = answer(page, "/stop", method="POST", Cookie=cookie(page), Origin=page.address)
        assert (status, time.monotonic() - began_s < 1.0) == (204, True)


def test_26_8_kernels_whose_loading_would_hold_up_stop_are_loaded_before_the_port_is_open(tmp_path):
    told = "from markerseek.bridges.page import listener, run_history"
    told += "; load = run_history.warm_up; init = listener.Listener.__init__"
    told += "; run_history.warm_up = lambda: (load(), print('loaded', file=sys.stderr))"
    told += "; listener.Listener.__init__ = lambda *a: (print('open', file=sys.stderr), init(*a))[1]"
    with served(tmp_path, start=f"import sys; {told}; {START}"):
        assert (tmp_path / "page.stderr").read_text().split() == ["loaded", "open"]


@pytest.mark.long
@pytest.mark.parametrize(
    "sent",
    [b"GET / HTTP/1.1\r\nX: ", b"POST / HTTP/1.1\r\nHost: elsewhere\r\nContent-Length: 1000\r\n\r\n"],
    ids=["header", "body"],
)
def test_26_8_whoever_shows_no_token_is_ended_within_6_s_though_bytes_drip(page, sent):
    with connected(page) as connection:
        connection.sendall(sent)
        # Another five seconds for a busy computer; without the limit it would go on for ever.
        ends_s = time.monotonic() + UNPROVED_S + 5
        with suppress(ConnectionResetError, BrokenPipeError):
            while select.select([connection], [], [], 0.5)[0] == [] or connection.recv(4096):
                assert time.monotonic() < ends_s
                connection.sendall(b"x")


@pytest.mark.long
def test_26_8_whoever_shows_the_token_stays(page):
    host = urlsplit(page.address).netloc
    request = f"HEAD / HTTP/1.1\r\nHost: {host}\r\nCookie: {cookie(page)}\r\n\r\n".encode()
    with connected(page) as known, connected(page) as stranger:
        # Once a second: a connection in use is not ended for its silence either.
        while not select.select([stranger], [], [], 1)[0]:
            known.sendall(request)
            assert known.recv(4096).startswith(b"HTTP/1.1 405")
        assert stranger.recv(1) == b""
        known.sendall(request)
        assert known.recv(4096).startswith(b"HTTP/1.1 405")


def test_26_8_header_without_end_is_refused(page):
    with connected(page) as connection, pytest.raises((ConnectionResetError, BrokenPipeError)):
        connection.sendall(b"GET / HTTP/1.1\r\n" + (b"X: " + b"x" * 10_000 + b"\r\n") * 1000)


def test_26_10_browser_that_is_opened_gets_the_page_once_and_its_command_shows_no_token(tmp_path, monkeypatch):
    program, seen = tmp_path / "browser.py", tmp_path / "seen"
    os.mkfifo(seen)
    program.write_text(
        "import json, sys, urllib.request\n"
        "opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())\n"
        "text = opener.open(sys.argv[1]).read().decode()\n"
        f"open({str(seen)!r}, 'w').write(json.dumps([open('/proc/self/cmdline').read(), text]))\n"
    )
    monkeypatch.setenv("BROWSER", f"{sys.executable} {program} %s")
    with served(tmp_path, "--open") as page:
        command, text = json.loads(seen.read_text())
        assert (page.address in command, page.token in command) == (True, False)
        assert "markerseekStop" in text
        # A second one needs the link.
        assert answer(page)[0] == 403
