"""A viewer of the live page without a browser: it starts a search and notes when each line of the log reaches it.

It speaks the protocol of the page's WebSocket, so that the page can be measured apart from Chromium, which loads a
small computer more than page and search together. Run as a program it prints its notes as one JSON object.
"""

from __future__ import annotations

import argparse
import asyncio
import html
import http.cookiejar
import json
import os
import re
import sys
import time
import urllib.request
from typing import Any
from urllib.parse import urlencode, urlsplit

import socketio

LONGEST_S = 300.0
"""Longest wait for the end of a search, in seconds."""


class Viewer:
    """One tab's worth of the page, which its link opens with its token, and with settings in the link."""

    def __init__(self, link: str, **query: object) -> None:
        place = urlsplit(link)
        self._origin = f"{place.scheme}://{place.netloc}"
        jar = http.cookiejar.CookieJar()
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor(jar))
        with opener.open(f"{self._origin}/search?{place.query}&{urlencode(query)}") as answer:
            text = answer.read().decode()
        self._cookie = "; ".join(f"{each.name}={each.value}" for each in jar)
        self._client_id = re.findall(r"'client_id': '([^']+)'", text)[0]
        packed = re.findall(r"parseElements\(String\.raw`(.*?)`\)", text, re.DOTALL)[0]
        self._elements: dict[int, dict[str, Any]] = {
            int(number): each for number, each in json.loads(html.unescape(packed)).items()
        }
        self.lines: list[tuple[float, str]] = []
        self.bytes = 0
        self.messages = 0
        self.busy = asyncio.Event()
        self.idle = asyncio.Event()
        self._socket = socketio.AsyncClient()
        self._socket.on("update", self._take)

    async def connect(self) -> None:
        """Open the WebSocket."""
        query = {
            "client_id": self._client_id,
            "next_message_id": 0,
            "implicit_handshake": "true",
            "document_id": self._client_id,
            "tab_id": self._client_id,
        }
        await self._socket.connect(
            f"{self._origin}?{urlencode(query)}",
            headers={"Cookie": self._cookie, "Origin": self._origin},
            transports=["websocket"],
            socketio_path="/_nicegui_ws/socket.io",
        )

    async def disconnect(self) -> None:
        """Close the WebSocket, as a tab that is closed."""
        await self._socket.disconnect()

    async def press_start(self) -> None:
        """Press Start once the page has sent its first beat."""
        while not self._find("nicegui-beat")["props"]["beat"]:
            await asyncio.sleep(0.05)
        number, start = next((number, each) for number, each in self._elements.items() if _is_start(each))
        listener = next(each for each in start["events"] if each["type"] == "click" and each["js_handler"])
        beat = self._find("nicegui-beat")["props"]["beat"]
        message = {
            "id": number,
            "client_id": self._client_id,
            "listener_id": listener["listener_id"],
            "args": [json.dumps(beat)],
        }
        await self._socket.emit("event", message)

    def _find(self, tag: str) -> dict[str, Any]:
        return next(each for each in self._elements.values() if each["tag"] == tag)

    async def _take(self, data: dict[str, Any]) -> None:
        now_s = time.time()
        number = data.pop("_id")
        self.messages += 1
        self.bytes += len(json.dumps(data))
        for name, element in data.items():
            if element is None:
                continue
            self._elements[int(name)] = element
            if "ms-log" in element.get("class", ()):
                self.lines += [(now_s, line) for line in element["text"].split("\n")[:3]]
            if _is_start(element):
                (self.busy if element["props"].get("disable") else self.idle).set()
        await self._socket.emit("ack", {"client_id": self._client_id, "next_message_id": number + 1})


def _is_start(element: dict[str, Any]) -> bool:
    return element.get("props", {}).get("label") == "Start"


async def watch(link: str, *, starts: bool, **query: object) -> dict[str, Any]:
    """Watch one search from its start to its end; a viewer that does not start it waits until another has."""
    viewer = Viewer(link, **query)
    await viewer.connect()
    if starts:
        await viewer.press_start()
    async with asyncio.timeout(LONGEST_S):
        await viewer.busy.wait()
        viewer.idle.clear()
        await viewer.idle.wait()
    # The last update is on its way.
    await asyncio.sleep(0.5)
    await viewer.disconnect()
    return {"lines": viewer.lines, "bytes": viewer.bytes, "messages": viewer.messages}


def main() -> None:
    """Watch one search and print what was seen."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("link")
    parser.add_argument("--starts", action="store_true")
    parser.add_argument("--query", default="{}", help="settings in the link, as JSON")
    given = parser.parse_args()
    # As the browser of another computer would be: it takes no processor time from page and search.
    os.nice(10)
    seen = asyncio.run(watch(given.link, starts=given.starts, **json.loads(given.query)))
    sys.stdout.write(json.dumps(seen))


if __name__ == "__main__":
    main()
