"""Chunks on processes of this machine.

At most a few chunks for each process are under way, so that memory does not grow with the study.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice

from markerseek.core import ConfigError, MarkerseekError
from markerseek.studies.chunks import Chunk, run_chunk
from markerseek.studies.study import Study

_AHEAD = 2
"""Chunks under way for each worker: one at work, one waiting."""


def default_workers() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_processes(study: Study, pieces: Iterable[Chunk], *, workers: int) -> Iterator[tuple[Chunk, bytes]]:
    """Chunks and their lines, each as it is ready; closing the iterator ends the processes.

    Parameters
    ----------
    study, pieces
        What to compute.
    workers
        Number of processes; 1 computes in this one.

    Raises
    ------
    ConfigError
        If ``workers`` is less than 1.
    """
    if workers < 1:
        raise ConfigError(f"workers is {workers}, at least 1 is needed")
    if workers == 1:
        for piece in pieces:
            yield piece, run_chunk(study, piece)
        return
    # Processes are started anew: a fork would copy the locks of threads that this one has.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(max_workers=workers, mp_context=context, initializer=_begin)
    try:
        yield from as_ready(lambda piece: pool.submit(run_chunk, study, piece), pieces, ahead=_AHEAD * workers)
    except BrokenProcessPool as problem:
        raise MarkerseekError(
            "a worker process was ended from outside, perhaps for want of memory; run the same command again to "
            "continue, with fewer --workers"
        ) from problem
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def as_ready(
    submit: Callable[[Chunk], Future[bytes]], pieces: Iterable[Chunk], *, ahead: int
) -> Iterator[tuple[Chunk, bytes]]:
    """Results of submitted chunks as they are ready, with so many under way at most."""
    waiting = iter(pieces)
    under_way = {submit(piece): piece for piece in islice(waiting, ahead)}
    while under_way:
        ready, _ = wait(under_way, return_when=FIRST_COMPLETED)
        for future in ready:
            piece = under_way.pop(future)
            under_way.update((submit(following), following) for following in islice(waiting, 1))
            yield piece, future.result()


def _begin() -> None:
    """In a new worker: leave the keyboard's interrupt to the parent, and end when the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
