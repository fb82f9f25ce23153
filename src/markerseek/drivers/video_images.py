"""Image pairs from two cameras, two videos, or one video with both images side by side."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from markerseek.core import AcquisitionError, ConfigError, NotConnectedError, UInt8, require_range
from markerseek.drivers._pair_source import WAIT_S, Pairing, PairSource
from markerseek.geometry import Camera
from markerseek.vision import brightness, opencv

NEAR_S = 0.05
"""Largest difference between the times of two images that are a pair, in seconds."""

_RETRY_S = 0.05
"""Time until a camera that gave no image is asked again, in seconds."""

_OPEN_MS = 10_000
"""Longest time for opening a stream, in milliseconds; OpenCV would take 30 s."""

_READ_MS = 5_000
"""Longest time for the next image of a stream, in milliseconds; OpenCV would take 30 s, in which its thread cannot end.
Of a camera it waits for an image at most 10 s."""

_SILENT_CURE = "check that the camera runs, its cable, and that no other program has it"
_LIVE = re.compile(r"[0-9]+|/dev/.*|[a-z]+://.*")
"""A camera: its number, its device, or the address of its stream; everything else is a file."""


def is_live(word: str) -> bool:
    """Return whether a word names a camera or a stream: ``0``, ``/dev/video0``, ``rtsp://…``.

    A file in ``/dev/shm`` is none.
    """
    return _LIVE.fullmatch(word) is not None and not Path(word).is_file()


class VideoImages(PairSource):
    """Image pairs from what OpenCV opens: numbers of cameras, devices, addresses of streams, or video files.

    Of a camera each image is taken at once, so that its driver keeps no old ones. Files are played at their frame rate,
    and their end is an `AcquisitionError`. Images are a pair if each is the nearest to the other, and they were taken
    within `NEAR_S`. One word alone is a video with both images side by side, the left one on the left.
    """

    def __init__(self, words: tuple[str, str] | tuple[str], cameras: tuple[Camera, Camera]) -> None:
        if len(set(words)) < len(words):
            raise ConfigError(f"{words[0]}: it is given for both cameras; give each camera its own")
        sources = (words[0], words[-1])
        super().__init__(
            f"video {words[0]}" if len(words) == 1 else f"video {words[0]} (left) and {words[1]} (right)",
            sources,
            cameras,
            pairing=Pairing(near_s=NEAR_S),
            silent_cure=_SILENT_CURE if all(map(is_live, words)) else None,
            cure=f"images of a pair are taken within {1e3 * NEAR_S:g} ms; use cameras or videos of the same frame rate",
        )
        if len({is_live(word) for word in words}) == 2:
            raise ConfigError(f"{self.name}: one is a camera and the other a file; give two of the same kind")
        self._ended: tuple[float, str] | None = None
        videos: list[Any] = []
        try:
            for word in words:
                videos.append(_opened(word))  # noqa: PERF401  those that are open are closed where one fails
        except BaseException:
            for video in videos:
                video.release()
            raise
        self._began_s = time.monotonic()
        play = self._follow if is_live(words[0]) else self._play
        self._start(*(partial(play, video, side) for side, video in enumerate(videos)))

    def _follow(self, video: Any, side: int) -> None:
        """Take each image of a camera when it comes."""
        with self._in_library(side), _released(video):
            while not self._over.is_set():
                found, image = video.read()
                if found:
                    now_s = time.monotonic()
                    self._receive(side, image, time_s=now_s, at_s=now_s)
                else:
                    self._over.wait(_RETRY_S)

    def _play(self, video: Any, side: int) -> None:
        """Take each image of a file when it is due."""
        number = 0
        with self._in_library(side), _released(video):
            rate_hz = _rate_hz(video)
            while True:
                due_s = self._began_s + number / rate_hz
                found, image = video.read()
                if not found or self._over.wait(max(0.0, due_s - time.monotonic())):
                    break
                self._receive(side, image, time_s=due_s, at_s=time.monotonic())
                number += 1
        self._ended = (
            time.monotonic(),
            f"{self._sources[side]}: the video has ended after {number} images; play a longer one",
        )

    def _receive(self, side: int, image: UInt8[np.ndarray, " ..."], *, time_s: float, at_s: float) -> None:
        pixels = brightness(image)
        if self._sources[0] != self._sources[1]:
            self._take(side, pixels, time_s=time_s, at_s=at_s)
            return
        self._require_side_by_side(pixels)
        for side, half in enumerate(np.split(pixels, 2, axis=1)):
            self._take(side, np.ascontiguousarray(half), time_s=time_s, at_s=at_s)

    def _require_side_by_side(self, pixels: UInt8[np.ndarray, "rows columns"]) -> None:
        rows, columns = pixels.shape
        (left, height), (right, _) = (camera.size_px for camera in self._cameras)
        if columns != left + right or left != right or rows != height:
            raise AcquisitionError(
                f"{self._sources[0]}: images of {columns} x {rows} pixels, two side by side as calibrated would have "
                f"{left + right} x {height}; name a video for each camera, or one that is neither cut nor scaled"
            )

    def _require_well(self, now_s: float, dropped: tuple[int, ...]) -> None:
        super()._require_well(now_s, dropped)
        # The last image of the other video may still come.
        if self._ended is not None and now_s - self._ended[0] > WAIT_S:
            raise AcquisitionError(self._ended[1])


@contextmanager
def _released(video: Any) -> Iterator[None]:
    try:
        yield
    finally:
        video.release()


def _opened(word: str) -> Any:
    """Return an open video; `NotConnectedError` if there is no such camera, `ConfigError` if there is no such file."""
    cv2 = opencv("reading videos")
    if is_live(word):
        if word.isdecimal() or word.startswith("/"):
            video = cv2.VideoCapture(int(word) if word.isdecimal() else word)
        else:
            limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, _OPEN_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, _READ_MS]
            video = cv2.VideoCapture(word, cv2.CAP_ANY, limits)
        if not video.isOpened():
            raise NotConnectedError(
                f"{word}: no camera can be opened; check its number or address (v4l2-ctl --list-devices), the rights, "
                "and that no other program has it"
            )
        # Not every driver follows; images are taken at once all the same.
        video.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        return video
    if not Path(word).is_file():
        raise ConfigError(f"{word}: there is no such video; check the name")
    video = cv2.VideoCapture(word)
    if not video.isOpened():
        raise ConfigError(f"{word}: it cannot be read as a video; save it again, as MP4 or AVI")
    require_range(f"{word}: frame rate", _rate_hz(video), low=0.1, high=1000, unit="/s", cure="save it again, as MP4")
    return video


def _rate_hz(video: Any) -> float:
    return float(video.get(opencv("reading videos").CAP_PROP_FPS))
