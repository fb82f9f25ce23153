"""Image pairs from two folders into which another program writes."""

from __future__ import annotations

import os
import re
import time
from collections import deque
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from markerseek.core import MAX_PAIRS, AcquisitionError, ConfigError, NotConnectedError, RecordError, UInt8
from markerseek.drivers._pair_source import ALONE_IMAGES, ALONE_S, Key, Pairing, PairSource
from markerseek.files import MIB, FileVersion, endings, os_reason, read_input, version_of
from markerseek.geometry import Camera
from markerseek.vision import SUFFIXES, decoded_image, says_its_end

NAMED_S = 1.0
NEAR_S = 0.05
"""Largest difference of the times of two files, in seconds: of the same number in their names, and of others."""

INCOMPLETE_S = 2.0
"""Time without a change after which an incomplete file is named, and a folder that cannot be read is an error."""

_EVERY_S = 0.04
_SHARE = 0.2
"""Time between two looks into the folders, and the largest share of a processor that looking may take: 1,000 files take
5 ms."""

_TURN_S = 0.25
"""Time after which the folders are looked into again though not all new images are read, in seconds."""

BEHIND_S = 1.0
"""Time after which an image that could not be read yet is left out, in seconds: so that the newest pairs are read, and
whole pairs are left out."""

_RATE_S = 5.0
"""Time over which images that are read, and that are left out, are counted, in seconds."""

_INCOMPLETE = "is not complete, or no image,"

_MOST_COUNTED = 10_000
"""Most images that are counted."""

_MOST_BYTES = 64 * MIB
"""Largest image file: 16 megapixels of 4 bytes."""

"""Inode, time of the last change in nanoseconds and size of a file: renamed it is the same, written again another."""


class _File(NamedTuple):
    """A file of a folder."""

    id: FileVersion
    name: str
    since_s: float
    """Monotonic time of the last look without it."""

    @property
    def time_s(self) -> float:
        """Time of its last change in seconds since 1970."""
        return self.id[1] * 1e-9

    @property
    def numbers(self) -> Key:
        """All numbers in its name."""
        return tuple(int(digits) for digits in re.findall(r"[0-9]+", Path(self.name).stem))


class FolderImages(PairSource):
    """Image pairs from two folders: PNG, JPEG, BMP, PGM, PPM or TIFF of 8 bits.

    Files that are there already are of before, unless they are written again. Names that begin with a point or end
    otherwise are ignored. A file that is not complete, or that another program keeps closed, is awaited; if it does not
    change for `INCOMPLETE_S`, a warning names it. Pairs are files with the same numbers in their names whose times of
    the last change differ by at most `NAMED_S`; others by their times alone, if these differ by at most `NEAR_S`.
    """

    def __init__(self, folders: tuple[Path, Path], cameras: tuple[Camera, Camera]) -> None:
        for folder in folders:
            if not folder.is_dir():
                raise ConfigError(f"{folder}: it is no folder; name that of the left and that of the right camera")
        if folders[0].samefile(folders[1]):
            raise ConfigError(f"{folders[0]}: it is given for both cameras; give each camera a folder of its own")
        super().__init__(
            f"folders {folders[0]} (left) and {folders[1]} (right)",
            (str(folders[0]), str(folders[1])),
            cameras,
            pairing=Pairing(near_s=NEAR_S, named_s=NAMED_S),
            cure=(
                f"a pair has the same number in both names and is written within {NAMED_S:g} s, or is written within "
                f"{1e3 * NEAR_S:g} ms; compare what the other program writes into the two folders"
            ),
        )
        self._watched = tuple(_Folder(folder) for folder in folders)
        self._read_at_s: deque[float] = deque(maxlen=_MOST_COUNTED)
        self._left_out_at_s: deque[float] = deque(maxlen=_MOST_COUNTED)
        self._first_at_s: float | None = None
        self._is_slow = False
        self._start(self._watch)

    def _watch(self) -> None:
        pause_s = 0.0
        while not self._over.wait(pause_s):
            began_s = time.thread_time()
            came = [(file, side) for side, folder in enumerate(self._watched) for file in folder.look()]
            spent_s = time.thread_time() - began_s
            if came and self._first_at_s is None:
                self._first_at_s = time.monotonic()
            self._announce(came)
            self._read_for_a_turn(sorted(came, key=lambda each: each[0].time_s))
            for folder in self._watched:
                self._left_out_at_s.extend([time.monotonic()] * folder.left_out())
                for sentence in folder.unfinished():
                    self._say(sentence)
            self._say_if_slow()
            pause_s = max(_EVERY_S, spent_s / _SHARE)

    def _announce(self, came: list[tuple[_File, int]]) -> None:
        """Note the names of all images: one that is left out is the partner of its namesake all the same."""
        with self._lock:
            for file, side in came:
                if file.numbers:
                    self._pairing.announce(side, file.numbers, file.time_s)

    def _read_for_a_turn(self, came: list[tuple[_File, int]]) -> None:
        """Read images of both cameras in the order of their times: all, or until the turn is over."""
        ends_s = time.monotonic() + _TURN_S
        sides = {side for _, side in came}
        for file, side in came:
            # Of each camera at least one, however long it takes: the other would wait for its partner in vain.
            if not sides and time.monotonic() > ends_s:
                break
            if self._read(side, self._watched[side], file):
                sides.discard(side)
                self._read_at_s.append(time.monotonic())

    def _read(self, side: int, folder: _Folder, file: _File) -> bool:
        """Read an image; returns whether it was complete."""
        data = folder.read(file)
        if data is None:
            return False
        with self._in_library(0):
            pixels = folder.decode(file, data)
        if pixels is None:
            return False
        self._take(side, pixels, time_s=file.time_s, at_s=folder.monotonic_s(file), key=folder.key(file))
        return True

    def _slow(self) -> str | None:
        """Say that images are read more slowly than they come; None if hardly one was left out lately."""
        since_s = time.monotonic() - _RATE_S
        if self._first_at_s is None or self._first_at_s > since_s:
            return None
        read, left_out = (
            sum(at_s >= since_s for at_s in tuple(each)) for each in (self._read_at_s, self._left_out_at_s)
        )
        if left_out < ALONE_IMAGES:
            return None
        return (
            f"{self.name}: images are read more slowly than they come ({read / _RATE_S:.1f} of "
            f"{(read + left_out) / _RATE_S:.1f} a second); save BMP or JPEG, which are read faster than PNG, smaller "
            "images or fewer, or end other programs on this computer"
        )

    def _say_if_slow(self) -> None:
        """Have it said once."""
        if not self._is_slow and (slow := self._slow()) is not None:
            self._is_slow = True
            self._say(slow)

    def _require_well(self, now_s: float, dropped: tuple[int, ...]) -> None:
        for folder in self._watched:
            folder.require_readable(now_s)
            folder.require_images(now_s)
        if now_s - self._unpaired_from_s > ALONE_S and (slow := self._slow()) is not None:
            self._unpaired_from_s = now_s
            raise AcquisitionError(slow)
        super()._require_well(now_s, dropped)


class _Folder:
    """The image files of one folder: which are new, and which of them are not complete."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._looked_s = time.monotonic()
        # Of before, taken, or named as incomplete.
        self._done: set[FileVersion] = set()
        # Since when it is as it is, in monotonic seconds, its name, and why it could not be read.
        self._waiting: dict[FileVersion, tuple[float, str, str]] = {}
        # Since when it is there and not read.
        self._first_s: dict[FileVersion, float] = {}
        self._left_out = 0
        self._unreadable: tuple[float, str] | None = None
        self._last_key: Key | None = None
        # Names of files that are no images by their endings, and since when such files come instead of images.
        self._others: set[str] = set()
        self._no_images: tuple[float, str] | None = None
        self._done.update(file.id for file in self._files())
        self._others_before = self._others
        self._has_images = False

    def look(self) -> list[_File]:
        """Return the files that are new or not read yet, the oldest first.

        Those that could not be read in time are left out.
        """
        now_s = time.monotonic()
        try:
            files = self._files()
        except OSError as problem:
            since_s = now_s if self._unreadable is None else self._unreadable[0]
            self._unreadable = since_s, os_reason(problem)
            return []
        self._unreadable = None
        self._looked_s = now_s
        ids = {file.id for file in files}
        if ids:
            # Without any, the folder may be that of a network drive which is away: its images of before come again.
            self._done &= ids
        self._waiting = {id_: why for id_, why in self._waiting.items() if id_ in ids}
        came = sorted((file for file in files if file.id not in self._done), key=lambda file: (file.time_s, file.name))
        self._first_s = {file.id: self._first_s.get(file.id, now_s) for file in came}
        self._note_others(now_s, images=bool(came))
        late = [file.id for number, file in enumerate(came, start=1) if self._is_late(file, now_s, len(came) - number)]
        self._done.update(late)
        self._left_out += len(late)
        return [file for file in came if file.id not in self._done]

    def _is_late(self, file: _File, now_s: float, newer: int) -> bool:
        """Return whether an image has waited too long to be read; one that is not complete is awaited."""
        waited_s = now_s - self._first_s[file.id]
        return file.id not in self._waiting and (waited_s > BEHIND_S or newer >= MAX_PAIRS)

    def left_out(self) -> int:
        """Return how many images were left out since the last call."""
        number = self._left_out
        self._left_out = 0
        return number

    def _note_others(self, now_s: float, *, images: bool) -> None:
        """Note whether files with other endings come, and no images."""
        self._has_images |= images
        others = self._others - self._others_before
        if self._has_images or not others:
            self._no_images = None
        else:
            since_s = now_s if self._no_images is None else self._no_images[0]
            self._no_images = since_s, endings(map(Path, others))

    def require_images(self, now_s: float) -> None:
        """Raise `AcquisitionError` if files come, for longer than `INCOMPLETE_S`, and none of them is an image."""
        if self._no_images is not None and now_s - self._no_images[0] > INCOMPLETE_S:
            raise AcquisitionError(
                f"{self._path}: no images come, but files that end with {self._no_images[1]}; "
                f"{', '.join(SUFFIXES)} are read: have the program save one of these"
            )

    def _files(self) -> list[_File]:
        """Return all image files."""
        files: list[_File] = []
        others: set[str] = set()
        with os.scandir(self._path) as entries:
            for entry in entries:
                name = entry.name
                # One that was renamed or deleted since it was listed, or cannot be looked at now, comes later.
                with suppress(OSError):
                    if name.startswith(".") or not entry.is_file():
                        continue
                    if name.lower().endswith(SUFFIXES):
                        files.append(_File(id=version_of(entry.stat()), name=name, since_s=self._looked_s))
                    else:
                        others.add(name)
        self._others = others
        return files

    def read(self, file: _File) -> bytes | None:
        """Return the bytes of a file; None if it is being written or cannot be opened yet, or has been deleted."""
        path = self._path / file.name
        try:
            data = read_input(path, most_bytes=_MOST_BYTES)
            unchanged = file.id == version_of(path.stat())
        except FileNotFoundError:
            return None
        except OSError as problem:
            self._wait(file, f"cannot be opened ({os_reason(problem)})")
            return None
        except RecordError as problem:
            raise AcquisitionError(f"{path}: {problem}") from problem
        # A file whose format has no end mark must not have changed since the last look.
        if unchanged and (says_its_end(data) or file.id in self._waiting):
            return data
        self._wait(file, _INCOMPLETE)
        return None

    def decode(self, file: _File, data: bytes) -> UInt8[np.ndarray, "rows columns"] | None:
        """Return the pixels of a file; None if it is not complete."""
        try:
            pixels = decoded_image(data)
        except ConfigError as problem:
            raise AcquisitionError(f"{self._path / file.name}: {problem}") from problem
        if pixels is None:
            self._wait(file, _INCOMPLETE)
            return None
        self._waiting.pop(file.id, None)
        self._done.add(file.id)
        return pixels

    def _wait(self, file: _File, reason: str) -> None:
        since_s = self._waiting[file.id][0] if file.id in self._waiting else time.monotonic()
        self._waiting[file.id] = since_s, file.name, reason

    def unfinished(self) -> list[str]:
        """Return the sentences on files that have not changed for `INCOMPLETE_S`.

        Each once, and they are not read any more.
        """
        now_s = time.monotonic()
        late = {id_: each for id_, each in self._waiting.items() if now_s - each[0] > INCOMPLETE_S}
        for id_ in late:
            del self._waiting[id_]
            self._done.add(id_)
        return [
            f"{self._path / name}: it {reason} for {INCOMPLETE_S:g} s, and is left out; look at the program that "
            "writes it"
            for _, name, reason in late.values()
        ]

    def require_readable(self, now_s: float) -> None:
        """Raise `NotConnectedError` if the folder cannot be read for longer than `INCOMPLETE_S`."""
        if self._unreadable is not None and now_s - self._unreadable[0] > INCOMPLETE_S:
            raise NotConnectedError(
                f"{self._path}: it cannot be read for {now_s - self._unreadable[0]:.0f} s ({self._unreadable[1]}); "
                "check its name, the rights, and the network drive"
            )

    def monotonic_s(self, file: _File) -> float:
        """Return the monotonic time at which a file was complete: by its date, after the last look without it."""
        now_s = time.monotonic()
        age_s = time.time() - file.time_s  # noqa: TID251  dates of files are times of the day
        return min(max(now_s - age_s, file.since_s), now_s)

    def key(self, file: _File) -> Key | None:
        """Return all numbers in a file's name.

        None without one, or where the last file had the same: they do not count.
        """
        key = file.numbers
        repeated = key == self._last_key
        self._last_key = key
        return None if repeated or not key else key
