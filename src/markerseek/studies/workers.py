"""Jobs on processes of this machine: chunks of a study, parts of a reproduction.

Results come in the order of the jobs. A few jobs for each worker are under way at a time: memory does not grow with
their number.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import TypeVar

from markerseek.core import ConfigError, MarkerseekError

_AHEAD = 8
"""Jobs under way for each worker: the next jobs go on while a long job is waited for."""

Job = TypeVar("Job")
DoneT = TypeVar("DoneT")


def default_workers() -> int:
    """Return the cores that this process may use."""
    # `os.cpu_count` also counts cores that a container or a batch system withholds.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_order(function: Callable[[Job], DoneT], jobs: Iterable[Job], *, workers: int | None = None) -> Generator[DoneT]:
    """Yield the result of each job, in their order; closing the iterator ends the processes.

    ``function``: a function of a module, or `functools.partial` of one, which other processes can import.
    ``workers``: number of processes; 1 computes in this one, None is `default_workers`.
    """
    count = default_workers() if workers is None else workers
    if count < 1:
        raise ConfigError(f"workers is {count}, at least 1 is needed")
    if count == 1:
        yield from map(function, jobs)
        return
    with _processes(count) as pool:
        under_way: deque[Future[DoneT]] = deque()
        for job in jobs:
            under_way.append(_submit(pool, function, job))
            if len(under_way) >= _AHEAD * count:
                yield under_way.popleft().result()
        while under_way:
            yield under_way.popleft().result()


@contextmanager
def _processes(workers: int) -> Iterator[ProcessPoolExecutor]:
    # The command that starts a worker would import from the current folder, before it takes over our own path.
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    # Spawned, because a fork would copy the locks that threads of this process hold.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(max_workers=workers, mp_context=context, initializer=_begin)
    others = set(multiprocessing.active_children())
    over = False
    try:
        yield pool
        over = True
    except BrokenProcessPool as problem:
        raise MarkerseekError(
            "a worker process was ended from outside, perhaps for lack of memory; run the same command again with "
            "fewer `workers` (a study continues where it was)"
        ) from problem
    finally:
        if not over:
            # What is under way is lost, and begins again later.
            for process in set(multiprocessing.active_children()) - others:
                process.kill()
        pool.shutdown(wait=True, cancel_futures=True)
        # Programs that this process starts later may need the current folder.
        if before is None:
            os.environ.pop("PYTHONSAFEPATH", None)
        else:
            os.environ["PYTHONSAFEPATH"] = before


def _submit(pool: ProcessPoolExecutor, function: Callable[[Job], DoneT], job: Job) -> Future[DoneT]:
    """Submit a job, which may start a process; Ctrl-C takes effect afterwards.

    A Ctrl-C goes to all processes of a terminal. A worker that does not block it prints a traceback while it imports,
    and so does one whose parent is interrupted while it sends what to import.
    """
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        return pool.submit(function, job)
    came: list[int] = []
    # Blocked for the worker. Another thread of this process may take the signal nevertheless.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    handler = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        return pool.submit(function, job)
    finally:
        signal.signal(signal.SIGINT, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        if came:
            signal.raise_signal(signal.SIGINT)


def _begin() -> None:
    """In a new worker: leave Ctrl-C to the parent, and end when the parent does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
