"""OpenCV, an extra: imported when it is needed first."""

from __future__ import annotations

from types import ModuleType

from markerseek.core import MissingExtraError


def opencv(purpose: str) -> ModuleType:
    """The module ``cv2``; `MissingExtraError` with the purpose where it is not installed."""
    try:
        import cv2
    except ImportError as problem:
        raise MissingExtraError(package="opencv-python-headless", extra="vision", purpose=purpose) from problem
    return cv2
