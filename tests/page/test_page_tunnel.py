"""The page behind a tunnel, with its public address."""

from __future__ import annotations

import http.client
import signal
import socket
import subprocess
from pathlib import Path

import pytest

from tests.emulated import markerseek


def asked(port: int, path: str, **headers: str) -> tuple[int, dict[str, str], str]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    text = answer.read().decode("utf-8", "replace")
    connection.close()
    return answer.status, {name.lower(): value for name, value in answer.getheaders()}, text


@pytest.mark.real_time
def test_the_page_behind_a_tunnel_is_refused_with_the_option_and_served_with_it(tmp_path: Path) -> None:
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
                assert "as by markerseek page --public-url http://localhost:9000" in text
        finally:
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=60)
