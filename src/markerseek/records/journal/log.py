"""SQLite's write-ahead log, looked at before SQLite does.

SQLite takes the log up to the first frame whose checksum is wrong, and says nothing of the rest: right for a write that
was torn, silent loss where a bit flipped in an earlier commit. The two can be told apart. A torn write leaves at most
one unfinished transaction at the end; behind a flipped bit there are more commits of the same log. The format is at
https://www.sqlite.org/fileformat2.html#the_write_ahead_log.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO, TypeAlias

import numpy as np

from markerseek.core import RecordError
from markerseek.core.shapes import UInt32
from markerseek.records.journal.store import PAGE_BYTES

_HEADER = struct.Struct(">8I")
_FRAME = struct.Struct(">6I")
_MAGIC = 0x377F0682
"""Of a log whose checksums read little-endian words; one more: big-endian."""

_WORD = 1 << 32

_AT_ONCE = 64
"""Frames that are read together, a megabyte."""

_Sums: TypeAlias = tuple[int, int]


def look_over(log: Path) -> tuple[int, RecordError | None]:
    """Number of commits that SQLite will take from a log, and what is wrong where commits stand behind a damaged one.

    Parameters
    ----------
    log
        The file beside the journal.
    """
    with log.open("rb") as file:
        good, lost = commits(file)
    if lost < 2:
        return good, None
    return good, RecordError(
        f"{log}: the journal's log is damaged after {good} commits, and at least {lost} cannot be read any more; keep "
        "both files as they are: 'markerseek journal show' prints what stands before; other programs remove the rest"
    )


def commits(log: BinaryIO) -> tuple[int, int]:
    """Number of transactions that SQLite will take from a log, and of those that it will pass over.

    Parameters
    ----------
    log
        The log, open at its beginning.
    """
    head = log.read(_HEADER.size)
    if len(head) < _HEADER.size:
        return 0, 0
    magic, _, page, _, first, second, one, two = _HEADER.unpack(head)
    order = "<u4" if magic == _MAGIC else ">u4"
    sums = (0, 0)
    for start in range(0, 24, 8):
        sums = _pair_step(head[start : start + 8], order, sums)
    whole = magic & ~1 == _MAGIC and sums == (one, two) and 512 <= page <= 65536 and page & (page - 1) == 0
    salts: tuple[int, int] | None = (first, second) if whole else None
    good = lost = 0
    for frame in _frames(log, page=page if whole else PAGE_BYTES, order=order):
        # Of a log whose header is damaged, the first frame tells which frames are of the same log.
        salts = salts or frame.salts
        if whole:
            if not frame.whole:
                break
            following = frame.step(sums)
            whole = frame.page > 0 and frame.salts == salts and following == frame.sums
            if whole:
                sums = following
                good += frame.ends
                continue
            # Here and in no later one the salts, or the mark of the end, can be what was damaged.
            lost += frame.ends or frame.would_end(sums)
        else:
            lost += frame.ends and frame.salts == salts
    return good, lost


@dataclass(frozen=True, slots=True, kw_only=True)
class _Frame:
    """A page in the log; the last one of a transaction carries the size of the database."""

    head: bytes
    order: str
    pairs: int
    page_sums: _Sums
    whole: bool

    @property
    def page(self) -> int:
        return int.from_bytes(self.head[:4], "big")

    @property
    def size(self) -> int:
        return int.from_bytes(self.head[4:8], "big")

    @property
    def ends(self) -> bool:
        return self.size > 0

    @property
    def salts(self) -> tuple[int, int]:
        return int.from_bytes(self.head[8:12], "big"), int.from_bytes(self.head[12:16], "big")

    @property
    def sums(self) -> _Sums:
        return int.from_bytes(self.head[16:20], "big"), int.from_bytes(self.head[20:24], "big")

    def step(self, sums: _Sums, *, size: int | None = None) -> _Sums:
        """Running sums after this frame, or one with another size."""
        start = self.head[:8] if size is None else self.head[:4] + size.to_bytes(4, "big")
        return _added(_carried(_pair_step(start, self.order, sums), self.pairs), self.page_sums)

    def would_end(self, sums: _Sums) -> bool:
        """Whether one flipped bit took the mark of the end away."""
        return any(self.step(sums, size=1 << bit) == self.sums for bit in range(32))


def _frames(log: BinaryIO, *, page: int, order: str) -> Iterator[_Frame]:
    """The frames of a log, the last one perhaps cut off behind its header."""
    length = _FRAME.size + page
    while chunk := log.read(_AT_ONCE * length):
        count = len(chunk) // length
        words = _words(chunk[: count * length], order).reshape(count, length // 4)
        ones, twos = _sums_of_pages(words[:, _FRAME.size // 4 :])
        for index in range(count):
            head = chunk[index * length : index * length + _FRAME.size]
            page_sums = int(ones[index]), int(twos[index])
            yield _Frame(head=head, order=order, pairs=page // 8, page_sums=page_sums, whole=True)
        rest = chunk[count * length :]
        if len(rest) >= _FRAME.size:
            yield _Frame(head=rest[: _FRAME.size], order=order, pairs=0, page_sums=(0, 0), whole=False)


def _words(data: bytes, order: str) -> UInt32[np.ndarray, " words"]:
    return np.frombuffer(data, dtype=order).astype(np.uint32, copy=False)


def _pair_step(pair: bytes, order: str, sums: _Sums) -> _Sums:
    """Both running sums after two further words: s0 += x0 + s1, then s1 += x1 + s0, modulo 2^32."""
    zero, one = struct.unpack("<2I" if order == "<u4" else ">2I", pair)
    first = (sums[0] + zero + sums[1]) % _WORD
    return first, (sums[1] + one + first) % _WORD


def _carried(sums: _Sums, pairs: int) -> _Sums:
    """What running sums become over so many pairs of zeros."""
    before, first, second = _last_fibonacci(pairs)
    return before * sums[0] + first * sums[1], first * sums[0] + second * sums[1]


def _added(one: _Sums, other: _Sums) -> _Sums:
    return (one[0] + other[0]) % _WORD, (one[1] + other[1]) % _WORD


def _sums_of_pages(
    words: UInt32[np.ndarray, "pages words"],
) -> tuple[UInt32[np.ndarray, " pages"], UInt32[np.ndarray, " pages"]]:
    """Sums of each page for itself, begun at zero."""
    none, once, twice = _weights(words.shape[1] // 2)
    even, odd = words[:, ::2], words[:, 1::2]
    return (
        np.einsum("ij,j->i", even, once) + np.einsum("ij,j->i", odd, none),
        np.einsum("ij,j->i", even, twice) + np.einsum("ij,j->i", odd, once),
    )


@lru_cache(maxsize=8)
def _weights(pairs: int) -> tuple[UInt32[np.ndarray, " pairs"], ...]:
    """How often each pair of words counts: F(2n), F(2n + 1), F(2n + 2) times where n pairs follow behind it."""
    numbers = np.array(_fibonacci(2 * pairs + 2), dtype=np.uint32)
    none, once, twice = (numbers[shift : 2 * pairs + shift : 2][::-1].copy() for shift in (0, 1, 2))
    return none, once, twice


@lru_cache(maxsize=8)
def _last_fibonacci(pairs: int) -> tuple[int, int, int]:
    """F(2n - 1), F(2n), F(2n + 1) for n pairs."""
    first, second = _fibonacci(2 * pairs + 2)[2 * pairs :]
    return second - first, first, second


def _fibonacci(count: int) -> list[int]:
    """Fibonacci numbers from F(0) = 0 on, modulo 2^32."""
    numbers = [0, 1]
    while len(numbers) < count:
        numbers.append((numbers[-1] + numbers[-2]) % _WORD)
    return numbers
