"""Opens the image pairs that a person names: folders, videos or cameras, ROS 2 topics."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from markerseek.core import ConfigError, StereoImages
from markerseek.drivers.folder_images import FolderImages
from markerseek.drivers.ros2_images import RosImages
from markerseek.drivers.video_images import VideoImages, is_live
from markerseek.geometry import Camera

TOPIC = "topic:"
"""What a ROS 2 topic begins with, so that it differs from a path."""

_CURE = (
    "name two folders, two cameras (0 1), two video files or one with both images side by side, or two ROS 2 topics "
    f"({TOPIC}/left/image_raw {TOPIC}/right/image_raw), the left one first"
)


def open_stereo_images(source: str | Sequence[str], *, left: Camera, right: Camera) -> StereoImages:
    """Open a source of image pairs.

    ``source``: its words, or all in one text as in a shell: ``"left right"``. ``left``, ``right``: calibrations, whose
    size the images must have. Raises `ConfigError` if the words name nothing that can be opened.
    """
    words = shlex.split(source) if isinstance(source, str) else list(source)
    cameras = (left, right)
    if not 1 <= len(words) <= 2 or not all(words):
        raise ConfigError(f"images: {len(words)} words were given; {_CURE}")
    first = words[0]
    last = words[-1]
    topics = [word.startswith(TOPIC) for word in words]
    if any(topics):
        if not all(topics) or len(words) != 2:
            raise ConfigError(f"images: {' '.join(words)}: two topics are needed; {_CURE}")
        return RosImages((first.removeprefix(TOPIC), last.removeprefix(TOPIC)), cameras)
    folders = [Path(word).is_dir() for word in words]
    if any(folders):
        if not all(folders) or len(words) != 2:
            raise ConfigError(f"images: {' '.join(words)}: two folders are needed; {_CURE}")
        return FolderImages((Path(first), Path(last)), cameras)
    for word in words:
        if not is_live(word) and not Path(word).is_file():
            raise ConfigError(f"images: there is no folder, video or camera {word}; {_CURE}")
    return VideoImages((first, last) if len(words) == 2 else (first,), cameras)
