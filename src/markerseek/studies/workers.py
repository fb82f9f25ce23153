"""Work on processes of this machine: chunks of a study, parts of a reproduction.

At most a few jobs for each process are under way, so that memory does not grow with their number.
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
from typing import TypeVar

from markerseek.core import ConfigError, MarkerseekError

_AHEAD = 2
"""Jobs under way for each worker: one at work, one waiting."""

Job = TypeVar("Job")
Done = TypeVar("Done")


def default_workers() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def on_processes(function: Callable[[Job], Done], jobs: Iterable[Job], *, workers: int) -> Iterator[tuple[int, Done]]:
    """Numbers of the jobs, from 0, and their results, each as it is ready; closing the iterator ends the processes.

    Parameters
    ----------
    function
        What is done with a job; one of a module, or `functools.partial` of one, so that other processes find it.
    jobs
        Its arguments, one after another.
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
        yield from enumerate(map(function, jobs))
        return
    # The command that starts a worker would import from the current folder, before it takes over our own path.
    os.environ["PYTHONSAFEPATH"] = "1"
    # Processes are started anew: a fork would copy the locks of threads that this one has.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(max_workers=workers, mp_context=context, initializer=_begin)
    try:
        yield from _as_ready(lambda job: pool.submit(function, job), jobs, ahead=_AHEAD * workers)
    except BrokenProcessPool as problem:
        raise MarkerseekError(
            "a worker process was ended from outside, perhaps for want of memory; run the same command again with "
            "fewer --workers (a study continues where it was)"
        ) from problem
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _as_ready(submit: Callable[[Job], Future[Done]], jobs: Iterable[Job], *, ahead: int) -> Iterator[tuple[int, Done]]:
    """Results of submitted jobs as they are ready, with so many under way at most."""
    waiting = enumerate(jobs)
    under_way = {submit(job): number for number, job in islice(waiting, ahead)}
    while under_way:
        ready, _ = wait(under_way, return_when=FIRST_COMPLETED)
        for future in ready:
            done = under_way.pop(future)
            under_way.update((submit(job), number) for number, job in islice(waiting, 1))
            yield done, future.result()


def _begin() -> None:
    """In a new worker: leave the keyboard's interrupt to the parent, and end when the parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
    os._exit(1)
