"""The page behind a path of another site, as Jupyter's proxy serves it: with the path taken away, and with it left."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from urllib.parse import urlsplit

import pytest

from markerseek.bridges.page import Address
from markerseek.core import ConfigError
from tests.page.page_browser import Served, needs_browser, open_tab, served

HEAD_END = b"\r\n\r\n"


class Proxy:
    """A proxy of one port that serves a page below a path; ``strips``: whether it takes the path away."""

    def __init__(self, prefix, *, strips):
        self.prefix = prefix
        self.strips = strips
        self.target = None
        self.listening = socket.create_server(("127.0.0.1", 0))
        self.port = self.listening.getsockname()[1]
        threading.Thread(target=self.accept, daemon=True).start()

    def accept(self):
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self.listening.accept()
                threading.Thread(target=self.serve, args=[connection], daemon=True).start()

    def serve(self, browser):
        head = b""
        with browser, socket.create_connection(self.target) as page, contextlib.suppress(OSError):
            while HEAD_END not in head:
                if not (more := browser.recv(65536)):
                    return
                head += more
            method, path, rest = head.split(b" ", 2)
            prefix = self.prefix.encode()
            if not path.startswith(prefix + b"/"):
                browser.sendall(b"HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\nConnection: close\r\n\r\n")
                return
            if self.strips:
                path = path[len(prefix) :]
            # One request a connection, and what such proxies add.
            upgrades = b"upgrade: websocket" in rest.lower()
            more = b"X-Forwarded-Prefix: " + prefix + b"\r\n" + (b"" if upgrades else b"Connection: close\r\n")
            line, _, rest = rest.partition(b"\r\n")
            if not upgrades:
                rest = b"\r\n".join(each for each in rest.split(b"\r\n") if not each.lower().startswith(b"connection:"))
            page.sendall(b" ".join([method, path, line]) + b"\r\n" + more + rest)
            while True:
                for end in select.select([browser, page], [], [])[0]:
                    data = end.recv(65536)
                    if not data:
                        return
                    (page if end is browser else browser).sendall(data)

    def close(self):
        self.listening.close()


@pytest.mark.real_time
@needs_browser
@pytest.mark.parametrize(
    ("prefix", "strips"), [("/proxy/8765", True), ("/user/a.b@lab/proxy/absolute/90", False)], ids=["strips", "keeps"]
)
def test_a_search_and_a_session_behind_a_path(browser, tmp_path, prefix, strips):
    with contextlib.closing(Proxy(prefix, strips=strips)) as proxy:
        public = f"http://localhost:{proxy.port}{prefix}/"
        # Its own port is not known before it is served.
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        with served(tmp_path, "--public-url", public, "--port", str(port)) as page:
            assert page.link.startswith(f"{public}?token=")
            proxy.target = ("127.0.0.1", port)
            watched = open_tab(browser, Served(page.process, page.link, page.data), "/search", "&seed=8&pace=0.05")
            # Only what is below the path reaches the page: the proxy serves nothing else.
            assert urlsplit(watched.tab.url).path == f"{prefix}/search"
            watched.start()
            watched.wait_for(".ms-log", "acquisition 1:")
            watched.tab.locator(".ms-stop").click()
            watched.wait_for(".ms-badge", "^STOPPED$")
            watched.tab.get_by_role("link", name="register").click()
            watched.tab.wait_for_url(f"**{prefix}/")
            watched.tab.wait_for_function("window.markerseekBeat > 0")
            watched.start()
            # The image of a camera has a path too.
            watched.tab.wait_for_function("document.querySelector('.ms-panel-left img')?.naturalWidth > 100")
            watched.tab.keyboard.press("Escape")
            watched.wait_for(".ms-badge", "^STOPPED$")
            watched.tab.reload()
            watched.wait_for(".ms-badge", "^STOPPED$")
            assert watched.problems == []
            cookies = watched.tab.context.cookies()
            # Not sent to what else is served there.
            assert [each["path"] for each in cookies if each["name"].startswith("markerseek")] == [prefix]
            watched.tab.context.close()


@pytest.mark.parametrize(
    ("public", "origin", "prefix"),
    [
        ("http://localhost:8888/proxy/8765/", "http://localhost:8888", "/proxy/8765"),
        ("https://Hub.example/user/a%", None, None),
        ("https://Hub.example/user/a.b/proxy/9", "https://hub.example", "/user/a.b/proxy/9"),
        ("http://[::1]:9000", "http://[::1]:9000", ""),
        ("http://[::1]", "http://[::1]", ""),
        ("http://localhost:9000/", "http://localhost:9000", ""),
        ("http://localhost:80/x", "http://localhost", "/x"),
        ("http://lab:8888/proxy/8765/", None, None),
        ("http://localhost/a/../b", None, None),
        ("http://localhost//b", None, None),
        ("http://localhost/a?b", None, None),
        ("http://localhost/'onload='", None, None),
        ("http://localhost:0/", None, None),
        ("http://[2001:db8::1]:9000", None, None),
    ],
)
def test_the_address_in_the_browser(public, origin, prefix):
    if origin is None:
        with pytest.raises(ConfigError, match="public url is"):
            Address(public_url=public)
        return
    address = Address(public_url=public)
    assert (address.public, address.prefix) == (origin, prefix)
    assert address.link(8765, "token=x") == f"{origin}{prefix}/?token=x"
    assert origin in address.origins(8765)
