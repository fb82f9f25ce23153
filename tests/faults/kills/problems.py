"""Failures of the campaign, noted with the files that show them."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from markerseek.core import MarkerseekError

from .processes import MismatchError
from .tally import Tally

KEPT = tempfile.gettempdir()
"""Where such files go: not where the campaign works, which is removed at its end."""


def work_in(folder: str) -> None:
    """Have this process make its other files there."""
    tempfile.tempdir = folder


@contextmanager
def watched(tally: Tally, path: Path, what: str) -> Iterator[None]:
    """Note what goes wrong in the block, and keep the file at a path with all beside it."""
    try:
        yield
    except (MismatchError, MarkerseekError, AssertionError) as problem:
        kept = Path(tempfile.mkdtemp(prefix="kills-wrong-", dir=KEPT))
        for part in path.parent.glob(f"{path.name}*"):
            shutil.copy(part, kept)
        tally.wrong.append(f"{what}: {type(problem).__name__}: {problem} (files: {kept})")
