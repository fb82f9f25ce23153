"""Reads a file that another program still writes: waits for it, and yields what it holds as soon as it is there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

_Item = TypeVar("_Item")


def await_file(path: Path, *, is_over: Callable[[], bool], wait: Callable[[], object]) -> bool:
    """Wait until a file exists, and return True; False if it is over without one.

    ``is_over``: whether no more will be written. ``wait``: called where there is no file yet.
    """
    while not path.exists():
        if is_over() and not path.exists():
            return False
        wait()
    return True


def yield_new(
    read: Callable[[], _Item | None], *, is_over: Callable[[], bool], wait: Callable[[], object]
) -> Iterator[_Item]:
    """Yield what a file holds, each item as soon as it is written, to the last one.

    ``read``: returns the next item, or None if it is not there yet. ``is_over``: whether no more will be written.
    ``wait``: called where nothing new is there.
    """
    while True:
        # Asked before the file is read: what was written before the end is read after it.
        over = is_over()
        while (item := read()) is not None:
            yield item
        if over:
            return
        wait()
