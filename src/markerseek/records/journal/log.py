"""SQLite's write-ahead log, looked at before SQLite does.

SQLite takes the log up to the first frame whose checksum is wrong, and says nothing of the rest: right for a write that
was torn, silent loss where a bit flipped in an earlier commit. The two can be told apart. A torn write leaves at most
one unfinished transaction at the end; behind a flipped bit there are more commits of the same log. The format is at
https://www.sqlite.org/fileformat2.html#the_write_ahead_log.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import UInt32

from markerseek.core import RecordError
from markerseek.records.journal.store import PAGE_BYTES

_HEADER = struct.Struct(">8I")
_FRAME = struct.Struct(">6I")
_MAGIC = 0x377F0682
"""Of a log whose checksums read little-endian words; one more: big-endian."""

_WORD = 1 << 32


def require_whole_log(log: Path) -> None:
    """Refuse a log in which commits stand behind a damaged one.

    Parameters
    ----------
    log
        The file beside the journal.

    Raises
    ------
    RecordError
        If more than one commit can no longer be read.
    """
    good, lost = commits(log.read_bytes())
    if lost > 1:
        raise RecordError(
            f"{log}: the journal's log is damaged after {good} commits, and at least {lost} cannot be read any more; "
            "keep both files as they are, and delete a copy of the log to read what the journal itself holds"
        )


def commits(log: bytes) -> tuple[int, int]:
    """Number of transactions that SQLite will take from a log, and of those that it will pass over.

    Parameters
    ----------
    log
        Contents of the file.
    """
    if len(log) < _HEADER.size + _FRAME.size:
        return 0, 0
    magic, _, page, _, *salts, one, two = _HEADER.unpack_from(log)
    order = "<u4" if magic == _MAGIC else ">u4"
    sums = _sums(log[:24], (0, 0), order)
    if magic & ~1 != _MAGIC or sums != (one, two) or not 512 <= page <= 65536:
        _, _, *salts, _, _ = _FRAME.unpack_from(log, _HEADER.size)
        return 0, _marked(log, _HEADER.size, page=PAGE_BYTES, salts=salts)
    good = 0
    for start in range(_HEADER.size, len(log) - _FRAME.size - page + 1, _FRAME.size + page):
        _, size, *own_salts, one, two = _FRAME.unpack_from(log, start)
        sums = _sums(log[start : start + 8], sums, order)
        sums = _sums(log[start + _FRAME.size : start + _FRAME.size + page], sums, order)
        if own_salts != salts or sums != (one, two):
            return good, _marked(log, start, page=page, salts=salts)
        good += size > 0
    return good, 0


def _marked(log: bytes, start: int, *, page: int, salts: list[int]) -> int:
    """Number of frames of this log from a place on that end a transaction: they carry the size of the database."""
    marked = 0
    for place in range(start, len(log) - _FRAME.size + 1, _FRAME.size + page):
        _, size, *own_salts, _, _ = _FRAME.unpack_from(log, place)
        marked += size > 0 and own_salts == salts
    return marked


def _sums(data: bytes, sums: tuple[int, int], order: str) -> tuple[int, int]:
    """Both running sums after further data: s0 += x0 + s1, s1 += x1 + s0 for each pair of words, modulo 2^32."""
    even, odd = np.frombuffer(data, dtype=order).astype(np.uint32).reshape(-1, 2).T
    fibonacci = _fibonacci(2 * len(even) + 2)
    # the pair that is n pairs before the end counts F(2n), F(2n + 1), F(2n + 2) times
    none, once, twice = (fibonacci[shift : 2 * len(even) + shift : 2][::-1] for shift in (0, 1, 2))
    first, second = (int(fibonacci[2 * len(even) + shift]) for shift in (0, 1))
    one = int((once * even + none * odd).sum(dtype=np.uint32)) + (second - first) * sums[0] + first * sums[1]
    two = int((twice * even + once * odd).sum(dtype=np.uint32)) + first * sums[0] + second * sums[1]
    return one % _WORD, two % _WORD


@lru_cache(maxsize=8)
def _fibonacci(count: int) -> UInt32[np.ndarray, " count"]:
    """Fibonacci numbers from F(0) = 0 on, modulo 2^32."""
    numbers = [0, 1]
    while len(numbers) < count:
        numbers.append((numbers[-1] + numbers[-2]) % _WORD)
    return np.array(numbers, dtype=np.uint32)
