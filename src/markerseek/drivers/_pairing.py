"""Which image of the left camera belongs to which of the right."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from typing import TypeAlias

import numpy as np

from markerseek.core import StereoPair, UInt8

WAIT_S = 1.0
"""Time for which an image waits for that of the other camera, in seconds."""

_MOST = 100
"""Most images of a camera that wait."""

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
    pair if each is the nearest to the other, and their times differ by at most ``near_s``.

    ``named_s``: 0 if images have no names.
    """

    def __init__(self, *, near_s: float, named_s: float = 0.0) -> None:
        self._near_s, self._named_s = near_s, named_s
        self._waiting: tuple[list[CameraImage], list[CameraImage]] = ([], [])
        self._latest_s = [-np.inf, -np.inf]
        self.dropped = [0, 0]
        """Images of the left and of the right camera that found no partner since the last pair."""

    def add(self, side: int, image: CameraImage) -> None:
        """Receive an image of a camera: 0 is the left one."""
        self._waiting[side].append(image)
        self._latest_s[side] = max(self._latest_s[side], image.time_s)

    def pairs(self, now_s: float) -> list[StereoPair]:
        """Pairs that are certain now, the oldest first; images that have waited too long are dropped and counted."""
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
        lefts, rights = ([image for image in each if now_s - image.since_s >= self._named_s] for each in self._waiting)
        for left in lefts:
            right = _nearest(rights, left.time_s)
            if right is None or abs(right.time_s - left.time_s) > self._near_s:
                continue
            # A nearer left one that still waits for its name counts: this right one may be its partner.
            if _nearest(self._waiting[0], right.time_s) is left and self._is_settled(left, right, now_s):
                rights.remove(right)
                yield self._pair(left, right)

    def _is_settled(self, left: CameraImage, right: CameraImage, now_s: float) -> bool:
        """Whether no image can come that is nearer to the later of the two."""
        first = 0 if left.time_s <= right.time_s else 1
        waited_s = now_s - max(left.since_s, right.since_s) - self._named_s
        return self._latest_s[first] >= max(left.time_s, right.time_s) or waited_s >= 2 * self._near_s

    def _pair(self, left: CameraImage, right: CameraImage) -> StereoPair:
        self._waiting[0].remove(left)
        self._waiting[1].remove(right)
        return StereoPair(left=left.pixels, right=right.pixels, at_s=max(left.at_s, right.at_s))


def _nearest(images: list[CameraImage], time_s: float) -> CameraImage | None:
    return min(images, key=lambda image: abs(image.time_s - time_s), default=None)
