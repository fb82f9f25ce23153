"""Protocol of the laser box, which triggers laser and acquisition and counts the pulses: lines as bytes.

A line is words separated by one space, a star, and the CRC-16/CCITT-FALSE of all before the star (polynomial
0x1021, start 0xFFFF, not reflected; 0x29B1 for ``123456789``) in four upper-case digits: ``BEAT 17*97F5``, then LF.

======================================================  ==========================================================
host to box                                             box to host
======================================================  ==========================================================
``HELLO``                                               ``OK HELLO id version lease_ms last_token seen``
``PERMIT token pulses rate_hz expiry_ms triggers``      ``OK PERMIT token seen``
``BEAT step``                                           nothing
``FIRE token``                                          ``DONE token sent photodiode`` when the train has ended
``DISARM``                                              ``OK DISARM``
anything that is refused                                ``ERR reason``
======================================================  ==========================================================

There is no "on". A permit is void after its expiry, after one firing, at the lease's end, at any refusal, at DISARM and
HELLO, and when the interlock opens, however briefly; without one there is no light. The lease begins with PERMIT and is
renewed by BEAT with a step above the last one. Tokens are numbers, and each permit's must be above all earlier ones, so
that nothing is fired twice.

``triggers`` is how often the acquisition is triggered; the first ``pulses`` of them trigger the laser too, so that a
permit of 0 pulses takes a dark frame, averaged like a lit one. They take 60 s at most. A train whose permit is
taken away is completed at the same rate without light, for an acquisition that counts triggers would wait for the rest;
until DONE is sent, HELLO and PERMIT are refused as ``BUSY``. DONE is sent `LIGHT_LATE_US` after the last trigger.

``seen`` is the photodiode's count since power-up: if it rises outside of firings, there was light without a permit.
Within any minute a box sends `MOST_PULSES_PER_MINUTE` pulses at most (refusal ``BUDGET``).
"""

from __future__ import annotations

import binascii
from typing import get_args

from markerseek.core import ConfigError, LaserError
from markerseek.wire.laserbox_messages import (
    EMULATOR,
    LEASE_MS,
    LIGHT_LATE_US,
    LINE_BYTES,
    MOST_COUNT,
    MOST_EXPIRY_MS,
    MOST_PULSES,
    MOST_PULSES_PER_MINUTE,
    MOST_RATE_HZ,
    VERSION,
    Beat,
    Command,
    Disarm,
    Disarmed,
    Done,
    Fire,
    Greeting,
    Hello,
    PermitPulses,
    Permitted,
    Refusal,
    RefusalReason,
    Reply,
)

__all__ = [
    "EMULATOR",
    "LEASE_MS",
    "LIGHT_LATE_US",
    "LINE_BYTES",
    "MOST_COUNT",
    "MOST_EXPIRY_MS",
    "MOST_PULSES",
    "MOST_PULSES_PER_MINUTE",
    "MOST_RATE_HZ",
    "VERSION",
    "Beat",
    "Command",
    "Disarm",
    "Disarmed",
    "Done",
    "Fire",
    "Greeting",
    "Hello",
    "Lines",
    "PermitPulses",
    "Permitted",
    "Refusal",
    "RefusalReason",
    "Reply",
    "crc16",
    "decode_command",
    "decode_reply",
    "encode",
]

_REASONS: tuple[RefusalReason, ...] = get_args(RefusalReason)


def crc16(data: bytes) -> int:
    """CRC-16/CCITT-FALSE of the bytes."""
    # CPython's crc_hqx is this polynomial without reflection; only the start value 0xFFFF must be given.
    return binascii.crc_hqx(data, 0xFFFF)


def encode(message: Command | Reply) -> bytes:
    """Line of a command or a reply, with its end.

    Raises
    ------
    ConfigError
        If the line would be refused at the other end: a number out of its range, an identity that is no word.
    """
    # Parsed again before it is sent, so that one set of rules holds for both ends.
    words = _words(message)
    understood = _command(words) if isinstance(message, Command) else _reply(words)
    if understood != message:
        raise ConfigError(f"laser box: {message} cannot be sent, a number or word is out of its range")
    text = " ".join(words).encode("ascii")
    return text + b"*%04X\n" % crc16(text)


def decode_command(line: bytes) -> Command | Refusal:
    """Command of a line without its end; the refusal that a box must answer, if it is none."""
    text = _checked(line)
    if text is None:
        return Refusal(reason="CRC")
    return _command(text.split(" ")) or Refusal(reason="FORM")


def decode_reply(line: bytes) -> Reply:
    """Reply of a line without its end.

    Raises
    ------
    LaserError
        If the line is damaged or no reply.
    """
    text = _checked(line)
    reply = None if text is None else _reply(text.split(" "))
    if reply is None:
        what = "damaged (its CRC does not fit)" if text is None else "no reply of a laser box"
        raise LaserError(f"laser box: the line {line[:LINE_BYTES]!r} is {what}; check cable, port and firmware")
    return reply


class Lines:
    """Splits a stream of bytes into lines; a line that is too long comes out empty."""

    def __init__(self) -> None:
        self._rest = b""
        self._too_long = False

    def feed(self, data: bytes) -> list[bytes]:
        """Lines completed by these bytes, without their ends."""
        *complete, rest = (self._rest + data).split(b"\n")
        lines = [b"" if len(line) >= LINE_BYTES else line for line in complete]
        if complete and self._too_long:
            lines[0] = b""
        # The rest is dropped, so that a device that never ends its line cannot fill the memory.
        self._too_long = len(rest) >= LINE_BYTES or (self._too_long and not complete)
        self._rest = b"" if self._too_long else rest
        return lines


def _words(message: Command | Reply) -> list[str]:
    match message:
        case Hello():
            return ["HELLO"]
        case PermitPulses(token=token, pulses=pulses, rate_hz=rate_hz, expiry_ms=expiry_ms, triggers=triggers):
            return ["PERMIT", *map(str, (token, pulses, rate_hz, expiry_ms, triggers))]
        case Beat(step=step):
            return ["BEAT", str(step)]
        case Fire(token=token):
            return ["FIRE", str(token)]
        case Disarm():
            return ["DISARM"]
        case _:
            return _reply_words(message)


def _reply_words(message: Reply) -> list[str]:
    match message:
        case Greeting(identity=identity, version=version, lease_ms=lease_ms, last_token=last_token, seen=seen):
            return ["OK", "HELLO", identity, *map(str, (version, lease_ms, last_token, seen))]
        case Permitted(token=token, seen=seen):
            return ["OK", "PERMIT", str(token), str(seen)]
        case Done(token=token, sent=sent, photodiode=photodiode):
            return ["DONE", *map(str, (token, sent, photodiode))]
        case Disarmed():
            return ["OK", "DISARM"]
        case Refusal(reason=reason):
            return ["ERR", reason]


def _checked(line: bytes) -> str | None:
    """Text of a line whose CRC fits, else None."""
    text, star, crc = line.rpartition(b"*")
    if not star or crc != b"%04X" % crc16(text) or not text.isascii():
        return None
    return text.decode("ascii")


def _command(words: list[str]) -> Command | None:
    verb, numbers = words[0], [_number(word) for word in words[1:]]
    match verb, numbers:
        case "HELLO", []:
            return Hello()
        case "PERMIT", [int(token), int(pulses), int(rate_hz), int(expiry_ms), int(triggers)]:
            permit = PermitPulses(token=token, pulses=pulses, rate_hz=rate_hz, expiry_ms=expiry_ms, triggers=triggers)
            return permit if _acceptable(permit) else None
        case "BEAT", [int(step)]:
            return Beat(step=step)
        case "FIRE", [int(token)]:
            return Fire(token=token)
        case "DISARM", []:
            return Disarm()
        case _:
            return None


def _acceptable(permit: PermitPulses) -> bool:
    return (
        permit.token >= 1
        and 1 <= permit.triggers <= MOST_PULSES
        and permit.pulses <= permit.triggers
        and 1 <= permit.rate_hz <= MOST_RATE_HZ
        and 1 <= permit.expiry_ms <= MOST_EXPIRY_MS
        # In whole numbers, as the firmware computes it: a division would round differently.
        and 1000 * permit.triggers <= permit.rate_hz * MOST_EXPIRY_MS
    )


def _reply(words: list[str]) -> Reply | None:
    match words:
        case ["OK", "HELLO", identity, *rest]:
            return _greeting(identity, [_number(word) for word in rest])
        case ["OK", "PERMIT", *rest]:
            return _permitted([_number(word) for word in rest])
        case ["OK", "DISARM"]:
            return Disarmed()
        case ["DONE", *rest]:
            return _done([_number(word) for word in rest])
        case ["ERR", word]:
            return next((Refusal(reason=reason) for reason in _REASONS if reason == word), None)
        case _:
            return None


def _greeting(identity: str, numbers: list[int | None]) -> Greeting | None:
    match numbers:
        case [int(version), int(lease_ms), int(last_token), int(seen)] if identity.isalnum() and len(identity) <= 16:
            return Greeting(identity=identity, version=version, lease_ms=lease_ms, last_token=last_token, seen=seen)
        case _:
            return None


def _permitted(numbers: list[int | None]) -> Permitted | None:
    match numbers:
        case [int(token), int(seen)]:
            return Permitted(token=token, seen=seen)
        case _:
            return None


def _done(numbers: list[int | None]) -> Done | None:
    match numbers:
        case [int(token), int(sent), int(photodiode)]:
            return Done(token=token, sent=sent, photodiode=photodiode)
        case _:
            return None


def _number(word: str) -> int | None:
    """Whole number of a word as `str` writes it, from 0 to `MOST_COUNT`; None if it is none."""
    # isdecimal: int() would also take "+1", " 1" and "1_0". `_checked` excludes the digits of other scripts.
    if not (word.isdecimal() and len(word) <= 10) or (word[0] == "0" and word != "0"):
        return None
    number = int(word)
    return number if number <= MOST_COUNT else None
