"""Chunks on a Dask cluster. Dask is an extra, and imported here only."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

from markerseek.core import ConfigError, MarkerseekError, MissingExtraError
from markerseek.studies.chunks import Chunk, run_chunk
from markerseek.studies.study import Study

_AHEAD = 3
"""Chunks under way for each thread of the cluster."""

_TIMEOUT_S = 20


def on_cluster(study: Study, pieces: Iterable[Chunk], *, address: str) -> Iterator[tuple[int, bytes]]:
    """Index and lines of each chunk, as it is ready; closing the iterator cancels the rest.

    Parameters
    ----------
    study, pieces
        The study and its chunks; the workers need the same version of this package.
    address
        Of the scheduler, as in ``tcp://10.0.0.5:8786``.

    Raises
    ------
    MissingExtraError
        If Dask is not installed.
    ConfigError
        If no scheduler answers there.
    """
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as problem:
        raise MissingExtraError(package="distributed", extra="cluster", purpose="a study on a cluster") from problem
    try:
        client = distributed.Client(address, timeout=_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as problem:
        raise ConfigError(f"scheduler: nothing answers at {address}: {problem}; is `dask scheduler` running?") from None
    with client:
        try:
            yield from _as_ready(distributed, client, study, enumerate(pieces))
        except (distributed.KilledWorker, distributed.comm.CommClosedError) as problem:
            raise MarkerseekError(f"the cluster failed: {problem}; run the same command again to continue") from problem


def _as_ready(
    distributed: Any, client: Any, study: Study, waiting: Iterator[tuple[int, Chunk]]
) -> Iterator[tuple[int, bytes]]:
    """Results as they are ready, with a few chunks under way for each thread: memory does not grow with the study."""
    # The study is sent to each worker once, not with every chunk.
    everywhere = client.scatter(study, broadcast=True, hash=False)

    def submit(number: int, piece: Chunk) -> Any:
        future = client.submit(run_chunk, everywhere, piece, pure=False)
        under_way[future.key] = number
        return future

    under_way: dict[str, int] = {}
    threads = sum(client.nthreads().values()) or 1
    ready = distributed.as_completed(
        [submit(*following) for following in islice(waiting, _AHEAD * threads)], loop=client.loop
    )
    for future in ready:
        number = under_way.pop(future.key)
        for following in islice(waiting, 1):
            ready.add(submit(*following))
        yield number, future.result()
