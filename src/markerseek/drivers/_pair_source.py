"""What the sources of image pairs share: threads that receive images, the pairs that wait, and what went wrong."""

from __future__ import annotations

import threading
import time
import warnings
from collections import deque
from collections.abc import Callable

import numpy as np

from markerseek._closing import Closing
from markerseek.core import MAX_PAIRS, AcquisitionError, NotConnectedError, StereoPair, UInt8
from markerseek.drivers._pairing import CameraImage, Key, Pairing
from markerseek.geometry import Camera

SIDES = ("left", "right")
"""The cameras, in the order of everything that is given for both."""

SILENT_S = 2.0
"""Longest time without an image from a camera that sends images all the time, in seconds."""

_FIRST_S = 10.0
"""Longest time until its first image, in seconds."""

_ALONE_S, _ALONE_IMAGES = 5.0, 10
"""Images without a partner, and seconds without a pair, from which it is said that nothing pairs."""

_JOIN_S = 1.0
"""Longest wait for a thread at the end, in seconds; one that a camera's driver holds up ends by itself later."""


class PairSource(Closing):
    """A `StereoImages` whose images come in threads of its own.

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
        self._sources, self._cameras, self._pairing = sources, cameras, pairing
        self._cure, self._silent_cure = cure, silent_cure
        self._lock = threading.Lock()
        self._ready: deque[StereoPair] = deque(maxlen=MAX_PAIRS)
        self._said: list[str] = []
        self._problem: Exception | None = None
        self._over = threading.Event()
        self._threads: list[threading.Thread] = []
        now_s = time.monotonic()
        self._last_s, self._patience_s = [now_s, now_s], [_FIRST_S, _FIRST_S]
        self._unpaired_from_s = now_s

    def newest(self) -> list[StereoPair]:
        """Pairs that came since the last call, the oldest first, at most `MAX_PAIRS`; raises what a thread met."""
        with self._lock:
            now_s = time.monotonic()
            self._ready.extend(self._pairing.pairs(now_s))
            pairs, said = list(self._ready), list(self._said)
            self._ready.clear()
            self._said.clear()
            dropped = tuple(self._pairing.dropped)
            if pairs:
                self._unpaired_from_s = now_s
        for sentence in said:
            warnings.warn(sentence, stacklevel=2)
        if not pairs:
            self._require_well(now_s, dropped)
        return pairs

    def close(self) -> None:
        """End the threads; allowed twice."""
        self._over.set()
        for thread in self._threads:
            thread.join(_JOIN_S)

    def _require_well(self, now_s: float, dropped: tuple[int, ...]) -> None:
        """Raise what keeps pairs from coming."""
        if self._problem is not None:
            raise self._problem
        for source, last_s, patience_s in zip(self._sources, self._last_s, self._patience_s, strict=True):
            if self._silent_cure and now_s - last_s > patience_s:
                raise NotConnectedError(f"{source}: no image for {now_s - last_s:.0f} s; {self._silent_cure}")
        if now_s - self._unpaired_from_s > _ALONE_S and max(dropped) >= _ALONE_IMAGES:
            left, right = dropped
            self._unpaired_from_s = now_s
            raise AcquisitionError(
                f"{self.name}: {left} images of the left camera and {right} of the right came, and no pair among them; "
                f"{self._cure}"
            )

    def _start(self, *works: Callable[[], None]) -> None:
        """Begin threads, each with one function."""
        for work in works:
            thread = threading.Thread(target=self._run, args=(work,), name=f"images: {self.name}", daemon=True)
            self._threads.append(thread)
            thread.start()

    def _run(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as problem:  # noqa: BLE001  raised by `newest`, in the thread of the caller
            self._problem = problem

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
            self._last_s[side], self._patience_s[side] = now_s, SILENT_S
            self._pairing.add(side, CameraImage(pixels, time_s=time_s, at_s=at_s, since_s=now_s, key=key))
            self._ready.extend(self._pairing.pairs(now_s))

    def _say(self, sentence: str) -> None:
        """Have `newest` warn of something."""
        with self._lock:
            self._said.append(sentence)


def require_size(pixels: UInt8[np.ndarray, "rows columns"], camera: Camera, source: str) -> None:
    """Refuse an image whose size is not that of the calibration."""
    rows, columns = pixels.shape
    if (columns, rows) != camera.size_px:
        width, height = camera.size_px
        raise AcquisitionError(
            f"{source}: images of {columns} x {rows} pixels, the camera's calibration is of {width} x {height}; take "
            "them as they come, neither cut nor scaled"
        )
