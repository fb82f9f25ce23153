"""OpenCV, imported when it is first needed: the only file that names it."""

from __future__ import annotations

from types import ModuleType

from markerseek.core import needs_package


def opencv(purpose: str) -> ModuleType:
    """The package ``cv2``.

    ``purpose``: what it is needed for, for the message.
    """
    with needs_package("opencv-python-headless", extra="vision", purpose=purpose, module="cv2"):
        import cv2
    return cv2
