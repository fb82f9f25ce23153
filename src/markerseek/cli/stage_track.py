"""Whether a stage stands where it was left: one that was switched off and homed, or turned by others, does not.

Where each stage was left is a file in the user's data folder. A registration keeps since when its stage has always
stood where it was left, so that another time shows that the stage has lost its angle meanwhile, or was turned unseen.
While a stage is open the file says so: a program that is killed leaves it so, and nobody knows where it left the stage.
A stage that was left at home stands there after homing, too: that is not seen.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from markerseek.core import MarkerseekError
from markerseek.files import data_folder, replace_file

if TYPE_CHECKING:
    from markerseek.drivers import BenchSettings
    from markerseek.rigs import Rig

SAME_DEG = 0.05
"""Largest distance between where a stage was left and where it stands: it holds its place by small corrections."""


class StagePlace(msgspec.Struct, frozen=True, kw_only=True):
    """Where a stage was left."""

    since: str
    """Since when it has always stood where it was left, UTC."""
    left_deg: float | None
    """None: a program has it open, or did not leave it in order."""


@contextmanager
def tracked(rig: Rig, settings: BenchSettings) -> Iterator[Rig]:
    """Open a rig that knows since when its stage has always stood where it was left, and note where it is left.

    A file that cannot be read or written makes no error: the time is then now, and nothing is known the next time.
    """
    from markerseek.guard import State

    if rig.by_hand is not None:
        # To read its angle is to ask the person who turns it.
        yield rig
        return
    path = _path(settings)
    before = None if path is None else _read(path)
    at_deg = rig.scanner.angle_deg
    known = before is not None and before.left_deg is not None and abs(at_deg - before.left_deg) <= SAME_DEG
    since = before.since if before is not None and known else datetime.now(UTC).isoformat(timespec="microseconds")
    _write(path, StagePlace(since=since, left_deg=None))
    failed = False
    try:
        yield replace(rig, stage_since=since)
    except (MarkerseekError, OSError):
        failed = True
        raise
    finally:
        # A device that has failed is not asked again: it may be silent for long.
        if not failed and rig.scanner.guard.state is not State.FAULT:
            with suppress(MarkerseekError, OSError):
                _write(path, StagePlace(since=since, left_deg=rig.scanner.angle_deg))


def _path(settings: BenchSettings) -> Path | None:
    """Return the file of a stage, by its settings: port, serial number; None if there is no data folder."""
    name = hashlib.sha256(msgspec.json.encode(settings.table()["stage"])).hexdigest()[:16]
    try:
        return data_folder() / "stages" / f"{name}.json"
    except MarkerseekError:
        return None


def _read(path: Path) -> StagePlace | None:
    try:
        return msgspec.json.decode(path.read_bytes(), type=StagePlace)
    except (OSError, msgspec.MsgspecError):
        return None


def _write(path: Path | None, place: StagePlace) -> None:
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(path) as part:
            part.write_bytes(msgspec.json.encode(place))
    except (OSError, MarkerseekError):
        # An old place would be taken for that of now.
        with suppress(OSError):
            path.unlink(missing_ok=True)
