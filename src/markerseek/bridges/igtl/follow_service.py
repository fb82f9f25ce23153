"""Serves the state of a run that follows a target over OpenIGTLink: the transform of the camera, and its state.

TRANSFORM ``DaVinciToProbeHome`` is as `streams` sends it, with ``TransformStatus`` and ``tre_m`` in its metadata; it is
NaN while no registration holds, and once the run says nothing any more. STRING ``FollowState`` is the newest step, or
``silent``.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Collection

import msgspec
import numpy as np

from markerseek._closing import Closing
from markerseek.bridges.follow_feed import SENT_S, FollowFeed, follow_state
from markerseek.bridges.igtl.commands import CommandAnswer, Request
from markerseek.bridges.igtl.peer import IPAddress
from markerseek.bridges.igtl.service import IgtlServer
from markerseek.bridges.igtl.streams import StreamMessage, camera_transform
from markerseek.following import FollowStep
from markerseek.wire import igtl


class FollowService(Closing):
    """The server, in a thread of its own, while it is open.

    ``simulated``: whether the registration is. ``allowed``: addresses of other computers that may connect. ``on_note``:
    receives sentences for the terminal. Errors as of `IgtlServer.open`.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        simulated: bool,
        allowed: Collection[IPAddress] = (),
        on_note: Callable[[str], None],
    ) -> None:
        self._feed = FollowFeed(simulated=simulated)
        self._server = IgtlServer(on_request=_refused, allowed=allowed, on_note=on_note)
        self._loop = asyncio.new_event_loop()
        self._closing = asyncio.Event()
        # Opened in its own thread too: a notebook's thread runs an event loop already.
        self._thread = threading.Thread(target=self._loop.run_forever, name="follow-igtl", daemon=True)
        self._thread.start()
        try:
            self.port = asyncio.run_coroutine_threadsafe(self._server.open(host, port), self._loop).result()
        except BaseException:
            self._end_loop()
            raise
        self._sending = asyncio.run_coroutine_threadsafe(self._send(), self._loop)

    def show(self, step: FollowStep) -> None:
        """Take a step of the run."""
        self._feed.show(step)

    def close(self) -> None:
        """End all connections; allowed twice."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._closing.set)
            try:
                self._sending.result()
            finally:
                self._end_loop()

    def _end_loop(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _send(self) -> None:
        simulated = self._feed.simulated
        metadata = {"registration": "simulated" if simulated else "measured"}
        try:
            while not self._closing.is_set():
                for message in follow_messages(self._feed.step, simulated=simulated):
                    self._server.publish(message, metadata=metadata)
                await asyncio.sleep(SENT_S)
        finally:
            await self._server.close()


def follow_messages(step: FollowStep | None, *, simulated: bool) -> list[StreamMessage]:
    """Return the messages of a step; None: nothing is known now."""
    matrix = None if step is None or step.davinci_to_trus is None else np.array(step.davinci_to_trus)
    errors = {} if step is None or step.tre_m is None else {"tre_m": step.tre_m}
    text = msgspec.json.encode(follow_state(step, simulated=simulated)).decode()
    return [camera_transform(matrix, errors=errors), StreamMessage(device="FollowState", content=igtl.Text(text=text))]


def _refused(request: Request) -> CommandAnswer:
    return CommandAnswer(
        done=False, sentence=f"there is no command {request.name[:80]!r}: a run that follows takes none"
    )
