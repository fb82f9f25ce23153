"""Banks that are there as a whole or not at all: for imports, which can be made again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from markerseek.core import RecordError
from markerseek.files import published
from markerseek.records.banks import BankFacts
from markerseek.records.ipasc.writer import BankWriter, require_new_bank


@contextmanager
def whole_bank(path: Path, *, angles: int, dark_frames: int = 0, facts: BankFacts) -> Iterator[BankWriter]:
    """A writer of a bank that gets its name when the block ends with all that was announced, and is gone if not.

    Parameters
    ----------
    path, angles, dark_frames, facts
        As of `BankWriter`.

    Raises
    ------
    RecordError
        If there is a file already, it cannot be written, or less came than was announced.
    ConfigError, MissingExtraError
        As of `BankWriter`.
    """
    require_new_bank(path)
    inside = False
    try:
        with published(path) as part:
            writer = BankWriter(part, angles=angles, dark_frames=dark_frames, facts=facts, whole_as=path)
            try:
                inside = True
                yield writer
                inside = False
            except BaseException:
                with suppress(RecordError):
                    writer.let_go()
                raise
            writer.let_go()
            writer.require_whole()
    except OSError as problem:
        if inside:
            raise
        raise RecordError(
            f"{path}: the bank cannot be written: {problem}; nothing was kept: make room, or name another place"
        ) from problem
