"""The server against clients that are new, slow, dead, or hostile."""

from __future__ import annotations

import asyncio
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest

from markerseek.bridges.igtl import CommandAnswer, IgtlServer, Request, StreamMessage, plain_address
from markerseek.bridges.igtl.peer import Peer
from markerseek.core import ConfigError
from markerseek.wire import igtl
from tests.igtl.igtl_client import LONGEST_S, IgtlClient


class Served:
    """A server in an event loop of its own thread, whose clock only a test sets: no load makes a client slow."""

    def __init__(self, *, host: str = "127.0.0.1", allowed: tuple[str, ...] = ()) -> None:
        self.notes: list[str] = []
        self.changed = threading.Condition()
        self.requests: list[Request] = []
        self.loop = asyncio.new_event_loop()
        self._now_s = 0.0
        self.loop.time = lambda: self._now_s
        known = [plain_address(each) for each in allowed]
        self.server = IgtlServer(on_request=self._asked, allowed=known, on_note=self._note)
        self.port = self.loop.run_until_complete(self.server.open(host, 0))
        self._thread = threading.Thread(target=self.loop.run_forever)
        self._thread.start()

    def _asked(self, request: Request) -> CommandAnswer:
        self.requests.append(request)
        return CommandAnswer(done=True, sentence=f"heard {request.name}")

    def _note(self, sentence: str) -> None:
        with self.changed:
            self.notes.append(sentence)
            self.changed.notify_all()

    def forward(self, seconds: float) -> None:
        """Set the clock of the server forward."""

        def work() -> None:
            self._now_s += seconds

        self.within(work)

    def noted(self, part: str, *, timeout_s: float = LONGEST_S) -> bool:
        """Whether a sentence with that part was, or will be, noted."""
        with self.changed:
            return self.changed.wait_for(lambda: any(part in note for note in self.notes), timeout_s)

    def publish(self, device: str, content: igtl.Content) -> None:
        def work() -> None:
            self.server.publish(StreamMessage(device=device, content=content), metadata={"rig": "simulated"})

        self.within(work)

    def within(self, work: Callable[[], object]) -> None:
        async def run() -> None:
            work()

        asyncio.run_coroutine_threadsafe(run(), self.loop).result(LONGEST_S)

    def close(self) -> None:
        asyncio.run_coroutine_threadsafe(self.server.close(), self.loop).result(LONGEST_S)
        self.loop.call_soon_threadsafe(self.loop.stop)
        self._thread.join()
        self.loop.close()


@contextmanager
def serving(*, host: str = "127.0.0.1", allowed: tuple[str, ...] = ()) -> Iterator[Served]:
    with pytest.MonkeyPatch.context() as patch:
        # The same limit in the operating system, for a cable that was pulled; its clock cannot be set.
        patch.delattr(socket, "TCP_USER_TIMEOUT", raising=False)
        served = Served(host=host, allowed=allowed)
        try:
            yield served
        finally:
            served.close()


def number(value: int) -> igtl.Text:
    return igtl.Text(text=str(value))


def picture(value: int) -> igtl.Image:
    return igtl.Image(pixels=np.full((1, 1000, 1000), value % 256, np.uint8), matrix=np.eye(4))


def test_a_new_client_gets_the_present_state_at_once() -> None:
    with serving() as served:
        for value in range(3):
            served.publish("SearchState", number(value))
        served.publish("PaSearch", igtl.Status(code=igtl.OK, name="IDLE"))
        with IgtlClient(served.port) as client:
            first = client.read()
            second = client.read()
        assert (first.content.text, first.metadata) == ("2", {"sequence": "3", "rig": "simulated"})
        assert second.content.name == "IDLE"


def test_each_command_is_answered_in_its_own_form() -> None:
    with serving() as served, IgtlClient(served.port) as client:
        assert client.ask('<Command Name="StartSearch" Seed="3" />', name="x7") == (
            '<CommandReply Status="SUCCESS" Message="heard StartSearch" />'
        )
        client.send(igtl.Command(number=9, name="StopSearch", text=""), device="Slicer")
        reply = client.read()
        assert isinstance(reply.content, igtl.Reply)
        assert (reply.device, reply.content.number, reply.content.name) == ("Slicer", 9, "StopSearch")
        assert reply.metadata == {"Status": "SUCCESS", "Message": "heard StopSearch"}
        # 200 at once: none replaces another.
        for each in range(200):
            client.send(igtl.Text(text='<Command Name="A" />'), device=f"CMD_{each}", version=1)
        assert [client.read().device for _ in range(200)] == [f"ACK_{each}" for each in range(200)]
        assert [request.name for request in served.requests[:2]] == ["StartSearch", "StopSearch"]
        assert served.requests[0].values == {"Seed": "3"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "cannot be read"),
        ("hello", "cannot be read"),
        ("<Command />", "has no name"),
        ('<Command Name="A" Name="B" />', "Name twice"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><Command Name="&a;" />', "cannot be read"),
        ("<Command " + 'a="1" ' * 9000, "cannot be read"),
    ],
)
def test_a_command_that_cannot_be_read_is_refused_with_a_sentence(text: str, said: str) -> None:
    with serving() as served, IgtlClient(served.port) as client:
        answer = client.ask(text)
        assert answer.startswith('<CommandReply Status="FAIL"')
        assert said in answer
        assert not served.requests


GOOD = igtl.encode(igtl.Message(device="CMD_1", content=igtl.Text(text='<Command Name="StartSearch" />')))
HOSTILE = {
    "wrong checksum": (GOOD[:-1] + b"X", "its CRC is"),
    "huge length": (GOOD[:42] + struct.pack(">Q", 1 << 62) + GOOD[50:], "a body of 4611686018427387904 bytes"),
    "another protocol": (
        b"GET / HTTP/1.1\r\nHost: localhost\r\nUser-Agent: curl/8.0 (x86_64)\r\n\r\n",
        "another protocol",
    ),
}


@pytest.mark.parametrize(("data", "said"), HOSTILE.values(), ids=HOSTILE)
def test_a_hostile_message_hurts_its_sender_only_and_is_refused_with_a_sentence(data: bytes, said: str) -> None:
    with serving() as served, IgtlClient(served.port) as bystander, IgtlClient(served.port) as hostile:
        hostile.socket.sendall(data)
        messages = list(hostile.messages())
        assert said in messages[-1].content.message
        assert served.noted(said)
        assert not served.requests
        assert "heard" in bystander.ask('<Command Name="A" />')


def test_of_three_clients_one_is_slow_and_one_is_killed_and_the_third_loses_nothing() -> None:
    count = 60
    with serving() as served, IgtlClient(served.port) as prompt:
        slow = socket.socket()
        # Small, so that the system takes little of what the slow client does not read.
        slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        slow.connect(("127.0.0.1", served.port))
        killed = IgtlClient(served.port, reads_ahead=False)
        received: list[igtl.Message] = []
        taken = threading.Semaphore(0)

        def read() -> None:
            for message in prompt.messages():
                received.append(message)
                if message.device == "SearchState":
                    taken.release()
                elif message.device == "End":
                    return

        reading = threading.Thread(target=read)
        reading.start()
        killed.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        for value in range(count):
            served.publish("PA_ProbeHome", picture(value))
            served.publish("SearchState", number(value))
            if value == count // 2:
                # As when it is killed: reset, without a farewell.
                killed.socket.close()
            # A search has seconds between two images; here the prompt client sets the pace.
            assert taken.acquire(timeout=LONGEST_S)
            if value == count // 2:
                served.forward(1.99)
                assert not any("too slow" in note for note in served.notes)
                served.forward(0.02)
                assert served.noted("it is too slow: a message was not taken within 2 s")
        served.publish("End", number(0))
        reading.join(LONGEST_S)
        slow.close()
    for device in ("PA_ProbeHome", "SearchState"):
        numbers = [int(each.metadata["sequence"]) for each in received if each.device == device]
        assert numbers == list(range(1, count + 1))


def test_only_the_newest_message_of_a_stream_waits_for_a_slow_client() -> None:
    with serving() as served, IgtlClient(served.port, reads_ahead=False) as client:
        for value in range(40):
            served.publish("PA_ProbeHome", picture(value))
            served.publish("SearchState", number(value))
        served.publish("End", number(0))
        received = client.until(lambda message: message.device == "End")
    images = [int(each.metadata["sequence"]) for each in received if each.device == "PA_ProbeHome"]
    states = [int(each.metadata["sequence"]) for each in received if each.device == "SearchState"]
    # The sequence numbers tell the client what it lost; the last it always has.
    assert images[-1] == states[-1] == 40
    assert len(images) < 20
    assert images == sorted(images)


def test_a_client_that_the_operating_system_gave_up_was_too_slow() -> None:
    reasons: list[str] = []
    peer = Peer(
        on_open=lambda _peer: None,
        on_message=lambda _peer, _message: None,
        on_close=lambda _peer, reason: reasons.append(reason),
    )
    # What asyncio hands on where TCP_USER_TIMEOUT has ended the connection.
    peer.connection_lost(TimeoutError(110, "Connection timed out"))
    assert reasons == ["it is too slow: a message was not taken within 2 s"]


def test_a_seventeenth_client_is_refused_and_its_stop_is_taken() -> None:
    with serving() as served, ExitStack() as ends:
        clients = [ends.enter_context(IgtlClient(served.port)) for _ in range(16)]
        for client in clients:
            client.ask('<Command Name="A" />')
        served.publish("SearchState", number(1))
        with IgtlClient(served.port) as one_more:
            status = one_more.read().content
            assert (status.name, status.message[:37]) == ("REFUSED", "16 clients are served, and no more; e")
            assert 'Status="FAIL" Message="16 clients are served' in one_more.ask('<Command Name="StartSearch" />')
            assert "heard StopSearch" in one_more.ask('<Command Name="StopSearch" />')
            served.publish("SearchState", number(2))
            served.forward(2.01)
            # It is shown nothing of what the others are.
            assert list(one_more.messages()) == []
        assert [request.name for request in served.requests] == ["A"] * 16 + ["StopSearch"]
        assert clients[0].until(lambda message: message.device == "SearchState")[-1].content.text == "1"
        clients.pop().close()
        assert served.noted("gone: it closed the connection")
        with IgtlClient(served.port) as next_one:
            assert next_one.read().content.text == "2"


def test_only_computers_that_are_allowed_are_served(own_address: str) -> None:
    with (
        serving(host="0.0.0.0", allowed=("198.51.100.7",)) as served,
        socket.create_connection((own_address, served.port), timeout=LONGEST_S) as other,
        IgtlClient(served.port) as local,
    ):
        assert other.recv(1) == b""
        assert served.noted("refused, it is none of the computers that may connect")
        assert "heard" in local.ask('<Command Name="A" />')


@pytest.mark.parametrize("host", ["0", "0.0.0.0", "0x0", "00.0", "::", "::0"])
def test_an_address_that_others_reach_needs_those_that_may_however_it_is_spelt(host: str) -> None:
    server = IgtlServer(on_request=lambda _request: CommandAnswer(done=True, sentence=""))
    with pytest.raises(ConfigError, match=r"is (0\.0\.0\.0|::), which other computers reach, .* `allowed=ADDRESS`"):
        asyncio.run(server.open(host, 0))
