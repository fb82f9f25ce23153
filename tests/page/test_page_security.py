"""The page as it is served: whom it lets in over HTTP and WebSocket, and where it listens."""

from __future__ import annotations

import socket
import ssl
import subprocess
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from page_browser import served

pytestmark = pytest.mark.real_time

UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}
SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"


def answer(page, path="/", *, method="GET", **headers):
    """Status and head of the answer to one request."""
    place = urlsplit(page.address)
    given = {"Host": place.netloc} | {name.replace("_", "-"): value for name, value in headers.items()}
    lines = [f"{method} {path} HTTP/1.1", *(f"{name}: {value}" for name, value in given.items() if value is not None)]
    with socket.create_connection((place.hostname, place.port), timeout=30) as connection:
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
    certificate, key = tmp_path / "page.pem", tmp_path / "page.key"
    made = subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=page"),
            *("-keyout", str(key), "-out", str(certificate)),
        ],
        check=False,
        capture_output=True,
    )
    if made.returncode:
        pytest.skip("no openssl to make a certificate")
    files = ("--tls-certificate", str(certificate), "--tls-key", str(key))
    with served(tmp_path, "--host", "127.0.0.2", *files) as page:
        place = urlsplit(page.address)
        assert place.scheme == "https"
        context = ssl.create_default_context(cafile=certificate)
        context.check_hostname = False
        with (
            socket.create_connection((place.hostname, place.port), timeout=30) as plain,
            context.wrap_socket(plain) as connection,
        ):
            connection.sendall(f"GET /?token={page.token} HTTP/1.1\r\nHost: {place.netloc}\r\n\r\n".encode())
            head = connection.recv(4096).decode()
        assert head.startswith("HTTP/1.1 303")
        assert "; Secure" in head


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
