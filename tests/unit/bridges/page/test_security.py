"""The security layer of the page lets through what comes from its own pages with the token, and nothing else."""

from __future__ import annotations

import asyncio
import re
from urllib.parse import unquote

import pytest

from markerseek.bridges.page import Access, SecurityLayer
from markerseek.bridges.page.security import BODY_BYTES, MESSAGES, PER_S
from markerseek.core import ConfigError

TOKEN = "t0ken-of-sixteen-or-more"
HOST = "127.0.0.1:8765"
ACCESS = Access(token=TOKEN, hosts=frozenset({HOST, "localhost:8765"}), scheme="http", cookie="markerseek_8765")
COOKIE = ("cookie", f"other=1; markerseek_8765={TOKEN}")
ORIGIN = ("origin", f"http://{HOST}")


class Application:
    """Takes whatever is let through, and reads it to its end."""

    def __init__(self) -> None:
        self.reached = 0
        self.received: list[dict] = []

    async def __call__(self, scope, receive, send) -> None:
        self.reached += 1
        while True:
            message = await receive()
            self.received.append(message)
            if message["type"].endswith("disconnect") or not message.get("more_body", scope["type"] == "websocket"):
                break
        if scope["type"] == "http":
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b"here"})


def ask(kind="http", *, method="GET", path="/", query="", headers=(), messages=None, now_s=lambda: 0.0):
    application, sent = Application(), []
    left = list(messages or [{"type": "http.request", "body": b"", "more_body": False}])

    async def receive():
        return left.pop(0) if left else {"type": f"{kind}.disconnect"}

    async def send(message):
        sent.append(message)

    scope = {
        "type": kind,
        "method": method,
        "path": path,
        "query_string": query.encode(),
        "headers": [(name.encode(), value.encode()) for name, value in headers],
    }
    asyncio.run(SecurityLayer(application, ACCESS, now_s=now_s, refusal_s=0.0)(scope, receive, send))
    return application, sent


def headers_of(sent):
    return {name.decode(): value.decode() for name, value in sent[0]["headers"]}


def test_own_page_with_token_is_let_through():
    application, sent = ask(headers=[("host", HOST), COOKIE])
    assert (application.reached, sent[0]["status"]) == (1, 200)
    assert "default-src 'self'" in headers_of(sent)["content-security-policy"]


REFUSED = {
    "no token": [("host", HOST)],
    "wrong token": [("host", HOST), ("cookie", "markerseek_8765=wrong")],
    "token of another cookie": [("host", HOST), ("cookie", f"markerseek_1={TOKEN}")],
    "foreign host": [("host", "evil.example:8765"), COOKIE],
    "host without port": [("host", "127.0.0.1"), COOKIE],
    "no host": [COOKIE],
    "two hosts": [("host", HOST), ("host", "evil.example"), COOKIE],
    "foreign origin": [("host", HOST), ("origin", "http://evil.example"), COOKIE],
    "origin of another port": [("host", HOST), ("origin", "http://127.0.0.1:1"), COOKIE],
    "origin null": [("host", HOST), ("origin", "null"), COOKIE],
}


@pytest.mark.parametrize("name", REFUSED)
def test_http_is_refused(name):
    application, sent = ask(headers=REFUSED[name])
    assert (application.reached, sent[0]["status"]) == (0, 403)
    assert TOKEN not in str(sent)


@pytest.mark.parametrize("name", [*REFUSED, "no origin"])
def test_websocket_is_refused_before_the_handshake(name):
    headers = REFUSED.get(name, [("host", HOST), COOKIE])
    # An own origin, unless the origin is what is wrong: the other fault alone must refuse.
    if not any(key == "origin" for key, _ in headers) and name != "no origin":
        headers = [*headers, ORIGIN]
    application, sent = ask("websocket", headers=headers)
    assert application.reached == 0
    assert [message["type"] for message in sent] == ["websocket.close"]


def test_websocket_of_own_page_is_let_through():
    application, sent = ask("websocket", headers=[("host", HOST), ORIGIN, COOKIE])
    assert (application.reached, sent) == (1, [])


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_requests_that_change_something_need_an_origin(method):
    assert ask(method=method, headers=[("host", HOST), COOKIE])[1][0]["status"] == 403
    assert ask(method=method, headers=[("host", HOST), COOKIE, ORIGIN])[1][0]["status"] == 200


def test_first_link_sets_a_cookie_and_drops_the_token():
    application, sent = ask(query=f"token={TOKEN}&method=ternary&seed=3", headers=[("host", HOST)])
    headers = headers_of(sent)
    assert (application.reached, sent[0]["status"]) == (0, 303)
    assert headers["location"] == "/?method=ternary&seed=3"
    assert headers["set-cookie"] == f"markerseek_8765={TOKEN}; HttpOnly; SameSite=Strict; Path=/"


def test_first_link_opened_again_drops_the_token_too():
    application, sent = ask(query=f"token={TOKEN}&seed=3", headers=[("host", HOST), COOKIE])
    assert (application.reached, sent[0]["status"], headers_of(sent)["location"]) == (0, 303, "/?seed=3")


def test_first_link_never_leads_elsewhere():
    _, sent = ask(path="//evil.example/", query=f"token={TOKEN}", headers=[("host", HOST)])
    assert headers_of(sent)["location"] == "/evil.example/"


@pytest.mark.parametrize("path", ["/\\evil.example", "/\t/evil.example", "/\\\\evil.example", "/\r\n/evil.example"])
def test_26_10_no_spelling_of_the_first_link_leads_elsewhere(path):
    _, sent = ask(path=path, query=f"token={TOKEN}", headers=[("host", HOST)])
    location = headers_of(sent)["location"]
    assert unquote(location) == path
    # Browsers take a backslash for a slash, and leave tabs and ends of lines out.
    assert re.fullmatch(r"/[A-Za-z0-9%./]+", location)
    assert not location.startswith("//")


@pytest.mark.parametrize("method", ["POST", "HEAD"])
def test_token_in_the_address_serves_for_the_first_link_only(method):
    assert ask(method=method, query=f"token={TOKEN}", headers=[("host", HOST), ORIGIN])[1][0]["status"] == 403


def test_large_body_is_refused_by_its_header():
    headers = [("host", HOST), COOKIE, ORIGIN, ("content-length", str(BODY_BYTES + 1))]
    application, sent = ask(method="POST", headers=headers)
    assert (application.reached, sent[0]["status"]) == (0, 413)


def test_large_body_is_cut_off_where_its_header_lies():
    half = {"type": "http.request", "body": b"x" * (BODY_BYTES // 2 + 1), "more_body": True}
    application, _ = ask(method="POST", headers=[("host", HOST), COOKIE, ORIGIN], messages=[half, half, half])
    assert [message["type"] for message in application.received] == ["http.request", "http.disconnect"]


@pytest.mark.parametrize(("apart_s", "closed"), [(0.0, True), (1.01 * PER_S / MESSAGES, False)])
def test_messages_that_come_too_fast_close_the_websocket(apart_s, closed):
    clock = iter(range(10 * MESSAGES))
    messages = [{"type": "websocket.receive", "text": "x"}] * (2 * MESSAGES)
    headers = [("host", HOST), ORIGIN, COOKIE]
    application, sent = ask("websocket", headers=headers, messages=messages, now_s=lambda: next(clock) * apart_s)
    assert len(application.received) == (MESSAGES + 1 if closed else 2 * MESSAGES + 1)
    assert [message.get("code") for message in sent] == ([1008] if closed else [])


def test_short_token_is_refused():
    with pytest.raises(ConfigError, match="at least 16"):
        Access(token="short", hosts=frozenset(), scheme="http", cookie="c")
