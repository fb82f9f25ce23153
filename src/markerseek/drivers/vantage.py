"""Driver of a live Verasonics Vantage: `matlab/markerseek_send.m` sends one int16 frame per laser trigger over TCP."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Annotated

import numpy as np

from markerseek.core import AcquisitionError, Clock, ConfigError, Int16, NotConnectedError, Within
from markerseek.drivers.clock import polls
from markerseek.drivers.entry import Entry, Opening
from markerseek.drivers.standard_receiver import (
    SLICE_S,
    ConnectionKeys,
    ConnectionMessages,
    ConnectionReceiver,
    mean_counts,
)
from markerseek.wire import vantage as wire

_LOG = logging.getLogger(__name__)

_GREETING_S = 5.0
"""Longest time from a connection to its greeting, in seconds."""


class VantageSettings(ConnectionKeys, frozen=True, kw_only=True, tag="vantage"):
    """A Verasonics Vantage whose sequence calls ``markerseek_send`` once for each trigger of the laser."""

    probe: str
    """Name of the probe, as given to the sender: a frame of another is refused."""
    port: Annotated[int, Within(1, 65535)] = 18955
    peer: str = "127.0.0.1"
    """Address of the Vantage's computer; others are turned away."""
    connect_s: Annotated[float, Within(0, 600, "s", open_low=True)] = 60.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.probe.isascii() and self.probe.isprintable() and 0 < len(self.probe) <= wire.MAX_PROBE_BYTES):
            raise ConfigError(
                f"receiver: probe is {self.probe!r}, it must have 1 to {wire.MAX_PROBE_BYTES} characters of ASCII"
            )


def await_sender(settings: VantageSettings, clock: Clock) -> socket.socket:
    """Return the connection that the sender opens; `NotConnectedError` if it does not come."""
    where = f"{settings.host}, port {settings.port}"
    try:
        server = socket.create_server((settings.host, settings.port), backlog=1)
    except OSError as problem:
        raise NotConnectedError(
            f"vantage: {where} cannot be listened on: {problem.strerror or problem}; correct host and port, or end the "
            "program that has the port"
        ) from problem
    with server:
        server.setblocking(False)
        refused = ""
        for _ in polls(clock, within_s=settings.connect_s, every_s=SLICE_S):
            try:
                connection, (address, *_) = server.accept()
            except BlockingIOError:
                continue
            if address == settings.peer:
                return connection
            connection.close()
            refused = f" ({address} was turned away: receiver.peer is {settings.peer})"
    raise NotConnectedError(
        f"vantage: no sender came to {where} within {settings.connect_s:g} s{refused}; call markerseek_send ('open', "
        "...) in MATLAB while the search waits"
    )


class VantageMessages(ConnectionMessages[wire.VantageFrame]):
    """The frames of a sender; ``unix_s``: time of day in seconds since 1970, which the frames carry."""

    driver = "vantage"
    peer = "sender"
    used = "frames"
    called = "frames"
    cure = "the sequence must wait for the laser's trigger (triggerIn) before each acquisition"
    check = "the trigger, and that the sequence calls markerseek_send for each"

    def __init__(
        self, connection: socket.socket, clock: Clock, settings: VantageSettings, unix_s: Callable[[], float]
    ) -> None:
        super().__init__(connection, clock)
        self._settings = settings
        self._unix_s = unix_s
        self._armed_unix_s = 0.0
        self._framer = wire.VantageFramer()
        self._counter = 0
        self._armed_counter = 0
        self._shape: tuple[int, ...] | None = None
        self.emulated = self._greeting().emulated

    def arm(self) -> None:
        """Note the time of day, and the counter of the last frame."""
        self._armed_unix_s = self._unix_s()
        self._armed_counter = self._counter

    def samples(self, messages: list[wire.VantageFrame]) -> Int16[np.ndarray, "channels samples"]:
        """Return the mean of the frames, whose counters are one after the other since the last frame that came."""
        self._require_in_order(messages, self._armed_counter)
        self._require_in_time(messages, self._armed_unix_s)
        return self._mean(messages)

    def _greeting(self) -> wire.VantageFrame:
        for _ in polls(self._clock, within_s=_GREETING_S, every_s=SLICE_S):
            if came := self.take()[0]:
                break
        else:
            raise NotConnectedError(
                f"vantage: what has connected says nothing for {_GREETING_S:g} s; is it markerseek_send.m?"
            )
        if came[0].counter != 0:
            raise NotConnectedError(f"vantage: the first frame has the counter {came[0].counter}, no greeting came")
        if came[0].probe != self._settings.probe:
            raise NotConnectedError(
                f"vantage: the sender has the probe {came[0].probe!r}, receiver.probe is {self._settings.probe!r}; "
                "connect that probe, or correct the key"
            )
        return came[0]

    def _require_in_order(self, frames: list[wire.VantageFrame], last: int) -> None:
        for frame in frames:
            if frame.counter <= last:
                raise AcquisitionError(
                    f"vantage: a frame with the counter {frame.counter} came after {last}: it is doubled, or the "
                    "sender has started again; take the frame again"
                )
            if frame.counter > last + 1:
                raise AcquisitionError(
                    f"vantage: {frame.counter - last - 1} frames are lost: {frame.counter} came after {last}; take the "
                    "frame again"
                )
            last = frame.counter

    def _require_in_time(self, frames: list[wire.VantageFrame], armed_unix_s: float) -> None:
        now_s = self._unix_s()
        for frame in frames:
            early_s = armed_unix_s - frame.time_s
            late_s = frame.time_s - now_s
            if not max(early_s, late_s) <= self._settings.clock_s:
                said = (
                    f"sent {early_s:.3f} s before the receiver was armed"
                    if early_s > late_s
                    else f"sent {late_s:.3f} s after it came"
                )
                raise AcquisitionError(
                    f"vantage: frame {frame.counter} was {said}, clock_s allows {self._settings.clock_s:g} s; it is of "
                    "another trigger, or the clocks of the two computers differ"
                )

    def _mean(self, frames: list[wire.VantageFrame]) -> Int16[np.ndarray, "channels samples"]:
        """Return the mean of the samples, rounded to counts."""
        for frame in frames:
            if frame.emulated != self.emulated:
                raise AcquisitionError(
                    f"vantage: frame {frame.counter} and the greeting differ in whether an emulator sends"
                )
            if frame.probe != self._settings.probe:
                raise AcquisitionError(
                    f"vantage: frame {frame.counter} is of the probe {frame.probe!r}, receiver.probe is "
                    f"{self._settings.probe!r}"
                )
            if frame.samples.shape != (self._shape or frames[0].samples.shape):
                raise AcquisitionError(
                    f"vantage: frame {frame.counter} has {frame.samples.shape} channels and samples, those before had "
                    f"{self._shape or frames[0].samples.shape}; do not change the sequence during a search"
                )
        self._shape = frames[0].samples.shape
        return mean_counts([frame.samples for frame in frames])

    def decoded(self, data: bytes) -> Iterator[wire.VantageFrame]:
        """Yield the frames, each with its counter noted."""
        for frame in self._framer.feed(data):
            _LOG.debug("vantage < frame %d of %s, its time %.6f s", frame.counter, frame.samples.shape, frame.time_s)
            # Also of frames that are not used: the next acquisition begins after them.
            self._counter = frame.counter
            yield frame


class VantageReceiver(ConnectionReceiver[VantageMessages]):
    """Frames of a Vantage, one for each trigger, averaged.

    Raises `NotConnectedError` if the sender does not greet at once, or names another probe.
    """

    kind = VantageMessages


def _open(settings: VantageSettings, opening: Opening) -> VantageReceiver:
    connection = await_sender(settings, opening.clock)
    opening.stack.enter_context(closing(connection))
    return VantageReceiver(connection=connection, clock=opening.clock, settings=settings, dark_triggers=opening.pulses)


ENTRY: Entry[VantageSettings, VantageReceiver] = Entry(
    settings=VantageSettings,
    open=_open,
    describe=lambda settings, _receiver: f"Vantage with {settings.probe}, sender at {settings.peer}",
    same=("probe",),
)
