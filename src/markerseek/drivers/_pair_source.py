"""What the sources of image pairs share: threads that receive images, which images are a pair, and what went wrong."""

from __future__ import annotations

import atexit
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from typing import TypeAlias

import numpy as np

from markerseek._closing import Closing
from markerseek.core import MAX_PAIRS, AcquisitionError, NotConnectedError, StereoPair, UInt8
from markerseek.geometry import Camera

_LOG = logging.getLogger(__name__)

WAIT_S = 1.0
"""Time for which an image waits for that of the other camera, in seconds."""

_MOST = 100
"""Most images of a camera that wait."""

_MOST_NAMES = 1000
"""Most names of a camera's images that are remembered."""

Key: TypeAlias = tuple[int, ...]
"""The numbers in an image's name."""


@dataclass(slots=True, eq=False)
class CameraImage:
    """An image of one camera."""

    pixels: UInt8[np.ndarray, "rows columns"]
    time_s: float
    """Time of the image, on a clock that is the same for both cameras."""
    at_s: float
    """Monotonic time at which it was there."""
    since_s: float
    """Monotonic time since when it waits."""
    key: Key | None = None
    """Numbers in its name; None: it has no name."""


class Pairing:
    """Pairs images of two cameras by their names, or by their times, which increase from image to image.

    Images of the same name are a pair if their times differ by at most ``named_s``. Images without such a partner are a
    pair if each is the nearest to the other, and their times differ by at most ``near_s``. An image whose namesake is
    known to be there, but never comes, is part of no pair.

    ``named_s``: 0 if images have no names.
    """

    def __init__(self, *, near_s: float, named_s: float = 0.0) -> None:
        self._near_s = near_s
        self._named_s = named_s
        self._waiting: tuple[list[CameraImage], list[CameraImage]] = ([], [])
        self._latest_s = [-np.inf, -np.inf]
        self._names: tuple[dict[Key, float], dict[Key, float]] = ({}, {})
        self.dropped = [0, 0]
        """Images of the left and of the right camera that found no partner since the last pair."""

    def announce(self, side: int, key: Key, time_s: float) -> None:
        """Note that an image of a camera with these numbers in its name is there, whether it can be read or not."""
        names = self._names[side]
        names.pop(key, None)
        names[key] = time_s
        if len(names) > _MOST_NAMES:
            del names[next(iter(names))]

    def add(self, side: int, image: CameraImage) -> None:
        """Receive an image of a camera: 0 is the left one."""
        self._waiting[side].append(image)
        self._latest_s[side] = max(self._latest_s[side], image.time_s)

    def pairs(self, now_s: float) -> list[StereoPair]:
        """Return the pairs that are certain now, the oldest first.

        Images that have waited too long are dropped and counted.
        """
        found = sorted(chain(self._by_name(), self._by_time(now_s)), key=lambda pair: pair.at_s)
        if found:
            self.dropped = [0, 0]
        for side, waiting in enumerate(self._waiting):
            kept = [image for image in waiting if now_s - image.since_s <= self._named_s + WAIT_S][-_MOST:]
            self.dropped[side] += len(waiting) - len(kept)
            waiting[:] = kept
        return found

    def _by_name(self) -> Iterator[StereoPair]:
        if not self._named_s:
            return
        for left in list(self._waiting[0]):
            same = [right for right in self._waiting[1] if right.key == left.key is not None]
            right = _nearest(same, left.time_s)
            if right is not None and abs(right.time_s - left.time_s) <= self._named_s:
                yield self._pair(left, right)

    def _by_time(self, now_s: float) -> Iterator[StereoPair]:
        lefts, rights = (
            [image for image in each if now_s - image.since_s >= self._named_s and not self._has_namesake(side, image)]
            for side, each in enumerate(self._waiting)
        )
        for left in lefts:
            right = _nearest(rights, left.time_s)
            if right is None or abs(right.time_s - left.time_s) > self._near_s:
                continue
            # A nearer left one that still waits for its name counts: this right one may be its partner.
            if _nearest(self._waiting[0], right.time_s) is left and self._is_settled(left, right, now_s):
                rights.remove(right)
                yield self._pair(left, right)

    def _has_namesake(self, side: int, image: CameraImage) -> bool:
        """Return whether an image of the other camera has the same name."""
        if image.key is None:
            return False
        time_s = self._names[1 - side].get(image.key)
        return time_s is not None and abs(time_s - image.time_s) <= self._named_s

    def _is_settled(self, left: CameraImage, right: CameraImage, now_s: float) -> bool:
        """Return whether no image can come that is nearer to the later of the two."""
        first = 0 if left.time_s <= right.time_s else 1
        waited_s = now_s - max(left.since_s, right.since_s) - self._named_s
        return self._latest_s[first] >= max(left.time_s, right.time_s) or waited_s >= 2 * self._near_s

    def _pair(self, left: CameraImage, right: CameraImage) -> StereoPair:
        self._waiting[0].remove(left)
        self._waiting[1].remove(right)
        return StereoPair(left=left.pixels, right=right.pixels, at_s=max(left.at_s, right.at_s))


def _nearest(images: list[CameraImage], time_s: float) -> CameraImage | None:
    return min(images, key=lambda image: abs(image.time_s - time_s), default=None)


_SIDES = ("left", "right")
"""The cameras, in the order of everything that is given for both."""

_SILENT_S = 2.0
"""Longest time without an image from a camera that sends images all the time, in seconds."""

_FIRST_S = 10.0
"""Longest time until its first image, in seconds."""

ALONE_S = 5.0
"""Time without a pair after which an error says that nothing pairs, in seconds."""

ALONE_IMAGES = 10
"""Images of a camera without a partner in that time, from which it says so."""

_JOIN_S = 1.0
"""Longest wait for a thread at the end, in seconds; one that a file system holds up ends by itself later."""


class ClosedError(Exception):
    """The source is closed, and its thread ends."""


class PairSource(Closing):
    """A `StereoImages` whose images come in threads of its own.

    A thread works in a library such as OpenCV within `_in_library` only: Python ends a thread where it comes back from
    a library, which C++ answers by aborting the whole program. `close` therefore waits until none is in one, and is
    also called when Python ends.

    ``name``: of the source, for messages. ``sources``: names of both cameras' sources. ``cameras``: their calibrations.
    ``cure``: what to do where nothing pairs. ``silent_cure``: what to do if a camera sends nothing any more; None:
    images need not come all the time.
    """

    def __init__(
        self,
        name: str,
        sources: tuple[str, str],
        cameras: tuple[Camera, Camera],
        *,
        pairing: Pairing,
        cure: str,
        silent_cure: str | None = None,
    ) -> None:
        self.name = name
        self._sources = sources
        self._cameras = cameras
        self._pairing = pairing
        self._cure = cure
        self._silent_cure = silent_cure
        self._lock = threading.Lock()
        self._ready: deque[StereoPair] = deque(maxlen=MAX_PAIRS)
        self._said: list[str] = []
        self._problem: Exception | None = None
        self._over = threading.Event()
        self._threads: list[threading.Thread] = []
        self._libraries = threading.Lock(), threading.Lock()
        now_s = time.monotonic()
        self._last_s = [now_s, now_s]
        self._patience_s = [_FIRST_S, _FIRST_S]
        self._unpaired_from_s = now_s

    def newest(self) -> list[StereoPair]:
        """Return the pairs that came since the last call, the oldest first, at most `MAX_PAIRS`.

        An error that a thread met is raised here.
        """
        with self._lock:
            now_s = time.monotonic()
            self._ready.extend(self._pairing.pairs(now_s))
            pairs = list(self._ready)
            said = list(self._said)
            self._ready.clear()
            self._said.clear()
            dropped = tuple(self._pairing.dropped)
            if pairs:
                self._unpaired_from_s = now_s
        for sentence in said:
            _LOG.warning("%s", sentence)
        if not pairs:
            self._require_well(now_s, dropped)
        return pairs

    def close(self) -> None:
        """End the threads; allowed twice."""
        self._over.set()
        for thread in self._threads:
            thread.join(_JOIN_S)
        for library in self._libraries:
            with library:
                pass
        atexit.unregister(self.close)

    def _require_well(self, now_s: float, dropped: tuple[int, ...]) -> None:
        """Raise the error that keeps pairs from coming, if there is one."""
        if self._problem is not None:
            raise self._problem
        for source, last_s, patience_s in zip(self._sources, self._last_s, self._patience_s, strict=True):
            if self._silent_cure and now_s - last_s > patience_s:
                raise NotConnectedError(f"{source}: no image for {now_s - last_s:.0f} s; {self._silent_cure}")
        if now_s - self._unpaired_from_s > ALONE_S and max(dropped) >= ALONE_IMAGES:
            left, right = dropped
            self._unpaired_from_s = now_s
            raise AcquisitionError(
                f"{self.name}: {left} images of the left camera and {right} of the right came, and no pair among them; "
                f"{self._cure}"
            )

    def _start(self, *works: Callable[[], None]) -> None:
        """Begin threads, each with one function."""
        atexit.register(self.close)
        for work in works:
            thread = threading.Thread(target=self._run, args=(work,), name=f"images: {self.name}", daemon=True)
            self._threads.append(thread)
            thread.start()

    def _run(self, work: Callable[[], None]) -> None:
        try:
            work()
        except ClosedError:
            pass
        except Exception as problem:  # noqa: BLE001  raised by `newest`, in the thread of the caller
            self._problem = problem

    @contextmanager
    def _in_library(self, side: int) -> Iterator[None]:
        """Work in a library, for one camera or, as 0, for both; `ClosedError` once the source is closed."""
        with self._libraries[side]:
            if self._over.is_set():
                raise ClosedError
            yield

    def _take(
        self,
        side: int,
        pixels: UInt8[np.ndarray, "rows columns"],
        *,
        time_s: float,
        at_s: float,
        key: Key | None = None,
    ) -> None:
        """Receive an image of a camera, 0 is the left one; `AcquisitionError` if its size is not the calibrated one."""
        require_size(pixels, self._cameras[side], self._sources[side])
        with self._lock:
            now_s = time.monotonic()
            _LOG.debug("%s < %s image %s, its time %.6f s", self.name, _SIDES[side], key, time_s)
            self._last_s[side] = now_s
            self._patience_s[side] = _SILENT_S
            self._pairing.add(side, CameraImage(pixels, time_s=time_s, at_s=at_s, since_s=now_s, key=key))
            self._ready.extend(self._pairing.pairs(now_s))

    def _say(self, sentence: str) -> None:
        """Let `newest` log a warning."""
        with self._lock:
            self._said.append(sentence)


def require_size(pixels: UInt8[np.ndarray, "rows columns"], camera: Camera, source: str) -> None:
    """Refuse an image whose size is not that of the calibration."""
    if problem := camera.size_problem(pixels):
        raise AcquisitionError(f"{source}: {problem}")
