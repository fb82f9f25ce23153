"""Chunks on a Dask cluster. Dask is an extra, and imported here only."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Iterator
from concurrent.futures import CancelledError
from functools import partial

from markerseek.core import ConfigError, MarkerseekError, MissingExtraError
from markerseek.studies.study import Study
from markerseek.studies.table import run_chunk
from markerseek.studies.workers import as_ready

_AHEAD = 3
"""Chunks under way for each thread of the cluster."""

_TIMEOUT_S = 20


def on_cluster(study: Study, pieces: Iterable[range], *, address: str) -> Iterator[tuple[int, bytes]]:
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
        # Not the default client: the caller may have one of its own.
        client = distributed.Client(address, timeout=_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as problem:
        raise ConfigError(f"scheduler: nothing answers at {address}: {problem}; is `dask scheduler` running?") from None
    with client:
        # The study is sent to each worker once, not with every chunk.
        everywhere = client.scatter(study, broadcast=True, hash=False)
        # Not pure: Dask would hash all arguments to find equal calls, and there are none.
        submit = partial(client.get_executor(pure=False).submit, run_chunk, everywhere)
        threads = sum(client.nthreads().values()) or 1
        try:
            yield from as_ready(submit, pieces, ahead=_AHEAD * threads)
        except (distributed.KilledWorker, distributed.comm.CommClosedError, CancelledError) as problem:
            raise MarkerseekError(f"the cluster failed: {problem}; run the same command again to continue") from problem
