"""The page as it is served: whom it lets in over HTTP and WebSocket, and where it listens."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import ssl
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from urllib.parse import urlencode, urlsplit

import pytest
import websockets.sync.client as websockets
from websockets.exceptions import ConnectionClosed

from markerseek.bridges.page.application import MAX_VIEWERS
from tests.page.page_browser import certified, served

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
    # Several values are as many lines.
    every = [(name, one) for name, value in given.items() for one in (value if isinstance(value, list) else [value])]
    lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {value}" for name, value in every if value is not None)]
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
    assert "HttpOnly; Path=/; SameSite=strict" in head
    assert answer(page, Cookie=cookie(page))[0] == 200


@pytest.mark.parametrize("path", ["/", "/search", "/stop", "/camera/left.jpg", "/_nicegui/x", "/?token=wrong", SOCKET])
def test_wrong_token(page, path):
    assert answer(page, path)[0] == 403
    assert answer(page, path, Cookie="markerseek=guess")[0] == 403


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
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
        # HTTP itself asks for a Host.
        assert status == (400 if headers.get("Host", "") is None else 403)


def test_websocket_needs_token_and_origin(page):
    upgrade = {name.replace("-", "_"): value for name, value in UPGRADE.items()}
    assert answer(page, SOCKET, **upgrade, Origin=page.address)[0] == 403
    assert answer(page, SOCKET, **upgrade, Cookie=cookie(page))[0] == 403
    assert answer(page, SOCKET, **upgrade, Cookie=cookie(page), Origin=page.address)[0] == 101


@pytest.mark.parametrize("name", ["localhost", "127.0.0.1", "[::1]"])
@pytest.mark.parametrize("scheme", ["http", "https"])
@pytest.mark.parametrize("port", ["", ":80", ":443", ":+PORT", ":0PORT", ":PORT1", ":PORT/", ":PORT."])
def test_an_origin_is_scheme_name_and_port(page, scheme, name, port):
    """Another program of this computer, on another port, is somebody else."""
    own = urlsplit(page.address).port
    origin = f"{scheme}://{name}{port.replace('PORT', str(own))}"
    upgrade = {each.replace("-", "_"): value for each, value in UPGRADE.items()}
    given = {"Cookie": cookie(page), "Origin": origin}
    assert answer(page, "/stop", method="POST", **given)[0] == 403
    assert answer(page, SOCKET, **upgrade, **given)[0] == 403
    assert answer(page, "/stop", **upgrade, **given)[0] == 403


@pytest.mark.parametrize("port", ["", ":80", ":", ":PORT1"])
def test_a_host_is_name_and_port(page, port):
    own = urlsplit(page.address).port
    for name in ("localhost", "127.0.0.1"):
        assert answer(page, Cookie=cookie(page), Host=f"{name}:{own}")[0] == 200
        assert answer(page, Cookie=cookie(page), Host=name + port.replace("PORT", str(own)))[0] == 403


@pytest.mark.parametrize("other", ["http://evil.example", "null", "", "OWN"])
def test_two_lines_of_an_origin_or_a_host_are_refused(page, other):
    own = page.address
    other = other.replace("OWN", own)
    upgrade = {each.replace("-", "_"): value for each, value in UPGRADE.items()}
    for origins in ([own, other], [other, own]):
        assert answer(page, Cookie=cookie(page), Origin=origins)[0] == 403
        assert answer(page, "/stop", method="POST", Cookie=cookie(page), Origin=origins)[0] == 403
        # The library of the WebSocket refuses them too.
        assert answer(page, SOCKET, **upgrade, Cookie=cookie(page), Origin=origins)[0] in {400, 403}
    host = urlsplit(own).netloc
    assert answer(page, Cookie=cookie(page), Host=[host, host])[0] in {400, 403}


UNREADABLE = [
    '42["event",{"client_id":"CID","id":1e999}]',
    '42["event",{"client_id":"CID","id":-4E4000}]',
    f'42["ack",{{"client_id":"CID","next_message_id":{"7" * 6000}}}]',
    "42" + "[" * 30_000,
    '42["event",{"client_id":"CID","id":4,"args":7}]',
    '42["event"]',
    '42["handshake",[]]',
    "42{}",
    "44{}",
    "4",
    "7",
    "",
    "b?",
]
"""Packets that no page of ours sends: numbers beyond double, nested without end, without what they must have."""


def test_a_packet_that_cannot_be_read_gives_one_line_and_no_traceback(tmp_path):
    from tests.page.page_viewer import Viewer

    with served(tmp_path) as page:
        for packet in UNREADABLE:
            viewer = Viewer(page.link)
            given = {"client_id": viewer._client_id, "next_message_id": 0, "implicit_handshake": "true"}
            given |= {"document_id": viewer._client_id, "tab_id": viewer._client_id}
            place = urlsplit(page.address)
            with websockets.connect(
                f"ws://{place.netloc}{SOCKET}&{urlencode(given)}",
                origin=page.address,
                additional_headers={"Cookie": cookie(page)},
                close_timeout=1,
                proxy=None,
            ) as line:
                line.recv(20)
                line.send("40")
                line.recv(20)
                line.send(packet.replace("CID", viewer._client_id))
                # Once something comes back, or the connection is closed, the packet has been read.
                with contextlib.suppress(ConnectionClosed, TimeoutError):
                    line.recv(0.3)
        assert answer(page, Cookie=cookie(page))[0] == 200
        said = (page.data / "page.stderr").read_text()
    assert "Traceback" not in said
    assert said.count("a browser sent a message that no page of markerseek sends") == 1


def test_stop_needs_origin(page):
    assert answer(page, "/stop", method="POST", Cookie=cookie(page))[0] == 403
    assert answer(page, "/stop", method="POST", Cookie=cookie(page), Origin=page.address)[0] == 204


def test_the_loopback_address_of_ipv6_is_served_without_tls(tmp_path):
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        pytest.skip("no IPv6 on this computer")
    with served(tmp_path, "--host", "[::1]") as page:
        assert page.link.startswith("http://[::1]:")
        port = urlsplit(page.address).port
        for host in (f"[::1]:{port}", f"localhost:{port}"):
            assert answer(page, Cookie=cookie(page), Host=host)[0] == 200
            given = {"Cookie": cookie(page), "Host": host, "Origin": f"http://{host}"}
            assert answer(page, "/stop", method="POST", **given)[0] == 204
        assert answer(page, Cookie=cookie(page), Host=f"::1:{port}")[0] == 403


def test_another_address_is_served_with_tls_only(tmp_path):
    with served(tmp_path, "--host", "127.0.0.2", *certified(tmp_path)) as page:
        assert page.address.startswith("https://")
        status, head = answer(page, f"/?token={page.token}")
        assert (status, "; Secure" in head) == (303, True)


def test_a_tab_too_many_is_refused_and_stop_is_not(tmp_path):
    from tests.page.page_viewer import Viewer

    async def many(page):
        viewers = [Viewer(page.link) for _ in range(MAX_VIEWERS)]
        for each in viewers:
            await each.connect()
        refused = await asyncio.to_thread(answer, page, Cookie=cookie(page))
        stopped = await asyncio.to_thread(
            answer, page, "/stop", method="POST", Cookie=cookie(page), Origin=page.address
        )
        for each in viewers:
            await each.disconnect()
        return refused[0], stopped[0]

    # In a thread: the browser of other tests has the event loop of this one.
    with served(tmp_path) as page, ThreadPoolExecutor() as threads:
        assert threads.submit(lambda: asyncio.run(many(page))).result() == (403, 204)


def test_browser_that_is_opened_gets_the_page_once_and_its_command_shows_no_token(tmp_path, monkeypatch):
    program = tmp_path / "browser.py"
    seen = tmp_path / "seen"
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
        # Its link works one time.
        once = command.rstrip("\0").rpartition(page.address)[2]
        assert "/?once=" in once
        assert answer(page, once)[0] == 403
